"""The answer of a comparison in a sentence: which point has the least error, and whether intervals overlap.

    answer(found) -> 'ekf has the smallest median per-run RMSE: 0.412 m, and its 95 % interval overlaps with no other.'

How often the best point loses its target stands beside its error, which is over all runs. Overlap describes the
intervals alone; the paired tests of `conclusions` decide on differences.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any, Final

import pandas as pd

from wsnsim.analysis.answer_network import percent
from wsnsim.analysis.baselines import label
from wsnsim.analysis.comparison import Comparison
from wsnsim.analysis.conclusions import number
from wsnsim.analysis.quantities import run_metric_name
from wsnsim.analysis.statistics import LEAST
from wsnsim.base.tables import MORE_IS_BETTER, ONE_IS_BEST

MOST_SENTENCES: Final = 3
"""Groups up to which each has a sentence of its own (our choice)."""


def answer(found: Comparison) -> str:
    """The sentence; of each group of points in turn if other keys vary, too. Empty if there is nothing to compare."""
    names = found.by or found.keys
    others = [key for key in found.keys if key not in names]
    groups: dict[str, list[int]] = {}
    for row in range(len(found.table)):
        where = ", ".join(f"{key} = {_shown(found.table[key].iloc[row])}" for key in others)
        groups.setdefault(where, []).append(row)
    if len(groups) > MOST_SENTENCES:
        return _counted(found, [found.table.iloc[rows] for rows in groups.values()], names, others)
    said = [(where, _of_group(found, found.table.iloc[rows], names)) for where, rows in groups.items()]
    return " ".join(f"{where}: {text}" if where else text for where, text in said if text)


def _counted(found: Comparison, groups: list[pd.DataFrame], names: tuple[str, ...], others: list[str]) -> str:
    """In how many groups each point is the best, the most frequent one first."""
    ranked = [(known, _order(known, found.metric)) for known in map(_with_value, groups) if len(known) > 1]
    alone = [known.loc[order.index[0]] for known, order in ranked if (order == order.iloc[0]).sum() == 1]
    if not alone:
        return ""
    first, *rest = Counter(_name(best, names) for best in alone).most_common(MOST_SENTENCES)
    more = "".join(f", {point} at {count}" for point, count in rest)
    name = f"{_word(found.metric)} median {run_metric_name(found.metric)}"
    return f"{first[0]} has the {name} at {first[1]} of {len(groups)} values of {' and '.join(others)}{more}."


def _with_value(table: pd.DataFrame) -> pd.DataFrame:
    """The points whose metric is known."""
    return table[table["median"].map(math.isfinite)]


def _order(known: pd.DataFrame, metric: str) -> pd.Series:
    """The ranks of the points, the best first."""
    return known["median"].map(lambda value: _rank(value, metric)).sort_values(kind="stable")


def _of_group(found: Comparison, table: pd.DataFrame, names: tuple[str, ...]) -> str:
    """The sentence on the points of one group; empty if fewer than two have a value."""
    known = _with_value(table)
    if len(known) < 2:
        return ""
    order = _order(known, found.metric)
    best = known.loc[order.index[0]]
    tied = int((known["median"].map(number) == number(best["median"])).sum())  # what is shown must differ
    name, point = f"median {run_metric_name(found.metric)}", _name(best, names)
    value = f"{number(best['median'])}{f' {found.unit}' if found.unit not in ('', '1') else ''}"
    if tied > 1:
        return f"No point alone has the {_word(found.metric)} {name}: {tied} points have {value}."
    rest = _overlap(best, known, names) + _losses(best, known, names, found.lost)
    return f"{point} has the {_word(found.metric)} {name}: {value}{rest}."


def _overlap(best: pd.Series, known: pd.DataFrame, names: tuple[str, ...]) -> str:
    """Whether the interval of the best point overlaps with others."""
    others = known.drop(index=best.name)
    if others.empty or not all(map(math.isfinite, (best["median_low"], *known["median_low"]))):
        return ""
    met = others[(others["median_low"] <= best["median_high"]) & (others["median_high"] >= best["median_low"])]
    if met.empty:
        return ", and its 95 % interval overlaps with no other"
    shown = ", ".join(_name(row, names) for _, row in met.head(3).iterrows())
    more = f" and {len(met) - 3} more" if len(met) > 3 else ""
    paired = " (the paired tests below decide)" if "pairs" in known and (known["pairs"] >= LEAST).any() else ""
    return f", and its 95 % interval overlaps with that of {shown}{more}{paired}"


def _losses(best: pd.Series, known: pd.DataFrame, names: tuple[str, ...], rule: str) -> str:
    """In how many runs the best point loses its target, and which point does so least; empty if it never does."""
    if not best["ever_lost"] > 0.0:
        return ""
    least = known.loc[known["ever_lost"].idxmin()]
    said = f"; it loses the target{f' ({rule})' if rule else ''} in {percent(best['ever_lost'])} of its runs"
    if least["ever_lost"] == best["ever_lost"]:
        return f"{said}, and no other in fewer"
    return f"{said}, {_name(least, names)} in the fewest: {percent(least['ever_lost'])}"


def _rank(value: float, metric: str) -> float:
    """What is least for the best value of a metric."""
    return (
        abs(math.log(value)) if metric in ONE_IS_BEST and value > 0.0 else -value if metric in MORE_IS_BETTER else value
    )


def _word(metric: str) -> str:
    return "most consistent" if metric in ONE_IS_BEST else "largest" if metric in MORE_IS_BETTER else "smallest"


def _name(row: pd.Series, names: tuple[str, ...]) -> str:
    """The point's values of the compared keys."""
    return label(_plain(row[name]) for name in names)


def _shown(value: Any) -> str:
    return label([_plain(value)])


def _plain(value: Any) -> Any:
    return None if value is pd.NA or value != value else value
