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
    rows = found["rows"]
    return {
        "answers": _answers(found["tests"]), "counts": _counts(found["tests"]), "conclusions": _conclusions(rows),
        "rows": _rows(rows), "ratios": _ratios(rows),
    }  # fmt: skip


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


def _answers(tests: Sequence[Mapping[str, Any]]) -> str:
    rows = []
    for number, these in by_number(tests).items():
        words = " and ".join([these[0]["words"].partition(": ")[2], *(f"< {each['below']:g}" for each in these[1:])])
        p = max(each["p_holm"] for each in these)
        rows.append([str(number), words, _interval(these[0]["found"]), f"{p:.2g}",
                     f"**{answer(each['answer'] for each in these)}**"])  # fmt: skip
    return table(["", "hypothesis", "found [95 %]", "p (Holm)", "answer"], rows)


def _counts(tests: Sequence[Mapping[str, Any]]) -> str:
    """How many hypotheses have each answer, and which."""
    found = {number: answer(each["answer"] for each in these) for number, these in by_number(tests).items()}
    said = []
    for word in ("yes", "no", "undecided"):
        numbers = [str(number) for number, each in found.items() if each == word]
        said.append(f"{len(numbers)} {word}" + f" ({', '.join(numbers)})" * bool(numbers))
    return f"Of {len(found)} hypotheses: {', '.join(said)}."


def _conclusions(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """What bits, their loss and thresholds that adapt change, in figures."""

    def over(variant: str, measure: str) -> str:
        return _interval(rows[variant]["ratios"][measure])

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


def _rows(rows: Mapping[str, Mapping[str, Any]]) -> str:
    heads = [head for words, _ in LEVELS.values() for head in (words, "over full")]
    cells = [
        [name, str(row["runs"]), *(cell for measure in LEVELS for cell in
                                   (f"{row['levels'][measure]:.3g}", _interval(row["ratios"][measure]))),
         str(row["lost"])]
        for name, row in rows.items()
    ]  # fmt: skip
    return table(["radio: tracker, readings", "runs", *heads, "lost"], cells)


def _ratios(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """A line for each radio: what the bits of the particle filter's readings change."""
    lines = []
    for radio in dict.fromkeys(name.partition(":")[0] for name in rows):
        for kind in ("fixed", "adaptive"):
            names = {bits: f"{radio}: pf, {kind} {bits}" for bits in BITS if f"{radio}: pf, {kind} {bits}" in rows}
            said = [_said(measure, [rows[name]["ratios"][measure][0] for name in names.values()]) for measure in LEVELS]
            counts = ", ".join(map(str, names))
            lines.append(f"- {radio}, {kind}, {counts} bit{'s' * (len(names) > 1)}, over full: {'; '.join(said)}")
    return "\n".join(lines)


def _said(measure: str, values: Iterable[float]) -> str:
    return f"{measure} {', '.join(f'{value:.2f}' for value in values)}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _interval(found: Sequence[float]) -> str:
    return "{:.3f} [{:.3f}, {:.3f}]".format(*found[:3])


def main() -> None:
    """Write docs/few_bits.json if asked to, then the blocks of docs/few_bits.md."""
    if "--new" in sys.argv[1:]:
        new = content(Data(Folder(CAMPAIGN), study("few_bits")))
        ROWS.write_text(json.dumps(new, indent=1) + "\n", encoding="utf-8")
    write_blocks(PAGE, blocks(json.loads(ROWS.read_text(encoding="utf-8"))))


if __name__ == "__main__":
    main()
