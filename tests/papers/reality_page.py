"""The tables of docs/reality.md, from the full campaign of `wsnsim reproduce reality`.

wsnsim reproduce reality --full --figures docs; python -m tests.papers.reality_page --new    take its rows, then write
python -m tests.papers.reality_page                                                 write from docs/reality.json
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import wsnsim
from tests.bench.page import write_blocks
from tests.papers.page_files import as_csv, write_files
from tests.papers.studies import module
from wsnsim.base.tables import Memory
from wsnsim.papers.measures import Data
from wsnsim.papers.study import study
from wsnsim.recording.folder import Folder

measures = module("reality", "answers")
_recording = module("reality", "recording")
figures_in_words, heard_share, track_residuals = (
    _recording.figures_in_words,
    _recording.heard_share,
    _recording.track_residuals,
)

HOME = Path(__file__).parents[2]
PAGE, ROWS = HOME / "docs/reality.md", HOME / "docs/reality.json"
CAMPAIGNS = HOME / "results/reproduce/full/reality"
FIGURES = ("gap", "gap_others", "residuals", "tracks")
NETWORK = "recorded_network"
OF_NETWORK = ("rmse", "nees", "frames_sent", "frames_lost", "delay", "report_delay", "energy")
"""Columns of `runs` and `tracks` that the page shows of the run through the network."""
STATES = {
    "simulated": "simulated, {}",
    "recorded": "recorded, {}",
    "gains known": "recorded, gains, {}",
    "gains estimated": "recorded, unknown gains, {}, estimated",
    "calibrated twin": "simulated, gains, {}, inflated",
}
"""Columns of the table of the calibration, and the words of their variants."""


def content(data: Data, others: Data) -> dict[str, Any]:
    """Everything that the page shows, as plain values: of the experiment `tracks`, and of all other trackers."""
    found = measures.tracks_of(data)
    names = [track.name for track in found.tracks]
    step = data.registered["step"]
    estimating = measures.trackers_on(data, "recorded, unknown gains", "estimated")
    calibrated = {
        kind: {
            state: [_mean(data, names, words.format(kind), column) for column in ("rmse", "nees")]
            for state, words in STATES.items()
            if state != "gains estimated" or kind in estimating
        }
        for kind in measures.trackers_on(data, "recorded, gains")
    }
    return {
        "runs": [each.manifest.points[0].replicates for each in (data, others)],
        "answers": [each._asdict() for each in measures.answers(data)],
        "gaps": [
            gap._asdict() for gap in sorted([*measures.gaps(data), *measures.gaps(others)], key=lambda gap: -gap.median)
        ],
        "calibrated": calibrated,
        "residuals": {name: _residuals(found, name, step) for name in names},
        "lines": [*measures.above(data, others), *measures.on_memory(data), *figures_in_words(found)],
        "network": network(),
    }


def _mean(data: Data, names: Sequence[str], words: str, column: str) -> float:
    """The mean over tracks of the medians over runs."""
    return float(sum(measures.medians(data, f"{name}, {words}", column)[0] for name in names) / len(names))


def _residuals(found: Any, name: str, step: float) -> dict[str, Any]:
    these = track_residuals(found, name)
    kept = ("sd", "kurtosis", "correlation", "scatter")
    return {key: getattr(these, key) for key in kept} | {"heard": heard_share(found, name, step)}


def network() -> dict[str, Mapping[str, Any]]:
    """One run of the recorded track through the network, and standalone."""
    runs = {}
    for word, settings in (("standalone", ["network=none"]), ("network", [])):
        recorder = Memory({"readings": True, "estimates": True})
        summary = wsnsim.experiment.simulate_run(
            wsnsim.load(NETWORK, [*settings, "record.readings=true"]), recorder=recorder
        )
        taken = int((recorder.table("readings")["step"] > 0).sum())
        used = int(recorder.table("estimates")["readings"].sum())
        kept = {name: value for name, value in {**summary.tracks[0], **summary.run}.items() if name in OF_NETWORK}
        runs[word] = {**kept, "taken": taken, "used": used}
    return runs


def blocks(rows: Mapping[str, Any]) -> dict[str, str]:
    """{name of a block of the page: its text}."""
    return {
        "answers": _answers(rows["answers"], rows["runs"][0]),
        "gaps": _gaps(rows["gaps"]),
        "calibration": _calibration(rows["calibrated"]),
        "lines": "\n".join(f"- {line}" for line in rows["lines"]),
        "network": _network(rows["network"]),
    }  # fmt: skip


def _answers(answers: Iterable[Mapping[str, Any]], runs: int) -> str:
    rows = [
        [str(number), each["words"].replace(">=", "≥"), " and ".join(_interval(*found) for found in each["found"]),
         f"**{each['answer']}**"]
        for number, each in enumerate(answers, 1)
    ]  # fmt: skip
    return _table(["", "hypothesis", f"found, {runs} seeds [95 %]", "answer"], rows)


def _gaps(gaps: Sequence[Mapping[str, Any]]) -> str:
    """The medians over the tracks, half of the trackers beside the other half."""
    cells, half = [(gap["tracker"], f"{gap['median']:.2f}") for gap in gaps], len(gaps) // 2
    pairs = zip(cells[:half], cells[half:], strict=True)
    return _table(["tracker", "median"] * 2, [[*one, *other] for one, other in pairs])


def files(rows: Mapping[str, Any]) -> dict[str, str]:
    """{name of a CSV file beside the page: its text}: the gap on each track, and what the readings themselves say."""
    residuals = [{"track": name, **_before_and_after(row)} for name, row in rows["residuals"].items()]
    return {"reality.csv": as_csv(rows["gaps"]), "reality_residuals.csv": as_csv(residuals)}


def _before_and_after(row: Mapping[str, Any]) -> dict[str, Any]:
    """Values under path loss alone and with gains in columns of their own."""
    words = ("path loss alone", "with gains")
    pairs = {key: dict(zip(words, value, strict=True)) for key, value in row.items() if isinstance(value, list)}
    return {**row, **pairs}


def _calibration(found: Mapping[str, Mapping[str, Sequence[float]]]) -> str:
    rows = [
        [kind, *(f"{each[state][0]:.2f} ({each[state][1]:.1f})" if state in each else "-" for state in STATES)]
        for kind, each in found.items()
    ]
    return _table(["tracker", *STATES], rows)


def _network(runs: Mapping[str, Mapping[str, Any]]) -> str:
    alone, net = runs["standalone"], runs["network"]
    rows = [
        ["RMSE, m", f"{alone['rmse']:.2f}", f"{net['rmse']:.2f}"],
        ["NEES per coordinate", f"{alone['nees']:.1f}", f"{net['nees']:.1f}"],
        [
            "readings that the head used, of those recorded",
            f"{alone['used']:,} of {alone['taken']:,}",
            f"{net['used']:,} of {net['taken']:,}",
        ],
        ["frames sent; lost", "-", f"{net['frames_sent']:,}; {net['frames_lost']:,}"],
        ["latency at the head, median, ms", "-", f"{1e3 * net['delay']:.1f}"],
        ["latency at the sink, median, ms", "-", f"{1e3 * net['report_delay']:.1f}"],
        ["energy, J", "-", f"{net['energy']:.1f}"],
    ]
    return _table(["", "standalone", "network"], rows)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _interval(value: float, low: float, high: float) -> str:
    return f"{value:.2f} [{low:.2f}, {high:.2f}]"


def main() -> None:
    """Write docs/reality.json if asked to, then the blocks of docs/reality.md."""
    if "--new" in sys.argv[1:]:
        new = content(*(Data(Folder(CAMPAIGNS / name), study("reality")) for name in ("tracks", "trackers")))
        ROWS.write_text(json.dumps(new, indent=1) + "\n", encoding="utf-8")
    rows = json.loads(ROWS.read_text(encoding="utf-8"))
    write_files(files(rows))
    write_blocks(PAGE, blocks(rows))


if __name__ == "__main__":
    main()
