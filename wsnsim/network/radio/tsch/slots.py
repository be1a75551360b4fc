"""Slots: when they begin by each node's clock, which are shared cells, what radios do in them, what listening costs.

slots.upcoming(node) -> ASN      slots.shared_cell(ASN, skipped) -> ASN      slots.when(node, ASN) -> s
"""

from __future__ import annotations

from bisect import bisect_left
from typing import Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.models.tsch import MOST_CELLS, Tsch
from wsnsim.network.clocks import Clocks
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.transmission import Transmission

ROUNDING: Final = 1e-6
"""Times that differ by less than this share of a slot are equal: what rounding leaves."""
NONE: Final = 0
"""Not a channel."""
NO_SLOT: Final = -(2**62)
"""Not the number of a slot."""


class Slots:
    """The slots of all nodes. The ASN (absolute slot number) of a node counts the slots by its own clock."""

    def __init__(self, mac: Tsch, clocks: Clocks) -> None:
        self._clocks = clocks
        self._length, self._size = mac.slot, mac.slotframe
        self._shared = mac.shared_slots
        self._channels = mac.channels
        self._is_shared = np.zeros(mac.slotframe, dtype=np.bool_)
        self._is_shared[list(mac.shared_slots)] = True
        self._sequence = np.array(mac.channels, dtype=np.int64)

    def current(self, node: int, time: float) -> int:
        """The ASN of a node's slot at a time."""
        return int(self._clocks.local_time(node, time) / self._length + ROUNDING)

    def upcoming(self, node: int, time: float) -> int:
        """The ASN of a node's next slot; of the present one, if it begins now."""
        return -int((-self._clocks.local_time(node, time) / self._length + ROUNDING) // 1.0)

    def when(self, node: int, asn: int, offset: float) -> float:
        """The time `offset` s after the start of a node's slot, by its clock."""
        local = asn * self._length + offset
        return self._clocks.true_time(node, local) if not self._clocks.perfect else local

    def shared_cell(self, asn: int, skipped: int = 0) -> int:
        """The ASN of the first shared cell that is not before `asn`, after skipping some."""
        frames, slot = divmod(asn, self._size)
        more, cell = divmod(bisect_left(self._shared, slot) + skipped, len(self._shared))
        return (frames + more) * self._size + self._shared[cell]

    def next_of(self, asn: int, slots: list[int]) -> int:
        """The ASN of the first of some slots of the slotframe, ascending, that is not before `asn`."""
        frames, slot = divmod(asn, self._size)
        at = bisect_left(slots, slot)
        return frames * self._size + slots[at] if at < len(slots) else (frames + 1) * self._size + slots[0]

    def channel(self, asn: int, offset: int = 0) -> int:
        """The channel of a cell with a channel offset."""
        return self._channels[(asn + offset) % len(self._channels)]

    def places(self, nodes: Ints, time: float) -> tuple[Ints, Floats]:
        """(n,) ASN of the present slots of nodes, and (n,) seconds since their start, by the nodes' clocks."""
        local = self._clocks.local_times(nodes, time) if not self._clocks.perfect else np.full(nodes.size, time)
        asn = np.floor(local / self._length + ROUNDING).astype(np.int64)
        return asn, local - asn * self._length

    def in_shared_cells(self, asn: Ints, channel: int) -> Bools:
        """(n,) whether slots are shared cells that use a channel."""
        found: Bools = self._is_shared[asn % self._size] & (self._sequence[asn % self._sequence.size] == channel)
        return found


class SlotRadios:
    """The radios of all nodes.

        ChannelListening(SlotRadios(...), channel).hears(ids, since) -> (n,)

    A node listens in the shared cells and in those in which it receives, around the time at which a frame may begin; in
    a slot in which it sends it does not. A sender listens when an acknowledgement is due. A node that has lost the time
    scans: it listens all the time, on one channel.

    Attributes:
        receiving: {node: {slot: channel offset}} the cells in which a node receives, beside the shared ones.
    """

    def __init__(self, mac: Tsch, slots: Slots, nodes: Nodes) -> None:
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


class ListeningTime:
    """Charges nodes for the listening in which a slot with a frame differs from an idle one.

    A duty (see `base.medium_access`) charges a node for `rx_wait` of listening in each of its cells. In a slot with a
    frame, a receiver listens only until the first frame begins, and the sender of a frame in a shared cell does not
    listen. A sender in a cell of its own switches its radio on once more. The time between a frame and its
    acknowledgement, in which the radio neither sends nor listens, is not charged.
    """

    def __init__(self, mac: Tsch, slots: Slots, radios: SlotRadios, nodes: Nodes) -> None:
        self._mac = mac
        self._slots = slots
        self._radios = radios
        self._nodes = nodes
        self._slot_of = np.full(nodes.size, NO_SLOT, dtype=np.int64)
        self._difference = np.zeros(nodes.size)

    def settle(self, sent: Transmission, in_shared_cell: bool) -> None:
        """Charge the sender of a frame, and those who listened to it. It is not an acknowledgement.

        Of several frames in one slot, which collide, the one that began first counts.
        """
        mac, spend = self._mac, self._nodes.spend_listening
        if in_shared_cell:
            spend(sent.source, -mac.rx_wait)
        else:
            spend(sent.source, 0.0, 1.0)
        listeners = sent.listeners
        if listeners is None or not listeners.size:
            return
        asn, passed = self._slots.places(listeners, sent.start)
        settled = np.where(self._slot_of[listeners] == asn, self._difference[listeners], 0.0)
        differences = np.minimum(passed - mac.rx_offset - mac.rx_wait, settled)
        self._slot_of[listeners], self._difference[listeners] = asn, differences
        for node, seconds in zip(listeners.tolist(), (differences - settled).tolist(), strict=True):
            if seconds and not self._radios.is_scanning(node):
                spend(node, seconds)

    def settle_answer(self, node: int, answered: bool) -> None:
        """Charge the sender of a frame for listening to an acknowledgement."""
        mac = self._mac
        self._nodes.spend_listening(node, mac.tx_ack_delay - mac.rx_ack_delay if answered else mac.ack_wait)
