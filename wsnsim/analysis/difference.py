"""The differences between two results: settings, the first differing event and estimate, and the run totals.

differ(a, b) -> ResultDifference;   as_json(difference);   text(difference) -> the verdict first, then what differs
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

import wsnsim.recording as recording
from wsnsim.analysis.logged_events import BLOCK, layout_or_empty, ranges, read_rows, row_in_words
from wsnsim.analysis.phrases import aligned, fitting
from wsnsim.analysis.plot_data import stored_json
from wsnsim.scenario.build import ABSENT, differing_leaves

OF_THE_DAY: Final = ("start", "end")
"""Provenance entries that differ between any two runs."""
NOT_COMPARED: Final = {"runs": ("cpu_seconds",)}
"""Columns that do not depend on the simulation alone."""
OF_NETWORK: Final = ("node", "x", "y", "gain", "energy_initial")
"""Columns of `nodes` that are constant in a run."""
Pair = tuple[Any, Any]


@dataclass(frozen=True)
class ReplicateDifference:
    """The differences in one run.

    Attributes:
        replicate: number of the run.
        tables: {name: whether the table is equal bit for bit}.
        truth: whether the ground-truth trajectories are equal; None if not recorded.
        network: whether the nodes are equal; None if not recorded.
        event: (row within the run, in A, in B) of the first differing event, each as (time, step, words), or None after
            the last event.
        reading: the first differing reading: step, target, node, its component if readings have several, and `values`
            (A, B), None where a side has none; None if all are equal or if they were not recorded.
        estimate: the first differing estimate: step and target, `apart` in the position's unit, differing columns.
        figures: {column of runs: (A, B)}.
    """

    replicate: int
    tables: Mapping[str, bool]
    truth: bool | None
    network: bool | None
    event: tuple[int, Any, Any] | None
    reading: Mapping[str, Any] | None
    estimate: Mapping[str, Any] | None
    figures: Mapping[str, Pair]


@dataclass(frozen=True)
class ResultDifference:
    """The differences between two results. CPU time is not compared.

    Attributes:
        paths: the two files.
        same: whether both hold the same tables, equal bit for bit (NaN equals NaN).
        settings: {dotted key: (A, B)} of the settings that differ.
        provenance: {dotted key: (A, B)} of the provenance entries that differ.
        lacking: what only one of the two holds, as sentences.
        replicates: the differences in each run that both hold.
        unit: unit of the position.
    """

    paths: tuple[str, str]
    same: bool
    settings: Mapping[str, Pair]
    provenance: Mapping[str, Pair]
    lacking: Sequence[str]
    replicates: Sequence[ReplicateDifference]
    unit: str


def differ(a: str | Path, b: str | Path) -> ResultDifference:
    """Compare two results. Raises ResultError if one cannot be read."""
    paths = (str(a), str(b))
    held = [recording.tables(path) for path in paths]
    common = [name for name in held[0] if name in held[1]]
    lacking = list(_lacking("table", *held)) + [
        words for name in common for words in _lacking(f"column {name}.", held[0][name].columns, held[1][name].columns)
    ]
    rows = {name: (ranges(a, name), ranges(b, name)) for name in common}
    runs = [sorted({number for name in common for number in rows[name][side]}) for side in (0, 1)]
    lacking += _lacking("replicate", *runs)
    both = [number for number in runs[0] if number in runs[1]]
    found = tuple(_parting(paths, number, rows) for number in both)
    same = not lacking and all(all(each.tables.values()) for each in found)
    plan = layout_or_empty(a)
    names = ("scenario/resolved_json", "provenance_json")
    one, other = ([stored_json(path, name) for name in names] for path in paths)
    unit = plan.units[plan.position[0]] if plan.position else ""
    changed = differing_leaves(one[0], other[0]), differing_leaves(one[1], other[1], OF_THE_DAY)
    return ResultDifference(paths, same, *changed, lacking, found, unit)


def as_json(found: ResultDifference) -> dict[str, Any]:
    """The differences as plain values."""
    return asdict(found)


def _parting(
    paths: tuple[str, str], replicate: int, rows: Mapping[str, tuple[dict[int, slice], ...]]
) -> ReplicateDifference:
    nothing = slice(0, 0)
    of_run = {name: (a.get(replicate, nothing), b.get(replicate, nothing)) for name, (a, b) in rows.items()}
    first = {name: _first(paths, name, pair) for name, pair in of_run.items()}
    network = _first(paths, "nodes", of_run["nodes"], OF_NETWORK) is None if "nodes" in of_run else None
    columns = [set(recording.tables(path)["truth"].columns) if "truth" in first else set() for path in paths]
    event, at = None, first.get("events")
    if at is not None:
        one, other = of_run["events"]
        event = at, _event(paths[0], one, at), _event(paths[1], other, at)
    return ReplicateDifference(
        replicate,
        {name: row is None for name, row in first.items()},
        (first["truth"] is None and columns[0] == columns[1]) if "truth" in first else None,
        network,
        event,
        _reading(paths, of_run["readings"]) if first.get("readings") is not None else None,
        _estimate(paths, of_run["estimates"]) if first.get("estimates") is not None else None,
        _figures(paths, of_run["runs"]) if "runs" in of_run else {},
    )  # fmt: skip


def _first(paths: tuple[str, str], table: str, rows: tuple[slice, slice], only: Sequence[str] = ()) -> int | None:
    """The first row within the ranges in which a common column differs; None if all are equal.

    Blocks of rows are read in turn. If one range is shorter, the first row after its end differs.
    """
    words = [recording.all_meanings(path, table) for path in paths]
    columns = [name for name in sorted(words[0].keys() & words[1].keys()) if name in (only or words[0])]
    columns = [name for name in columns if name not in NOT_COMPARED.get(table, ())]
    sizes = [one.stop - one.start for one in rows]
    step = max(BLOCK // (2 * max(len(columns), 1)), 1)
    for start in range(0, min(sizes), step):
        stop = min(start + step, *sizes)
        differs = np.zeros(stop - start, dtype=np.bool_)
        a, b = (
            recording.read_table(path, table, columns, slice(one.start + start, one.start + stop))
            for path, one in zip(paths, rows, strict=True)
        )
        for name in columns:
            differs |= ~_equal(a[name], b[name], (words[0][name], words[1][name]))
        if differs.any():
            return start + int(np.argmax(differs))
    return None if sizes[0] == sizes[1] else min(sizes)


def _equal(a: np.ndarray, b: np.ndarray, words: tuple[tuple[str, ...], tuple[str, ...]]) -> np.ndarray:
    """Whether values are equal bit for bit, (n,); NaN equals NaN, and categories are compared by their words."""
    if words[0] != words[1]:
        known: dict[str, int] = {}
        a, b = (
            np.array([known.setdefault(w, len(known)) for w in (*one, *map(str, range(len(one), 256)))])[values]
            for one, values in zip(words, (a, b), strict=True)
        )
    if a.dtype == b.dtype == np.float64:
        return np.asarray((a.view(np.uint64) == b.view(np.uint64)) | (np.isnan(a) & np.isnan(b)))
    return np.asarray(a == b)


def _event(path: str, rows: slice, at: int) -> tuple[float, int, str] | None:
    """(time, step, words) of a row within a range; None after its end."""
    if rows.start + at >= rows.stop:
        return None
    ((_, row),) = read_rows(path, slice(rows.start + at, rows.start + at + 1))
    return row.time, row.step, row_in_words(row)


def _reading(paths: tuple[str, str], rows: tuple[slice, slice]) -> dict[str, Any] | None:
    """The first reading, by step, target, node and component, that differs or that only one side has."""
    columns = [recording.tables(path)["readings"].columns for path in paths]
    names = [name for name in ("step", "target", "node", "component") if all(name in held for held in columns)]
    sides = []
    for path, one in zip(paths, rows, strict=True):
        table = recording.read_table(path, "readings", [*names, "reading"], one)
        keys = zip(*(table[name].tolist() for name in names), strict=True)
        sides.append(dict(zip(keys, table["reading"].tolist(), strict=True)))
    for key in sorted(sides[0].keys() | sides[1].keys()):
        values = tuple(side.get(key) for side in sides)
        if values[0] != values[1]:
            return {**dict(zip(names, key, strict=True)), "values": values}
    return None


def _estimate(paths: tuple[str, str], rows: tuple[slice, slice]) -> dict[str, Any] | None:
    """The first step, of any target, at which the estimates differ, and the distance between them."""
    tables = [recording.read_table(path, "estimates", rows=one) for path, one in zip(paths, rows, strict=True)]
    common = [name for name in tables[0] if name in tables[1]]
    of_step = [
        {key: row for row, key in enumerate(zip(table["step"].tolist(), table["target"].tolist(), strict=True))}
        for table in tables
    ]
    for key in sorted(of_step[0].keys() | of_step[1].keys()):
        if key not in of_step[0] or key not in of_step[1]:
            return {"step": key[0], "target": key[1], "only_in": "A" if key in of_step[0] else "B"}
        one, other = (
            {name: table[name][rows_of[key] : rows_of[key] + 1] for name in common}
            for table, rows_of in zip(tables, of_step, strict=True)
        )
        differs = [name for name in common if not _equal(one[name], other[name], ((), ()))[0]]
        if differs:
            place = [name for name in layout_or_empty(paths[0]).position if name in common]
            apart = float(np.sqrt(sum((one[name][0] - other[name][0]) ** 2 for name in place))) if place else np.nan
            errors = [float(row["error"][0]) for row in (one, other)]
            return {"step": key[0], "target": key[1], "apart": apart, "errors": errors, "columns": differs}
    return None


def _figures(paths: tuple[str, str], rows: tuple[slice, slice]) -> dict[str, Pair]:
    """The numeric columns of `runs`, side by side."""
    if any(one.start == one.stop for one in rows):
        return {}
    sides = [recording.read_table(path, "runs", rows=one) for path, one in zip(paths, rows, strict=True)]
    left_out = ("replicate", "status", "fingerprint", "event_fingerprint")
    names = [name for name in sides[0] if name in sides[1] and name not in left_out]
    return {name: (sides[0][name][0].item(), sides[1][name][0].item()) for name in names}


def _lacking(what: str, a: Any, b: Any) -> list[str]:
    """What only one of the two holds, as sentences."""
    blank = "" if what.endswith(".") else " "
    only_a = [f"only A holds {what}{blank}{one}" for one in a if one not in b]
    return only_a + [f"only B holds {what}{blank}{one}" for one in b if one not in a]


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
    return fitting(lines, "    ")


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
        words = [f"{side[0]:.9g} s, step {side[1]}, {side[2]}" if side else "no further event" for side in sides]
        lines += [f"    {name}: {word}" for name, word in zip("AB", words, strict=True)]
    if one.reading is not None:
        lines.append(f"  first differing reading: {_reading_line(one.reading)}")
    if one.estimate is not None:
        lines.append(f"  first differing estimate: step {_estimate_line(one.estimate, unit)}")
    return lines + _figure_lines(one.figures)


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
