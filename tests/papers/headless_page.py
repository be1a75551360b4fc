"""The tables of docs/headless.md, from the full campaign of the study `headless`; ratios and tests as in few_bits.

wsnsim reproduce headless --full; python -m tests.papers.headless_page --new FOLDER OF_WIDER
python -m tests.papers.headless_page                                                 write from docs/headless.json
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.bench.page import write_blocks
from tests.papers.few_bits_page import LEVELS, answers, few_bits, interval, rows_of_tests, table
from tests.papers.page_files import as_csv, counts, write_files
from wsnsim.analysis import statistics
from wsnsim.papers.measures import Data
from wsnsim.papers.study import study
from wsnsim.recording.folder import Folder

HOME = Path(__file__).parents[2]
SHOWN = ("ideal: kalman", "ideal: diffusion", "ideal: naive", "csma: ekf", "csma: kalman", "csma: diffusion",
         "csma: information, ratio", "csma: intersection", "csma: ekf, death", "csma: diffusion, death", "xmac: ekf",
         "xmac: kalman", "xmac: diffusion", "csma: diffusion, 75 m")  # fmt: skip
"""Rows of the page; the file has all."""
PAGE, ROWS = HOME / "docs/headless.md", HOME / "docs/headless.json"


def content(data: Data, wider: Data) -> dict[str, Any]:
    """Everything that the page shows, as plain values. `wider`: the experiment that was not registered."""
    tests = [row | {"words": few_bits.words(row)} for row in few_bits.tested(data)]
    rows = {name: _row(data, name) for name in data.variants}
    return {"tests": tests, "rows": rows | {name: _row(wider, name) for name in wider.variants if "75 m" in name}}


def _row(data: Data, variant: str) -> dict[str, Any]:
    """The levels of a variant's measures, and their ratios to `ekf` on the same radio, with a death if it has one."""
    head = f"{variant.partition(':')[0]}: ekf" + ", death" * variant.endswith("death")
    return {
        "runs": len(data.of(variant, "runs")), "lost": int(data.lost(variant).sum()),
        "levels": {measure: getattr(statistics, statistic)(few_bits.MEASURES[measure](data, variant).to_numpy()).value
                   for measure, (_, statistic) in LEVELS.items()},
        "ratios": {measure: few_bits.ratio(data, variant, head, measure) for measure in LEVELS},
    }  # fmt: skip


def blocks(found: Mapping[str, Any]) -> dict[str, str]:
    """{name of a block of the page: its text}."""
    cells = [
        [name, f"{row['levels']['error']:.3g}", *(interval(row["ratios"][measure]) for measure in ("error", "traffic")),
         str(row["lost"])]
        for name, row in found["rows"].items() if name in SHOWN
    ]  # fmt: skip
    head = ["radio: tracker", "error, median, m", "error over ekf", "traffic over ekf", "runs lost"]
    return {
        "counts": counts(answers(found["tests"])), "rows": table(head, cells),
        "conclusions": _conclusions(found["rows"]),
    }  # fmt: skip


def files(found: Mapping[str, Any]) -> dict[str, str]:
    """{file of docs: its rows, or its tests}."""
    rows = as_csv([{"variant": name} | row for name, row in found["rows"].items()])
    return {"headless.csv": rows, "headless_tests.csv": rows_of_tests(found["tests"])}


def _conclusions(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """What no head costs, when it pays, and what decides it, in figures."""

    def over(variant: str, measure: str) -> str:
        return "{:.2g} [{:.2g}, {:.2g}]".format(*rows[variant]["ratios"][measure])

    kalman = {radio: over(f"{radio}: kalman", "traffic") for radio in ("csma", "xmac", "ideal")}
    wider = [rows[f"{radio}: kalman, 75 m"]["ratios"]["traffic"][0] / rows[f"{radio}: kalman"]["ratios"]["traffic"][0]
             for radio in ("ideal", "csma")]  # fmt: skip
    lost = sum(row["lost"] for name, row in rows.items() if "75 m" in name)
    return "\n".join([
        f"- **The price.** With one round, no head costs {kalman['csma']} times the traffic of a head on CSMA/CA,"
        f" {kalman['xmac']} times on X-MAC and {kalman['ideal']} times on the ideal radio, which pays each bit at each"
        " listener and no preamble. Rounds that count and agree cost"
        f" {over('csma: information, ratio', 'traffic')} times on CSMA/CA.",
        "- **The error.** Its median is about that of a head. But in one run nobody sensed the target for a step: a"
        " head predicts on, and participants within sensing range (50 m) had all left. Within communication range (rows"
        f" with 75 m: added after the answers, not registered; now the default) {lost or 'no'} runs were lost, for"
        f" {wider[1]:.2g} and {wider[0]:.2g} times the traffic of 50 m (CSMA/CA and ideal).",
        "- **When it pays.** When the node that matters dies: diffusion then has"
        f" {over('csma: diffusion, death', 'error')} times the error of a head. Without a death, and at equal joules,"
        f" it has {over('csma: diffusion, 3 s', 'error')} times that of a head on CSMA/CA and"
        f" {over('xmac: diffusion, 6 s', 'error')} times on X-MAC.",
        "- **Loss.** Where frames are lost, ratio consensus has"
        f" {over('csma: information, ratio', 'error')} times the error of a head, Metropolis weights"
        f" {over('csma: information', 'error')} times.",
    ])  # fmt: skip


def main() -> None:
    """Write docs/headless.json if asked to, then the blocks of docs/headless.md."""
    if "--new" in sys.argv[1:]:
        new = content(*(Data(Folder(Path(folder)), study("headless")) for folder in sys.argv[-2:]))
        ROWS.write_text(json.dumps(new, indent=1) + "\n", encoding="utf-8")
    found = json.loads(ROWS.read_text(encoding="utf-8"))
    write_files(files(found))
    write_blocks(PAGE, blocks(found))


if __name__ == "__main__":
    main()
