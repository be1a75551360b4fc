"""Measures of the frontier: ratios to a twin, and the bound for the measurements that arrived."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import pandas as pd

from wsnsim.papers.toolkit import Data, OwnMeasure, Study, bound_from_events, computing

from . import hypotheses, real_radio, settings
from . import strategies as frontier_strategies
from .bound import SETTLED, nees_of_runs, over_bound, rmse_after
from .figures import FIGURES
from .settings import twin


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
    "over_bound": over_bound,
    "over_bound_settled": partial(over_bound, after=SETTLED),
    "rmse_settled": rmse_after,
    "nees_away": partial(nees_of_runs, near=False),
    "nees_near_walls": partial(nees_of_runs, near=True),
    "state_nees_away": partial(nees_of_runs, near=False, of="state"),
    "state_nees_near_walls": partial(nees_of_runs, near=True, of="state"),
}


def conclusions(data: Data) -> list[str]:
    """Three lines for each radio, and the answers to the hypotheses on the frontier."""
    found, bound = frontier_strategies.strategies(data), frontier_strategies.limit(data)
    return [*frontier_strategies.conclusions(found, bound), *hypotheses.lines(data)]


SUMMARIES: Final = {"conclusions": conclusions, "settings": settings.lines, "answers": hypotheses.lines,
                    "margins": real_radio.choices}  # fmt: skip
EXPERIMENTS: Final[dict[str, Callable[[Study, Any], dict[str, Any]]]] = {
    "settings_ideal": lambda study, _: settings.variants(study, "ideal"),
    "settings_slots": lambda study, _: settings.variants(study, "slots"),
    "margins": real_radio.margins,
    "real_radio": real_radio.variants,
}
__all__ = ["EXPERIMENTS", "FIGURES", "MEASURES", "SUMMARIES"]
