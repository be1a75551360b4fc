"""A comparison as a table for a terminal.

text(compared) -> str
"""

from __future__ import annotations

import math
import textwrap
from typing import Any, Final

import pandas as pd

from wsnsim.analysis.baselines import label
from wsnsim.analysis.comparison import Comparison
from wsnsim.analysis.comparison_answer import answer
from wsnsim.analysis.pairs import ERRORS
from wsnsim.analysis.phrases import aligned, counted, wrapped
from wsnsim.analysis.plot_data import bracketed
from wsnsim.analysis.quantities import run_metric_name
from wsnsim.analysis.statistics import LEAST
from wsnsim.base.tables import MORE_IS_BETTER, ONE_IS_BEST
from wsnsim.bounds.initial_conditions import FAULTLESS

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
