"""Listening time: what slots with a frame cost beside the closed form of idle slots.

A duty (see `base.medium_access`) charges a node for `rx_wait` of listening in each of its cells. In a slot with a
frame, a receiver listens only until the first frame begins, and the sender of a frame in a shared cell does not
listen. A sender in a cell of its own switches its radio on once more. The time between a frame and its
acknowledgement, in which the radio neither sends nor listens, is not charged.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.base.hopping_mac import HoppingMac
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.transmission import Transmission
from wsnsim.network.radio.tsch.radios import SlotRadios
from wsnsim.network.radio.tsch.slots import Slots

NO_SLOT: Final = -(2**62)
"""Not the number of a slot."""


class ListeningTime:
    """Charges nodes for the listening in which a slot with a frame differs from an idle one."""

    def __init__(self, mac: HoppingMac, slots: Slots, radios: SlotRadios, nodes: Nodes) -> None:
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
