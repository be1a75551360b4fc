"""The table `runs` of some variants in memory, as a paper's measures read it."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd


class TablesOfRuns:
    """Data whose tables are those given, by variant."""

    def __init__(self, tables: Mapping[str, pd.DataFrame]) -> None:
        self.tables = tables

    def of(self, variant: str, table: str) -> pd.DataFrame:
        """The rows of a variant."""
        return self.tables[variant]

    def of_runs(self, variant: str, column: str) -> pd.Series:
        """A column by replicate."""
        return self.tables[variant].set_index("replicate")[column]
