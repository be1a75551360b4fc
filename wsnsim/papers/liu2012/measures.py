"""What figures 1 to 4 and table 1 of Liu (2012) show, a figure a run.

measure(data, variant) -> a Series by replicate          as `measures` takes them: 'median_of:<this module>:<name>'
probabilities(data, variant) -> {replicate: (steps, sensors)}       what figures 3 and 4 show of each run

Probabilities are no column of any table: the runs are made again to read them, and held against what was recorded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
import pandas as pd

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import ResultError
from wsnsim.base.ports import Estimate
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import Memory
from wsnsim.experiment import replicate_of
from wsnsim.papers.measures import Data
from wsnsim.scenario import build, load

TAKES_PART: Final = 0.05
"""Probability from which a sensor takes part [our choice]."""
RUNS: Final = 50
"""Runs of table 1."""
SAME: Final = 1e-9
"""By how much an estimate (m, m/s) may differ if it is made again: what another order of additions leaves."""
_SEEN: Final[WeakKeyDictionary[Data, dict[str, Mapping[int, Floats]]]] = WeakKeyDictionary()
"""Probabilities by variant, as long as their data are held."""


def velocity_over_rkf(data: Data, variant: str) -> pd.Series:
    """The root mean square error of the velocity over that of RKF."""
    one, two = (_velocity(data, name) for name in (variant, _twin(variant)))
    return one / two


def operations_over_rkf(data: Data, variant: str) -> pd.Series:
    """The operations that the tracker stated, over those of RKF."""
    return _column(data, variant, "cycles") / _column(data, _twin(variant), "cycles")


def seconds_over_rkf(data: Data, variant: str) -> pd.Series:
    """The processor time of a run over that of RKF, truth and readings included."""
    return _column(data, variant, "cpu_seconds") / _column(data, _twin(variant), "cpu_seconds")


def seconds_of_50(data: Data, variant: str) -> pd.Series:
    """The processor time of 50 runs like this one (s)."""
    return RUNS * _column(data, variant, "cpu_seconds")


def taking_part(data: Data, variant: str) -> pd.Series:
    """At how many steps a sensor takes part, the mean over all sensors."""
    found = probabilities(data, variant)
    return pd.Series({number: float((chances >= TAKES_PART).sum(axis=0).mean()) for number, chances in found.items()})


def to_neighbours(data: Data, variant: str) -> pd.Series:
    """Of the changes of the most probable sensor, the share that goes to a neighbour; not a number without any."""
    found = {}
    for number, chances in probabilities(data, variant).items():
        leaps = np.abs(np.diff(chances.argmax(axis=1)))
        found[number] = float((leaps[leaps > 0] == 1).mean()) if leaps.any() else float("nan")
    return pd.Series(found)


def in_turn(data: Data, variant: str) -> pd.Series:
    """Of neighbouring sensors that take part, the share that does so in the order in which they stand.

    Where a sensor takes part is the mean of the target's true places, weighed with the sensor's probability.
    """
    truth, found = data.of(variant, "truth").sort_values("step"), {}
    for number, chances in probabilities(data, variant).items():
        places = truth[(truth["replicate"] == number) & (truth["step"] > 0)]["px"].to_numpy()
        chances = chances[:, (chances >= TAKES_PART).any(axis=0)]
        means = (chances * places[:, None]).sum(axis=0) / chances.sum(axis=0)
        found[number] = float((np.diff(means) > 0.0).mean()) if means.size > 1 else float("nan")
    return pd.Series(found)


def probabilities(data: Data, variant: str) -> Mapping[int, Floats]:
    """(steps, sensors) the probability of each sensor at the steps 1, 2, ... of each run; needs `estimates`.

    Raises:
        ResultError: the runs, made again, give other estimates than those recorded.
    """
    seen = _SEEN.setdefault(data, {})
    if variant not in seen:
        seen[variant] = made_again(data, variant)
    return seen[variant]


def made_again(data: Data, variant: str) -> Mapping[int, Floats]:
    """As `probabilities`, run by run."""
    problem = build(load(dict(data.scenario(variant))))
    assert isinstance(problem, TrackingSetup), "figures 3 and 4 have a target"
    recorded, found = data.of(variant, "estimates"), {}
    for replicate in sorted(data.of(variant, "runs")["replicate"].tolist()):
        watched, memory = _Watched(problem.tracker), Memory({"estimates": True})
        replicate_of(replace(problem, tracker=watched), replicate, memory)
        if not _alike(memory.table("estimates"), recorded[recorded["replicate"] == replicate]):
            raise ResultError(
                f"{data.folder.path}: replicate {replicate} of '{variant}' gives other estimates now: "
                "another version wrote it"
            )
        found[replicate] = np.array(watched.seen)
    return found


def _alike(now: Mapping[str, np.ndarray], then: pd.DataFrame) -> bool:
    """Whether two tables of estimates of one run are equal but for rounding."""
    then = then.sort_values("step")
    return len(now["step"]) == len(then) and all(
        np.allclose(now[column], then[column], rtol=SAME, atol=SAME, equal_nan=True) for column in ("px", "vx", "ax")
    )


class _Watched:
    """A tracker whose sensor probabilities are kept, step by step."""

    def __init__(self, tracker: Any) -> None:
        self._tracker = tracker
        self.seen: list[Floats] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._tracker, name)

    def estimate(self, belief: Any) -> Estimate:
        """The tracker's own, which is asked for once a step."""
        self.seen.append(belief.probabilities.copy())
        estimate: Estimate = self._tracker.estimate(belief)
        return estimate


def _twin(variant: str) -> str:
    """The same with RKF."""
    return variant.replace("imsf", "rkf")


def _column(data: Data, variant: str, column: str) -> pd.Series:
    return data.of(variant, "runs").set_index("replicate")[column].astype(np.float64)


def _velocity(data: Data, variant: str) -> pd.Series:
    runs = np.sort(data.of(variant, "runs")["replicate"].to_numpy())
    return pd.Series(np.sqrt((data.column_errors(variant, "vx") ** 2).mean(axis=1)), index=runs)
