"""The event log of a run: one row per event, written to the recorder in chunks, its fingerprint, and the step clock.

    log.add(event(time, step, target, node, kind, ...))                one event
    log.add_all(event(time, step, target, EACH, kind, ...), nodes)     the same event at each of several nodes

`event` composes a row; where many are made at once, they are written as tuples. `add` is the append method of a list,
since it is called about 100 000 times a second. The fingerprint is the sum over all events of a 64-bit hash of (time,
node, kind, peer, bits). It therefore depends neither on the order of events at equal times nor on whether events are
recorded.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final, TypeAlias, TypeVar

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.rng import derive_each
from wsnsim.base.tables import EVENT_CAUSE, KIND, TABLES, Recorder

TYPES: Final = {column.name: np.dtype(column.dtype) for column in TABLES["events"] if column.name != "replicate"}
NAMES: Final = tuple(TYPES)
HASHED: Final = ("time", "node", "kind", "peer", "bits")
"""The columns of which the fingerprint is made: the others are not needed where events are not recorded."""
CHOOSE_HASHED: Final = itemgetter(*map(NAMES.index, HASHED))
CHUNK: Final = 8192
"""Rows after which the log is written to the recorder."""
EACH: Final = -2
"""Stands for the node's number in an event that is shared by several nodes."""
DROP: Final = KIND["drop"]
NONE: Final = EVENT_CAUSE["none"]
Event = tuple[float, int, int, int, int, int, int, int, int, int, int, float, int]


def event(  # noqa: PLR0913
    time: float, step: int, target: int, node: int, kind: int, what: int = 0, frame: int = 0, sequence: int = 0,
    peer: int = -1, packets: int = 0, bits: int = 0, joules: float = 0.0, cause: int = NONE,
) -> Event:  # fmt: skip
    """Return one row of the table `events`, without its first column `replicate`.

    The parameters are the columns, in their order. Frequent callers pass them by position, which is faster.
    """
    return (time, step, target, node, kind, what, frame, sequence, peer, packets, bits, joules, cause)


class EventLog:
    """The event log of one run. It holds at most one chunk of events in memory.

    Attributes:
        step: The number of the present step.
        add: Appends one event.
        extend: Appends several events.
        code: Returns the code of a word in the column `what`.
    """

    def __init__(self, recorder: Recorder, replicate: int) -> None:
        self._recorder = recorder
        self._replicate = replicate
        self._wanted = recorder.wants("events")
        self._rows: list[Event] = []
        self._shared_nodes: list[Ints] = []
        self._shared_rows = 0
        self._sum = 0
        self.step = 0
        self.add: Callable[[Event], None] = self._rows.append
        self.extend: Callable[[Any], None] = self._rows.extend
        self.code = recorder.words.code

    def word(self, code: int) -> str:
        """Return the word of a code in the column `what`."""
        return self._recorder.words.all()[code]

    def drop(
        self, time: float, target: int, node: int, reason: str, peer: int, packets: int, sequence: int = 0
    ) -> None:
        """Append that a node dropped what it was to send to a peer, and why."""
        code = self.code(reason)
        self.add(event(time, self.step, target, node, DROP, code, sequence=sequence, peer=peer, packets=packets))

    def add_all(self, row: Event, nodes: Ints) -> None:
        """Append one event for each of the nodes; `row` has EACH instead of the node."""
        self._rows.append(row)
        self._shared_nodes.append(nodes)
        self._shared_rows += nodes.size
        if self._shared_rows >= CHUNK:
            self.flush(everything=True)

    def flush(self, everything: bool = False) -> None:
        """Write the events to the recorder if they fill a chunk, or in any case with `everything`."""
        if len(self._rows) < CHUNK and not (everything and self._rows):
            return
        names = NAMES if self._wanted else HASHED
        rows = self._rows if self._wanted else map(CHOOSE_HASHED, self._rows)
        flat = np.fromiter(itertools.chain.from_iterable(rows), np.float64, len(self._rows) * len(names))
        self._rows.clear()
        columns = self._columns(names, flat.reshape(-1, len(names)))
        self._shared_rows = 0
        self._sum = (self._sum + _digest(columns)) & 0xFFFF_FFFF_FFFF_FFFF
        if self._wanted:
            self._recorder.write("events", {"replicate": self._replicate, **columns})

    def _columns(self, names: Sequence[str], rows: Floats) -> dict[str, np.ndarray[Any, Any]]:
        """Typed columns of events; an event that several nodes share becomes one row for each of them."""
        columns = {name: _typed(rows[:, i], TYPES[name]) for i, name in enumerate(names)}
        if not self._shared_nodes:
            return columns
        shared = rows[:, names.index("node")] == EACH
        repeats = np.ones(len(rows), dtype=np.int64)
        repeats[shared] = [nodes.size for nodes in self._shared_nodes]
        columns = {name: np.repeat(values, repeats) for name, values in columns.items()}
        columns["node"][np.repeat(shared, repeats)] = np.concatenate(self._shared_nodes)
        self._shared_nodes.clear()
        return columns

    def fingerprint(self) -> int:
        """Return the 64-bit digest of all events so far."""
        self.flush(everything=True)
        return self._sum


def _typed(values: Floats, dtype: np.dtype[Any]) -> np.ndarray[Any, Any]:
    """A column in the type of its table."""
    typed = values.astype(dtype)
    assert dtype.kind == "f" or bool((typed == values).all()), f"an event holds a number that does not fit {dtype}"
    return typed


def _digest(columns: Mapping[str, np.ndarray[Any, Any]]) -> int:
    times, *others = (columns[name] for name in HASHED)
    keys = derive_each(times.view(np.uint64), *(values.astype(np.int64).view(np.uint64) for values in others))
    return int(keys.sum(dtype=np.uint64))


Result = TypeVar("Result")
Acting: TypeAlias = Generator[simpy.Event, Any, Result]
"""What somebody does in simulated time: a generator of events that it waits for, which returns a result."""


def then(event: simpy.Event, action: Callable[..., Any], *arguments: Any) -> None:
    """Call an action with arguments when an event fires, after those that wait for it already."""
    assert event.callbacks is not None, "the event must not have been processed yet"
    event.callbacks.append(lambda _: action(*arguments))


@dataclass(slots=True)
class StepClock:
    """Simulated time in steps of `dt` s. Only `World` advances `step`."""

    env: simpy.Environment
    dt: float
    step: int = 0

    @property
    def now(self) -> float:
        """The simulated time in s."""
        return self.env.now

    @property
    def next_step(self) -> float:
        """The time in s at which the next step begins."""
        return (self.step + 1) * self.dt


class ProtocolLog:
    """Logs what protocols do, at the present time and step. Such an event costs no energy of its own."""

    def __init__(self, clock: StepClock, event_log: EventLog) -> None:
        self._clock = clock
        self._event_log = event_log

    def add(
        self, kind: str, target: int, node: int, what: str = "", peer: int = -1, packets: int = 0, sequence: int = 0
    ) -> None:
        """Log one event."""
        clock, log = self._clock, self._event_log
        code = log.code(what)
        now, step = clock.env.now, clock.step
        log.add(event(now, step, target, node, KIND[kind], code, 0, sequence, peer, packets))
