"""Fragmentation: bursts are split into MAC frames, and the results of the frames become the result of the burst."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from wsnsim.base.arrays import Bools
from wsnsim.base.frames import EVERYONE, SEND, Burst, MacFrame, Received
from wsnsim.base.medium_access import FramedMac, Packing
from wsnsim.base.tables import KIND
from wsnsim.network.event_log import EventLog

RELAY = KIND["relay"]


class Fragment(MacFrame):
    """A MAC frame that carries part of a burst: the packets `first` to `last` - 1, or a part of one long packet."""

    __slots__ = ("_reassembly", "first", "last")

    def __init__(self, reassembly: _Reassembly, first: int, last: int, packets: int, bits: int, code: int) -> None:
        burst = reassembly.burst
        kind = RELAY if burst.relayed else SEND
        super().__init__(burst.to, bits, packets, burst.target, code, kind, burst.sequence)
        self._reassembly = reassembly
        self.first = first
        self.last = last

    def finish(self, received: Received | None) -> None:
        """Add the result of the fragment to its burst; `received` is None if the fragment never got the channel."""
        self._reassembly.burst.sent += self.bits * self.sends
        self._reassembly.add(self, received)


class _Reassembly:
    """A burst whose fragments are on their way: how many are missing, and what was received so far."""

    def __init__(self, burst: Burst, spans: Sequence[tuple[int, int]], on_end: Callable[[], None]) -> None:
        self.burst = burst
        self._missing = len(spans)
        self._spans = spans
        self._on_end = on_end
        self._lost = np.zeros(burst.mask.size, dtype=np.bool_)
        self._received: dict[int, list[tuple[int, int]]] = {}

    def add(self, fragment: Fragment, received: Received | None) -> None:
        """Note the result of one fragment; after the last one, complete the burst."""
        if self.burst.to == EVERYONE:
            for node in () if received is None else received.tolist():
                self._received.setdefault(node, []).append((fragment.first, fragment.last))
        elif not received:
            self._lost[fragment.first : fragment.last] = True
        self._missing -= 1
        if self._missing == 0:
            self._complete()

    def _complete(self) -> None:
        burst = self.burst
        if burst.to == EVERYONE:
            burst.received = {node: self._mask_of(spans) for node, spans in sorted(self._received.items())}
        else:
            mask = burst.mask & ~self._lost
            burst.mask, burst.packets = mask, int(mask.sum())
        self._on_end()

    def _mask_of(self, received: Sequence[tuple[int, int]]) -> Bools:
        """Which packets of a broadcast are complete at a node that received these fragments."""
        if len(received) == len(self._spans):
            return self.burst.mask
        arrived, sent = (np.zeros(self.burst.mask.size, dtype=np.int64) for _ in range(2))
        for counts, spans in ((arrived, received), (sent, self._spans)):
            for first, last in spans:
                counts[first:last] += 1
        result: Bools = self.burst.mask & (arrived == sent)
        return result


class Fragmentation:
    """Splits bursts into MAC frames. The packing and the payload of a frame limit the number of packets in it."""

    def __init__(self, mac: FramedMac, packing: Packing, log: EventLog) -> None:
        self._mac = mac
        self._packing = packing
        self._log = log
        self._sequence = 0

    def split(self, burst: Burst, on_end: Callable[[], None]) -> list[MacFrame]:
        """Return the fragments of a burst, in order; none for a burst without packets.

        The MAC calls `finish` on each of them once. After the last one the burst holds what arrived, and `on_end`
        is called.
        """
        if burst.packets == 0:
            return []
        if not burst.sequence:
            self._sequence += 1
            burst.sequence = self._sequence
        spans = self._spans(burst)
        reassembly = _Reassembly(burst, [(first, last) for first, last, _, _ in spans], on_end)
        code = self._log.code(burst.parcel.what)
        return [
            Fragment(reassembly, first, last, packets, self._mac.bits(bits), code)
            for first, last, packets, bits in spans
        ]

    def _spans(self, burst: Burst) -> list[tuple[int, int, int, int]]:
        """(first, last, packets, payload bits) of each fragment."""
        size, capacity = burst.parcel.packet_bits, self._mac.payload_bits
        present = [int(i) for i in np.flatnonzero(burst.mask)]
        if size > capacity:
            sizes = [capacity] * (size // capacity) + ([size % capacity] if size % capacity else [])
            return [(i, i + 1, 1, bits) for i in present for bits in sizes]
        per_frame = max(self._packing.packets(size, capacity), 1)
        groups = [present[i : i + per_frame] for i in range(0, len(present), per_frame)]
        return [(group[0], group[-1] + 1, len(group), len(group) * size) for group in groups]
