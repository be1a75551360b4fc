"""The sections of a page, as HTML: what each result is, its summary, its figures, its scenario and its provenance.

Every text from a result is escaped. It stands in an element of its own, so that its writing direction does not affect
the text around it. The first table of the summary has the quantities that most readers ask for, the second one, which
is folded, all others. The name of a quantity is explained by its definition.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.analysis import error_bounds, quantities
from wsnsim.analysis.quantities import BOUND_NOTE, QUANTITIES, beside, bound_name, flagged, medians, worth_showing
from wsnsim.analysis.result_facts import facts_of_file
from wsnsim.analysis.summary_text import PublishedLookup
from wsnsim.base.errors import ResultError
from wsnsim.recording import read_json
from wsnsim.report.replay import Replay
from wsnsim.report.scenario_words import isolated, scenario_html
from wsnsim.report.svg_figures import SvgFigure

MAX_FINGERPRINTS: Final = 30
TAG: Final = re.compile(r"<[^>]*>")
ID: Final = re.compile(r'(\bid="|href="#|url\(#)')


@dataclass(frozen=True)
class PageSection:
    """What the page shows of one result.

    Attributes:
        info: the answer of `wsnsim info`.
        path: the result file.
        name: name of the result in the page.
        replicate: the run that is replayed.
        figures: figures, the most important first.
        left_out: reasons for missing figures.
    """

    info: Mapping[str, Any]
    path: Path
    name: str
    replicate: int
    figures: list[SvgFigure]
    left_out: list[str]


def names(infos: Sequence[Mapping[str, Any]], files: Sequence[Path]) -> list[str]:
    """The scenarios' names; where results share one, with their files and as many folders as needed."""
    bare = [str(info["name"] or file.stem) for info, file in zip(infos, files, strict=True)]
    result = list(bare)
    for name in {name for name in bare if bare.count(name) > 1}:
        rows = [row for row, each in enumerate(bare) if each == name]
        paths = [files[row].resolve().parts for row in rows]
        depths = range(1, max(map(len, paths)) + 1)  # how many last parts make the paths distinct
        depth = next(depth for depth in depths if len({path[-depth:] for path in paths}) == len(set(paths)))
        for row, path in zip(rows, paths, strict=True):
            result[row] = f"{name}, {'/'.join(path[-depth:])}"
    return result


def lead(section: PageSection, replay: Replay) -> str:
    """One line on what the result is, and a warning if it is incomplete."""
    info = section.info
    runs = info["replicates"] or 0
    text = f": seed {info['seed']}, {runs} Monte Carlo run{'s' * (runs != 1)}"
    if runs > 1 and replay.text:
        text += f" (replicate {section.replicate} is replayed)"
    text += f", wsnsim {info['wsnsim_version']}"
    line = f'<p class="lead">{isolated(info["file"])}{html.escape(text)}</p>'
    if info["status"] == "complete":
        return line
    return line + f'\n<p class="warn">This result is {html.escape(info["status"])}: the simulation did not finish.</p>'


def answer(section: PageSection, several: bool) -> str:
    """The result's answer in a sentence; with its name if there are several. Empty if no run has finished."""
    name = f"<b>{isolated(section.name)}</b>: " if several else ""
    return f'<p class="answer">{name}{html.escape(section.info["answer"])}</p>' if section.info["answer"] else ""


def notes(section: PageSection, replay: Replay, several: bool) -> str:
    """What a viewer of the replay must know; with the result's name if there are several."""
    rows = "".join(f"<li>{html.escape(note)}</li>" for note in replay.notes)
    name = f"<p>{isolated(section.name)}</p>" if several and rows else ""
    return f"{name}<ul>{rows}</ul>" if rows else ""


def replay_data(section: PageSection, replay: Replay) -> str:
    """The replay as a data block, which browsers do not run."""
    title = html.escape(section.name)
    return f'<script type="text/plain" class="replay-data" data-title="{title}">{replay.text}</script>'


def html_of(section: PageSection, number: int) -> str:
    """The figures, the scenario and the provenance of one result."""
    shown = "\n".join(_figure(each, f"{number}-{i}") for i, each in enumerate(section.figures))
    missing = "".join(f"<li>{html.escape(reason)}</li>" for reason in section.left_out)
    return f"""<section aria-labelledby="h-{number}">
<h2 id="h-{number}">{isolated(section.name)}: figures</h2>
<div class="figures">
{shown}
</div>
{f'<ul class="small">{missing}</ul>' if missing else ""}
<details open><summary>Scenario, in SI units</summary>
{scenario_html(section.path)}
</details>
<details><summary>Provenance</summary>
<dl>{"".join(_provenance(section))}</dl>
</details>
</section>"""


def _figure(figure: SvgFigure, prefix: str) -> str:
    """A figure with ids that are unique in the page."""
    svg = TAG.sub(lambda tag: ID.sub(rf"\g<1>f{prefix}-", tag[0]), figure.svg)
    return f'<figure role="img" aria-label="{html.escape(figure.label)}">{svg}</figure>'


