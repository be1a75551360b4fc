"""What Ruan (2020) says beside the size of the errors, a figure a run.

measure(data, variant) -> a Series by replicate          as `measures` takes them: 'median_of:<this module>:<name>'
"""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd

from wsnsim.papers.measures import Data

THIRD: Final = 10
"""Steps: the first and the last third of a run [our choice]."""


def growth(data: Data, variant: str) -> pd.Series:
    """By how much the root mean square error of the last third is above that of the first (m)."""
    errors = data.errors(variant)
    first, last = (np.sqrt((part**2).mean(axis=1)) for part in (errors[:, :THIRD], errors[:, -THIRD:]))
    return pd.Series(last - first, index=np.sort(data.of(variant, "runs")["replicate"].to_numpy()))


def saved(data: Data, variant: str) -> pd.Series:
    """By what share the RMSE of a run with 200 particles is below that with 50."""
    kind = variant.partition(", ")[0]
    many, few = (data.of(f"{kind}, {count}", "runs").set_index("replicate")["rmse"] for count in (200, 50))
    return 1.0 - many / few
