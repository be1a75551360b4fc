"""Measures of figures 6 and 8 of Jiang (2013): number and level of clusters, energy of steps.

They need the tables `clusters` and `energy_steps`. The level of a cluster is the median energy of the network in a
step, over the steps between the one in which it formed and the one in which it hands over [our choice].
"""

from __future__ import annotations

from typing import Final

import pandas as pd

from wsnsim.papers.measures import Data

NEAR: Final = 0.01
"""Relative difference from its cluster's level up to which a step is on it [our choice]."""
ROUNDING: Final = 1e-6
"""Seconds subtracted from formation times, as a cluster acts at the step at whose time it forms."""


def clusters(data: Data, variant: str) -> pd.Series:
    """The number of clusters."""
    return data.of(variant, "clusters").groupby("replicate").size()


def least_level(data: Data, variant: str) -> pd.Series:
    """The lowest level of a cluster (J)."""
    return _levels(data, variant).groupby("replicate").min()


def largest_level(data: Data, variant: str) -> pd.Series:
    """The highest level of a cluster (J)."""
    return _levels(data, variant).groupby("replicate").max()


def on_level(data: Data, variant: str) -> pd.Series:
    """The fraction of all steps, handovers included, that are on the level of their cluster."""
    steps = leveled(data, variant)
    near = (steps["joules"] - steps["level"]).abs() <= NEAR * steps["level"]
    return near.groupby(steps["replicate"]).mean()


def above_level(data: Data, variant: str) -> pd.Series:
    """The energy (J) spent above the clusters' levels, over the steps that are above them."""
    steps = leveled(data, variant)
    above = steps["joules"] - steps["level"]
    return above.where(above > NEAR * steps["level"], 0.0).groupby(steps["replicate"]).sum()


def step_energy(data: Data, variant: str) -> pd.Series:
    """The mean energy of the network in a step (J)."""
    return leveled(data, variant).groupby("replicate")["joules"].mean()


def leveled(data: Data, variant: str) -> pd.DataFrame:
    """One row for each step from 1 on: replicate, step, time, joules, the acting cluster and its level.

    A cluster without a step between its first and its last has no level.
    """
    spent = data.of(variant, "energy_steps").groupby(["replicate", "step"], as_index=False)
    steps = spent.agg({"time": "first", "joules": "sum"})
    steps = steps[steps["step"] > 0].sort_values(["time", "replicate"])
    formed = data.of(variant, "clusters")[["replicate", "cluster", "formed"]].sort_values(["formed", "replicate"])
    formed["formed"] -= ROUNDING
    found = pd.merge_asof(steps, formed, left_on="time", right_on="formed", by="replicate")
    found = found.sort_values(["replicate", "step"]).reset_index(drop=True)
    whole = found.groupby(["replicate", "cluster"])["joules"]
    inside = (whole.cumcount() > 0) & (whole.cumcount(ascending=False) > 0)
    level = found[inside].groupby(["replicate", "cluster"])["joules"].median().rename("level")
    return found.join(level, on=["replicate", "cluster"])


def _levels(data: Data, variant: str) -> pd.Series:
    """The level of each cluster, by replicate and cluster."""
    return leveled(data, variant).dropna(subset="level").groupby(["replicate", "cluster"])["level"].first()


_FUNCTIONS: Final = (clusters, least_level, largest_level, on_level, above_level, step_energy)
MEASURES: Final = {measure.__name__: measure for measure in _FUNCTIONS}
