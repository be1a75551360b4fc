"""The tables of docs/association.md, from the full campaign of `wsnsim reproduce association`.

wsnsim reproduce association --full --figures docs; python -m tests.papers.association_page --new [FOLDER]
    take the rows of its campaign, then write
python -m tests.papers.association_page         write from docs/association.csv and docs/association_tests.csv
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from tests.bench.page import write_blocks
from tests.papers.few_bits_page import answer, answers, by_number, table
from tests.papers.page_files import counts
from tests.papers.studies import module
from wsnsim.papers.measures import Data
from wsnsim.papers.study import study
from wsnsim.recording.folder import Folder

association = module("association")

HOME = Path(__file__).parents[2]
PAGE, ROWS, TESTS = (HOME / "docs" / f"association{end}" for end in (".md", ".csv", "_tests.csv"))
CAMPAIGN = HOME / "results/reproduce/full/association/association"
MEASURES = (*association.COLUMNS, *association.MEASURES)
NAMES = dict(zip(association.KINDS, ("NN", "GNN", "JPDA", "LMB", "MHT"), strict=True))
CELLS = {
    "ideal, 0.9, 1": "ideal, 0.9, 1", "ideal, 0.7, 1": "ideal, 0.7, 1", "ideal, 0.7, 5": "ideal, 0.7, 5",
    "lossy, 0.7, 1": "20 % loss, 0.7, 1", "csma, 0.7, 1": "CSMA/CA, 0.7, 1", "csma, 0.7, 5": "CSMA/CA, 0.7, 5",
    "xmac, 0.7, 1": "X-MAC, 0.7, 1", "moving ideal, 0.7, 1": "ideal, groups that move, 0.7, 1",
}  # fmt: skip
"""Cells of the short table, and what it calls them."""
SAID = {
    1: "switches of NN less those of GNN > 1 (ideal, 0.7, 1)",
    2: "GOSPA of JPDA over that of GNN < 0.9 (ideal, 0.7, 5)",
    3: "GOSPA of JPDA over that of GNN > 0.9 (CSMA/CA, 0.7, 1)",
    4: "traffic of JPDA over that of GNN within 0.95 and 1.05 (groups that move)",
    5: "latency of MHT over that of JPDA > 10 (ideal), < 1.5 (X-MAC)",
    6: "20 % loss: further switches < 1; GOSPA over that of missed detections within 0.8 and 1.25",
    7: "completeness of JPDA with clutter of 5 less that with 1: < -0.3 (CSMA/CA), > -0.1 (ideal)",
}
"""Hypotheses in short."""
DECIDES = {
    1: "targets move straight at constant speed, as filters assume",
    2: "the head knows detection probability and clutter exactly",
    3: "all nodes send at the same instant of a step",
    4: "tracks get numbers unique in the network at no cost",
    5: "ten cycles for a floating-point operation at 64 MHz",
    6: "losses are independent; the head knows how many scans were sent",
    7: "a packet for each detection, none left out by the node",
}
"""The idealisation that decides the answer."""


def content(data: Data) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The rows (variant, measure, value, low, high, runs) and the tests, as tables."""
    rows = [
        {"variant": name, "measure": measure,
         **association.mean(association.values(data, name, measure).to_numpy(dtype=float))._asdict()}
        for name in data.variants for measure in MEASURES
    ]  # fmt: skip
    tests = [row | row.pop("found")._asdict() for row in association.tested(data)]
    return pd.DataFrame(rows), pd.DataFrame(tests)


def blocks(rows: pd.DataFrame, tests: pd.DataFrame) -> dict[str, str]:
    """{name of a block of the page: its text}."""
    levels = {(row.variant, row.measure): row for row in rows.itertuples()}
    each = by_number(tests.to_dict("records"))
    return {
        "answers": _answers(each), "counts": counts(answers(tests.to_dict("records"))), "rows": _rows(levels),
        "conclusions": _conclusions(levels),
    }  # fmt: skip


def _answers(tests: Mapping[int, list[Mapping[str, Any]]]) -> str:
    rows = [
        [str(number), SAID[number], "; ".join(dict.fromkeys(_interval(pd.Series(one)) for one in these)),
         f"**{answer(one['answer'] for one in these)}**", DECIDES[number]]
        for number, these in tests.items()
    ]  # fmt: skip
    return table(["", "hypothesis", "found [95 %]", "answer", "what decides it"], rows)


