"""Measures of figures 2 to 4 and table 1 of Liu (2012): velocity, cost, and the probabilities of the sensors.

The probabilities need the table `tracker_state`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
import pandas as pd

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import ResultError
from wsnsim.papers.measures import Data

TAKES_PART: Final = 0.05
"""Probability above which a sensor takes part [our choice]."""
RUNS: Final = 50
"""Runs of table 1."""


def velocity_over_rkf(data: Data, variant: str) -> pd.Series:
    """The root mean square error of the velocity, divided by that of RKF."""
    one, two = (_velocity(data, name) for name in (variant, _twin(variant)))
    return one / two


def operations_over_rkf(data: Data, variant: str) -> pd.Series:
    """The operations that the tracker states, divided by those of RKF."""
    return data.of_runs(variant, "cycles") / data.of_runs(_twin(variant), "cycles")


def seconds_over_rkf(data: Data, variant: str) -> pd.Series:
    """The processor time of a run, truth and measurements included, divided by that of RKF.

    Runs that are made at once share their time evenly, and not all filters gain as much: --no-batch times single runs.
    """
    return data.of_runs(variant, "cpu_seconds") / data.of_runs(_twin(variant), "cpu_seconds")


def seconds_of_50(data: Data, variant: str) -> pd.Series:
    """The processor time of 50 runs like this one (s), made at once or one by one."""
    return RUNS * data.of_runs(variant, "cpu_seconds")


def taking_part(data: Data, variant: str) -> pd.Series:
    """The number of steps in which a sensor takes part, averaged over all sensors."""
    found = probabilities(data, variant)
    return pd.Series({number: float((chances >= TAKES_PART).sum(axis=0).mean()) for number, chances in found.items()})


def to_neighbours(data: Data, variant: str) -> pd.Series:
    """The fraction of the changes of the most probable sensor that go to a neighbour; NaN without any change."""
    found = {}
    for number, chances in probabilities(data, variant).items():
        leaps = np.abs(np.diff(chances.argmax(axis=1)))
        found[number] = float((leaps[leaps > 0] == 1).mean()) if leaps.any() else float("nan")
    return pd.Series(found)


def in_turn(data: Data, variant: str) -> pd.Series:
    """The fraction of neighbouring sensors that take part in the order of their positions, of those that take part.

    A sensor takes part at the mean of the target's true positions, weighted with the sensor's probability.
    """
    truth, found = data.of(variant, "truth").sort_values("step"), {}
    for number, chances in probabilities(data, variant).items():
        places = truth[(truth["replicate"] == number) & (truth["step"] > 0)]["px"].to_numpy()
        taking = chances[:, (chances >= TAKES_PART).any(axis=0)]
        means = (taking * places[:, None]).sum(axis=0) / taking.sum(axis=0)
        found[number] = float((np.diff(means) > 0.0).mean()) if means.size > 1 else float("nan")
    return pd.Series(found)


def probabilities(data: Data, variant: str) -> Mapping[int, Floats]:
    """(steps, sensors) the probability of each sensor at the steps 1, 2, ..., by replicate.

    Raises:
        ResultError: the tracker recorded no probabilities.
    """
    state = data.of(variant, "tracker_state")
    state = state[state["name"] == "probability"]
    if state.empty:
        raise ResultError(f"{data.folder.path}: '{variant}' has no probabilities in the table tracker_state")
    runs = state.pivot(index=["replicate", "step"], columns="index", values="value").groupby(level="replicate")
    return {int(number): run.to_numpy(dtype=np.float64) for number, run in runs}


def _twin(variant: str) -> str:
    """The same variant with RKF."""
    return variant.replace("imsf", "rkf")


def _velocity(data: Data, variant: str) -> pd.Series:
    runs = np.sort(data.of(variant, "runs")["replicate"].to_numpy())
    return pd.Series(np.sqrt((data.column_errors(variant, "vx") ** 2).mean(axis=1)), index=runs)


_FUNCTIONS: Final = (
    velocity_over_rkf, operations_over_rkf, seconds_over_rkf, seconds_of_50, taking_part, to_neighbours, in_turn,
)  # fmt: skip
MEASURES: Final = {measure.__name__: measure for measure in _FUNCTIONS}
