"""The summary tables of a page: a row per summary quantity with its 95 % interval, a column per result.

The first table has the quantities that most readers ask for, the second one, which is folded, all others. The name of a
quantity is explained by its definition.
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from wsnsim.analysis import recorded_bounds
from wsnsim.analysis.quantities import (
    BOUND_NAMES,
    BOUND_NOTE,
    QUANTITIES,
    beside,
    bound_name,
    flagged,
    medians,
    worth_showing,
)
from wsnsim.analysis.result_facts import facts_of_file
from wsnsim.analysis.summary_text import PublishedLookup
from wsnsim.base.errors import ResultError
from wsnsim.recording import read_json

MIN_RUNS: Final = 5
"""Least number of Monte Carlo runs for an interval."""
RUNS: Final = "Monte Carlo runs"
PUBLISHED_KEYS: Final = ("rmse", "energy")
BOUNDS: Final = [bound_name(readings, faults) for readings in BOUND_NAMES for faults in ((), ("stuck",))]
EXPLAINED: Final = (
    {quantity.name: quantity.definition for quantity in QUANTITIES.values()}
    | dict.fromkeys(BOUNDS, BOUND_NOTE)
    | {RUNS: "independent repetitions of the scenario, each with random numbers of its own"}
)
"""The explanation of each row by its name."""
Cells = dict[str, str]


def summary_table(
    results: Sequence[Path],
    names: Sequence[str],
    published: PublishedLookup | None = None,
    plugins: bool = False,
    bounds: bool = False,
) -> str:
    """The tables as HTML. A quantity that no result has is left out.

    Args:
        results: result files.
        names: their names in the page.
        published: gives the published values of a scenario.
        plugins: whether plug-ins that a result's scenario names are imported for the bounds.
        bounds: whether the three trajectory-conditional CRLBs are shown.
    """
    columns = [_cells(path, published, plugins, bounds) for path in results]
    order = [RUNS, QUANTITIES["rmse"].name, *BOUNDS, *(each.name for each in QUANTITIES.values())]
    labels = [label for label in dict.fromkeys(order) if any(label in column for column in columns)]
    if not labels:
        return "<p>There is no summary: no run has finished.</p>"
    first = {RUNS, *BOUNDS, *(QUANTITIES[key].name for key in flagged("page"))}
    some, others = ([label for label in labels if (label in first) == wanted] for wanted in (True, False))
    notes = [f"In brackets: 95 % bootstrap intervals over runs, for {MIN_RUNS} runs or more."]
    notes += [f"{BOUND_NOTE[0].upper()}{BOUND_NOTE[1:]}."] if bounds and {*BOUNDS} & {*labels} else []
    folded = (
        f"<details><summary>Other quantities</summary>\n{_table(others, columns, names)}</details>\n" if others else ""
    )
    return f'{_table(some, columns, names)}{folded}<p class="small">{" ".join(notes)}</p>'


def _table(labels: Sequence[str], columns: Sequence[Cells], names: Sequence[str]) -> str:
    """A table with a row per label."""
    head = "".join(f'<th scope="col">{_breakable(name)}</th>' for name in names)
    rows = "".join(
        f'<tr><th scope="row">{explained(label, EXPLAINED[label])}</th>'
        + "".join(f"<td>{column.get(label, '')}</td>" for column in columns)
        + "</tr>\n"
        for label in labels
    )
    return (
        f'<div class="wide" tabindex="0" role="region" aria-label="Summary"><table>\n'
        f'<thead><tr><th scope="col">over all runs</th>{head}</tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n'
    )


def explained(term: str, explanation: str) -> str:
    """A term as HTML, with an explanation on hover, on focus and by tap."""
    return f'<span class="term" tabindex="0" data-tip="{html.escape(explanation)}">{html.escape(term)}</span>'


def _breakable(name: str) -> str:
    """A result's name as the head of its column, with line breaks allowed after '_', '/' and ','."""
    broken = re.sub("([_/,])", r"\1<wbr>", html.escape(name))
    return f"<bdi>{broken}</bdi>"


def _cells(path: Path, published: PublishedLookup | None, plugins: bool, bounds: bool) -> Cells:
    """The summary quantities of a result by name, as HTML."""
    values, paper = _published_values(path, published)
    facts = facts_of_file(path)
    unit = facts.unit
    cells: Cells = {}
    errors = facts.recorded.errors
    if errors.size and not np.isfinite(errors).any():
        cells[QUANTITIES["rmse"].name] = "no estimate"
    middles = medians(facts)
    for key, value in worth_showing(facts).items():
        quantity = QUANTITIES[key]
        low, high = quantity.interval(facts)
        ends = quantity.interval_text(low, high) if low < high else ""
        cells[quantity.name] = html.escape(quantity.text(value, unit)) + _small(ends)
        cells[quantity.name] += _small(beside(key, middles, facts.consistent, unit))
        if key in PUBLISHED_KEYS and key in values:
            cells[quantity.name] += _small(f"published {quantity.text(values[key], unit)} ({paper})")
    if errors.size and bounds:
        cells |= {
            bound_name(readings, facts.faults): html.escape(QUANTITIES["rmse"].text(bound, unit))
            for readings, bound in recorded_bounds.time_averages(path, plugins).items()
        }
    if facts.count:
        cells[RUNS] = str(facts.count)
    return cells


def _small(text: str) -> str:
    return f' <span class="small">{html.escape(text)}</span>' if text else ""


def _published_values(path: Path, published: PublishedLookup | None) -> tuple[Mapping[str, float], str]:
    """The published values of the result's scenario."""
    if published is None:
        return {}, ""
    try:
        return published(read_json(path, "scenario/resolved_json"))
    except (ResultError, ValueError):
        return {}, ""
