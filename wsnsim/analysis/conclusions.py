"""What a comparison concludes: one sentence a pair of points.

sentence(pair, words) -> 'ekf is 21.1 m better than pf in per-run RMSE, 95 % [18, 25], Wilcoxon p = 6.1e-05, ...'

A sentence claims a difference only if the 95 % interval of the median paired difference excludes zero and the p-value,
corrected for the number of pairs, is at most 5 %; a difference in losses only if McNemar's corrected p-value is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from wsnsim.analysis.pairs import ERRORS
from wsnsim.analysis.phrases import counted
from wsnsim.analysis.quantities import run_metric_name
from wsnsim.analysis.statistics import LEAST

LEVEL: Final = 0.05
Pair = Mapping[str, Any]


class PairWords(NamedTuple):
    """The names in a sentence: the point and its baseline, where they are compared, the metric and its unit."""

    point: str
    baseline: str
    group: str
    metric: str
    unit: str


def sentence(pair: Pair, words: PairWords) -> str:
    """What the columns of a pair (`pairs.with_pairs`) say, losses first."""
    clauses = [clause for clause in (_of_losses(pair, words), _of_metric(pair, words)) if clause]
    return (f"{words.group}: " if words.group else "") + "; ".join(clauses)


def shows_difference(pair: Pair) -> bool:
    """Whether the interval of the difference excludes zero and the corrected p-value is at most 5 %."""
    low, high = pair["difference_low"], pair["difference_high"]
    return bool((low > 0.0 or high < 0.0) and pair["p_holm"] <= LEVEL)


def shows_losses(pair: Pair) -> bool:
    """Whether one of the two loses its target in more runs, by McNemar's corrected p-value."""
    return bool(pair["p_losses_holm"] <= LEVEL)


def _of_losses(pair: Pair, words: PairWords) -> str:
    """The clause on losses; empty if no run was lost."""
    if math.isnan(pair["p_losses"]):
        return ""
    alone, other = int(pair["lost_alone"]), int(pair["baseline_lost_alone"])
    test = f"exact McNemar p = {p_value(pair['p_losses_holm'])}, Holm-corrected, {pair['common']:.0f} pairs"
    if not shows_losses(pair):
        return (
            f"no difference in losses is shown between {words.point} and {words.baseline}"
            f" ({counted(alone, 'run')} lost by the former alone, {other} by the latter alone, {test})"
        )
    fewer, more = (words.point, words.baseline) if alone < other else (words.baseline, words.point)
    few, many = sorted((alone, other))
    return f"{fewer} loses its target in fewer runs than {more} ({few} lost by it alone, {many} by the other, {test})"


def _of_metric(pair: Pair, words: PairWords) -> str:
    """The clause on the metric."""
    name, pairs = run_metric_name(words.metric), int(pair["pairs"])
    among = counted(pairs, "pair") + (
        " of runs that both survive" if pairs < pair["common"] and _is_error(words) else ""
    )
    if pairs < LEAST:
        return (
            f"{among} {'is' if pairs == 1 else 'are'} too few to compare {words.point} and {words.baseline} in {name}"
        )
    test = f"Wilcoxon p = {p_value(pair['p_holm'])}, Holm-corrected, {among}"
    value, low, high = (float(pair[key]) for key in ("difference", "difference_low", "difference_high"))
    unit = f" {words.unit}" if words.unit not in ("", "1") else ""
    if not shows_difference(pair):
        return (
            f"no difference in {name} is shown between {words.point} and {words.baseline}:"
            f" median {number(value)}{unit}, 95 % [{number(low)}, {number(high)}], {test}"
        )
    size, *ends = sorted_by_size(value, low, high)
    return (
        f"{words.point} is {number(size)}{unit} {_word(value, words)} than {words.baseline} in {name},"
        f" 95 % [{number(ends[0])}, {number(ends[1])}], {test}"
    )


def _word(value: float, words: PairWords) -> str:
    """'better' or 'worse' of an error, of which less is better; of other metrics, what is the larger."""
    if _is_error(words):
        return "better" if value < 0.0 else "worse"
    return "lower" if value < 0.0 else "higher"


def _is_error(words: PairWords) -> bool:
    return words.metric in ERRORS


def sorted_by_size(value: float, low: float, high: float) -> tuple[float, float, float]:
    """A difference without its sign, and the ends of its interval, the smaller first."""
    return (value, low, high) if value > 0.0 else (-value, -high, -low)


def number(value: float) -> str:
    """A value of a sentence, with three digits."""
    return f"{value:.3g}"


def p_value(value: float) -> str:
    """A p-value with two digits."""
    return f"{value:.2g}"
