"""The errors of runs beside the bound for all readings in range, whole and after the first second.

    squares(data, variant) -> Squares                 squared errors and bounds, step by step
    pooled(squares, after) -> Interval                root mean square error over that of the bounds
    of_medians(squares, after) -> Interval            median RMSE of a run over the median of the runs' bounds

The bound limits the mean square over runs, so that `pooled` is the ratio that cannot be below 1 but for chance (and for
what the bound's cautions say); it counts every run, astray or not. The ratio of medians is that of the frontier. Both
take the steps that have an estimate, of the error and of the bound.
"""

from __future__ import annotations

import functools
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import pandas as pd

from wsnsim.papers.toolkit import (
    Bools,
    Data,
    Floats,
    Interval,
    Ints,
    Plugins,
    bounds,
    interval,
    load,
    state_nees,
    weights,
)

SETTLED: Final = 1.0
"""Seconds that a run counts as its beginning."""


class Squares(NamedTuple):
    """The squared errors (m²) of runs of one target and their squared bounds, NaN where there is no estimate.

    Attributes:
        runs: (n,) the numbers of the runs.
        times: (K,) of the steps, in s.
        errors: (n, K).
        bounds: (n, K).
    """

    runs: Ints
    times: Floats
    errors: Floats
    bounds: Floats

    def after(self, time: float) -> Squares:
        """The steps after a time (s)."""
        kept = self.times > time * (1.0 + 1e-9)
        return Squares(self.runs, self.times[kept], self.errors[:, kept], self.bounds[:, kept])


@functools.lru_cache(maxsize=16)
def squares(data: Data, variant: str) -> Squares:
    """The squared errors of a variant's runs and their trajectory-conditional bounds for all readings in range.

    The bound is that for what the variant's filter knows of gains. Needs the table `estimates`; a single target.
    """
    scenario = load(data.scenario(variant), plugins=Plugins.NONE)
    table = data.of(variant, "estimates")
    runs = np.sort(data.of(variant, "runs")["replicate"].to_numpy())
    found = bounds.bound(scenario, runs.tolist(), "per_trajectory")
    assert not found.reason and found.each.shape[1] == 1, f"{variant} has no bound of one target"
    least = found.each[:, 0] ** 2
    errors = np.full(least.shape, np.nan)
    errors[np.searchsorted(runs, table["replicate"]), table["step"].to_numpy() - 1] = table["error"].to_numpy() ** 2
    times = scenario.step * np.arange(1, least.shape[1] + 1)
    return Squares(runs, times, errors, np.where(np.isfinite(errors), least, np.nan))


def resampled(count: int) -> Floats:
    """(1 + draws, count) weights of runs: all once, then those of every resample."""
    return np.concatenate([np.ones((1, count)), weights(count, count)])


def pooled(found: Squares) -> Interval:
    """The root mean square error over all runs and steps, divided by the root of the mean squared bound."""
    known = np.isfinite(found.errors)
    sums = (np.where(known, each, 0.0).sum(axis=1) for each in (found.errors, found.bounds))
    errors, least = (resampled(len(found.runs)) @ one for one in sums)
    with np.errstate(invalid="ignore"):  # a resample may have no estimate at all
        return interval(np.sqrt(errors / least))


def rmse_of_runs(squared: Floats) -> Floats:
    """(n,) roots of the mean over the steps that have an estimate; NaN for a run without one."""
    known = np.isfinite(squared)
    with np.errstate(invalid="ignore"):
        result: Floats = np.sqrt(np.where(known, squared, 0.0).sum(axis=1) / known.sum(axis=1))
    return result


def of_medians(found: Squares) -> Interval:
    """The median RMSE of a run, divided by the median over the runs of the bound."""
    return ratio_of_medians(rmse_of_runs(found.errors), rmse_of_runs(found.bounds))


def ratio_of_medians(values: Floats, others: Floats) -> Interval:
    """The median of the runs' values divided by that of others, resampled together; unknown if most are."""
    with np.errstate(invalid="ignore"):
        return interval(medians(values) / medians(others))


def medians(values: Floats) -> Floats:
    """(1 + draws,) the median of the runs as they are, and of every resample. The lower of two middle values counts."""
    values = np.where(np.isfinite(values), values, np.inf)
    order = np.argsort(values, kind="stable")
    cumulated = np.cumsum(resampled(len(values))[:, order], axis=1)
    middle = np.argmax(2.0 * cumulated >= cumulated[:, -1:], axis=1)
    result: Floats = values[order[middle]]
    return result


