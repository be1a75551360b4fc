"""What figure 2 of Ruan (2020) shows beside the size of the errors, a figure a run.

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
