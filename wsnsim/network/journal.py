"""What happened, in order: the event log, handed on a chunk at a time, and its fingerprint.

    journal.add((time, step, target, node, kind, what, frame, sequence, peer, packets, bits, joules, cause))

`add` is a list's own append: it is called a hundred thousand times a second. The fingerprint is the sum of a 64-bit
hash of each event's (time, node, kind, peer, bits), so it does not depend on the order at equal times, nor on whether
events are recorded.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import Recorder
from wsnsim.base.rng import derive_each
from wsnsim.base.tables import TABLES

NAMES: Final = tuple(column.name for column in TABLES["events"])[1:]
CHUNK: Final = 8192
TIME, NODE, KIND, PEER, BITS = (NAMES.index(name) for name in ("time", "node", "kind", "peer", "bits"))

Event = tuple[float, int, int, int, int, int, int, int, int, int, int, float, int]


class Journal:
    """The event log of one run. Nothing is kept longer than a chunk."""

    def __init__(self, recorder: Recorder, replicate: int) -> None:
        self._recorder = recorder
        self._replicate = replicate
        self._wanted = recorder.wants("events")
        self._rows: list[Event] = []
        self._sum = 0
        self.add: Callable[[Event], None] = self._rows.append
        self.extend: Callable[[Any], None] = self._rows.extend
        self.code = recorder.words.code

    def drain(self, everything: bool = False) -> None:
        """Hand on what has gathered, once it is a chunk."""
        if len(self._rows) < CHUNK and not (everything and self._rows):
            return
        flat = np.fromiter(itertools.chain.from_iterable(self._rows), np.float64, len(self._rows) * len(NAMES))
        rows = flat.reshape(-1, len(NAMES))
        self._rows.clear()
        self._sum = (self._sum + _digest(rows)) & 0xFFFF_FFFF_FFFF_FFFF
        if self._wanted:
            columns: dict[str, Any] = {name: rows[:, i] for i, name in enumerate(NAMES)}
            self._recorder.write("events", {"replicate": self._replicate, **columns})

    def fingerprint(self) -> int:
        """The 64-bit digest of all that was added."""
        self.drain(everything=True)
        return self._sum


def _digest(rows: Floats) -> int:
    times = rows[:, TIME].copy().view(np.uint64)
    others = [rows[:, i].astype(np.int64).view(np.uint64) for i in (NODE, KIND, PEER, BITS)]
    return int(np.sum(derive_each(times, *others), dtype=np.uint64))
