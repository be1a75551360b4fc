"""The tables of docs/duty_cycles.md, from the full campaigns of `wsnsim reproduce duty_cycles`.

wsnsim reproduce duty_cycles --full --figures docs     run everything
python -m tests.papers.duty_cycles_page --new          take the rows of what was run, then write
python -m tests.papers.duty_cycles_page                write from docs/duty_cycles.json

An experiment that has not been run keeps what the page had of it. If the points of an experiment have different numbers
of runs, the page shows the runs that all of them have.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.bench.page import write_blocks
from tests.papers.page_files import answer_rows, as_csv, counts, write_files
from tests.papers.studies import module
from wsnsim.analysis import statistics
from wsnsim.base.arrays import Bools
from wsnsim.papers.measures import Data
from wsnsim.papers.study import study
from wsnsim.recording.folder import Folder

answers_of = module("duty_cycles", "hypotheses").OF_EXPERIMENT
_study = module("duty_cycles")
best_lines, best_points = _study.best_lines, _study.best_points
_points = module("duty_cycles", "points")
common_runs, run, value = _points.common_runs, _points.run, _points.value

HOME = Path(__file__).parents[2]
PAGE, ROWS = HOME / "docs/duty_cycles.md", HOME / "docs/duty_cycles.json"
CAMPAIGNS = HOME / "results/reproduce/full/duty_cycles"
NOT_YET = "*The runs have not been made yet.*"
FIELDS = ("li", "found", "jiang")
EXACT = "exact_clocks"
AGAIN = "_again"
"""How the names of the experiments of the replication end."""
EXPERIMENTS = (*FIELDS, *(name + AGAIN for name in FIELDS))
LEAST_RUNS = {"li_again": 10, "found_again": 10, "jiang_again": 6}
"""Runs that all points of an experiment need before its hypotheses are answered, as registered."""
ASIDE = re.compile(r" \((not run|no interval is usable)\)$")
"""What the words of an answer say beside its hypothesis."""
GOT = {
    "error, m": "median:error", "RMSE of a run, m": "median:rmse", "in time": "mean:tracked",
    "with three": "mean:tracked_three", "latency at the head, s": "tracks_median:delay",
    "at the sink, s": "tracks_median:report_delay", "delivered": "mean:delivered",
}  # fmt: skip
"""Columns of the table of what a tracker gets, and their measures."""
PAID = {
    "energy, J": "mean:energy", "radio on": "mean:radio_on", "lifetime of the mean node, days": "median:days",
    "of the busiest": "median:days_busiest",
}  # fmt: skip
"""Columns of the table of what it costs, and their measures."""
SHARES = ("in time", "with three", "delivered", "radio on")
CAUSES = {
    "listening": ("idle",), "starts and stops": ("switch",), "sending": ("tx_electronics", "tx_amplifier"),
    "receiving": ("rx",), "overhearing": ("overhear",), "asleep": ("sleep",),
    "computing, sensing": ("cpu", "sense", "leak"),
}  # fmt: skip
"""Columns of joules by cause, and the causes of the table `energy`."""


def campaign(name: str) -> Data | None:
    """The results of an experiment; None if its points have no run in common."""
    if not [*(CAMPAIGNS / name).glob("*/*.h5")]:
        return None
    data = Data(Folder(CAMPAIGNS / name), study("duty_cycles"))
    return data if run(data) == data.variants and len(common_runs(data)) else None


def content(before: Mapping[str, Any]) -> dict[str, Any]:
    """Everything that the page shows, as plain values, by experiment."""
    found = dict(before)
    for name in EXPERIMENTS:
        if (data := campaign(name)) is not None:
            few = runs_missing(data, LEAST_RUNS.get(name, 1))
            found[name] = of_field(data, [] if few else answers_of[name](data)) | {"too_few": few}
    if (data := campaign(EXACT)) is not None:
        found[EXACT] = {"rows": of_field(data, [])["rows"]}
    if (data := campaign("waiting")) is not None:
        found["waiting"] = {"rows": {name: [value(data, name, "mean:energy")] for name in run(data)}}
    return found


def runs_missing(data: Data, least: int) -> dict[str, int]:
    """{point: its runs} of the points that have fewer runs than are needed for answers."""
    counts = {name: len(data.of(name, "runs")) for name in run(data)}
    return {name: count for name, count in counts.items() if count < least}


def of_field(data: Data, answers: Iterable[Any]) -> dict[str, Any]:
    """The rows of a field's points, its best intervals and its answers."""
    rows = {
        name: {
            "runs": len(common_runs(data)), "lost": statistics.share(data.lost(name)[_common(data, name, "runs")]),
            **{words: value(data, name, measure) for words, measure in {**GOT, **PAID}.items()},
            "causes": _causes(data, name),
        }
        for name in run(data)
    }  # fmt: skip
    return {
        "rows": rows, "best": best_lines(data), "best_points": best_points(data),
        "answers": [each._asdict() for each in answers],
    }  # fmt: skip


