"""The tables of docs/few_bits.md, from the full campaign of `wsnsim reproduce few_bits`.

wsnsim reproduce few_bits --full --figures docs; python -m tests.papers.few_bits_page --new    take its rows, then write
python -m tests.papers.few_bits_page                                                 write from docs/few_bits.json
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.bench.page import write_blocks
from tests.papers.page_files import as_csv, counts, write_files
from tests.papers.studies import module
from wsnsim.analysis import statistics
from wsnsim.papers.measures import Data
from wsnsim.papers.study import study
from wsnsim.recording.folder import Folder

few_bits = module("few_bits")

HOME = Path(__file__).parents[2]
PAGE, ROWS = HOME / "docs/few_bits.md", HOME / "docs/few_bits.json"
CAMPAIGN = HOME / "results/reproduce/full/few_bits/bits"
LEVELS = {"error": ("error, m", "median"), "energy": ("energy, J", "mean"), "traffic": ("traffic, J", "mean")}
"""Measures, their columns, and the statistic over runs beside the ratio."""
SHOWN = ("ideal: pf, fixed 8", "ideal: pf, fixed 1", "ideal: pf, adaptive 2", "ideal: pf, adaptive 1",
         "ideal: ekf, fixed 1", "ideal: ekf, adaptive 1", "xmac 125: pf, fixed 8", "xmac 125: pf, fixed 1",
         "xmac 125: pf, adaptive 2", "xmac 250: pf, fixed 1")  # fmt: skip
"""Rows of the page; the file has all."""


def content(data: Data) -> dict[str, Any]:
    """Everything that the page shows, as plain values."""
    return {
        "tests": [row | {"words": few_bits.words(row)} for row in few_bits.tested(data)],
        "rows": {name: _row(data, name) for name in data.variants if len(data.of(name, "runs"))},
    }


def _row(data: Data, variant: str) -> dict[str, Any]:
    """The levels of a variant's measures, and their ratios to readings in full on the same radio and tracker."""
    full = f"{variant.partition(',')[0]}, full"
    return {
        "runs": len(data.of(variant, "runs")), "lost": int(data.lost(variant).sum()),
        "levels": {measure: getattr(statistics, statistic)(few_bits.MEASURES[measure](data, variant).to_numpy()).value
                   for measure, (_, statistic) in LEVELS.items()},
        "ratios": {measure: few_bits.ratio(data, variant, full, measure) for measure in LEVELS},
    }  # fmt: skip


def blocks(found: Mapping[str, Any]) -> dict[str, str]:
    """{name of a block of the page: its text}."""
    return {"counts": counts(answers(found["tests"])), "rows": _shown(found["rows"])}


def files(found: Mapping[str, Any]) -> dict[str, str]:
    """{name of a CSV file beside the page: its text}: all rows, with ratios to readings in full, and the tests."""
    rows = []
    for name, row in found["rows"].items():
        figures = {f"{words} ({statistic})": row["levels"][measure] for measure, (words, statistic) in LEVELS.items()}
        ratios = {f"{measure} over full": row["ratios"][measure][:3] for measure in LEVELS}
        rows.append({"radio: tracker, readings": name, "runs": row["runs"], "lost": row["lost"], **figures, **ratios})
    return {"few_bits.csv": as_csv(rows), "few_bits_tests.csv": rows_of_tests(found["tests"])}


def answer(words: Iterable[str]) -> str:
    """The answer to a hypothesis that needs all of its tests."""
    given = set(words)
    return "no" if "no" in given else "undecided" if "undecided" in given else "yes"


def by_number(tests: Iterable[Mapping[str, Any]]) -> dict[int, list[Mapping[str, Any]]]:
    """The tests of each hypothesis."""
    found: dict[int, list[Mapping[str, Any]]] = {}
    for test in tests:
        found.setdefault(test["number"], []).append(test)
    return found


def answers(tests: Iterable[Mapping[str, Any]]) -> dict[int, list[str]]:
    """The answer to each hypothesis."""
    return {number: [answer(each["answer"] for each in these)] for number, these in by_number(tests).items()}


def rows_of_tests(tests: Iterable[Mapping[str, Any]]) -> str:
    """A row for each registered test as CSV: its words, what was found, p after Holm's correction, and the answer."""
    return as_csv({"number": each["number"], "test": each["words"].partition(": ")[2], "found": each["found"][:3],
                   "p (Holm)": each["p_holm"], "answer": each["answer"]} for each in tests)  # fmt: skip


def _shown(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """What few bits and thresholds that adapt change: ratios to readings in full, and runs that lost the target."""
    cells = [[name, *(interval(rows[name]["ratios"][measure]) for measure in ("error", "traffic", "energy")),
              f"{rows[name]['lost']} of {rows[name]['runs']}"] for name in SHOWN]  # fmt: skip
    return table(["radio: tracker, readings", "error", "traffic", "energy", "runs lost"], cells)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def interval(found: Sequence[float]) -> str:
    return "{:.2f} [{:.2f}, {:.2f}]".format(*found[:3])


def main() -> None:
    """Write docs/few_bits.json if asked to, then the blocks of docs/few_bits.md."""
    if "--new" in sys.argv[1:]:
        new = content(Data(Folder(CAMPAIGN), study("few_bits")))
        ROWS.write_text(json.dumps(new, indent=1) + "\n", encoding="utf-8")
    found = json.loads(ROWS.read_text(encoding="utf-8"))
    write_files(files(found))
    write_blocks(PAGE, blocks(found))


if __name__ == "__main__":
    main()
