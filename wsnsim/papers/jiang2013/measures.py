"""What figure 6 of Jiang (2013) shows, a figure a run.

measure(data, variant) -> a Series by replicate          as `measures` takes them: 'mean_of:<this module>:<name>'

They need the tables `clusters` and `energy_steps`. A cluster's level is the median of what the network
spends in a step, over the steps between the one in which it formed and the one in which it hands over [our choice].
"""

from __future__ import annotations

from typing import Final

import pandas as pd

from wsnsim.papers.measures import Data

NEAR: Final = 0.01
"""Share of its cluster's level by which a step may differ and still be on it [our choice]."""

ROUNDING: Final = 1e-6
"""Seconds: a cluster acts at the step at whose time it forms."""


def clusters(data: Data, variant: str) -> pd.Series:
    """How many clusters there were."""
    return data.of(variant, "clusters").groupby("replicate").size()


def least_level(data: Data, variant: str) -> pd.Series:
    """The lowest level of a cluster (J)."""
    return _levels(data, variant).groupby("replicate").min()


def largest_level(data: Data, variant: str) -> pd.Series:
    """The highest level of a cluster (J)."""
    return _levels(data, variant).groupby("replicate").max()


def on_level(data: Data, variant: str) -> pd.Series:
    """The share of all steps, those of handovers included, that are on the level of their cluster."""
    steps = leveled(data, variant)
    near = (steps["joules"] - steps["level"]).abs() <= NEAR * steps["level"]
    return near.groupby(steps["replicate"]).mean()


def leveled(data: Data, variant: str) -> pd.DataFrame:
    """A row a step from 1 on: replicate, step, time, joules, the cluster that acts, and that cluster's level.

    A cluster that is too short to have a step of its own between its first and its last has none.
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
