"""A comparison as a table for a terminal, and its answer in a sentence: which point has the least error.

    text(compared) -> str
    answer(found) -> 'ekf has the smallest median per-run RMSE: 0.412 m, and its 95 % interval overlaps with no other.'

How often the best point loses its target stands beside its error, which is over all runs. Overlap describes the
intervals alone; the paired tests of `conclusions` decide on differences.
"""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from typing import Any, Final

import pandas as pd

from wsnsim.analysis.answer import percent
from wsnsim.analysis.campaign_info import label
from wsnsim.analysis.comparison import Comparison
from wsnsim.analysis.conclusions import ERRORS, number
from wsnsim.analysis.phrases import aligned, counted, wrapped
from wsnsim.analysis.plot_data import bracketed
from wsnsim.analysis.quantities import run_metric_name
from wsnsim.analysis.statistics import LEAST
from wsnsim.base.tables import MORE_IS_BETTER, ONE_IS_BEST
from wsnsim.bounds.least_errors import FAULTLESS

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
    best = known.loc[_order(known, found.metric).index[0]]
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


WIDTH: Final = 120
"""Characters of a line of a conclusion."""
ENERGY: Final = "energy"
"""The metric that is the energy itself."""
SEEN: Final = 0.995
"""Share of tracked steps above which the column `tracked` is left out."""


def text(found: Comparison) -> str:
    """The answer in a sentence, the table, a line per point, and below it what the columns mean."""
    table = found.table
    heads, rows = columns(found)
    counts = table["replicates"]
    many = f"{counts.min()}" if counts.min() == counts.max() else f"{counts.min()} to {counts.max()}"
    title = f"{found.name}: {len(table)} point{'s' * (len(table) != 1)}, {many} run{'s' * (many != '1')} each"
    return "\n".join(
        [
            *wrapped(answer(found)),
            title,
            *aligned([heads, *rows], len(found.keys)),
            *_conclusions(found),
            *_notes(found),
        ]
    )


def _conclusions(found: Comparison) -> list[str]:
    """A sentence a pair, wrapped, and its hint below it."""
    if "conclusion" not in found.table:
        return []
    lines = []
    for sentence, hint in zip(found.table["conclusion"], found.table["hint"], strict=True):
        lines += textwrap.wrap(sentence, WIDTH, initial_indent="- ", subsequent_indent="  ")
        lines += textwrap.wrap(f"hint: {hint}" if hint else "", WIDTH, initial_indent="  ", subsequent_indent="  ")
    return lines


def columns(found: Comparison) -> tuple[list[str], list[list[str]]]:
    """Return the headings of the table, and the cells of each row as texts."""
    table, unit = found.table, found.unit
    name = run_metric_name(found.metric)
    heading = f"{name}{bracketed(unit)}"
    columns: list[tuple[str, list[str]]] = [(key, [_setting(value) for value in table[key]]) for key in found.keys]
    if table["replicates"].nunique() > 1:
        columns.append(("runs", [str(count) for count in table["replicates"]]))
    columns.append((f"median {heading}", [_spread(row, "median") for _, row in table.iterrows()]))
    columns.append(("mean", [_number(value) for value in table["mean"]]))
    if found.metric == "nees":
        columns.append(("median over steps", [_number(value) for value in table["nees_median"]]))
        columns.append(("singular", [f"{value:.0f}" for value in table["singular"]]))
    if "bound" in table and table["bound"].notna().any():
        columns.append(
            ("CRLB" + " without faults" * (FAULTLESS in found.of_bounds), [_number(value) for value in table["bound"]])
        )
    if (table["tracked"] < SEEN).any():
        columns.append(("tracked", [f"{100.0 * value:.0f} %" for value in table["tracked"]]))
    columns.append(("lost at any time", [_share(row) for _, row in table.iterrows()]))
    if found.metric != "lost" and (table["lost_fraction"] != table["ever_lost"]).any():
        columns.append(("at the end", [f"{100.0 * value:.0f} %" for value in table["lost_fraction"]]))
    if found.metric != ENERGY and table["energy"].notna().any() and (table["energy"] > 0).any():
        columns.append(("energy [J]", [_spread(row, "energy") for _, row in table.iterrows()]))
    if _per_joule(found):
        columns.append((f"{name}/J", [_number(value) for value in table["error_per_joule"]]))
        columns.append(("Pareto", ["*" if flag else "" for flag in table["front"]]))
    if "difference" in table and table["pairs"].notna().any():
        columns.append(("difference", [_spread(row, "difference") for _, row in table.iterrows()]))
        columns.append(("effect", [_number(value, 2) for value in table["effect"]]))
        columns.append(("Wilcoxon p", [_number(value, 2) for value in table["p_holm"]]))
        if table["p_losses"].notna().any():
            columns.append(("McNemar p of losses", [_number(value, 2) for value in table["p_losses_holm"]]))
    cells = [values for _, values in columns]
    return [head for head, _ in columns], [list(row) for row in zip(*cells, strict=True)]


