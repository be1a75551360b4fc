"""Pairs of points compared run by run: losses by McNemar's exact test, then a metric by Wilcoxon's signed-rank test.

    pair_columns(here, there, metric) -> {column: value} of one pair
    corrected(rows) -> None        adds the p-values corrected for the number of pairs

Losses are compared first, on all runs. Errors are then compared on the runs in which neither of the two lost its target
at any time: the error of a run that lost it says only how long ago. Other metrics are compared on all runs. P-values
are corrected over all pairs of the comparison (Holm 1979), those of losses and those of the metric separately.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd

from wsnsim.analysis import campaigns, statistics
from wsnsim.base.tables import TABLES

NAN: Final = float("nan")
ERRORS: Final = tuple(column.name for column in TABLES["runs"] if column.of_position)
"""Metrics that are compared on the runs that both points survive."""
DIFFERENCE: Final = ("difference", "difference_low", "difference_high", "effect", "p", "pairs")
WHOLE: Final = ("difference_all", "difference_all_low", "difference_all_high")
LOSSES: Final = ("lost_alone", "baseline_lost_alone", "p_losses")
NUMBERS: Final = (*DIFFERENCE, "p_holm", *WHOLE, *LOSSES, "p_losses_holm", "common")
WILCOXON: Final = "Wilcoxon signed-rank"


def pair_columns(here: pd.DataFrame, there: pd.DataFrame, metric: str) -> dict[str, float]:
    """The differences of a point from its baseline, from their rows of `runs` by replicate.

    `difference` and the columns after it are of the metric, for errors on the runs that both survive;
    `difference_all` is of all runs. `lost_alone` counts the runs that only the point lost at any time,
    `baseline_lost_alone` those that only the baseline lost.
    """
    common = here.index.intersection(there.index)
    one, other = here.loc[common], there.loc[common]
    lost, other_lost = campaigns.ever_lost(one), campaigns.ever_lost(other)
    values, base = (frame[metric].to_numpy(dtype=np.float64) for frame in (one, other))
    kept = ~(lost | other_lost) if metric in ERRORS else np.ones(len(common), dtype=np.bool_)
    whole = found = statistics.paired_difference(values[kept], base[kept])
    if not kept.all():
        whole = statistics.paired_difference(values, base)
    alone, other_alone = int((lost & ~other_lost).sum()), int((other_lost & ~lost).sum())
    losses = (alone, other_alone, statistics.exact_mcnemar(alone, other_alone) if (lost | other_lost).any() else NAN)
    return {
        **dict(zip(DIFFERENCE, found, strict=True)),
        **dict(zip(WHOLE, whole[:3], strict=True)),
        **dict(zip(LOSSES, losses, strict=True)),
        "common": len(common),
    }


def with_pairs(table: pd.DataFrame, pairs: dict[int, dict[str, float]]) -> pd.DataFrame:
    """The table of a comparison with the columns of its pairs, by row; corrected over all pairs."""
    numbers = {name: [pairs.get(row, {}).get(name, NAN) for row in range(len(table))] for name in NUMBERS}
    for raw, adjusted in (("p", "p_holm"), ("p_losses", "p_losses_holm")):
        numbers[adjusted] = statistics.holm(numbers[raw])
    tests = [_test(pairs[row]["pairs"]) if row in pairs else "" for row in range(len(table))]
    return table.assign(**{name: np.array(column, dtype=np.float64) for name, column in numbers.items()}, test=tests)


def _test(pairs: float) -> Any:
    """The name of the test of the metric: exact up to `statistics.EXACT` pairs, then by the normal approximation."""
    if not pairs:
        return ""
    return f"{WILCOXON}, exact" if pairs <= statistics.EXACT else WILCOXON
