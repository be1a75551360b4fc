"""The summary table of a page: one row per summary quantity with its 95 % interval, one column per result."""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.analysis import recorded_bounds
from wsnsim.analysis.quantities import (
    BOUND_NAMES,
    BOUND_NOTE,
    QUANTITIES,
    position_unit,
    read_arrays,
    worth_showing,
)
from wsnsim.base.errors import ResultError
from wsnsim.recording import read_json

PublishedValues = tuple[Mapping[str, float], str]
"""Values by quantity, and the paper's name."""
PublishedLookup = Callable[[Mapping[str, Any]], PublishedValues]
"""A function that returns the published values of a resolved scenario."""
MIN_RUNS: Final = 5
"""Least number of Monte Carlo runs for an interval."""
RUNS: Final = "Monte Carlo runs"
PUBLISHED_KEYS: Final = ("rmse", "energy")
Cells = dict[str, str]


def summary_table(
    results: Sequence[Path], names: Sequence[str], published: PublishedLookup | None = None, plugins: bool = False
) -> str:
    """The table as HTML. A quantity that no result has is left out.

    `plugins` says whether plug-ins that a result's scenario names are imported for the bounds.
    """
    columns = [_cells(path, published, plugins) for path in results]
    first, *others = (quantity.name for quantity in QUANTITIES.values())
    order = [RUNS, first, *BOUND_NAMES.values(), *others]
    labels = [label for label in order if any(label in column for column in columns)]
    if not labels:
        return "<p>There is no summary: no run has finished.</p>"
    head = "".join(f'<th scope="col">{_breakable(name)}</th>' for name in names)
    rows = "".join(
        f'<tr><th scope="row">{html.escape(label)}</th>'
        + "".join(f"<td>{column.get(label, '')}</td>" for column in columns)
        + "</tr>\n"
        for label in labels
    )
    return (
        f'<div class="wide" tabindex="0" role="region" aria-label="Summary"><table>\n'
        f'<thead><tr><th scope="col">over all runs</th>{head}</tr></thead>\n<tbody>\n{rows}'
        "</tbody></table></div>\n"
        f'<p class="small">In brackets: 95 % bootstrap intervals over runs, for {MIN_RUNS} runs or more. '
        f"{BOUND_NOTE[0].upper()}{BOUND_NOTE[1:]}.</p>"
    )


def _breakable(name: str) -> str:
    """A result's name as the head of its column, with line breaks allowed after '_', '/' and ','."""
    broken = re.sub("([_/,])", r"\1<wbr>", html.escape(name))
    return f"<bdi>{broken}</bdi>"


def _cells(path: Path, published: PublishedLookup | None, plugins: bool) -> Cells:
    """The summary quantities of a result by name, as HTML."""
    values, paper = _published_values(path, published)
    arrays, unit = read_arrays(path), position_unit(path)
    cells: Cells = {}
    if arrays.errors.size and not np.isfinite(arrays.errors).any():
        cells[QUANTITIES["rmse"].name] = "no estimate"
    for key, value in worth_showing(arrays).items():
        quantity = QUANTITIES[key]
        low, high = quantity.interval(arrays)
        bounds = quantity.interval_text(low, high) if low < high else ""
        cells[quantity.name] = html.escape(quantity.text(value, unit)) + _small(bounds)
        if key in PUBLISHED_KEYS and key in values:
            cells[quantity.name] += _small(f"published {quantity.text(values[key], unit)} ({paper})")
    if arrays.errors.size:
        cells |= {
            BOUND_NAMES[readings]: html.escape(QUANTITIES["rmse"].text(bound, unit))
            for readings, bound in recorded_bounds.time_averages(path, plugins).items()
        }
    if arrays.runs and arrays.runs["replicate"].size:
        cells[RUNS] = str(arrays.runs["replicate"].size)
    return cells


def _small(text: str) -> str:
    return f' <span class="small">{html.escape(text)}</span>' if text else ""


def _published_values(path: Path, published: PublishedLookup | None) -> PublishedValues:
    """The published values of the result's scenario."""
    if published is None:
        return {}, ""
    try:
        return published(read_json(path, "scenario/resolved_json"))
    except (ResultError, ValueError):
        return {}, ""
