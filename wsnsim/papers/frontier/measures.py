"""Measures of the frontier: ratios to a twin, and the bound for the measurements that arrived."""

from __future__ import annotations

from functools import partial
from typing import Final

import pandas as pd

from wsnsim.papers.bounds_beside import bound_from_events
from wsnsim.papers.frontier import settings
from wsnsim.papers.frontier.strategies import conclusions
from wsnsim.papers.frontier.variants import twin
from wsnsim.papers.measures import Data, OwnMeasure, computing


def _over_twin(data: Data, variant: str, column: str) -> pd.Series:
    """A column of `runs`, each run divided by the same run of the twin."""
    return data.of_runs(variant, column) / data.of_runs(twin(variant), column)


def arrived(data: Data, variant: str) -> pd.Series:
    """The bound (m) of each run for the measurements that arrived; needs events, estimates, clusters."""
    return bound_from_events(data, variant, "arrived")


MEASURES: Final[dict[str, OwnMeasure]] = {
    "rmse_over_twin": partial(_over_twin, column="rmse"),
    "energy_over_twin": partial(_over_twin, column="energy"),
    "arrived": arrived,
    "computing": computing,
}

SUMMARIES: Final = {"conclusions": conclusions, "settings": settings.lines}
