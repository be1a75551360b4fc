"""The summary of a result in one line, and as HTML for a notebook."""

from __future__ import annotations

import html as markup
import math
from collections.abc import Iterator
from typing import Final

from wsnsim.analysis.phrases import counted
from wsnsim.analysis.quantities import ONLY_IF_NOT_ZERO, QUANTITIES, beside, medians
from wsnsim.analysis.result_facts import facts_of_report
from wsnsim.experiment import Report

SHOWN: Final = (
    "rmse", "median_error", "nees", "nees_median", "singular", "tracked", "ever_lost", "lost", "lost_limit",
    "lost_window", "energy", "packet_delivery_ratio", "first_death",
)  # fmt: skip
"""The quantities that a notebook shows, where they have a value."""


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
    facts = facts_of_report(report)
    middles = medians(facts)
    for key in SHOWN:
        value = QUANTITIES[key].value(facts)
        if math.isfinite(value) and (value or key not in ONLY_IF_NOT_ZERO):
            more = beside(key, middles, facts.consistent, facts.unit)
            yield key, QUANTITIES[key].name, QUANTITIES[key].text(value, facts.unit) + (f" ({more})" if more else "")
