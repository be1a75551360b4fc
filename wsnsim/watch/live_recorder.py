"""The recorder that a run is watched through: it passes on all rows to the result's file, and keeps what a view needs.

    experiment.run(scenario, out=path, watched=lambda file: LiveRecorder(file, on_begin, on_piece))

It works in the thread of the simulation, so it only sets aside what was written; others encode it. What it passes on is
what it is given, so the result is the same as without it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final, NamedTuple, final

import numpy as np

from wsnsim.base.ports import Recorder
from wsnsim.base.rows import Issued, RunNow, RunStart

INTERVAL: Final = 0.25
"""Seconds between two looks at a run."""
FOLLOWED: Final = ("events", "particles")
"""Tables whose rows are kept as they are written."""


class NewEstimate(NamedTuple):
    """An estimate of a target that was not seen before."""

    target: int
    issued: Issued


@dataclass(frozen=True)
class RunPiece:
    """What happened in a run since the last look.

    Attributes:
        step: number of the present step; those before it are over.
        time: simulated time in s.
        rows: rows of the tables `FOLLOWED`, as they were written.
        estimates: new estimates.
        heads: (target, step, head) of the steps since the last look.
        joules: energy in J that the network has spent, by cause; empty without a network.
        residual: (N,) residual energies in J, None without a network.
        words: the categories of `events.what` so far.
    """

    step: int
    time: float
    rows: Mapping[str, list[Mapping[str, Any]]]
    estimates: list[NewEstimate]
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
            estimates += [NewEstimate(track.target, each) for each in islice(track.estimates.values(), seen, None)]
            heads += [(track.target, step, head) for step, head in enumerate(track.heads[headed : now.step], headed)]
            self._seen[track.target], self._headed[track.target] = len(track.estimates), now.step
        rows, self._rows = self._rows, {}
        self._on_piece(
            RunPiece(now.step, now.time, rows, estimates, heads, tuple(now.joules), now.residual, self.words.all())
        )
        self._due = self._clock() + self._interval
