"""The figures of a campaign as a table for a terminal.

text(compared) -> str
"""

from __future__ import annotations

import math
from typing import Any, Final

import pandas as pd

from wsnsim.analysis.comparison import Comparison, label
from wsnsim.analysis.statistics import LEAST
from wsnsim.base.tables import MORE_IS_BETTER

SEEN: Final = 0.995
"""Share of the steps from which on a track counts as whole."""


def text(found: Comparison) -> str:
    """A line a point; below it what the columns mean."""
    table = found.table
    heads, rows = _columns(found)
    widths = [max(len(row[i]) for row in [heads, *rows]) for i in range(len(heads))]
    left = len(found.keys)
    lines = [
        "  ".join(
            cell.ljust(w) if i < left else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in [heads, *rows]
    ]
    counts = table["replicates"]
    many = f"{counts.min()}" if counts.min() == counts.max() else f"{counts.min()} to {counts.max()}"
    title = f"{found.name}: {len(table)} point{'s' * (len(table) != 1)}, {many} replicate{'s' * (many != '1')} each"
    return "\n".join([title, *(f"  {line}".rstrip() for line in lines), *_notes(found)])


def _columns(found: Comparison) -> tuple[list[str], list[list[str]]]:
    table, unit = found.table, found.unit
    said = f"{found.metric}{f' [{unit}]' if unit not in ('', '1') else ''}"
    columns: list[tuple[str, list[str]]] = [(key, [_setting(value) for value in table[key]]) for key in found.keys]
    if table["replicates"].nunique() > 1:
        columns.append(("runs", [str(count) for count in table["replicates"]]))
    columns.append((f"median {said}", [_spread(row, "median") for _, row in table.iterrows()]))
    columns.append(("mean", [_number(value) for value in table["mean"]]))
    if "bound" in table and table["bound"].notna().any():
        columns.append(("bound", [_number(value) for value in table["bound"]]))
    if (table["tracked"] < SEEN).any():
        columns.append(("tracked", [f"{100.0 * value:.0f} %" for value in table["tracked"]]))
    if found.metric != "lost":
        columns.append(("lost", [_share(row) for _, row in table.iterrows()]))
    if table["energy"].notna().any() and (table["energy"] > 0).any():
        columns.append(("energy [J]", [_spread(row, "energy") for _, row in table.iterrows()]))
        columns.append((f"{found.metric}/J", [_number(value) for value in table["error_per_joule"]]))
        columns.append(("front", ["*" if flag else "" for flag in table["front"]]))
    if "difference" in table and table["pairs"].notna().any():
        columns.append(("difference", [_spread(row, "difference") for _, row in table.iterrows()]))
        columns.append(("effect", [_number(value, 2) for value in table["effect"]]))
    cells = [values for _, values in columns]
    return [head for head, _ in columns], [list(row) for row in zip(*cells, strict=True)]


def _notes(found: Comparison) -> list[str]:
    table = found.table
    notes = ["  [ , ]: 95 % intervals, of medians and differences by bootstrap, of shares by Wilson's score"]
    if table["replicates"].max() < LEAST:
        notes = [f"  [ , ]: 95 % intervals of shares by Wilson's score; medians have one from {LEAST} replicates on"]
    if (table["energy"] > 0).any():
        notes.append(f"  {found.metric}/J: falls with every joule more, so less is not better by itself: see the front")
    if (table["tracked"] < SEEN).any():
        notes.append(
            f"  tracked: share of the steps with an estimate in time; {found.metric} is of the steps that have one"
        )
    better = "larger" if found.metric in MORE_IS_BETTER else "smaller"
    among = "of its group" if found.by and set(found.keys) - set(found.by) else "point"
    if (table["front"]).any():
        notes.append(
            f"  *: no other {among} has both a {better} median {found.metric} and less energy; who loses more than\n"
            "  5 % of the runs is left out"
        )
    if "difference" in table and table["pairs"].notna().any():
        notes.append(
            f"  difference: median over replicates of that from {found.baseline}, on the same truth and readings;\n"
            "  effect: rank-biserial correlation, from -1 (always less) to 1 (always more)"
        )
    if "bound" in table and table["bound"].notna().any():
        notes.append(
            "  bound: Cramer-Rao along each truth, of all readings in range, median over runs as the error beside it;\n"
            "  not strict: a filter may be below on some truths (--json also has the strict one, over all truths)"
        )
    unknown = int((table["replicates"] - table["known"]).sum())
    if unknown:
        notes.append(f"  {unknown} runs have no {found.metric}: medians and means are of the others")
    notes += [f"  no bound: {found.unbounded}"] if found.unbounded else []
    return [*notes, f"  {found.unpaired}"] if found.unpaired else notes


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
    value, low, high = (100.0 * float(row[f"lost_fraction{end}"]) for end in ("", "_low", "_high"))
    return f"{value:.0f} % [{low:.0f}, {high:.0f}]"