def _causes(data: Data, variant: str) -> dict[str, float]:
    """Mean joules of a run by the page's causes."""
    table = data.of(variant, "energy")[_common(data, variant, "energy")]
    joules = table.groupby("cause")["joules"].sum() / len(common_runs(data))
    unknown = {*joules.index} - {cause for causes in CAUSES.values() for cause in causes}
    assert not unknown, f"no column of the page has the causes {unknown}"
    return {words: float(sum(joules.get(cause, 0.0) for cause in causes)) for words, causes in CAUSES.items()}


def _common(data: Data, variant: str, table: str) -> Bools:
    """Which rows of a variant's table are of the runs that all variants have."""
    kept: Bools = data.of(variant, table)["replicate"].isin(common_runs(data)).to_numpy()
    return kept


def blocks(found: Mapping[str, Any]) -> dict[str, str]:
    """{name of a block of the page: its text}."""
    return {
        "counts": "\n".join(f"- {study}: {counts(of)}" for study, of in _by_number(found).items()),
        "changed": _changed(found),
        "shared_cells": _shared_cells(found),
        "price": _price(found),
    }


def files(found: Mapping[str, Any]) -> dict[str, str]:
    """{name of a CSV file beside the page: its text}: all rows, best intervals, answers."""
    rows = [{"experiment": name, "tracker, MAC": variant, **row} for name in (*EXPERIMENTS, EXACT)
            for variant, row in found.get(name, {}).get("rows", {}).items()]  # fmt: skip
    waiting = found.get("waiting", {"rows": {}})["rows"]
    rows += [{"experiment": "waiting", "tracker, MAC": name, "energy, J": row[0]} for name, row in waiting.items()]
    best = [{"experiment": name, "tracker and MAC": words, "best interval": said} for name in EXPERIMENTS
            for words, _, said in (line.partition(": ") for line in found.get(name, {}).get("best", ()))]  # fmt: skip
    heads = ("hypothesis", "first study", "answer", "replication", "answer of the replication")
    answers = [dict(zip(heads, (words, *_said(first), *_said(again)), strict=True))
               for words, first, again in compared(found)]  # fmt: skip
    said = answer_rows("duty_cycles", _by_number(found))
    parts = {"rows": rows, "best": best, "answers": answers, "hypotheses": said}
    return {f"duty_cycles_{name}.csv": as_csv(content) for name, content in parts.items()}


def compared(found: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any], Mapping[str, Any] | None]]:
    """(hypothesis, answer of the first study, that of the replication or None), by the numbers of the hypotheses."""
    first, again = (
        {ASIDE.sub("", each["words"]): each for name in FIELDS if name + ending in found
         for each in found[name + ending]["answers"]}
        for ending in ("", AGAIN)
    )  # fmt: skip
    assert set(again) <= set(first), "the replication answers the hypotheses of the first study"
    return [(words, first[words], again.get(words)) for words in sorted(first, key=number)]


def number(words: str) -> int:
    """The number of the hypothesis that an answer begins with."""
    return int(words.partition(":")[0])


def _by_number(found: Mapping[str, Any]) -> dict[str, dict[int, list[str]]]:
    """The answers to the tests of each hypothesis, in the first study and in the replication."""
    first, again = ({}, {})
    for words, one, other in compared(found):
        first.setdefault(number(words), []).append(one["answer"])
        again.setdefault(number(words), []).extend([other["answer"]] if other else [])
    return {"first study": first, "replication": again}


