"""Fragmentation: bursts are split into MAC frames, and the results of the frames become the result of the burst."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Ints
from wsnsim.base.frames import EVERYONE, SEND, Burst, MacFrame, Received
from wsnsim.base.medium_access import FramedMac, Packing
from wsnsim.base.tables import KIND
from wsnsim.network.event_log import EventLog

RELAY = KIND["relay"]
Span: TypeAlias = tuple[int, int, int, int]
"""First packet, last packet + 1, number of packets, and bits on the air of one fragment."""


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
        burst = self._reassembly.burst
        burst.sent += self.bits * self.sends
        burst.attempts += min(self.sends, self.retries + 1)
        if self.to != EVERYONE:
            burst.acknowledged |= bool(received) if self.acknowledged is None else self.acknowledged
        self._reassembly.add(self, received)

    def note_arrival(self, now: float) -> None:
        """Note in the burst which of its packets are complete at the destination."""
        self._reassembly.note_arrival(self, now)


class _Reassembly:
    """A burst whose fragments are on their way: how many are missing, and what was received so far."""

    def __init__(self, burst: Burst, spans: list[Span], on_end: Callable[[], None]) -> None:
        self.burst = burst
        self._missing = len(spans)
        self._spans = spans
        self._on_end = on_end
        self._lost: list[Fragment] = []
        self._received: list[tuple[Fragment, Ints]] = []
        self._arrived: list[Fragment] = []

    def add(self, fragment: Fragment, received: Received | None) -> None:
        """Note the result of one fragment; after the last one, complete the burst."""
        if self.burst.to == EVERYONE:
            if received is not None:
                self._received.append((fragment, received))
        elif not received:
            self._lost.append(fragment)
        self._missing -= 1
        if self._missing == 0:
            self._complete()

    def note_arrival(self, fragment: Fragment, now: float) -> None:
        """Note that a fragment of a unicast has arrived; repetitions of it are ignored."""
        if fragment in self._arrived:
            return
        self._arrived.append(fragment)
        burst, complete = self.burst, self._mask_of(self._arrived)
        if complete.sum() > (0 if burst.heard is None else burst.heard.sum()):
            burst.heard, burst.heard_at = complete, now

    def _complete(self) -> None:
        burst = self.burst
        if burst.to == EVERYONE:
            burst.received = self._masks()
        elif self._lost:
            burst.mask = burst.mask.copy()
            for fragment in self._lost:
                burst.mask[fragment.first : fragment.last] = False
            burst.packets = int(burst.mask.sum())
        self._on_end()

    def _masks(self) -> dict[int, Bools]:
        """{node: which packets of a broadcast it received}, ascending."""
        if len(self._spans) == len(self._received) == 1:
            return dict.fromkeys(sorted(self._received[0][1].tolist()), self.burst.mask)
        found: dict[int, list[Fragment]] = {}
        for fragment, received in self._received:
            for node in received.tolist():
                found.setdefault(node, []).append(fragment)
        return {node: self._mask_of(fragments) for node, fragments in sorted(found.items())}

    def _mask_of(self, received: list[Fragment]) -> Bools:
        """Which packets of a burst are complete at a node that received these fragments."""
        if len(received) == len(self._spans):
            return self.burst.mask
        # a packet is complete if as many fragments with parts of it arrived as were sent
        arrived, sent = (np.zeros(self.burst.mask.size, dtype=np.int64) for _ in range(2))
        for fragment in received:
            arrived[fragment.first : fragment.last] += 1
        for first, last, *_ in self._spans:
            sent[first:last] += 1
        result: Bools = self.burst.mask & (arrived == sent)
        return result


class Fragmentation:
    """Splits bursts into MAC frames. The packing and the payload of a frame limit the number of packets in it."""

    def __init__(self, mac: FramedMac, packing: Packing, log: EventLog) -> None:
        self._mac = mac
        self._packing = packing
        self._log = log
        self._sequence = 0
        self._whole: dict[tuple[int, int], list[Span]] = {}
        """{(packets, bits of a packet): spans of a burst with all packets of its parcel}"""

    def send_all(
        self,
        bursts: Sequence[Burst],
        ended: simpy.Event,
        may_send: Callable[[Burst], bool],
        enqueue: Callable[[int, MacFrame], None],
    ) -> simpy.Event:
        """Give the frames of bursts to `enqueue(source, frame)`; return `ended`, which fires after the last burst.

        A burst whose source may not send is lost.
        """
        remaining = len(bursts)

        def note_end() -> None:
            nonlocal remaining
            remaining -= 1
            if remaining == 0:
                ended.succeed()

        if not bursts:
            return ended.succeed()
        for burst in bursts:
            frames = self.split(burst, note_end)
            if not frames or not may_send(burst):
                burst.lose()
                note_end()
            else:
                for frame in frames:
                    enqueue(burst.source, frame)
        return ended

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
        reassembly = _Reassembly(burst, spans, on_end)
        code = self._log.code(burst.parcel.what)
        return [Fragment(reassembly, *span, code) for span in spans]

    def _spans(self, burst: Burst) -> list[Span]:
        """The span of each fragment of a burst; cached for bursts that carry their whole parcel."""
        size, count = burst.parcel.packet_bits, burst.mask.size
        if burst.packets < count:
            return self._divided(np.flatnonzero(burst.mask).tolist(), size)
        spans = self._whole.get((count, size))
        if spans is None:
            spans = self._whole[count, size] = self._divided(list(range(count)), size)
        return spans

    def _divided(self, present: list[int], size: int) -> list[Span]:
        """The spans of the packets with the indices `present`, each of `size` bits."""
        bits_of, capacity = self._mac.bits, self._mac.payload_bits
        if size > capacity:
            sizes = [capacity] * (size // capacity) + ([size % capacity] if size % capacity else [])
            return [(i, i + 1, 1, bits_of(bits)) for i in present for bits in sizes]
        per_frame = max(self._packing.packets(size, capacity), 1)
        groups = [present[i : i + per_frame] for i in range(0, len(present), per_frame)]
        return [(group[0], group[-1] + 1, len(group), bits_of(len(group) * size)) for group in groups]
