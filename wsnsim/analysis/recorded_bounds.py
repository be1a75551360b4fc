"""The trajectory-conditional CRLBs of a result file, to show beside its errors.

    in_range(path) -> Bound or None        time_averages(path) -> {readings: bound, ...}

They are tight but not strict bounds, see `wsnsim.bounds`. A file without a scenario, of another version, or of a motion
model without a bound has none; no error is raised. A file that names a plug-in has
none either, unless `plugins` allows importing it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wsnsim.analysis.plot_data import stored_json
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import WsnsimError
from wsnsim.bounds import READINGS, Bound, bound_of_run
from wsnsim.recording import read_table, tables
from wsnsim.scenario import Plugins
from wsnsim.scenario.registry import refused


def lacking(path: str | Path, plugins: bool = False) -> str:
    """Why there is no bound, if the result's scenario needs a plug-in that is not imported; '' otherwise."""
    why = refused(stored_json(path, "scenario/resolved_json"), Plugins.ANY if plugins else Plugins.NONE)
    return f"the bound {why.partition(': ')[2]}" if why else ""


def in_range(path: str | Path, plugins: bool = False) -> Bound | None:
    """The bound for all readings in range."""
    return _found(path, "in_range", plugins)


def time_averages(path: str | Path, plugins: bool = False) -> dict[str, float]:
    """The time average of each bound over the steps that have an estimate, in the position's unit.

    Without recorded events, or without a network, the only one is that for all readings in range.
    """
    log = tables(path).get("events")
    known = READINGS if log is not None and log.rows else ("in_range",)
    found = {readings: bound for readings in known if (bound := _found(path, readings, plugins)) is not None}
    means = {readings: bound.time_mean_at(_errors(path, bound)) for readings, bound in found.items()}
    return {readings: mean for readings, mean in means.items() if np.isfinite(mean)}


def _found(path: str | Path, readings: str, plugins: bool) -> Bound | None:
    try:
        found = bound_of_run(path, readings, plugins=plugins)
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
