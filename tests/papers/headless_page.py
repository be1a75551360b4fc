"""The tables of docs/headless.md, from the full campaign of the study `headless`; ratios and tests as in few_bits.

wsnsim reproduce scenarios/studies/headless --full; python -m tests.papers.headless_page --new FOLDER OF_WIDER
python -m tests.papers.headless_page                                                 write from docs/headless.json
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.bench.page import write_blocks
from tests.papers.few_bits_page import LEVELS, answers, counts, few_bits, interval, table
from wsnsim.analysis import statistics
from wsnsim.papers.measures import Data
from wsnsim.papers.study import study
from wsnsim.recording.folder import Folder

HOME = Path(__file__).parents[2]
STUDY = HOME / "scenarios/studies/headless"
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
        for name, row in found["rows"].items()
    ]  # fmt: skip
    head = ["radio: tracker", "error, median, m", "error over ekf", "traffic over ekf", "runs lost"]
    return {"answers": answers(found["tests"]), "counts": counts(found["tests"]), "rows": table(head, cells)}


def main() -> None:
    """Write docs/headless.json if asked to, then the blocks of docs/headless.md."""
    if "--new" in sys.argv[1:]:
        new = content(*(Data(Folder(Path(folder)), study(str(STUDY))) for folder in sys.argv[-2:]))
        ROWS.write_text(json.dumps(new, indent=1) + "\n", encoding="utf-8")
    write_blocks(PAGE, blocks(json.loads(ROWS.read_text(encoding="utf-8"))))


if __name__ == "__main__":
    main()