def over_bound(data: Data, variant: str, after: float = 0.0) -> pd.Series:
    """The RMSE of each run over its bound, by replicate."""
    found = squares(data, variant).after(after)
    return pd.Series(rmse_of_runs(found.errors) / rmse_of_runs(found.bounds), index=found.runs)


def rmse_after(data: Data, variant: str, after: float = SETTLED) -> pd.Series:
    """The RMSE (m) of each run after a time, by replicate."""
    found = squares(data, variant).after(after)
    return pd.Series(rmse_of_runs(found.errors), index=found.runs)


def near_walls(positions: Floats, times: Floats, wall: float, margin: float, memory: float) -> Bools:
    """(n, K) whether a trajectory is within a margin of a wall, or was so within the last seconds.

    Args:
        positions: (n, K, 2) true positions, in m.
        times: (K,) of the steps, in s.
        wall: the target is turned back where a coordinate exceeds this, in m.
        margin: m on the near side of the wall; everything beyond it is near.
        memory: s after which a wall is forgotten.
    """
    near = (np.abs(positions) > wall - margin).any(axis=2)
    last = np.maximum.accumulate(np.where(near, times, -np.inf), axis=1)
    result: Bools = times - last <= memory * (1.0 + 1e-9)
    return result


Of = Literal["position", "state"]
DIMENSIONS: Final[dict[Of, int]] = {"position": 2, "state": 4}


class Stretches(NamedTuple):
    """The steps of runs: (n, K) whether they are near a wall, and whether they belong to the beginning."""

    runs: Ints
    near: Bools
    beginning: Bools


@functools.lru_cache(maxsize=16)
def stretches(data: Data, variant: str) -> Stretches:
    """The stretches of a variant's runs, as registered. Needs the table `truth`; a single target."""
    wanted = data.registered["walls"]
    runs = np.sort(data.of(variant, "runs")["replicate"].to_numpy())
    positions = true_positions(data, variant)
    times = data.scenario(variant)["step"] * np.arange(1, positions.shape[1] + 1)
    wall = data.scenario(variant)["motion"]["bound"]
    near = near_walls(positions, times, wall, wanted["margin"], wanted["memory"])
    return Stretches(runs, near, np.broadcast_to(times <= wanted["beginning"], near.shape))


def true_positions(data: Data, variant: str) -> Floats:
    """(n, K, 2) true positions at the steps 1, 2, ..."""
    truth = data.of(variant, "truth").sort_values(["replicate", "step"])
    truth = truth[truth["step"] > 0]
    result: Floats = truth[["px", "py"]].to_numpy().reshape(truth["replicate"].nunique(), -1, 2)
    return result


def mean_nees(data: Data, variant: str, near: bool, of: Of = "position") -> Interval:
    """The mean NEES over the steps of one kind of stretch after the beginning, with its bootstrap interval over runs.

    Needs `estimates` and `truth`; `covariances` for the whole state.
    """
    sums, counts = _sums(data, variant, near, of)
    with np.errstate(invalid="ignore"):
        return interval((resampled(len(sums)) @ sums) / (resampled(len(sums)) @ counts))


def nees_of_runs(data: Data, variant: str, near: bool, of: Of = "position") -> pd.Series:
    """The mean of each run, by replicate."""
    sums, counts = _sums(data, variant, near, of)
    with np.errstate(invalid="ignore", divide="ignore"):
        return pd.Series(sums / counts, index=stretches(data, variant).runs)


def _sums(data: Data, variant: str, near: bool, of: Of) -> tuple[Floats, Floats]:
    """(n,) the sums over the steps of a kind of stretch, and their numbers."""
    where = stretches(data, variant)
    values = nees_of_steps(data, variant, of)
    counted = np.isfinite(values) & (where.near == near) & ~where.beginning
    return np.where(counted, values, 0.0).sum(axis=1), counted.sum(axis=1).astype(np.float64)


@functools.lru_cache(maxsize=16)
def nees_of_steps(data: Data, variant: str, of: Of) -> Floats:
    """(n, K) NEES of every step, NaN without an estimate."""
    where = stretches(data, variant)
    table: Any = data.of(variant, "estimates") if of == "position" else _of_state(data, variant)
    values = np.full(where.near.shape, np.nan)
    values[np.searchsorted(where.runs, table["replicate"]), table["step"].to_numpy() - 1] = table["nees"].to_numpy()
    return values


def _of_state(data: Data, variant: str) -> pd.DataFrame:
    """`replicate`, `step` and `nees` of the whole state, a row per estimate."""
    point = data.manifest.points[data.variants.index(variant)]
    return pd.concat([state_nees(batch.path) for batch in data.folder.batches(point.id)])
