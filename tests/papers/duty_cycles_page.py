"""The tables of docs/duty_cycles.md, from the full campaigns of `wsnsim reproduce duty_cycles`.

wsnsim reproduce duty_cycles --full --figures docs     run everything
python -m tests.papers.duty_cycles_page --new          take the rows of what was run, then write
python -m tests.papers.duty_cycles_page                write from docs/duty_cycles.json

An experiment that has not been run keeps what the page had of it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.bench.page import spliced
from wsnsim.analysis import statistics
from wsnsim.papers.duty_cycles import hypotheses
from wsnsim.papers.duty_cycles.measures import best_lines
from wsnsim.papers.duty_cycles.points import run, value
from wsnsim.papers.measures import Data
from wsnsim.papers.paper import DUTY_CYCLES, paper
from wsnsim.recording.folder import Folder

HOME = Path(__file__).parents[2]
PAGE, ROWS = HOME / "docs/duty_cycles.md", HOME / "docs/duty_cycles.json"
CAMPAIGNS = HOME / "results/reproduce/full/duty_cycles"
NOT_YET = "*The runs have not been made yet.*"
FIELDS = ("li", "found", "jiang")
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
    """The results of an experiment; None if a variant has no run."""
    if not [*(CAMPAIGNS / name).glob("*/*.h5")]:
        return None
    data = Data(Folder(CAMPAIGNS / name), paper(DUTY_CYCLES))
    return data if run(data) == data.variants else None


def content(before: Mapping[str, Any]) -> dict[str, Any]:
    """Everything that the page shows, as plain values, by experiment."""
    found = dict(before)
    for name in FIELDS:
        if (data := campaign(name)) is not None:
            found[name] = of_field(data, hypotheses.OF_EXPERIMENT[name](data))
    if (data := campaign("waiting")) is not None:
        found["waiting"] = {"rows": {name: [value(data, name, "mean:energy")] for name in run(data)}}
    return found


def of_field(data: Data, answers: Iterable[Any]) -> dict[str, Any]:
    """The rows of a field's points, its best intervals and its answers."""
    rows = {
        name: {
            "runs": len(data.of(name, "runs")), "lost": statistics.share(data.lost(name)),
            **{words: value(data, name, measure) for words, measure in {**GOT, **PAID}.items()},
            "causes": _causes(data, name),
        }
        for name in run(data)
    }  # fmt: skip
    return {"rows": rows, "best": best_lines(data), "answers": [each._asdict() for each in answers]}


def _causes(data: Data, variant: str) -> dict[str, float]:
    """Mean joules of a run by the page's causes."""
    table = data.of(variant, "energy")
    joules = table.groupby("cause")["joules"].sum() / data.of(variant, "runs")["replicate"].nunique()
    unknown = {*joules.index} - {cause for causes in CAUSES.values() for cause in causes}
    assert not unknown, f"no column of the page has the causes {unknown}"
    return {words: float(sum(joules.get(cause, 0.0) for cause in causes)) for words, causes in CAUSES.items()}


def blocks(found: Mapping[str, Any]) -> dict[str, str]:
    """{name of a block of the page: its text}."""
    made = {"answers": _answers(found), "waiting": _waiting(found)}
    for name in FIELDS:
        rows = found[name]["rows"] if name in found else None
        made |= {f"{name}_got": _got(rows) if rows else NOT_YET, f"{name}_paid": _paid(rows) if rows else NOT_YET}
        if name != "found":
            made[f"{name}_best"] = "\n".join(f"- {line}" for line in found[name]["best"]) if rows else NOT_YET
    return made


def _answers(found: Mapping[str, Any]) -> str:
    answers = [each for name in FIELDS if name in found for each in found[name]["answers"]]
    answers.sort(key=lambda each: int(each["words"].partition(":")[0]))
    if not answers:
        return NOT_YET
    return _table(["hypothesis", "found [95 %]", "answer"], [
        [each["words"], " and ".join(map(_interval, each["found"])), f"**{each['answer']}**"] for each in answers
    ])  # fmt: skip


def _got(rows: Mapping[str, Mapping[str, Any]]) -> str:
    return _table(["tracker, MAC", "runs", *GOT, "lost"], [
        [name, str(row["runs"]), *(_cell(words, row[words]) for words in GOT), f"{row['lost'][0]:.0%}"]
        for name, row in rows.items()
    ])  # fmt: skip


def _paid(rows: Mapping[str, Mapping[str, Any]]) -> str:
    return _table(["tracker, MAC", *PAID, *(f"{words}, J" for words in CAUSES)], [
        [name, *(_cell(words, row[words]) for words in PAID), *(f"{row['causes'][words]:.3g}" for words in CAUSES)]
        for name, row in rows.items()
    ])  # fmt: skip


def _waiting(found: Mapping[str, Any]) -> str:
    if "waiting" not in found:
        return NOT_YET
    rows = [[name.partition(", ")[2], _interval(row[0])] for name, row in found["waiting"]["rows"].items()]
    return _table(["MAC", "energy without a target, J"], rows)


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
    text = PAGE.read_text(encoding="utf-8")
    for name, block in blocks(found).items():
        text = spliced(text, name, block)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