def _said(answer: Mapping[str, Any] | None) -> tuple[str, str]:
    """What was found, and the answer; of a replication that has not been run, dashes."""
    if answer is None:
        return "-", "not run"
    return " and ".join(map(_interval, answer["found"])), answer["answer"]


def _changed(found: Mapping[str, Any]) -> str:
    """How many answers the replication repeats, and which hypotheses have others."""
    missing = "".join(map(_too_few, ((name, found.get(name, {}).get("too_few")) for name in LEAST_RUNS)))
    both = [(words, first["answer"], again["answer"]) for words, first, again in compared(found) if again]
    if not both:
        return NOT_YET
    other = [each for each in both if each[1] != each[2]]
    without = len(compared(found)) - len(both)
    open_ = f" {without} answers have no replication: their points are missing.{missing}" if without else ""
    same = f"Of {len(both)} answers the replication repeats {len(both) - len(other)}"
    if not other:
        return f"{same}.{open_}"
    opposed = sum({one, two} == {"yes", "no"} for _, one, two in other)
    numbers = ", ".join(map(str, dict.fromkeys(number(words) for words, *_ in other)))
    return f"{same}; {len(other)} are others (hypotheses {numbers}), {opposed} of them the opposite.{open_}"


def _too_few(of: tuple[str, Mapping[str, int] | None]) -> str:
    """The points of an experiment that have too few runs; empty if none has."""
    name, few = of
    if not few:
        return ""
    named = ", ".join(f"{point} ({count})" for point, count in few.items())
    return f" Of `{name}`, which needs {LEAST_RUNS[name]} runs of each point, these have fewer: {named}."


def _shared_cells(found: Mapping[str, Any]) -> str:
    """What `ekf` gets and costs on TSCH, by slots and shared cells."""
    rows = found.get("jiang_again", {}).get("rows", {})
    names = [f"ekf, tsch {slots}{cells}" for slots in (31, 11) for cells in ("", ", shared 4")]
    if not rows:
        return NOT_YET
    columns = ("in time", "error, m", "delivered", "energy, J", "radio on")
    return _table(["slots, shared cells", *columns], [
        [_slots_and_cells(name), *(_cell(words, rows[name][words]) for words in columns)] for name in names
    ])  # fmt: skip


def _price(found: Mapping[str, Any]) -> str:
    """What the best intervals of Li's field save, and what they cost: each value beside that on CSMA."""
    field = found.get("li", {})
    if "best_points" not in field:
        return NOT_YET
    columns = ("energy, J", "latency at the head, s", "delivered", "RMSE of a run, m")
    lines = []
    for one in field["best_points"]:
        csma, point = field["rows"][one["csma"]], field["rows"].get(one["point"])
        cells = [f"{_short(words, csma)} → {_short(words, point)}" if point else "-" for words in columns]
        lines.append([one["tracker"], one["point"].partition(", ")[2] or f"{one['mac']}: none is usable", *cells])
    return _table(["tracker", "MAC", *columns], lines)


def _short(words: str, row: Mapping[str, Any]) -> str:
    """A value without its interval."""
    return f"{row[words][0]:.1%}" if words in SHARES else f"{row[words][0]:.3g}"


def _slots_and_cells(variant: str) -> str:
    """'ekf, tsch 31, shared 4' -> '31 slots, 4 cells'."""
    _, mac, *more = variant.split(", ")
    return f"{mac.removeprefix('tsch ')} slots, {more[0].removeprefix('shared ') + ' cells' if more else '1 cell'}"


def _cell(words: str, found: Sequence[float]) -> str:
    return f"{found[0]:.1%}" if words in SHARES else _interval(found)


def _interval(found: Sequence[float]) -> str:
    return "{:.3g} [{:.3g}, {:.3g}]".format(*found)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def main() -> None:
    """Write docs/duty_cycles.json if asked to, then the blocks of docs/duty_cycles.md."""
    found = json.loads(ROWS.read_text(encoding="utf-8")) if ROWS.exists() else {}
    if "--new" in sys.argv[1:]:
        found = json.loads(json.dumps(content(found), default=float))
        ROWS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    write_files(files(found))
    write_blocks(PAGE, blocks(found))


if __name__ == "__main__":
    main()
