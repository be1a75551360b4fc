"""What happened, in order: the event log, handed on a chunk at a time, and its fingerprint.

    journal.add((time, step, target, node, kind, what, frame, sequence, peer, packets, bits, joules, cause))
    journal.add_all((time, step, target, EACH, kind, ...), nodes)      the same event at each of several nodes

`add` is a list's own append: it is called a hundred thousand times a second. The fingerprint is the sum of a 64-bit
hash of each event's (time, node, kind, peer, bits), so it does not depend on the order at equal times, nor on whether
events are recorded.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.ports import Recorder
from wsnsim.base.rng import derive_each
from wsnsim.base.tables import TABLES

NAMES: Final = tuple(column.name for column in TABLES["events"])[1:]
CHUNK: Final = 8192
EACH: Final = -2
"""In the place of a node's number: the event is that of each of several nodes."""
TYPES: Final = {column.name: np.dtype(column.dtype) for column in TABLES["events"][1:]}
NODE: Final = NAMES.index("node")

Event = tuple[float, int, int, int, int, int, int, int, int, int, int, float, int]


class EventLog:
    """The event log of one run. Nothing is kept longer than a chunk. `step` is the number of the present step."""

    def __init__(self, recorder: Recorder, replicate: int) -> None:
        self._recorder = recorder
        self._replicate = replicate
        self._wanted = recorder.wants("events")
        self._rows: list[Event] = []
        self._nodes: list[Ints] = []
        self._waiting = 0
        self.step = 0
        self._sum = 0
        self.add: Callable[[Event], None] = self._rows.append
        self.extend: Callable[[Any], None] = self._rows.extend
        self.code = recorder.words.code

    def add_all(self, event: Event, nodes: Ints) -> None:
        """The same event at each of the nodes; `event` has EACH in a node's place."""
        self._rows.append(event)
        self._nodes.append(nodes)
        self._waiting += nodes.size
        if self._waiting >= CHUNK:
            self.drain(everything=True)

    def drain(self, everything: bool = False) -> None:
        """Hand on what has gathered, once it is a chunk."""
        if len(self._rows) < CHUNK and not (everything and self._rows):
            return
        flat = np.fromiter(itertools.chain.from_iterable(self._rows), np.float64, len(self._rows) * len(NAMES))
        self._rows.clear()
        columns = self._spread(flat.reshape(-1, len(NAMES)))
        self._sum = (self._sum + _digest(columns)) & 0xFFFF_FFFF_FFFF_FFFF
        if self._wanted:
            self._recorder.write("events", {"replicate": self._replicate, **columns})

    def _spread(self, rows: Floats) -> dict[str, np.ndarray[Any, Any]]:
        """The columns of events in their own types, with a row for each node of those that several share."""
        columns = {name: _typed(rows[:, i], dtype) for i, (name, dtype) in enumerate(TYPES.items())}
        if not self._nodes:
            return columns
        shared = rows[:, NODE] == EACH
        counts = np.ones(len(rows), dtype=np.int64)
        counts[shared] = [nodes.size for nodes in self._nodes]
        spread = {name: np.repeat(values, counts) for name, values in columns.items()}
        spread["node"][np.repeat(shared, counts)] = np.concatenate(self._nodes)
        self._nodes.clear()
        self._waiting = 0
        return spread

    def fingerprint(self) -> int:
        """The 64-bit digest of all that was added."""
        self.drain(everything=True)
        return self._sum


def _typed(values: Floats, dtype: np.dtype[Any]) -> np.ndarray[Any, Any]:
    """A column in the type of its table."""
    typed = values.astype(dtype)
    assert dtype.kind == "f" or bool((typed == values).all()), f"an event holds a number that does not fit {dtype}"
    return typed


def _digest(columns: Mapping[str, np.ndarray[Any, Any]]) -> int:
    times = columns["time"].view(np.uint64)
    others = [columns[name].astype(np.int64).view(np.uint64) for name in ("node", "kind", "peer", "bits")]
    return int(np.sum(derive_each(times, *others), dtype=np.uint64))
