"""The tables of docs/late.md, from the full campaign of `wsnsim reproduce late`.

wsnsim reproduce late --full --figures docs; python -m tests.papers.late_page --new    take its rows, then write
python -m tests.papers.late_page                                                 write from docs/late.json
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.bench.page import write_blocks
from tests.papers.page_files import counts
from tests.papers.studies import module
from wsnsim.analysis import statistics
from wsnsim.papers.measures import Data
from wsnsim.papers.study import study
from wsnsim.recording.folder import Folder

late = module("late")

HOME = Path(__file__).parents[2]
PAGE, ROWS = HOME / "docs/late.md", HOME / "docs/late.json"
CAMPAIGN = HOME / "results/reproduce/full/late/late"


def content(data: Data) -> dict[str, Any]:
    """Everything that the page shows, as plain values."""
    radios = data.registered["radios"]
    points = {f"{radio} {interval}": (interval, [radio]) for radio in radios for interval in late.INTERVALS}
    points |= {f"all {interval}": (interval, list(radios)) for interval in late.INTERVALS}
    return {
        "tests": [row | {"words": late.words(row)} for row in late.tested(data)],
        "rows": {name: _row(data, name) for name in data.variants},
        "points": {
            name: {
                "share": {way: late.share(data, *point[:1], way, *point[1:]) for way in late.WAYS},
                "error": {way: late.ratio(data, point[0], way, "ignore", "error", point[1]) for way in late.WAYS},
                "energy": {way: late.ratio(data, point[0], way, "ignore", "energy", point[1]) for way in late.WAYS},
            }
            for name, point in points.items()
        },
    }  # fmt: skip


def _row(data: Data, variant: str) -> dict[str, Any]:
    tracks = data.of(variant, "tracks")
    return {
        "runs": len(data.of(variant, "runs")),
        "error": statistics.median(data.of_runs(variant, "rmse").to_numpy()).value,
        "energy": statistics.mean(data.of_runs(variant, "energy").to_numpy()).value,
        "late": float(tracks["late_readings"].fillna(0.0).mean()), "estimates": float(tracks["reports"].mean()),
        "lost": int(data.lost(variant).sum()),
    }  # fmt: skip


def blocks(found: Mapping[str, Any]) -> dict[str, str]:
    """{name of a block of the page: its text}."""
    tests = found["tests"]
    return {
        "answers": _answers(tests), "counts": counts({each["number"]: [each["answer"]] for each in tests}),
        "points": _points(found), "conclusions": _conclusions(found["rows"]),
    }  # fmt: skip


def _answers(tests: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        [str(each["number"]), each["words"].partition(": ")[2], _interval(each["found"]), f"{each['p_holm']:.2g}",
         f"**{each['answer']}**"] for each in tests
    ]  # fmt: skip
    return _table(["", "hypothesis", "found [95 %]", "p (Holm)", "answer"], rows)


def _points(found: Mapping[str, Any]) -> str:
    """For each radio and interval, and pooled: what each way changes."""
    rows = [[name, *(_interval(point["error"][way]) for way in late.WAYS)] for name, point in found["points"].items()]
    return _table(["radio, ms", *late.WAYS], rows)


def _conclusions(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Errors and late readings at 500 ms, and how far the radios that always listen are from them."""
    said = [
        f"{radio} {rows[f'{radio} 500, ignore']['error']:.1f} m, by refilter"
        f" {rows[f'{radio} 500, refilter']['error']:.1f} m with {rows[f'{radio} 500, refilter']['late']:.1f} late"
        " readings a run" for radio in ("xmac", "contikimac", "tsch")
    ]  # fmt: skip
    timely = rows["csma, flood"]
    return (
        f"Median errors at 500 ms, ignoring: {'; '.join(said)}. Radios that always listen have {timely['error']:.1f} m"
        f" for {timely['energy']:.0f} J."
    )


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _interval(found: Sequence[float]) -> str:
    return "{:.2f} [{:.2f}, {:.2f}]".format(*found[:3])


def main() -> None:
    """Write docs/late.json if asked to, then the blocks of docs/late.md."""
    if "--new" in sys.argv[1:]:
        new = content(Data(Folder(CAMPAIGN), study("late")))
        ROWS.write_text(json.dumps(new, indent=1) + "\n", encoding="utf-8")
    write_blocks(PAGE, blocks(json.loads(ROWS.read_text(encoding="utf-8"))))


if __name__ == "__main__":
    main()
