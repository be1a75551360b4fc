"""The event log of a run: one row per event, written to the recorder in chunks, its fingerprint, and the step clock.

    log.add(event(time, step, target, node, kind, ...))                one event
    log.add_all(event(time, step, target, EACH, kind, ...), nodes)     the same event at each of several nodes
    log.add_unicasts(UnicastRows(time, step, target, ...))             two events for each of several unicasts

`event` composes a row; where many are made at once, they are written as tuples. `add` is the append method of a list,
since it is called about 100 000 times a second. The fingerprint is the sum over all events of a 64-bit hash of (time,
node, kind, peer, bits). It therefore depends neither on the order of events at equal times nor on whether events are
recorded.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final, NamedTuple

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.frames import SEND
from wsnsim.base.rng import derive_each
from wsnsim.base.tables import EVENT_CAUSE, KIND, TABLES, Recorder
from wsnsim.network.energy.ledger import HopCost

TYPES: Final = {column.name: np.dtype(column.dtype) for column in TABLES["events"] if column.name != "replicate"}
NAMES: Final = tuple(TYPES)
NODE: Final = NAMES.index("node")
HASHED: Final = ("time", "node", "kind", "peer", "bits")
"""The columns of which the fingerprint is made: the others are not needed where events are not recorded."""
CHOOSE_HASHED: Final = itemgetter(*map(NAMES.index, HASHED))
CHUNK: Final = 8192
"""Rows after which the log is written to the recorder."""
EACH: Final = -2
"""Stands for the node's number in an event that is shared by several nodes."""
UNICASTS: Final = -3
"""Stands for the node's number in a row that is replaced by those of unicasts."""
NONE, TX, RX = EVENT_CAUSE["none"], EVENT_CAUSE["tx"], EVENT_CAUSE["rx"]
Event = tuple[float, int, int, int, int, int, int, int, int, int, int, float, int]


def event(  # noqa: PLR0913
    time: float, step: int, target: int, node: int, kind: int, what: int = 0, frame: int = 0, sequence: int = 0,
    peer: int = -1, packets: int = 0, bits: int = 0, joules: float = 0.0, cause: int = NONE,
) -> Event:  # fmt: skip
    """Return one row of the table `events`, without its first column `replicate`.

    The parameters are the columns, in their order. Frequent callers pass them by position, which is faster.
    """
    return (time, step, target, node, kind, what, frame, sequence, peer, packets, bits, joules, cause)


STANDS_FOR_UNICASTS: Final = event(0.0, 0, -1, UNICASTS, 0)


class UnicastRows(NamedTuple):
    """What is logged of unicasts that all arrived within the instant; lists have one value for each of them.

    Attributes:
        time, step, target: As in the table `events`.
        first: The number of the first frame; each is numbered as its burst.
        sources, destinations: The nodes.
        codes: What they are called: codes of the column `what`.
        packets: The number of their packets.
        costs: Their bits and joules.
    """

    time: float
    step: int
    target: int
    first: int
    sources: list[int]
    destinations: list[int]
    codes: list[int]
    packets: list[int]
    costs: list[HopCost]


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
        self._unicasts: list[UnicastRows] = []
        self._shared_rows = 0
        self._sum = 0
        self.step = 0
        self.add: Callable[[Event], None] = self._rows.append
        self.extend: Callable[[Any], None] = self._rows.extend
        self.code = recorder.words.code

    def word(self, code: int) -> str:
        """Return the word of a code in the column `what`."""
        return self._recorder.words.all()[code]

    def add_all(self, row: Event, nodes: Ints) -> None:
        """Append one event for each of the nodes; `row` has EACH instead of the node."""
        self._rows.append(row)
        self._shared_nodes.append(nodes)
        self._shared_rows += nodes.size
        if self._shared_rows >= CHUNK:
            self.flush(everything=True)

    def add_unicasts(self, unicasts: UnicastRows) -> None:
        """Append the transmission and the reception of each of the unicasts, in turn."""
        self._rows.append(STANDS_FOR_UNICASTS)
        self._unicasts.append(unicasts)
        self._shared_rows += 2 * len(unicasts.sources)
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
        columns = self._columns(names, _with_unicasts(names, flat.reshape(-1, len(names)), self._unicasts))
        self._unicasts.clear()
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


def _with_unicasts(names: Sequence[str], rows: Floats, unicasts: list[UnicastRows]) -> Floats:
    """The rows (R, names) with those of unicasts at their places."""
    if not unicasts:
        return rows
    places = rows[:, names.index("node")] == UNICASTS
    repeats = np.ones(len(rows), dtype=np.int64)
    repeats[places] = [2 * len(some.sources) for some in unicasts]
    result = rows.repeat(repeats, axis=0)
    result[places.repeat(repeats)] = _unicast_rows(unicasts)[:, [NAMES.index(name) for name in names]]
    return result


def _unicast_rows(unicasts: list[UnicastRows]) -> Floats:
    """(2 n, columns) the transmission and the reception of each of n unicasts."""
    counts = np.array([len(some.sources) for some in unicasts])
    size, before = int(counts.sum()), counts.cumsum() - counts
    common = np.array([some[:3] for some in unicasts], dtype=np.float64).repeat(counts, axis=0)
    numbers = np.arange(size) + (np.array([some.first for some in unicasts]) - before).repeat(counts)
    lists = zip(*[some[4:] for some in unicasts], strict=True)
    sources, destinations, codes, packets, costs = (list(itertools.chain.from_iterable(each)) for each in lists)
    figures = np.fromiter(itertools.chain.from_iterable(costs), np.float64, len(HopCost._fields) * size)
    bits, _, _, sent, received = figures.reshape(size, -1).T
    result = np.empty((size, 2, len(NAMES)))
    result[:, :, :NODE] = common[:, None]
    for side, (node, peer, kind, joules, cause) in enumerate(
        ((sources, destinations, SEND, sent, TX), (destinations, sources, KIND["receive"], received, RX))
    ):
        values = (node, kind, codes, numbers, numbers, peer, packets, bits, joules, cause)
        for column, value in enumerate(values, NODE):
            result[:, side, column] = value
    return result.reshape(-1, len(NAMES))


def _typed(values: Floats, dtype: np.dtype[Any]) -> np.ndarray[Any, Any]:
    """A column in the type of its table."""
    typed = values.astype(dtype)
    assert dtype.kind == "f" or bool((typed == values).all()), f"an event holds a number that does not fit {dtype}"
    return typed


def _digest(columns: Mapping[str, np.ndarray[Any, Any]]) -> int:
    times, *others = (columns[name] for name in HASHED)
    keys = derive_each(times.view(np.uint64), *(values.astype(np.int64).view(np.uint64) for values in others))
    return int(keys.sum(dtype=np.uint64))


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
        self, kind: str, target: int, node: int, what: str = "", peer: int = -1, packets: int = 0, bits: int = 0
    ) -> None:
        """Log one event."""
        clock, log = self._clock, self._event_log
        code = log.code(what)
        log.add(event(clock.env.now, clock.step, target, node, KIND[kind], code, peer=peer, packets=packets, bits=bits))
