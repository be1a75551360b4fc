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
BITS = (1, 2, 4, 8)


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
    return {"counts": counts(answers(found["tests"])), "conclusions": _conclusions(found["rows"])}


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
    return as_csv({"number": each["number"], "test": _words(each), "found": each["found"][:3],
                   "p (Holm)": each["p_holm"], "answer": each["answer"]} for each in tests)  # fmt: skip


def _words(test: Mapping[str, Any]) -> str:
    return test["words"].partition(": ")[2]


def _conclusions(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """What bits, their loss and thresholds that adapt change, in figures."""

    def over(variant: str, measure: str) -> str:
        return interval(rows[variant]["ratios"][measure])

    eight, one, adaptive = "pf, fixed 8", "pf, fixed 1", "pf, adaptive 2"
    radios = ("ideal", "xmac 125")
    return "\n".join([
        f"- **Bits alone**: 8 fixed bits have {over(f'ideal: {eight}', 'error')} times the error of full readings on"
        f" the ideal radio and {over(f'xmac 125: {eight}', 'error')} times on X-MAC at 125 ms. Their traffic is"
        f" {over(f'ideal: {eight}', 'traffic')} times that of full readings on the ideal radio,"
        f" {over(f'xmac 125: {eight}', 'traffic')} times on X-MAC, and the network's energy on X-MAC"
        f" {over(f'xmac 125: {eight}', 'energy')} times.",
        f"- **One bit**: 1 fixed bit spends {over(f'ideal: {one}', 'traffic')} times the traffic on the ideal radio,"
        f" {over(f'xmac 125: {one}', 'traffic')} times on X-MAC at 125 ms and {over(f'xmac 250: {one}', 'traffic')}"
        f" times at 250 ms, has {over(f'ideal: {one}', 'error')}, {over(f'xmac 125: {one}', 'error')} and"
        f" {over(f'xmac 250: {one}', 'error')} times the error, and loses the target in"
        f" {', '.join(str(rows[f'{radio}: {one}']['lost']) for radio in (*radios, 'xmac 250'))} of"
        f" {rows[f'ideal: {one}']['runs']} runs.",
        "- **Thresholds that adapt**: 2 adaptive bits have "
        + " and ".join(f"{over(f'{radio}: {adaptive}', 'error')} times the error and"
                       f" {over(f'{radio}: {adaptive}', 'traffic')} times the traffic of full readings ({radio})"
                       for radio in radios) + ".",
        f"- **Gaussian filters**: with 1 fixed bit, `ekf` loses the target in {rows['ideal: ekf, fixed 1']['lost']} of"
        f" {rows['ideal: ekf, fixed 1']['runs']} runs on the ideal radio, `pf` in {rows[f'ideal: {one}']['lost']}; with"
        f" 1 adaptive bit, {rows['ideal: ekf, adaptive 1']['lost']} and {rows['ideal: pf, adaptive 1']['lost']}.",
    ])  # fmt: skip


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def interval(found: Sequence[float]) -> str:
    return "{:.3f} [{:.3f}, {:.3f}]".format(*found[:3])


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
