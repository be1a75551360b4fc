"""What the radios of nodes do in slots: which listen on a channel, which send, await an acknowledgement, or scan.

    SlotRadios(...).on(channel).hears(ids, since) -> (n,)

A node listens in the shared cells and in those in which it receives, around the time at which a frame may begin; in a
slot in which it sends it does not. A sender listens when an acknowledgement is due. A node that has lost the time
scans: it listens all the time, on one channel.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.base.arrays import Bools, Ints
from wsnsim.base.hopping_mac import MOST_CELLS, HoppingMac
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.tsch.slots import Slots

NONE: Final = 0
"""Not a channel."""


class SlotRadios:
    """The radios of all nodes.

    Attributes:
        receiving: {node: {slot: channel offset}} the cells in which a node receives, beside the shared ones.
    """

    def __init__(self, mac: HoppingMac, slots: Slots, nodes: Nodes) -> None:
        self._mac = mac
        self._slots = slots
        self._nodes = nodes
        self.receiving: dict[int, dict[int, int]] = {}
        self._sends_from, self._sends_until = np.full(nodes.size, np.inf), np.full(nodes.size, -np.inf)
        self._sends_on = np.full(nodes.size, NONE)
        self._answer_from, self._answer_channel = np.full(nodes.size, np.inf), np.full(nodes.size, NONE)
        self._scan_from, self._scanned = np.full(nodes.size, np.inf), np.full(nodes.size, NONE)

    def is_sending(self, node: int, now: float) -> bool:
        """Whether a node is in a slot in which it sends."""
        return bool(self._sends_from[node] <= now <= self._sends_until[node])

    def send(self, node: int, channel: int, since: float, until: float) -> None:
        """Note that a node sends in its present slot, and does not listen."""
        self._sends_from[node], self._sends_until[node], self._sends_on[node] = since, until, channel

    def await_answer(self, node: int, channel: int, ended: float) -> None:
        """Note that a node listens for the acknowledgement of a frame that has ended."""
        self._answer_from[node], self._answer_channel[node] = ended + self._mac.rx_ack_delay, channel

    def scan(self, node: int, channel: int, now: float) -> None:
        """A node that has lost the time listens on a channel from now on."""
        self._scan_from[node], self._scanned[node] = now, channel

    def end_scan(self, node: int) -> None:
        """A node follows its slots again."""
        self._scan_from[node], self._scanned[node] = np.inf, NONE

    def is_scanning(self, node: int) -> bool:
        """Whether a node has lost the time."""
        return bool(self._scanned[node] != NONE)

    def receive(self, node: int, slot: int, offset: int) -> bool:
        """Let a node receive in a cell; returns False, and does nothing, if it cannot: it has another in this slot."""
        cells = self.receiving.get(node, {})
        if slot in cells or len(cells) == MOST_CELLS:
            return False
        cells[slot] = offset
        self.receiving[node] = cells
        self._nodes.set_duty(node, len(cells))
        return True

    def stop_receiving(self, node: int, slot: int) -> None:
        """A node does not receive in a slot from now on."""
        cells = self.receiving.get(node)
        if cells is not None and cells.pop(slot, None) is not None:
            self._nodes.set_duty(node, len(cells))
            if not cells:
                del self.receiving[node]

    def forget(self, node: int) -> None:
        """Forget what a node did that is down."""
        self.receiving.pop(node, None)
        self.end_scan(node)
        self._sends_from[node] = self._answer_from[node] = np.inf

    def on(self, channel: int) -> ChannelListening:
        """Return who listens on a channel."""
        return ChannelListening(self, channel)

    def listen(self, ids: Ints, since: float, channel: int) -> Bools:
        """(n,) which nodes listen to a frame on a channel that began at a time."""
        asn, passed = self._slots.places(ids, since)
        in_time = np.abs(passed - self._mac.tx_offset) <= self._mac.guard
        found = in_time & self._slots.in_shared_cells(asn, channel)
        self._add_own_cells(found, in_time, ids, asn, channel)
        sends = (since >= self._sends_from[ids]) & (since <= self._sends_until[ids])
        found &= ~sends | (self._sends_on[ids] == channel)
        answered = since - self._answer_from[ids]
        found |= (self._answer_channel[ids] == channel) & (answered >= 0.0) & (answered <= self._mac.ack_wait)
        scanned = self._scanned[ids]
        scans: Bools = scanned != NONE
        return np.where(scans, (scanned == channel) & (self._scan_from[ids] <= since), found) if scans.any() else found

    def _add_own_cells(self, found: Bools, in_time: Bools, ids: Ints, asn: Ints, channel: int) -> None:
        """Add the nodes that receive in a cell of their own on a channel."""
        if not self.receiving:
            return
        for at, node in enumerate(ids.tolist()):
            cells = self.receiving.get(node)
            if cells is not None and in_time[at]:
                number = int(asn[at])
                offset = cells.get(number % self._mac.slotframe)
                if offset is not None and self._slots.channel(number, offset) == channel:
                    found[at] = True


class ChannelListening:
    """Which radios listen on one channel (`base.mac_mechanisms.Listening`)."""

    def __init__(self, radios: SlotRadios, channel: int) -> None:
        self._radios = radios
        self._channel = channel

    def hears(self, ids: Ints, since: float) -> Bools:
        """(n,) which nodes listen to a frame that began at a time."""
        return self._radios.listen(ids, since, self._channel)
