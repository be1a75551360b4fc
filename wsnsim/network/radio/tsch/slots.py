"""Slots: when they begin by each node's clock, which are shared cells, and which channel a cell uses.

slots.upcoming(node) -> ASN      slots.shared_cell(ASN, skipped) -> ASN      slots.when(node, ASN) -> s
"""

from __future__ import annotations

from bisect import bisect_left
from typing import Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.hopping_mac import HoppingMac
from wsnsim.network.clocks import Clocks

ROUNDING: Final = 1e-6
"""Times that differ by less than this share of a slot are equal: what rounding leaves."""


class Slots:
    """The slots of all nodes. The ASN (absolute slot number) of a node counts the slots by its own clock."""

    def __init__(self, mac: HoppingMac, clocks: Clocks) -> None:
        self._mac = mac
        self._clocks = clocks
        self._length, self._size = mac.slot, mac.slotframe
        self._shared = mac.shared_slots
        self._channels = mac.channels
        self._is_shared = np.zeros(mac.slotframe, dtype=np.bool_)
        self._is_shared[list(mac.shared_slots)] = True
        self._sequence = np.array(mac.channels, dtype=np.int64)

    def local(self, node: int, time: float) -> float:
        """What the clock of a node shows at a time, in s."""
        return float(self._clocks.local(np.array([node]), time)[0]) if not self._clocks.perfect else time

    def current(self, node: int, time: float) -> int:
        """The ASN of a node's slot at a time."""
        return int(self.local(node, time) / self._length + ROUNDING)

    def upcoming(self, node: int, time: float) -> int:
        """The ASN of a node's next slot; of the present one, if it begins now."""
        return -int((-self.local(node, time) / self._length + ROUNDING) // 1.0)

    def when(self, node: int, asn: int, offset: float) -> float:
        """The time `offset` s after the start of a node's slot, by its clock."""
        local = asn * self._length + offset
        return self._clocks.when(node, local) if not self._clocks.perfect else local

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
        local = self._clocks.local(nodes, time) if not self._clocks.perfect else np.full(nodes.size, time)
        asn = np.floor(local / self._length + ROUNDING).astype(np.int64)
        return asn, local - asn * self._length

    def in_shared_cells(self, asn: Ints, channel: int) -> Bools:
        """(n,) whether slots are shared cells that use a channel."""
        found: Bools = self._is_shared[asn % self._size] & (self._sequence[asn % self._sequence.size] == channel)
        return found
