"""The differences between two results for a terminal.

text(difference) -> the verdict first, then what differs
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from wsnsim.analysis.difference import Pair, ReplicateDifference, ResultDifference
from wsnsim.analysis.phrases import aligned
from wsnsim.base.leaves import ABSENT


def text(found: ResultDifference) -> str:
    """The lines for a terminal, the verdict first."""
    verdict = "are equal bit for bit" if found.same else "differ"
    lines = [f"{found.paths[0]} (A) and {found.paths[1]} (B) {verdict}"]
    for title, pairs in (("settings", found.settings), ("provenance", found.provenance)):
        if pairs:
            width = max(map(len, pairs))
            lines += [f"{title} that differ{'s' * (title == 'provenance')}:"]
            lines += [f"  {name:<{width}}  {_shown(one)} | {_shown(other)}" for name, (one, other) in pairs.items()]
    lines += found.lacking
    for one in found.replicates:
        lines += _parting_lines(one, found.unit)
    return "\n".join(lines)


def _parting_lines(one: ReplicateDifference, unit: str) -> list[str]:
    same = {True: "same", False: "DIFFERENT", None: "unrecorded"}
    differing = [name for name, equal in one.tables.items() if not equal]
    lines = ["", f"replicate {one.replicate}: {same[one.truth]} ground truth, {same[one.network]} network"]
    if not differing:
        return [*lines, "  every table is equal"]
    lines.append(f"  tables that differ: {', '.join(differing)}")
    if one.event is not None:
        number, *sides = one.event
        lines.append(f"  first differing event: number {number + 1:,} of the run")
        lines += [f"    {name}: {_event_line(side)}" for name, side in zip("AB", sides, strict=True)]
    if one.reading is not None:
        lines.append(f"  first differing reading: {_reading_line(one.reading)}")
    if one.estimate is not None:
        lines.append(f"  first differing estimate: step {_estimate_line(one.estimate, unit)}")
    return lines + _figure_lines(one.figures)


def _event_line(event: tuple[float, int, str] | None) -> str:
    return "no further event" if event is None else f"{event[0]:.9g} s, step {event[1]}, {event[2]}"


def _reading_line(first: Mapping[str, Any]) -> str:
    values = ", ".join(f"{name} {'has none' if value is None else f'{value:.6g}'}"
                       for name, value in zip("AB", first["values"], strict=True))  # fmt: skip
    component = f", component {first['component']}" if "component" in first else ""
    return f"step {first['step']}, node {first['node']}, target {first['target']}{component}: {values}"


def _estimate_line(first: Mapping[str, Any], unit: str) -> str:
    where = f"{first['step']} of target {first['target']}"
    if "only_in" in first:
        return f"{where}: only {first['only_in']} has it"
    if np.isnan(first["apart"]):
        none = [name for name, error in zip("AB", first["errors"], strict=True) if np.isnan(error)]
        reason = f"{' and '.join(none)} issued none" if none else "positions cannot be compared"
        return f"{where}: {reason} (columns {', '.join(first['columns'])})"
    errors = " and ".join(f"{name} {error:.4g}" for name, error in zip("AB", first["errors"], strict=True))
    apart = f"{first['apart']:.4g} {unit}".rstrip()
    return f"{where}: {apart} apart (error {errors}; columns {', '.join(first['columns'])})"


def _figure_lines(figures: Mapping[str, Pair]) -> list[str]:
    """A table of the columns of `runs`, with B - A where they differ."""
    rows = [("", "A", "B", "B - A")]
    for name, (a, b) in figures.items():
        equal = a == b or (a != a and b != b)
        rows.append((name, f"{a:.6g}", f"{b:.6g}", "=" if equal else f"{b - a:+.4g}"))
    return [f"  {line}" for line in aligned(rows)]


def _shown(value: Any) -> str:
    return value if value is ABSENT else json.dumps(value, ensure_ascii=False)
