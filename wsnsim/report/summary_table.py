"""Results side by side in figures, as a table of a page: the mean over replicates and its 95 % interval.

tally(paths, names, published) -> HTML
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.analysis import plot_data, recorded_bounds, result_info
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import ResultError
from wsnsim.recording import attributes, read_table, read_text, tables

Published = Callable[[Mapping[str, Any]], tuple[Mapping[str, float], str]]
"""What papers print of a resolved scenario's set-up, and the paper's name."""
LEAST: Final = 5
"""Replicates from which on there is an interval: the bootstrap of fewer says nothing."""
MORE: Final = {
    "tracked": ("steps tracked", "{:.1%}"),
    "awake": ("time that nodes are awake", "{:.1%}"),
    "first_death": ("first death, where nodes died", "{:.4g} s"),
    "in_range": ("receptions in range", "{:,.0f}"),
    "delivered": ("receptions delivered", "{:,.0f}"),
    "collided": ("receptions lost to collisions", "{:,.0f}"),
    "retries": ("frames sent again", "{:,.0f}"),
    "access_failures": ("frames that never got the channel", "{:,.0f}"),
    "coverage": ("field covered at the end", "{:.1%}"),
}
"""Further columns of `runs`, beside those that `wsnsim info` shows."""
ROWS: Final = {**result_info.FIGURES, **MORE}
OVER_TIME: Final = "RMSE, mean over time"
ONLY_IF_ANY: Final = ("collided", "retries", "access_failures", "frames_lost", "handovers", "cycles")
ONLY_IF_NOT_ALL: Final = ("awake",)
ONLY_IF_SOME_FAILED: Final = ("in_range", "delivered")
Cells = dict[str, str]


def tally(paths: Sequence[Path], names: Sequence[str], published: Published | None = None) -> str:
    """The table: a row a figure, a column a result; a figure that no result has is left out."""
    columns = [_cells(path, published) for path in paths]
    order = ["replicates", OVER_TIME, *recorded_bounds.WORDS.values(), *(words for words, _ in ROWS.values())]
    labels = [label for label in order if any(label in column for column in columns)]
    if not labels:
        return "<p>No run has ended: there is no summary.</p>"
    head = "".join(f'<th scope="col">{_headed(name)}</th>' for name in names)
    rows = "".join(
        f'<tr><th scope="row">{html.escape(label)}</th>'
        + "".join(f"<td>{column.get(label, '')}</td>" for column in columns)
        + "</tr>\n"
        for label in labels
    )
    return (
        f'<div class="wide" tabindex="0" role="region" aria-label="Summary"><table>\n'
        f'<thead><tr><th scope="col">mean over replicates</th>{head}</tr></thead>\n<tbody>\n{rows}'
        "</tbody></table></div>\n"
        f'<p class="small">In brackets: 95 % bootstrap intervals over replicates, from {LEAST} replicates on.</p>'
    )


def _headed(name: str) -> str:
    """A result's name at the head of its column, where it may break behind '_', '/' and commas."""
    broken = re.sub("([_/,])", r"\1<wbr>", html.escape(name))
    return f"<bdi>{broken}</bdi>"


def _cells(path: Path, published: Published | None) -> Cells:
    """A result's figures by what they are, as HTML."""
    printed, paper = _printed(path, published)
    unit, targets = _unit(path), bool(attributes(path)["states"])
    cells: Cells = {}
    if not plot_data.lacking(path, "error"):
        cells |= _over_time(path, unit, printed.get("rmse"), paper)
        cells |= {
            recorded_bounds.WORDS[of]: html.escape(f"{mean:.4f}{unit.format()}")
            for of, mean in recorded_bounds.beside(path).items()
        }
    runs = read_table(path, "runs") if "runs" in tables(path) else {}
    for name, (words, form) in ROWS.items():
        values = runs.get(name, np.empty(0)).astype(np.float64)
        values = values[np.isfinite(values)]
        if not values.size or _idle(name, values, runs) or (name == "lost" and not targets):
            continue
        said = form + (unit if name in result_info.OF_POSITION else "")
        cells[words] = _cell(float(values.mean()), _interval(values), said)
        if name == "energy" and "energy" in printed:
            cells[words] += _paper(said.format(printed["energy"]), paper)
    if runs and runs["replicate"].size:
        cells["replicates"] = str(runs["replicate"].size)
    return cells


def _idle(name: str, values: Floats, runs: Mapping[str, np.ndarray]) -> bool:
    """Whether a figure says nothing: of what never happened, or of a network where there is none."""
    bare = not np.isfinite(runs["energy"]).any()
    return (
        (name in ONLY_IF_ANY and not values.any())
        or (name in ONLY_IF_NOT_ALL and bool((values == 1.0).all()))
        or (name in result_info.OF_NETWORK and bare)
        or (name in ONLY_IF_SOME_FAILED and np.array_equal(runs["in_range"], runs["delivered"]))
    )


def _over_time(path: Path, unit: str, printed: float | None, paper: str) -> Cells:
    """The time mean of the RMSE over runs at each step: the targets of a replicate are drawn together."""
    errors, _ = plot_data.errors(path)
    runs = plot_data.counts(path).runs
    blocks = errors.reshape(runs, -1, errors.shape[1]) if len(errors) % runs == 0 else errors[:, None, :]
    mean = metrics.time_mean_rmse(errors)
    if not np.isfinite(mean):
        return {OVER_TIME: "no estimate"}

    def pooled(rows: Floats) -> float:
        return metrics.time_mean_rmse(rows.reshape(-1, rows.shape[-1]))

    said = "{:.4f}" + unit
    cell = _cell(mean, metrics.bootstrap_interval(blocks, pooled), said)
    return {OVER_TIME: cell + (_paper(said.format(printed), paper) if printed is not None else "")}


def _interval(values: Floats) -> tuple[float, float]:
    """The bootstrap's interval of the mean; none where all runs are alike."""
    if not np.ptp(values):
        return float("nan"), float("nan")
    return metrics.bootstrap_interval(values, lambda drawn: float(np.mean(drawn)))


def _cell(mean: float, interval: tuple[float, float], form: str) -> str:
    low, high = interval
    number = form.split(" ")[0]
    bounds = f"{number.format(low)}, {number.format(high)}" if np.isfinite(low) else ""
    return html.escape(form.format(mean)) + (f' <span class="small">[{html.escape(bounds)}]</span>' if bounds else "")


def _paper(value: str, paper: str) -> str:
    return f' <span class="small">published {html.escape(value)} ({html.escape(paper)})</span>'


def _printed(path: Path, published: Published | None) -> tuple[Mapping[str, float], str]:
    """What the paper prints whose set-up the file's scenario is."""
    if published is None:
        return {}, ""
    try:
        return published(json.loads(read_text(path, "scenario/resolved_json")))
    except (ResultError, ValueError):
        return {}, ""


def _unit(path: Path) -> str:
    """The unit of the position as it follows a number, braces doubled for a format; nothing where there is none."""
    if not attributes(path)["states"]:
        return ""
    plan = plot_data.layout(path)
    unit = plan.units[plan.position[0]].replace("{", "{{").replace("}", "}}")
    return f" {unit}" if unit else ""
