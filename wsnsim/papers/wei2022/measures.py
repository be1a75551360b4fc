"""What figures 5 to 7 and 9 to 10 of Wei (2022) show, a figure a run.

measure(data, variant) -> a Series by replicate          as `measures` takes them: 'mean_of:<this module>:<name>'

Velocities need the tables `truth` and `estimates`, clouds need `particles`.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd

from wsnsim.base import metrics
from wsnsim.papers.measures import Data


def cloud(data: Data, variant: str, step: int) -> pd.DataFrame:
    """The particles of a step, of all runs."""
    frame = data.of(variant, "particles")
    return frame[frame["step"] == step]


def _distinct(data: Data, variant: str, step: int) -> pd.Series:
    """Distinct places among the particles, as a share of them."""
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
    """The operations that the tracker stated, over those of another variant."""
    one, two = (_of_runs(data, name, "cycles") for name in (variant, other))
    return one / two


def gain_over_cs_pf(data: Data, variant: str) -> pd.Series:
    """By how much the RMSE of a run is below that of CS-PF with as many particles."""
    one, two = (_of_runs(data, name, "rmse") for name in (variant, variant.replace("ics_pf", "cs_pf")))
    return two - one


def _of_runs(data: Data, variant: str, column: str) -> pd.Series:
    return data.of(variant, "runs").set_index("replicate")[column].astype(np.float64)


distinct_10, distinct_30, distinct_90 = (partial(_distinct, step=step) for step in (10, 30, 90))
spread_10, spread_30, spread_90 = (partial(_spread, step=step) for step in (10, 30, 90))
operations_over_pf, operations_over_cs_pf = (partial(_operations, other=other) for other in ("pf", "cs_pf"))
operations_over_cs_pf_30, operations_over_cs_pf_100 = (
    partial(_operations, other=f"cs_pf, {count}") for count in (30, 100)
)
vx, vy = (partial(_column, column=column) for column in ("vx", "vy"))
