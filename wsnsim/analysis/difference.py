"""Where two results part: in what they were told, in what happened first, and in what came out.

differ(a, b) -> ResultDifference;   as_json(difference)
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

import wsnsim.recording as recording
from wsnsim.analysis.event_groups import BLOCK, layout_or_empty, ranges, rows_in
from wsnsim.analysis.phrases import row_in_words
from wsnsim.base.errors import ResultError

OF_THE_DAY: Final = ("start", "end")
"""What of the provenance differs between any two runs."""
UNTOLD: Final = {"runs": ("cpu_seconds",)}
"""Columns that say nothing of what was simulated."""
OF_NETWORK: Final = ("node", "x", "y", "gain", "energy_initial")
"""Columns of `nodes` that are fixed before a run starts."""
ABSENT: Final = "(absent)"
Pair = tuple[Any, Any]


@dataclass(frozen=True)
class ReplicateDifference:
    """How one replicate of two results compares.

    `tables`: {name: whether it is equal, to the last bit}. `truth`, `network`: whether both chased the same target with
    the same nodes; None where that was not recorded. `event`: (row within the replicate, in A, in B) of the first event
    that differs, an event as (time, step, words), None where one has no more. `estimate`: target and step of the first
    that differs, `apart` in the position's unit, and the columns that differ. `figures`: {column of runs: (A, B)}.
    """

    replicate: int
    tables: Mapping[str, bool]
    truth: bool | None
    network: bool | None
    event: tuple[int, Any, Any] | None
    estimate: Mapping[str, Any] | None
    figures: Mapping[str, Pair]


@dataclass(frozen=True)
class ResultDifference:
    """Where two results part; `same`: both hold the same tables, equal to the last bit (NaN equals NaN).

    `settings` and `provenance`: {dotted path: (A, B)} of what differs. `lacking`: what only one holds, in words.
    Processor time is not compared.
    """

    paths: tuple[str, str]
    same: bool
    settings: Mapping[str, Pair]
    provenance: Mapping[str, Pair]
    lacking: Sequence[str]
    replicates: Sequence[ReplicateDifference]
    unit: str


def differ(a: str | Path, b: str | Path) -> ResultDifference:
    """Compare two results. Raises ResultError where one cannot be read."""
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
    same = not lacking and all(all(one.tables.values()) for one in found)
    plan = layout_or_empty(a)
    return ResultDifference(
        paths, same, _differing(paths, "scenario/resolved_json"), _differing(paths, "provenance_json", OF_THE_DAY),
        lacking, found, plan.units[plan.position[0]] if plan.position else "",
    )  # fmt: skip


def as_json(found: ResultDifference) -> dict[str, Any]:
    """The same as plain values."""
    return asdict(found)


def _parting(
    paths: tuple[str, str], replicate: int, rows: Mapping[str, tuple[dict[int, slice], ...]]
) -> ReplicateDifference:
    nothing = slice(0, 0)
    of_run = {name: (a.get(replicate, nothing), b.get(replicate, nothing)) for name, (a, b) in rows.items()}
    first = {name: _first(paths, name, pair) for name, pair in of_run.items()}
    network = _first(paths, "nodes", of_run["nodes"], OF_NETWORK) is None if "nodes" in of_run else None
    event, at = None, first.get("events")
    if at is not None:
        one, other = of_run["events"]
        event = at, _event(paths[0], one, at), _event(paths[1], other, at)
    return ReplicateDifference(
        replicate,
        {name: row is None for name, row in first.items()},
        (first["truth"] is None and _like(paths, "truth")) if "truth" in first else None,
        network,
        event,
        _estimate(paths, of_run["estimates"]) if first.get("estimates") is not None else None,
        _figures(paths, of_run["runs"]) if "runs" in of_run else {},
    )  # fmt: skip


def _first(paths: tuple[str, str], table: str, rows: tuple[slice, slice], only: Sequence[str] = ()) -> int | None:
    """The first row, counted within the ranges, in which a column that both have differs; None if none does.

    Read a block at a time. Where one range ends first, it parts there.
    """
    names = [set(recording.tables(path)[table].columns) for path in paths]
    columns = [name for name in sorted(names[0] & names[1]) if name in (only or names[0])]
    columns = [name for name in columns if name not in UNTOLD.get(table, ())]
    a_path, b_path = paths
    words = {
        name: (recording.meanings(a_path, table, name), recording.meanings(b_path, table, name)) for name in columns
    }
    sizes = [one.stop - one.start for one in rows]
    step = max(BLOCK // 4, 1)
    for start in range(0, min(sizes), step):
        stop = min(start + step, *sizes)
        differs = np.zeros(stop - start, dtype=np.bool_)
        for name in columns:
            a, b = (
                recording.read_table(path, table, [name], slice(one.start + start, one.start + stop))[name]
                for path, one in zip(paths, rows, strict=True)
            )
            differs |= ~_equal(a, b, words[name])
        if differs.any():
            return start + int(np.argmax(differs))
    return None if sizes[0] == sizes[1] else min(sizes)


def _equal(a: np.ndarray, b: np.ndarray, words: tuple[tuple[str, ...], tuple[str, ...]]) -> np.ndarray:
    """(n,) whether values are equal to the last bit, NaN equal to NaN; categories by their words."""
    if words[0] != words[1]:
        known: dict[str, int] = {}
        a, b = (
            np.array([known.setdefault(w, len(known)) for w in (*one, *map(str, range(len(one), 256)))])[values]
            for one, values in zip(words, (a, b), strict=True)
        )
    if a.dtype == b.dtype == np.float64:
        return np.asarray((a.view(np.uint64) == b.view(np.uint64)) | (np.isnan(a) & np.isnan(b)))
    return np.asarray(a == b)


def _like(paths: tuple[str, str], table: str) -> bool:
    """Whether the two have the same columns."""
    one, other = (recording.tables(path)[table].columns for path in paths)
    return set(one) == set(other)


def _event(path: str, rows: slice, at: int) -> tuple[float, int, str] | None:
    """(time, step, words) of a row within a range; None beyond its end."""
    if rows.start + at >= rows.stop:
        return None
    (row,) = rows_in(path, slice(rows.start + at, rows.start + at + 1))
    return row.time, row.step, row_in_words(row)


def _estimate(paths: tuple[str, str], rows: tuple[slice, slice]) -> dict[str, Any] | None:
    """The first step, of whichever target, at which the estimates differ, and how far apart they are."""
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
    """What `runs` says of a replicate, side by side; what is written in words is left out."""
    if any(one.start == one.stop for one in rows):
        return {}
    sides = [recording.read_table(path, "runs", rows=one) for path, one in zip(paths, rows, strict=True)]
    left_out = ("replicate", "status", "fingerprint", "event_fingerprint")
    names = [name for name in sides[0] if name in sides[1] and name not in left_out]
    return {name: (sides[0][name][0].item(), sides[1][name][0].item()) for name in names}


def _differing(paths: tuple[str, str], name: str, but: Sequence[str] = ()) -> dict[str, Pair]:
    """{dotted path: (A, B)} of what differs in a JSON text of the two."""
    sides = [dict(_leaves(_json(path, name))) for path in paths]
    keys = [*sides[0], *(key for key in sides[1] if key not in sides[0])]
    pairs = {key: (sides[0].get(key, ABSENT), sides[1].get(key, ABSENT)) for key in keys if key not in but}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def _json(path: str, name: str) -> Any:
    try:
        return json.loads(recording.read_text(path, name))
    except ResultError:
        return {}


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """(dotted path, value) of all that holds no mapping."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _leaves(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and any(isinstance(inner, dict) for inner in value):
        for number, inner in enumerate(value):
            yield from _leaves(inner, f"{path}.{number}")
    else:
        yield path, value


def _lacking(what: str, a: Any, b: Any) -> list[str]:
    """What only one of two holds, in words."""
    blank = "" if what.endswith(".") else " "
    only_a = [f"only A holds {what}{blank}{one}" for one in a if one not in b]
    return only_a + [f"only B holds {what}{blank}{one}" for one in b if one not in a]
