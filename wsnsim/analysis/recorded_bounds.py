"""What was possible in a recorded run, where that can be said: bounds to stand beside its errors.

    in_range(path) -> Bound or None        beside(path) -> {readings: metres, ...}

Along each truth: tight, and not strict; see `bounds`. Results that are no runs of a scenario, of another version, or of
a motion that has no bound have none, and nothing is raised.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import WsnsimError
from wsnsim.bounds import Bound, bound_of_run
from wsnsim.recording import read_table, tables

WORDS: Final = {
    "in_range": "bound along the truth, not strict: readings in range",
    "active": "bound along the truth, not strict: active members' readings",
    "arrived": "bound along the truth, not strict: readings that arrived",
}


def in_range(path: str | Path) -> Bound | None:
    """The bound for all readings in range."""
    return _found(path, "in_range")


def beside(path: str | Path) -> dict[str, float]:
    """The time mean of each bound at the steps that have an estimate, in the position's unit.

    Without a log, and without a network, there is that for all readings in range alone.
    """
    log = tables(path).get("events")
    known = list(WORDS) if log is not None and log.rows else ["in_range"]
    found = {readings: bound for readings in known if (bound := _found(path, readings)) is not None}
    means = {readings: bound.time_mean_at(_errors(path, bound)) for readings, bound in found.items()}
    return {readings: mean for readings, mean in means.items() if np.isfinite(mean)}


def _found(path: str | Path, readings: str) -> Bound | None:
    try:
        found = bound_of_run(path, readings)
    except WsnsimError:
        return None
    return None if found.reason else found


def _errors(path: str | Path, found: Bound) -> Floats:
    """(replicates, targets, steps) errors at the bound's steps, NaN where there is no estimate."""
    table = read_table(path, "estimates", ["replicate", "target", "step", "error"])
    errors = np.full(found.each.shape, np.nan)
    rows = np.searchsorted(found.query.replicates, table["replicate"])
    errors[rows, table["target"], table["step"] - 1] = table["error"]
    return errors
