"""How wrong the clocks of nodes are at the end of runs, from the table `clocks`, for summaries.

figures(report) -> dict        rows(figures) -> [(name, value)]
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from wsnsim.base.results import Report
from wsnsim.recording import read_table

COLUMNS: Final = ("error", "error_max", "spread", "spread_max", "synchronised")
UNITS: Final = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def figures(report: Report) -> dict[str, float]:
    """The columns of `clocks` at the end of runs, mean over runs, with names such as `clock_error`.

    NaN where the table was not recorded.
    """
    if not dict(report.scenario.record).get("clocks"):
        return {f"clock_{name}": math.nan for name in COLUMNS}
    table = read_table(report.out, "clocks", ["replicate", *COLUMNS])
    last = np.flatnonzero(np.diff(table["replicate"].astype(np.int64), append=-1))
    return {f"clock_{name}": float(table[name][last].mean()) if last.size else math.nan for name in COLUMNS}


def rows(figures: Mapping[str, float]) -> list[tuple[str, str]]:
    """The lines of a summary; none where clocks were not recorded or show the true time."""
    if not figures["clock_error_max"] > 0.0:
        return []
    error, spread = (
        f"{_seconds(figures[f'clock_{name}'])}, at most {_seconds(figures[f'clock_{name}_max'])}"
        for name in ("error", "spread")
    )
    result = [("clocks from true time at the end", error), ("clocks from their mean at the end", spread)]
    if figures["clock_synchronised"] > 0.0:
        result.append(("nodes that take their clock for synchronised", f"{figures['clock_synchronised']:.0%}"))
    return result


def _seconds(time: float) -> str:
    """A time in the largest unit of which it is at least one."""
    size, unit = next(((size, unit) for size, unit in UNITS if time >= size), UNITS[-1])
    return f"{time / size:.3g} {unit}"
