"""Tracks beside targets in a result whose readings name no target: who follows whom, and GOSPA over time.

    is_unlabelled(path) -> whether rows of `estimates` are of tracks
    followed_runs(path) -> FollowedRun of each run
    swaps(path, replicate) -> the events of identities that switch
    gospa_table(path, cutoffs) -> DataFrame
    least_localisation(least, errors)

Which track follows which target is decided here, after the run, by `multi_target.follow`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from wsnsim.base import multi_target
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import ResultError, UsageError, shown_value
from wsnsim.base.multi_target import FollowedRun, Tracks
from wsnsim.recording import attributes, read_table, tables

if TYPE_CHECKING:
    import pandas as pd


def is_unlabelled(path: str | Path) -> bool:
    """Whether the readings of a result name no target, so that the rows of `estimates` are of tracks."""
    size = tables(path).get("estimates")
    return size is not None and "track" in size.columns


def followed_runs(path: str | Path, replicates: Sequence[int] | None = None) -> Iterator[FollowedRun]:
    """Yield the runs of a result file, or those with these numbers.

    Raises:
        ResultError: the readings name their targets, or `truth`, `estimates` or `runs` was not recorded.
    """
    if not is_unlabelled(path):
        raise ResultError(f"{path}: its readings name their targets: there are no tracks to assign to them")
    root = attributes(path)
    place = [root["states"][i][0] for i in root["position"]]
    runs = read_table(path, "runs", ["replicate", "steps", "lost_limit", "lost_window"])
    truth = read_table(path, "truth", ["replicate", "target", "step", "time", *place])
    estimates = read_table(path, "estimates", ["replicate", "step", "time", "track", *place, "confirmed"])
    dt = _duration(truth, estimates)
    for row, number in enumerate(runs["replicate"].tolist()):
        if replicates is not None and number not in replicates:
            continue
        steps, limit, window = (float(runs[name][row]) for name in ("steps", "lost_limit", "lost_window"))
        own = {name: values[estimates["replicate"] == number] for name, values in estimates.items()}
        order = np.lexsort((own["track"], own["step"]))
        tracks = Tracks(
            own["step"][order].astype(np.int64), own["track"][order].astype(np.int64),
            np.column_stack([own[name][order] for name in place]), own["confirmed"][order] > 0,
        )  # fmt: skip
        positions = _positions({n: v[truth["replicate"] == number] for n, v in truth.items()}, place, int(steps))
        yield FollowedRun.of(number, positions, tracks, limit, round(window / dt), dt)


def followed_estimates(path: str | Path, replicate: int) -> dict[str, np.ndarray]:
    """Columns of the table `estimates` of one run as where readings name their target: of the tracks that follow one.

    There are no rows of steps at which no track follows a target; `target` and `error` are as there.
    """
    held = read_table(path, "estimates")
    if not {"truth", "runs"} <= tables(path).keys():
        return {name: values[:0] for name, values in held.items()} | {"target": np.empty(0, int), "error": np.empty(0)}
    run = next(followed_runs(path, [replicate]))
    own = np.flatnonzero(held["replicate"] == replicate)
    own = own[np.lexsort((held["track"][own], held["step"][own]))]
    target, step = np.nonzero(run.followed >= 0)
    rows = own[run.followed[target, step]]
    return {name: values[rows] for name, values in held.items()} | {"target": target, "error": run.errors[target, step]}


def swaps(path: str | Path, replicate: int) -> list[dict[str, Any]]:
    """The events `swap` of a run, by time: another track follows a target (`track`) than did before (`before`).

    No event log has them, since no node knows them: they are assigned here. Empty where the assignment is impossible.
    """
    if not is_unlabelled(path) or not {"truth", "runs"} <= tables(path).keys():
        return []
    return [
        {"kind": "swap", "time": step * run.rule.dt, "step": step, "target": target, "track": after, "before": before}
        for run in followed_runs(path, [replicate])
        for step, target, before, after in run.switches.tolist()
    ]


def _duration(*found: dict[str, np.ndarray]) -> float:
    """The duration of a step in s, from tables with steps and their times; 1 s if they have no step after the start."""
    pairs = ((table["step"][at], table["time"][at]) for table in found for at in np.flatnonzero(table["step"])[:1])
    return next((float(time / step) for step, time in pairs), 1.0)


def _positions(truth: dict[str, np.ndarray], place: Sequence[str], steps: int) -> Floats:
    """(T, K + 1, P) the positions of the table `truth` of one run."""
    targets = int(truth["target"].astype(np.int64).max(initial=-1)) + 1
    found = np.full((targets, steps + 1, len(place)), np.nan)
    kept = truth["step"] <= steps
    found[truth["target"][kept], truth["step"][kept]] = np.column_stack([truth[name][kept] for name in place])
    return found


def gospa_table(path: str | Path, cutoffs: Sequence[float] = (), order: float = multi_target.ORDER) -> pd.DataFrame:
    """GOSPA (α = 2) and its parts at each step of each run: `replicate`, `step`, `time`, `cutoff`, `gospa`, ...

    Args:
        path: a result file.
        cutoffs: the distances c, in the unit of the position; by default that of the columns of `runs`.
        order: the order p, at least 1.

    Raises:
        ResultError: as `followed_runs`.
        UsageError: a cutoff is not a positive number, or the order is below 1.
    """
    import pandas as pd  # slow to import, and summaries need the rest of this file

    for cutoff in cutoffs:
        if not 0.0 < cutoff < np.inf:
            raise UsageError(f"cutoffs: expected positive numbers, got {shown_value(cutoff)}")
    if not 1.0 <= order < np.inf:
        raise UsageError(f"order: expected a number from 1 on, got {shown_value(order)}")
    found = []
    for run in followed_runs(path):
        wanted = list(cutoffs) or [run.rule.cutoff]
        parts = multi_target.gospa(run.truth, run.tracks, wanted, order)
        count = run.truth.shape[1] - 1
        steps = np.tile(np.arange(1, count + 1), len(wanted))
        rows = {"replicate": run.replicate, "step": steps, "time": steps * run.rule.dt}
        rows |= {"cutoff": np.repeat(wanted, count), **dict(zip(GOSPA, (part.ravel() for part in parts), strict=True))}
        found.append(pd.DataFrame(rows))
    return pd.concat(found, ignore_index=True)


GOSPA: Final = multi_target.DISTANCES[:-1]
"""The columns of GOSPA and its parts, as in the table `runs`."""


def least_localisation(least: Floats, errors: Floats) -> float:
    """The least localisation part of GOSPA (p = 2), root mean square over runs and steps; NaN if nothing is followed.

    Args:
        least: (R, T, K) the bound of each target's position error, R of the runs or 1.
        errors: (R, T, K) errors of the tracks that follow the targets, NaN where none does: these alone count.
    """
    known = np.isfinite(errors)
    squares = np.where(known, np.broadcast_to(least, errors.shape) ** 2, 0.0)
    return float(np.sqrt(squares.sum(axis=1).mean())) if known.any() else np.nan