def _rows(levels: Mapping[tuple[str, str], Any]) -> str:
    """GOSPA and switches of each tracker in some cells; traffic and latency of JPDA there."""
    rows = []
    for cell, name in CELLS.items():
        values = [f"{levels[f'{cell}: {kind}', 'gospa'].value:.2f} ({levels[f'{cell}: {kind}', 'switches'].value:.1f})"
                  for kind in association.KINDS]  # fmt: skip
        joules, latency = (levels[f"{cell}: jpda", measure].value for measure in ("traffic", "latency"))
        rows.append([name, *values, f"{joules:.3g}", f"{1e3 * latency:.0f}"])
    return table(["radio, detection, clutter", *NAMES.values(), "traffic, J", "latency, ms"], rows)


def _conclusions(levels: Mapping[tuple[str, str], Any]) -> str:
    """What the rows answer to the three questions, in figures."""

    def level(variant: str, measure: str, digits: int = 2) -> str:
        return _interval(levels[variant, measure], digits)

    def value(variant: str, measure: str, digits: int = 2) -> str:
        return f"{levels[variant, measure].value:.{digits}f}"

    def ms(variant: str) -> str:
        return f"{1e3 * levels[variant, 'latency'].value:.0f}"

    ideal, csma, moving, hard = (f"{radio}, 0.7, {clutter}: " for radio, clutter in
                                 (("ideal", 1), ("csma", 1), ("moving ideal", 1), ("ideal", 5)))  # fmt: skip
    late, soon = ms(hard + "mht"), ms(hard + "jpda")
    false = value(ideal + "nearest_neighbour", "false_tracks", 0)
    return "\n".join([
        "- **When is JPDA worth its packets?** It has none of its own: with one head, all trackers get the same scans;"
        f" where groups move, its traffic is {value(moving + 'jpda', 'traffic', 3)} J, that of GNN"
        f" {value(moving + 'gnn', 'traffic', 3)} J and that of LMB, whose tracks are mixtures,"
        f" {value(moving + 'lmb', 'traffic', 3)} J. With five false detections a scan its GOSPA is"
                f" {level(hard + 'jpda', 'gospa')} m, that of GNN {level(hard + 'gnn', 'gospa')} m. MHT has"
        f" {level(hard + 'mht', 'gospa')} m, since its tracks outlive targets that leave, and a latency of {late} ms in"
        f" place of {soon} ms. Over CSMA/CA the channel decides.",
        f"- **What does 20 % loss do to identity?** With JPDA, {level('lossy, 0.7, 1: jpda', 'switches')} switches a"
        f" run with it and {level(ideal + 'jpda', 'switches')} without; completeness"
        f" {level('lossy, 0.7, 1: jpda', 'completeness', 3)} and {level(ideal + 'jpda', 'completeness', 3)}.",
        "- **Does nearest neighbour switch more?** It has"
        f" {level(ideal + 'nearest_neighbour', 'switches')} switches a run, GNN has"
        f" {level(ideal + 'gnn', 'switches')}; it also has {false} false tracks an hour, since two tracks that take the"
        " same detection leave another one, which starts a third.",
        f"- **Radios**: with JPDA, X-MAC has a lower GOSPA than CSMA/CA, for"
        f" {value('xmac, 0.7, 1: jpda', 'energy', 1)} J in place of {value(csma + 'jpda', 'energy', 1)} J, but"
        f" {ms('xmac, 0.7, 1: jpda')} ms in place of {ms(csma + 'jpda')} ms (not registered). We assume that over"
        " CSMA/CA frames collide since all nodes send at the same instant.",
    ])  # fmt: skip


def _interval(found: Any, digits: int = 3) -> str:
    return f"{found.value:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}]"


def read() -> tuple[pd.DataFrame, pd.DataFrame]:
    """The rows and the tests that are stored."""
    return pd.read_csv(ROWS), pd.read_csv(TESTS)


def main() -> None:
    """Write both files if asked to, then the blocks of docs/association.md."""
    if "--new" in sys.argv[1:]:
        campaign = Path(sys.argv[2]) if len(sys.argv) > 2 else CAMPAIGN
        for frame, path in zip(content(Data(Folder(campaign), study("association"))), (ROWS, TESTS), strict=True):
            frame.to_csv(path, index=False, float_format="%.6g", lineterminator="\n")
    write_blocks(PAGE, blocks(*read()))


if __name__ == "__main__":
    main()
