"""The summary of a result as text, as plain values, in one line, and as HTML for a notebook."""

from __future__ import annotations

import html as markup
import math
from collections.abc import Iterator
from typing import Any, Final

from wsnsim.analysis import beaconing, summary, summary_text
from wsnsim.analysis.phrases import counted
from wsnsim.analysis.quantities import ONLY_IF_NOT_ZERO, QUANTITIES, beside, medians
from wsnsim.experiment import Report
from wsnsim.papers import published
from wsnsim.scenario import resolved

SHOWN: Final = (
    "rmse", "median_error", "nees", "nees_median", "singular", "tracked", "ever_lost", "lost", "lost_limit",
    "lost_window", "energy", "packet_delivery_ratio", "first_death",
)  # fmt: skip
"""The quantities that a notebook shows, where they have a value."""


def text(report: Report, bounds: bool = False) -> str:
    """Return the summary as lines, as `wsnsim run` prints it; `bounds`: with the three bounds of the error."""
    if not report.states:
        return beaconing.text(report)
    values, paper = published(resolved(report.scenario))
    return summary_text.text(report, values, paper, summary.bounds_of_report(report, bounds))


def as_json(report: Report, bounds: bool = False) -> dict[str, Any]:
    """Return the summary as plain values, as `wsnsim run --json` prints it."""
    if not report.states:
        return beaconing.as_json(report)
    values, _ = published(resolved(report.scenario))
    return summary.as_json(report, values, summary.bounds_of_report(report, bounds))


def one_line(report: Report) -> str:
    """Return name, number of runs, error and energy."""
    found = [counted(len(report.summaries), "Monte Carlo run")]
    found += [f"{name} {value}" for key, name, value in _quantities(report) if key in ("rmse", "energy")]
    return f"{report.scenario.name}: {', '.join(found)}"


def html(report: Report, answer: str, place: str, tables: tuple[str, ...]) -> str:
    """Return the summary as HTML: a sentence, what was run, a small table of quantities, and which tables it holds."""
    runs = counted(len(report.summaries), "Monte Carlo run")
    steps = max(int(one.run["steps"]) for one in report.summaries)
    heading = f"{runs} of {counted(steps, 'step')}, seed {report.scenario.seed} ({place})"
    rows = "".join(
        f"<tr><th style='text-align:left'>{markup.escape(name)}</th><td>{markup.escape(value)}</td></tr>"
        for _, name, value in _quantities(report)
    )
    return (
        f"<div><p>{markup.escape(answer)}</p>"
        f"<p><b>{markup.escape(report.scenario.name)}</b>: {markup.escape(heading)}</p>"
        f"<table><tbody>{rows}</tbody></table><p>Tables: {markup.escape(', '.join(tables))}</p></div>"
    )


def _quantities(report: Report) -> Iterator[tuple[str, str, str]]:
    """Yield (key, name, value with unit) of the quantities that have a value."""
    arrays = summary.result_arrays(report)
    unit = report.states[report.position[0]][1] if report.states else "m"
    middles = medians(arrays)
    for key in SHOWN:
        value = QUANTITIES[key].value(arrays)
        if math.isfinite(value) and (value or key not in ONLY_IF_NOT_ZERO):
            more = beside(key, middles, arrays.consistent, unit)
            yield key, QUANTITIES[key].name, QUANTITIES[key].text(value, unit) + (f" ({more})" if more else "")
