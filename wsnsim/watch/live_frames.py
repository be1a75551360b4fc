"""The frames of a run that is being watched, put together from its pieces.

    frames = LiveFrames(start)
    frames.head                           the head of the replay as text
    frames.add(pieces) -> text            the frames that are complete, as text

A frame is complete one step after it has ended, since a transmission may end in the next step.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final, final

import numpy as np

from wsnsim.analysis.plot_data import Columns
from wsnsim.analysis.replicate_tables import EVENTS
from wsnsim.base.arrays import Floats
from wsnsim.base.rows import RunStart
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import CAUSES
from wsnsim.report.replay_portions import PortionTables, ReplayPortions
from wsnsim.watch.live_recorder import NewEstimate, RunPiece

NONE: Final[Columns] = {}


@final
class LiveFrames:
    """One run so far: its frames, errors and energy.

    Attributes:
        head: the head of the replay as text.
        replicate: number of the run.
        time: simulated time in s.
        error: position error of the last estimate, NaN before the first one.
        joules: {cause: energy in J that the network has spent}.
    """

    def __init__(self, start: RunStart) -> None:
        self._start, self._portions = start, ReplayPortions(start)
        self._rows: dict[str, Columns] = {"events": NONE, "particles": NONE}
        self._squares, self._count = 0.0, 0
        self.head = self._portions.head()
        self.replicate, self.time, self.error = start.replicate, 0.0, float("nan")
        self.joules: dict[str, float] = {}

    @property
    def rmse(self) -> float:
        """Root mean square position error of all estimates so far, NaN without one."""
        return float(np.sqrt(self._squares / self._count)) if self._count else float("nan")

    def add(self, pieces: Sequence[RunPiece]) -> str:
        """The frames that are complete after these pieces, as text."""
        last = pieces[-1]
        self._take_rows(pieces)
        guess = self._guess([each for piece in pieces for each in piece.estimates])
        self._measure(guess)
        guess = _joined([guess, self._headed(pieces, guess)])
        self.time = last.time
        self.joules = {cause: joules for cause, joules in zip(CAUSES, last.joules, strict=False) if joules > 0.0}
        complete = last.step - 2
        spent = tuple((piece.time, sum(piece.joules)) for piece in pieces if piece.joules)
        tables = PortionTables(self._rows["events"], guess, self._until(complete), last.residual, last.words, spent)
        text = self._portions.add(tables, complete)
        self._forget_rows()
        return text

    def _take_rows(self, pieces: Iterable[RunPiece]) -> None:
        names = {"events": EVENTS, "particles": self._particle_columns()}
        for table, columns in names.items():
            written = [rows for piece in pieces for rows in piece.rows.get(table, ())]
            new = [_equally_long({name: rows[name] for name in columns}) for rows in written]
            self._rows[table] = _joined([self._rows[table], *new])

    def _particle_columns(self) -> tuple[str, ...]:
        return ("target", "step", *self._position(), "weight")

    def _position(self) -> tuple[str, ...]:
        setup = self._start.setup
        if not isinstance(setup, TrackingSetup):
            return ()
        motion = setup.motions[0]
        return tuple(motion.columns[i] for i in motion.position)

    def _until(self, step: int) -> Columns:
        """The particles of the steps that are complete and not yet encoded."""
        rows = self._rows["particles"]
        return _chosen(rows, (rows["step"] <= step) & (rows["step"] > self._encoded())) if rows else NONE

    def _encoded(self) -> int:
        """The last step that is encoded, -1 before the first one."""
        return (self._portions.known - 1) * self._portions.stride if self._portions.known else -1

    def _forget_rows(self) -> None:
        """Forget the rows that no later frame needs."""
        for table, rows in self._rows.items():
            if rows:
                self._rows[table] = _chosen(rows, rows["step"] >= self._encoded())

    def _guess(self, estimates: Sequence[NewEstimate]) -> Columns:
        """The rows of estimates, with their errors."""
        setup, truths = self._start.setup, self._start.truths
        if not estimates or not isinstance(setup, TrackingSetup):
            return NONE
        place = list(setup.motions[0].position)
        targets = np.array([each.target for each in estimates])
        steps = np.array([each.issued.step for each in estimates])
        means = np.array([each.issued.estimate.mean for each in estimates])[:, place]
        true = np.array([truths[target][step, place] for target, step in zip(targets, steps, strict=True)])
        heads = np.array([each.issued.head for each in estimates])
        error = np.sqrt(((means - true) ** 2).sum(axis=1))
        return _row_columns(targets, steps, setup.dt, dict(zip(self._position(), means.T, strict=True)), error, heads)

    def _headed(self, pieces: Sequence[RunPiece], guess: Columns) -> Columns:
        """Rows with the cluster heads of steps without an estimate."""
        rows = [row for piece in pieces for row in piece.heads if row[1] > 0]
        known = set(zip(guess["target"].tolist(), guess["step"].tolist(), strict=True)) if guess else set()
        rows = [row for row in rows if row[:2] not in known]
        if not rows:
            return NONE
        targets, steps, heads = np.array(rows).T
        missing = np.full(len(rows), np.nan)
        places = dict.fromkeys(self._position(), missing)
        return _row_columns(targets, steps, self._start.setup.dt, places, missing, heads)

    def _measure(self, guess: Columns) -> None:
        if guess:
            self._squares += float((guess["error"] ** 2).sum())
            self._count += guess["error"].size
            self.error = float(guess["error"][np.argmax(guess["step"])])


def _row_columns(
    targets: np.ndarray, steps: np.ndarray, dt: float, places: dict[str, Floats], error: Floats, heads: np.ndarray
) -> Columns:
    return {"target": targets, "step": steps, "time": steps * dt, **places, "error": error, "head": heads}


def _equally_long(columns: dict[str, Any]) -> Columns:
    arrays = np.broadcast_arrays(*(np.atleast_1d(values) for values in columns.values()))
    return dict(zip(columns, arrays, strict=True))


def _joined(tables: Sequence[Columns]) -> Columns:
    """The rows of several tables, those without rows left out."""
    filled = [table for table in tables if table and next(iter(table.values())).size]
    if not filled:
        return NONE
    return {name: np.concatenate([table[name] for table in filled]) for name in filled[0]}


def _chosen(rows: Columns, chosen: np.ndarray) -> Columns:
    kept = {name: values[chosen] for name, values in rows.items()}
    return kept if chosen.any() else NONE
