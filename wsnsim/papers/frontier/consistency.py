"""The mean normalised estimation error squared (NEES), on stretches near walls and away from them.

    stretches(data, variant) -> Stretches             which steps of which runs count
    mean_nees(data, variant, near, of) -> Interval    of the position (2 when consistent) or the whole state (4)

A Gaussian that straddles the line at which the target is turned back is two of them a step later: there the claims of
a filter are put to a test of their own. The stretches were fixed before the runs, see docs/frontier.md.
"""

from __future__ import annotations

import functools
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import pandas as pd

from wsnsim.analysis.consistency import state_nees
from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.papers.answers import Interval, interval
from wsnsim.papers.frontier.against_bound import near_walls, resampled
from wsnsim.papers.measures import Data

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
    wanted = data.published["registered"]["walls"]
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