def _notes(found: Comparison) -> list[str]:
    table = found.table
    name = run_metric_name(found.metric)
    notes = ["  [ , ]: 95 % confidence intervals, of medians and differences by bootstrap, of shares by Wilson's score"]
    if table["replicates"].max() < LEAST:
        notes = [
            f"  [ , ]: 95 % confidence intervals of shares by Wilson's score; of medians only from {LEAST} runs on"
        ]
    notes += [f"  lost: {found.lost}"] if found.lost else []
    if found.metric in ONE_IS_BEST:
        notes.append(f"  {name}: per degree of freedom; 1 is consistent, above 1 overconfident, below 1 cautious")
    if found.metric == "nees":
        notes.append(
            "  median over steps: of each run, median over runs; a consistent filter has 0.69 in the plane, 0.45 on a\n"
            "  line; singular: steps of all runs with a singular covariance, which have no NEES"
        )
    if _per_joule(found):
        notes.append(f"  {name}/J: falls with every joule spent, so a smaller value alone is not better: see Pareto")
    if (table["tracked"] < SEEN).any():
        notes.append(
            f"  tracked: share of the steps with an estimate in time; {name} is over the steps with an estimate"
        )
    better = "larger" if found.metric in MORE_IS_BETTER else "smaller"
    among = "point of its group" if found.by and set(found.keys) - set(found.by) else "point"
    if _per_joule(found) and table["front"].any():
        notes.append(
            f"  Pareto: * is on the Pareto front: no other {among} has both a {better} median {name} and less\n"
            "  energy; points with more than 5 % of their runs lost at any time are left out"
        )
    if "difference" in table and table["pairs"].notna().any():
        notes.append(
            f"  difference: median over runs of the paired difference from {found.baseline}{_survivors(found)};\n"
            "  effect: rank-biserial correlation, from -1 (always less) to 1 (always more);\n"
            "  Wilcoxon p: signed-rank test, Holm-corrected over all pairs; the interval is of each pair alone"
        )
        if table["p_losses"].notna().any():
            notes.append("  McNemar p: exact test of runs lost by one of the two alone, Holm-corrected over all pairs")
    if "bound" in table and table["bound"].notna().any():
        notes.append(
            "  CRLB: trajectory-conditional Cramer-Rao lower bound of all readings in range, median over runs;\n"
            "  not a strict bound: a filter may be below it on some trajectories (--json also has the posterior CRLB)"
        )
    unknown = int((table["replicates"] - table["known"]).sum())
    if unknown:
        notes.append(f"  without {name}: {counted(unknown, 'run')}; medians and means are over the others")
    notes += [f"  no bound: {found.unbounded}"] if found.unbounded else []
    notes += [f"  of the bound: {found.of_bounds}"] if found.of_bounds else []
    notes += [f"  {found.same}"] if found.same else []
    return [*notes, f"  {found.unpaired}"] if found.unpaired else notes


def _per_joule(found: Comparison) -> bool:
    """Whether metric per joule and Pareto front are shown.

    They are not without energy, nor of the energy itself, nor of a metric of which 1 is best.
    """
    return found.metric != ENERGY and found.metric not in ONE_IS_BEST and bool((found.table["energy"] > 0).any())


def _survivors(found: Comparison) -> str:
    """On which runs errors are compared, if some were lost."""
    lost = found.metric in ERRORS and (found.table["pairs"] < found.table["common"]).any()
    return (
        ",\n  over the runs in which neither lost its target at any time (difference_all: over all runs)"
        if lost
        else ""
    )


def _setting(value: Any) -> str:
    return "-" if value is None or value is pd.NA or value != value else label([value])


def _number(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}g}" if math.isfinite(value) else "-"


def _spread(row: pd.Series, name: str) -> str:
    value, low, high = (float(row[key]) for key in (name, f"{name}_low", f"{name}_high"))
    if not math.isfinite(value):
        return "-"
    return f"{_number(value)} [{_number(low)}, {_number(high)}]" if math.isfinite(low) else _number(value)


def _share(row: pd.Series) -> str:
    value, low, high = (100.0 * float(row[f"ever_lost{end}"]) for end in ("", "_low", "_high"))
    return f"{value:.0f} % [{low:.0f}, {high:.0f}]"
