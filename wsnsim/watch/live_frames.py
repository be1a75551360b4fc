"""The recorder that a run is watched through, and the frames that are put together from what it keeps.

    experiment.run(scenario, out=path, watched=lambda file: LiveRecorder(file, on_begin, on_piece))
    frames = LiveFrames(start)
    frames.head                           the head of the replay as text
    frames.add(pieces) -> text            the frames that are complete, as text

The recorder works in the thread of the simulation, so it only sets aside what was written. What it passes on to the
result's file is what it is given, so the result is the same as without it. A frame is complete one step after it has
ended, since a transmission may end in the next step.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final, final

import numpy as np

from wsnsim.analysis.plot_data import EVENTS, Columns
from wsnsim.base.rows import Issued, RunNow, RunStart
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import CAUSES, Recorder, equally_long
from wsnsim.report.replay import ReplayPortions

INTERVAL: Final = 0.25
"""Seconds between two looks at a run."""
FOLLOWED: Final = ("events", "particles")
"""Tables whose rows are kept as they are written."""


@dataclass(frozen=True)
class RunPiece:
    """What happened in a run since the last look.

    Attributes:
        step: number of the present step; those before it are over.
        time: simulated time in s.
        rows: rows of the tables `FOLLOWED`, as they were written.
        estimates: new estimates, each with the number of its target.
        heads: (target, step, head) of the steps since the last look.
        joules: energy in J that the network has spent, by cause; empty without a network.
        residual: (N,) residual energies in J, None without a network.
        words: the categories of `events.what` so far.
    """

    step: int
    time: float
    rows: Mapping[str, list[Mapping[str, Any]]]
    estimates: list[tuple[int, Issued]]
    heads: list[tuple[int, int, int]]
    joules: tuple[float, ...]
    residual: np.ndarray | None
    words: tuple[str, ...]


@final
class LiveRecorder:
    """A recorder before another one. Event logs are followed whether the other one keeps them or not.

    Args:
        inner: where all rows go.
        on_begin: called when a run begins.
        on_piece: called with what is new, at most every `interval` seconds.
        interval: seconds between two looks.
        clock: gives the present time in s.
    """

    def __init__(
        self,
        inner: Recorder,
        on_begin: Callable[[RunStart], None],
        on_piece: Callable[[RunPiece], None],
        interval: float = INTERVAL,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._inner, self._on_begin, self._on_piece = inner, on_begin, on_piece
        self._interval, self._clock = interval, clock
        self.words, self.state_names = inner.words, inner.state_names
        self._forget()

    def _forget(self) -> None:
        self._rows: dict[str, list[Mapping[str, Any]]] = {}
        self._seen: dict[int, int] = {}
        self._headed: dict[int, int] = {}
        self._due = 0.0

    def wants(self, table: str) -> bool:
        """Whether the other recorder keeps the table, or the view needs it."""
        return table == "events" or self._inner.wants(table)

    def write(self, table: str, columns: Mapping[str, Any]) -> None:
        """Pass on rows."""
        if table in FOLLOWED:
            self._rows.setdefault(table, []).append({name: np.array(values) for name, values in columns.items()})
        if table != "events" or self._inner.wants(table):
            self._inner.write(table, columns)

    def begin(self, start: RunStart) -> None:
        """A run begins: what is left of the one before is forgotten."""
        self._forget()
        self._on_begin(start)

    def due(self) -> bool:
        """Whether the last look is long enough ago."""
        return self._clock() >= self._due

    def follow(self, now: RunNow) -> None:
        """Hand on what is new."""
        estimates, heads = [], []
        for track in now.tracks:
            seen, headed = self._seen.get(track.target, 0), self._headed.get(track.target, 0)
            estimates += [(track.target, each) for each in islice(track.estimates.values(), seen, None)]
            heads += [(track.target, step, head) for step, head in enumerate(track.heads[headed : now.step], headed)]
            self._seen[track.target], self._headed[track.target] = len(track.estimates), now.step
        rows, self._rows = self._rows, {}
        self._on_piece(
            RunPiece(now.step, now.time, rows, estimates, heads, tuple(now.joules), now.residual, self.words.all())
        )
        self._due = self._clock() + self._interval


NONE: Final[Columns] = {}


@final
class LiveFrames:
    """One run so far: its frames, errors and energy.

    Attributes:
        head: the head of the replay as text.
        error: position error of the last estimate, NaN before the first one.
        joules: {cause: energy in J that the network has spent}.
    """

    def __init__(self, start: RunStart) -> None:
        self._start, self._portions = start, ReplayPortions(start)
        self._rows: dict[str, Columns] = {"events": NONE, "particles": NONE}
        self._squares, self._count = 0.0, 0
        self.head = self._portions.head()
        self.error = float("nan")
        self.joules: dict[str, float] = {}

    @property
    def rmse(self) -> float:
        """Root mean square position error of all estimates so far, NaN without one."""
        return float(np.sqrt(self._squares / self._count)) if self._count else float("nan")

    def add(self, pieces: Sequence[RunPiece]) -> str:
        """The frames that are complete after these pieces, as text."""
        last = pieces[-1]
        names = {"events": EVENTS, "particles": ("target", "step", *self._portions.position, "weight")}
        for table, columns in names.items():
            written = [rows for piece in pieces for rows in piece.rows.get(table, ())]
            new = [equally_long({name: rows[name] for name in columns}) for rows in written]
            self._rows[table] = _joined([self._rows[table], *new])
        guess = self._guess(pieces)
        known = np.isfinite(guess["error"]) if guess else np.empty(0, dtype=bool)
        if known.any():
            self._squares += float((guess["error"][known] ** 2).sum())
            self._count += int(known.sum())
            self.error = float(guess["error"][known][np.argmax(guess["step"][known])])
        self.joules = {cause: joules for cause, joules in zip(CAUSES, last.joules, strict=False) if joules > 0.0}
        complete = last.step - 2
        spent = [(piece.time, sum(piece.joules)) for piece in pieces if piece.joules]
        tables = {"events": self._rows["events"], "guess": guess, "cloud": self._until(complete), "words": last.words}
        text = self._portions.add(complete, last.residual, spent, **tables)
        self._forget_rows()
        return text

    def _until(self, step: int) -> Columns:
        """The particles of the steps that are complete and not yet encoded."""
        rows = self._rows["particles"]
        return _chosen(rows, (rows["step"] <= step) & (rows["step"] > self._encoded())) if rows else NONE

    def _encoded(self) -> int:
        """The last step that is encoded, -1 before the first one."""
        return (self._portions.known - 1) * self._portions.stride if self._portions.known else -1

    def _forget_rows(self) -> None:
        """Forget the rows that no later frame needs."""
        kept = {table: rows["step"] >= self._encoded() for table, rows in self._rows.items() if rows}
        self._rows |= {table: _chosen(self._rows[table], rows) for table, rows in kept.items()}

    def _guess(self, pieces: Sequence[RunPiece]) -> Columns:
        """The rows of new estimates, with their errors, and of cluster heads at steps without an estimate."""
        setup, truths = self._start.setup, self._start.truths
        if not isinstance(setup, TrackingSetup):
            return NONE
        place = list(setup.motions[0].position)
        unknown = [np.nan] * (len(place) + 1)
        rows = {row[:2]: (*row[:2], *unknown, row[2]) for piece in pieces for row in piece.heads if row[1] > 0}
        for target, issued in (each for piece in pieces for each in piece.estimates):
            mean = issued.estimate.mean[place]
            error = np.sqrt(((mean - truths[target][issued.step, place]) ** 2).sum())
            rows[target, issued.step] = (target, issued.step, *mean, error, issued.head)
        if not rows:
            return NONE
        names = ("target", "step", *self._portions.position, "error", "head")
        guess = dict(zip(names, np.array(list(rows.values())).T, strict=True))
        guess |= {name: guess[name].astype(np.int64) for name in ("target", "step", "head")}
        return guess | {"time": guess["step"] * setup.dt}


def _joined(tables: Sequence[Columns]) -> Columns:
    """The rows of several tables, those without rows left out."""
    filled = [table for table in tables if table and next(iter(table.values())).size]
    if not filled:
        return NONE
    return {name: np.concatenate([table[name] for table in filled]) for name in filled[0]}


def _chosen(rows: Columns, chosen: np.ndarray) -> Columns:
    kept = {name: values[chosen] for name, values in rows.items()}
    return kept if chosen.any() else NONE
