"""The tables of docs/frontier.md, from the full campaigns of `wsnsim reproduce frontier`.

python -m tests.papers.frontier_page --settings     store the sweeps: the frontier takes its settings from there
wsnsim reproduce frontier --full --figures docs     run everything
python -m tests.papers.frontier_page --new          take the rows of what was run, then write
python -m tests.papers.frontier_page                write from docs/frontier.json

An experiment that has not been run keeps what the page had of it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.bench.page import spliced
from wsnsim.analysis import campaigns
from wsnsim.papers.answers import Interval, interval
from wsnsim.papers.frontier import consistency, hypotheses, settings
from wsnsim.papers.frontier.against_bound import SETTLED, medians, of_medians, pooled, squares
from wsnsim.papers.frontier.strategies import conclusions, strategies
from wsnsim.papers.measures import Data
from wsnsim.papers.paper import FRONTIER, paper
from wsnsim.recording.folder import Folder

HOME = Path(__file__).parents[2]
PAGE, ROWS = HOME / "docs/frontier.md", HOME / "docs/frontier.json"
CAMPAIGNS = HOME / "results/reproduce/full/frontier"
AT_THE_BOUND = ("at_the_bound", "at_the_bound_again")
NOT_YET = "*The runs have not been made yet.*"
SWEEPS = {radio: f"settings_{radio}" for radio in settings.SWEPT_RADIOS.values()}


def campaign(name: str) -> Data | None:
    """The results of an experiment, all runs of which are there; None without."""
    folder = Folder(CAMPAIGNS / name)
    if not (CAMPAIGNS / name / "campaign.json").exists():
        return None
    data = Data(folder, paper(FRONTIER))
    counts = data.table("runs").groupby("variant")["replicate"].nunique()
    wanted = {point.settings["variant"]: point.replicates for point in data.manifest.points}
    return data if counts.to_dict() == wanted else None


def content(before: Mapping[str, Any]) -> dict[str, Any]:
    """Everything that the page shows, as plain values, by experiment."""
    found = dict(before)
    for name, of in CONTENT.items():
        data = campaign(name)
        if data is not None:
            found[name] = {"runs": data.manifest.points[0].replicates, **of(data)}
            if name in hypotheses.OF_EXPERIMENT:
                found[name]["answers"] = [each._asdict() for each in hypotheses.OF_EXPERIMENT[name](data)]
    return found


def _rows(data: Data, of: Callable[[Data, str], Mapping[str, Any]]) -> dict[str, Any]:
    return {"rows": {variant: of(data, variant) for variant in data.variants}}


def _beside_bound(data: Data, variant: str) -> dict[str, Any]:
    """Errors over the bound, energy and losses of a variant."""
    whole, runs = squares(data, variant), data.of(variant, "runs")
    later = whole.after(SETTLED)
    return {
        "pooled": pooled(whole), "settled": pooled(later), "medians": of_medians(whole),
        "settled_medians": of_medians(later), "energy": hypotheses.mean_of_runs(data, variant, "energy"),
        "rmse": _median(data, variant, "rmse"), "greatest": float(runs["rmse"].max()),
        "lost": int(campaigns.ever_lost(runs).sum()), "in_time": hypotheses.mean_of_runs(data, variant, "tracked"),
        "cpu": float(runs["cpu_seconds"].mean()),
    }  # fmt: skip


def _consistent(data: Data, variant: str) -> dict[str, Any]:
    """The same, and the mean NEES of position and state on either kind of stretch."""
    nees = {
        f"{of}, {'near walls' if near else 'away'}": consistency.mean_nees(data, variant, near, of)
        for of in consistency.DIMENSIONS
        for near in (False, True)
    }
    return {**_beside_bound(data, variant), "nees": nees}


def _asleep(data: Data, variant: str) -> dict[str, Any]:
    runs = data.of(variant, "runs")
    return {
        "rmse": _median(data, variant, "rmse"), "bound": data.bound(variant, "per_trajectory").of_replicates.mean(),
        "energy": hypotheses.mean_of_runs(data, variant, "energy"),
        "in_time": hypotheses.mean_of_runs(data, variant, "tracked"),
        "lost": int(campaigns.ever_lost(runs).sum()), "without": hypotheses.mean_of_runs(data, variant, "time_lost"),
    }  # fmt: skip


def _frontier(data: Data) -> dict[str, Any]:
    return {"lines": conclusions(data), "strategies": [one._asdict() for one in strategies(data)]}


def _median(data: Data, variant: str, column: str) -> Interval:
    return interval(medians(data.of_runs(variant, column).to_numpy()))


CONTENT: Mapping[str, Callable[[Data], dict[str, Any]]] = {
    **dict.fromkeys(AT_THE_BOUND, lambda data: _rows(data, _consistent)),
    "on_a_radio": lambda data: _rows(data, _beside_bound),
    "asleep": lambda data: _rows(data, _asleep),
    "robustness": lambda data: _rows(data, _consistent),
    "frontier": _frontier,
}


def blocks(found: Mapping[str, Any]) -> dict[str, str]:
    """{name of a block of the page: its text}."""
    bound = {name: row for part in AT_THE_BOUND for name, row in found.get(part, {}).get("rows", {}).items()}
    counts = {name: found[part]["runs"] for part in AT_THE_BOUND for name in found.get(part, {}).get("rows", {})}
    return {
        "answers": _answers(found),
        "bound": _table(["seed", "runs", *BESIDE], [[_last(name), str(counts[name]), *_cells(row)] for name, row in
                        bound.items()]) if bound else NOT_YET,
        "consistency": _table(["seed", *next(iter(bound.values()))["nees"]],
                              [[_last(name), *map(_text, row["nees"].values())] for name, row in bound.items()])
        if bound else NOT_YET,
        **{name: _of(found, name, of) for name, of in TABLES.items()},
        **{f"settings_{radio}": _settings(radio) for radio in SWEEPS},
    }  # fmt: skip


BESIDE = ("pooled error / bound", "after 1 s", "median error / median bound", "after 1 s ", "energy, J", "lost",
          "greatest RMSE, m", "in time")  # fmt: skip


def _cells(row: Mapping[str, Any]) -> list[str]:
    """The cells of BESIDE."""
    ratios = [_text(row[key]) for key in ("pooled", "settled", "medians", "settled_medians")]
    return [*ratios, _short(row["energy"]), str(row["lost"]), f"{row['greatest']:.2f}", f"{row['in_time'][0]:.1%}"]


def _of(found: Mapping[str, Any], name: str, of: Callable[[Mapping[str, Any]], str]) -> str:
    return of(found[name]) if name in found else NOT_YET


def _radio(found: Mapping[str, Any]) -> str:
    return _table(["seed", *BESIDE], [[_last(name), *_cells(row)] for name, row in found["rows"].items()])


def _asleep_table(found: Mapping[str, Any]) -> str:
    head = ["tracker", "RMSE of a run, median, m", "energy, J", "steps with an estimate in time",
            f"lost, of {found['runs']}", "time without a track, s"]  # fmt: skip
    return _table(head, [
        [name.partition(": ")[2], _text(row["rmse"]), _short(row["energy"]), f"{row['in_time'][0]:.0%}",
         str(row["lost"]), _text(row["without"])] for name, row in found["rows"].items()
    ])  # fmt: skip


def _robustness(found: Mapping[str, Any]) -> str:
    head = ["tracker and what it knows", "RMSE of a run, median, m", "pooled error / bound for that knowledge",
            "NEES of the position away from walls", f"lost, of {found['runs']}"]  # fmt: skip
    return _table(head, [
        [name.partition(": ")[2], _text(row["rmse"]), _text(row["pooled"]), _text(row["nees"]["position, away"]),
         str(row["lost"])] for name, row in found["rows"].items()
    ])  # fmt: skip


def _frontier_block(found: Mapping[str, Any]) -> str:
    return "\n".join(f"- {line}" for line in found["lines"])


TABLES: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "on_a_radio": _radio, "asleep": _asleep_table, "robustness": _robustness, "frontier": _frontier_block,
}  # fmt: skip


def _settings(radio: str) -> str:
    """The choices of a stored sweep, and what the sweep found of them."""
    if radio not in settings.stored():
        return NOT_YET
    sweep = settings.stored()[radio]
    results = {one.variant: one for one in sweep.results}
    rows = []
    for name, choice in sweep.choices.items():
        for word, variant in zip(("fair", "frugal"), choice, strict=True):
            if word == "fair" or variant != choice.fair:
                one = results[variant]
                said = variant.removeprefix(f"{radio}: {name}").removeprefix(", ") or "the defaults"
                rows.append([name, word, said, f"{one.rmse:.2f}", f"{one.energy:.3g}", f"{one.lost:.0%}",
                             f"{one.in_time:.0%}"])  # fmt: skip
    return _table(["strategy", "", "setting", "RMSE, m", "energy, J", "lost", "in time"], rows)


def _answers(found: Mapping[str, Any]) -> str:
    answers = [each for name in CONTENT if name in found for each in found[name].get("answers", ())]
    if not answers:
        return NOT_YET
    answers.sort(key=lambda each: int(each["words"].split(":")[0].split(" ")[0]))
    return _table(["hypothesis", "found [95 %]", "answer"], [
        [each["words"].replace(">=", "≥").replace("<=", "≤"), " and ".join(map(_text, each["found"])),
         f"**{each['answer']}**"] for each in answers
    ])  # fmt: skip


def _last(variant: str) -> str:
    return variant.rpartition(", ")[2].removeprefix("seed ")


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _text(found: Sequence[float]) -> str:
    return "{:.2f} [{:.2f}, {:.2f}]".format(*found)


def _short(found: Sequence[float]) -> str:
    return "{:.3g} [{:.3g}, {:.3g}]".format(*found)


def main() -> None:
    """Store the sweeps, or write docs/frontier.json, if asked to; then write the blocks of docs/frontier.md."""
    if "--settings" in sys.argv[1:]:
        done = {radio: campaign(name) for radio, name in SWEEPS.items()}
        settings.store({radio: settings.sweep_of(data) for radio, data in done.items() if data is not None})
    before = json.loads(ROWS.read_text(encoding="utf-8")) if ROWS.exists() else {}
    if "--new" in sys.argv[1:]:
        before = json.loads(json.dumps(content(before), default=float))
        ROWS.write_text(json.dumps(before, indent=1) + "\n", encoding="utf-8")
    text = PAGE.read_text(encoding="utf-8")
    for name, block in blocks(before).items():
        text = spliced(text, name, block)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
