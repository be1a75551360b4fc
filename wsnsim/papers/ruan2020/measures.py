"""Measures of Ruan (2020) other than the size of the errors: their growth, what particles save, where targets end."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd

from wsnsim.papers.measures import Data

THIRD: Final = 10
"""Steps in the first and in the last third of a run [our choice]."""


def growth(data: Data, variant: str) -> pd.Series:
    """The root mean square error of the last third of a run, less that of the first third (m)."""
    errors = data.errors(variant)
    first, last = (np.sqrt((part**2).mean(axis=1)) for part in (errors[:, :THIRD], errors[:, -THIRD:]))
    return pd.Series(last - first, index=np.sort(data.of(variant, "runs")["replicate"].to_numpy()))


def saved(data: Data, variant: str) -> pd.Series:
    """The fraction by which the RMSE of a run with 200 particles is below that with 50."""
    kind = variant.partition(", ")[0]
    return 1.0 - data.of_runs(f"{kind}, 200", "rmse") / data.of_runs(f"{kind}, 50", "rmse")


def end(data: Data, variant: str) -> pd.Series:
    """The distance from the start of the ground-truth trajectory to its end (m)."""
    runs = data.of(variant, "truth").sort_values("step").groupby("replicate")[["px", "py"]]
    return pd.Series(np.hypot(*(runs.last() - runs.first()).to_numpy().T), index=runs.last().index)


_FUNCTIONS: Final = (growth, saved, end)
MEASURES: Final = {measure.__name__: measure for measure in _FUNCTIONS}