def _provenance(section: PageSection) -> Iterator[str]:
    """The rows of the list of file, versions, machine, fingerprints and table sizes."""
    info = section.info
    facts = {"file": info["file"], "bytes": f"{info['bytes']:,}", "status": info["status"]}
    facts |= _flat(info["provenance"] or {"wsnsim": info["wsnsim_version"]})
    if info["fingerprints"]:
        facts["fingerprint" + "s" * (len(info["fingerprints"]) > 1)] = ", ".join(
            info["fingerprints"][:MAX_FINGERPRINTS]
        )
    facts["rows"] = ", ".join(f"{name} {size['rows']:,}" for name, size in info["tables"].items())
    for name, value in facts.items():
        yield f"<dt>{isolated(name)}</dt><dd>{isolated(value)}</dd>"


def _flat(mapping: Mapping[str, Any]) -> dict[str, str]:
    """The values as text, those of a nested mapping or list in one line."""
    result: dict[str, str] = {}
    for name, value in mapping.items():
        if isinstance(value, Mapping):
            text = ", ".join(f"{key} {inner}" for key, inner in value.items())
        else:
            text = " ".join(map(str, value)) if isinstance(value, list) else str(value)
        result[name.replace("_", " ")] = text
    return result


MIN_RUNS: Final = 5
"""Least number of Monte Carlo runs for an interval."""
RUNS: Final = "Monte Carlo runs"
PUBLISHED_KEYS: Final = ("rmse", "energy")
BOUNDS: Final = [bound_name(readings, faults) for readings in quantities.BOUND_NAMES for faults in ((), ("stuck",))]
RMSES: Final = [quantities.name_of("rmse", runs) for runs in (1, 2)]
EXPLAINED: Final = (
    {quantity.name: quantity.definition for quantity in QUANTITIES.values()}
    | dict.fromkeys(BOUNDS, BOUND_NOTE)
    | dict.fromkeys(RMSES, QUANTITIES["rmse"].definition)
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
    order = [RUNS, *RMSES, *BOUNDS, *(each.name for each in QUANTITIES.values())]
    labels = [label for label in dict.fromkeys(order) if any(label in column for column in columns)]
    if not labels:
        return "<p>There is no summary: no run has finished.</p>"
    first = {RUNS, *RMSES, *BOUNDS, *(QUANTITIES[key].name for key in flagged("page"))}
    some, others = ([label for label in labels if (label in first) == wanted] for wanted in (True, False))
    notes = [f"In brackets: 95 % bootstrap intervals over runs, for {MIN_RUNS} runs or more."]
    notes += [f"{BOUND_NOTE[0].upper()}{BOUND_NOTE[1:]}."] if bounds and {*BOUNDS} & {*labels} else []
    folded = (
        f"<details><summary>Other quantities</summary>\n{_table(others, columns, names)}</details>\n" if others else ""
    )
    return f'{_table(some, columns, names)}{folded}<p class="small">{" ".join(notes)}</p>'


def _table(labels: Sequence[str], columns: Sequence[Cells], names: Sequence[str]) -> str:
    """A table with a row per label."""
    broken = [re.sub("([_/,])", r"\1<wbr>", html.escape(name)) for name in names]
    head = "".join(f'<th scope="col"><bdi>{name}</bdi></th>' for name in broken)
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


def _cells(path: Path, published: PublishedLookup | None, plugins: bool, bounds: bool) -> Cells:
    """The summary quantities of a result by name, as HTML."""
    values, paper, differs = _published_values(path, published)
    facts = facts_of_file(path)
    unit = facts.unit
    cells: Cells = {}
    errors = facts.recorded.errors
    if errors.size and not np.isfinite(errors).any():
        cells[quantities.name_of("rmse", facts.count)] = "no estimate"
    middles = medians(facts)
    for key, value in worth_showing(facts).items():
        quantity, name = QUANTITIES[key], quantities.name_of(key, facts.count)
        low, high = quantity.interval(facts)
        ends = quantity.interval_text(low, high) if low < high else ""
        cells[name] = html.escape(quantity.text(value, unit)) + _small(ends)
        cells[name] += _small(beside(key, middles, facts.consistent, unit))
        if key in PUBLISHED_KEYS and key in values:
            about = f"published {quantity.text(values[key], unit)} ({paper})"
            cells[name] += f' <span class="small">{explained(about, differs)}</span>'
    if errors.size and bounds:
        cells |= {
            bound_name(readings, facts.faults): html.escape(QUANTITIES["rmse"].text(bound, unit))
            for readings, bound in error_bounds.time_averages(path, plugins).items()
        }
    if facts.count:
        cells[RUNS] = str(facts.count)
    return cells


def _small(text: str) -> str:
    return f' <span class="small">{html.escape(text)}</span>' if text else ""


def _published_values(path: Path, published: PublishedLookup | None) -> tuple[Mapping[str, float], str, str]:
    """The published values of the result's scenario, the paper, and why runs differ from it."""
    try:
        return published(read_json(path, "scenario/resolved_json")) if published else ({}, "", "")
    except (ResultError, ValueError):
        return {}, "", ""
