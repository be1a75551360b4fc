"""A burst of packets becomes frames, and what becomes of the frames becomes a burst's result.

Bursts(mac, packing, journal).cut(burst, ended) -> [Piece]: the frames to send, each to be told how it fared
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from wsnsim.base.arrays import Bools
from wsnsim.base.radio import FramedMac, Packing
from wsnsim.network.event_log import EventLog
from wsnsim.network.radio.ideal_medium import EVERYONE, RELAY, SEND, Burst
from wsnsim.network.radio.transmission import Heard, MacFrame


class Fragment(MacFrame):
    """A frame of a burst: it carries the packets `first` to `last` - 1, or a part of one that fits no frame."""

    __slots__ = ("first", "last", "of")

    def __init__(self, of: _Burst, first: int, last: int, packets: int, bits: int, code: int) -> None:
        frame = of.frame
        kind = RELAY if frame.relayed else SEND
        super().__init__(frame.to, bits, packets, frame.target, code, kind, frame.sequence)
        self.of = of
        self.first = first
        self.last = last

    def done(self, heard: Heard | None) -> None:
        """The frame has fared so: see `transmission.Heard`; None if it never got the channel."""
        self.of.frame.sent += self.bits * self.sends
        self.of.settle(self, heard)


class _Burst:
    """A burst under way: which of its frames are still to come, and who has heard what so far."""

    def __init__(self, frame: Burst, spans: Sequence[tuple[int, int]], ended: Callable[[], None]) -> None:
        self.frame = frame
        self._waiting = len(spans)
        self._spans = spans
        self._ended = ended
        self._lost = np.zeros(frame.mask.size, dtype=np.bool_)
        self._heard: dict[int, list[tuple[int, int]]] = {}

    def settle(self, piece: Fragment, heard: Heard | None) -> None:
        """Note how one of the frames fared; when all have, the burst's frame says what arrived."""
        if self.frame.to == EVERYONE:
            for node in () if heard is None else heard.tolist():
                self._heard.setdefault(node, []).append((piece.first, piece.last))
        elif not heard:
            self._lost[piece.first : piece.last] = True
        self._waiting -= 1
        if self._waiting == 0:
            self._finish()

    def _finish(self) -> None:
        frame = self.frame
        if frame.to == EVERYONE:
            frame.heard = {node: self._mask_of(spans) for node, spans in sorted(self._heard.items())}
        else:
            mask = frame.mask & ~self._lost
            frame.mask, frame.packets = mask, int(mask.sum())
        self._ended()

    def _mask_of(self, heard: Sequence[tuple[int, int]]) -> Bools:
        """Which packets of a broadcast are whole where these frames of it were heard."""
        if len(heard) == len(self._spans):
            return self.frame.mask
        got, sent = (np.zeros(self.frame.mask.size, dtype=np.int64) for _ in range(2))
        for counts, spans in ((got, heard), (sent, self._spans)):
            for first, last in spans:
                counts[first:last] += 1
        return self.frame.mask & (got == sent)


class Fragmentation:
    """How bursts are cut into frames: as many packets in each as the packing allows and the payload holds."""

    def __init__(self, mac: FramedMac, packing: Packing, journal: EventLog) -> None:
        self._mac = mac
        self._packing = packing
        self._journal = journal
        self._sequences = 0

    def cut(self, frame: Burst, ended: Callable[[], None]) -> list[Fragment]:
        """The frames of a burst; `ended` is called when all have been settled. None for a burst without packets."""
        if frame.packets == 0:
            return []
        if not frame.sequence:
            self._sequences += 1
            frame.sequence = self._sequences
        spans = self._spans(frame)
        burst = _Burst(frame, [(first, last) for first, last, _, _ in spans], ended)
        code = self._journal.code(frame.parcel.what)
        return [
            Fragment(burst, first, last, packets, self._mac.bits(bits), code) for first, last, packets, bits in spans
        ]

    def _spans(self, frame: Burst) -> list[tuple[int, int, int, int]]:
        """(first, last, packets, payload bits) of each frame: what is left of the burst, packet by packet."""
        size, most = frame.parcel.packet_bits, self._mac.payload_bits
        present = [int(i) for i in np.flatnonzero(frame.mask)]
        if size > most:
            sizes = [most] * (size // most) + ([size % most] if size % most else [])
            return [(i, i + 1, 1, bits) for i in present for bits in sizes]
        each = max(self._packing.packets(size, most), 1)
        groups = [present[i : i + each] for i in range(0, len(present), each)]
        return [(group[0], group[-1] + 1, len(group), len(group) * size) for group in groups]
