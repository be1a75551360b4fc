"""Measures of Wei (2022): velocities, operations and the particles of single steps.

Velocities need the tables `truth` and `estimates`, particles need `particles`.
"""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np
import pandas as pd

from wsnsim.base import metrics
from wsnsim.papers.measures import Data, OwnMeasure


def cloud(data: Data, variant: str, step: int) -> pd.DataFrame:
    """The particles of a step, of all runs."""
    frame = data.of(variant, "particles")
    return frame[frame["step"] == step]


def _distinct(data: Data, variant: str, step: int) -> pd.Series:
    """The fraction of the particles at distinct positions."""
    places = cloud(data, variant, step).groupby("replicate")["x"]
    return places.nunique() / places.size()


def _spread(data: Data, variant: str, step: int) -> pd.Series:
    """The weighted standard deviation of the particles."""
    frame = cloud(data, variant, step)
    found = {
        number: float(np.sqrt(np.cov(one["x"], aweights=one["weight"], ddof=0)))
        for number, one in frame.groupby("replicate")
    }
    return pd.Series(found)


def _column(data: Data, variant: str, column: str) -> pd.Series:
    """The root mean square error of a state column over the steps."""
    runs = np.sort(data.of(variant, "runs")["replicate"].to_numpy())
    return pd.Series([metrics.rmse(row) for row in data.column_errors(variant, column)], index=runs)


def _operations(data: Data, variant: str, other: str) -> pd.Series:
    """The operations that the tracker states, divided by those of another variant."""
    return data.of_runs(variant, "cycles") / data.of_runs(other, "cycles")


def _gain_over_cs_pf(data: Data, variant: str) -> pd.Series:
    """The RMSE of a run of CS-PF with as many particles, less that of the variant."""
    return data.of_runs(variant.replace("ics_pf", "cs_pf"), "rmse") - data.of_runs(variant, "rmse")


MEASURES: Final[dict[str, OwnMeasure]] = {
    **{f"distinct_{step}": partial(_distinct, step=step) for step in (10, 30, 90)},
    **{f"spread_{step}": partial(_spread, step=step) for step in (10, 30, 90)},
    **{f"operations_over_{other}": partial(_operations, other=other) for other in ("pf", "cs_pf")},
    **{f"operations_over_cs_pf_{count}": partial(_operations, other=f"cs_pf, {count}") for count in (30, 100)},
    "gain_over_cs_pf": _gain_over_cs_pf,
    "vx": partial(_column, column="vx"),
    "vy": partial(_column, column="vy"),
}
