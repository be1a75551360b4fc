"""The tables of docs/frontier.md, from the full campaigns of `wsnsim reproduce frontier`.

python -m tests.papers.frontier_page --settings COMMIT...   store the sweeps: the frontier takes its settings from there
wsnsim reproduce frontier --full --figures docs     run everything
python -m tests.papers.frontier_page --new          take the rows of what was run, then write
python -m tests.papers.frontier_page                write from docs/frontier.json

An experiment that has not been run keeps what the page had of it. Variants that `tests.papers.frontier_runs` ran alone
are merged with what the page had; so is the sweep of strategies that were added.
"""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tests.bench.page import write_blocks
from tests.papers.frontier_merge import merged, merged_strategies, number, of_row
from tests.papers.frontier_runs import ADDED
from tests.papers.frontier_table import followers, rows_of
from tests.papers.page_files import answer_rows, as_csv, counts, write_files
from tests.papers.studies import module
from wsnsim.analysis import campaigns
from wsnsim.analysis.figure_style import write_figure
from wsnsim.papers.measures import Data
from wsnsim.papers.rows import Interval, interval
from wsnsim.papers.study import study
from wsnsim.recording.folder import Folder

consistency = module("frontier", "bound")
figures = module("frontier", "figures")
hypotheses = module("frontier", "hypotheses")
real_radio = module("frontier", "real_radio")
settings = module("frontier", "settings")
_bound = module("frontier", "bound")
SETTLED, medians, of_medians, pooled, squares = (
    _bound.SETTLED,
    _bound.medians,
    _bound.of_medians,
    _bound.pooled,
    _bound.squares,
)
_strategies = module("frontier", "strategies")
limit, strategies = _strategies.limit, _strategies.strategies

HOME = Path(__file__).parents[2]
PAGE, ROWS = HOME / "docs/frontier.md", HOME / "docs/frontier.json"
PICTURE = HOME / "docs/frontier_frontier.png"
CAMPAIGNS = (HOME / "results/reproduce/full", ADDED)
"""Folders of campaigns; those in later ones replace rows of earlier ones."""
ASLEEP = "asleep"
AT_THE_BOUND = ("at_the_bound", "at_the_bound_again")
ON_A_RADIO = ("on_a_radio", "on_a_radio_again")
WITHOUT_SLOTS = "on_a_radio_contending"
LEAST = 5
"""Runs below which an experiment is not shown."""
MANY_DIGITS = 1e4
"""From here on numbers have three digits and an exponent: a filter that diverges may have any NEES."""
SWEEPS = {radio: f"settings_{radio}" for radio in settings.SWEPT_RADIOS.values()}


def campaigns_of(name: str) -> Iterator[Data]:
    """The results of an experiment: the campaigns each variant of which has at least LEAST runs."""
    for where in (folder / "frontier" for home in CAMPAIGNS for folder in (home, *sorted(home.glob("*")))):
        if (where / name / "campaign.json").exists() and [*(where / name).glob("*/*.h5")]:
            data = Data(Folder(where / name), study("frontier"))
            counts = data.table("runs").groupby("variant")["replicate"].nunique()
            if all(counts.get(variant, 0) >= LEAST for variant in data.variants):
                yield data


def content(before: Mapping[str, Any]) -> dict[str, Any]:
    """Everything that the page shows, as plain values, by experiment."""
    found = dict(before)
    for name, of in CONTENT.items():
        for data in campaigns_of(name):
            new, had = of(data), found.get(name, {})
            found[name] = _merged_frontier(had, new) if name == "frontier" else merged(had, new)
    if ASLEEP in found:
        found[ASLEEP] = merged(found[ASLEEP], {"rows": {}, "answers": _answers_asleep(found[ASLEEP]["rows"])})
    return found


def _answers_asleep(rows: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Hypothesis 8, of the rows that say which runs lost the target."""
    lost = {name: pd.Series(row["lost_by_run"], dtype=np.float64) for name, row in rows.items() if "lost_by_run" in row}
    ours = next(name for name in rows if hypotheses.strategy_of(name) == hypotheses.OURS)
    if ours not in lost:
        return []
    least = study("frontier").registered["asleep_in_time"]
    return [each._asdict() for each in hypotheses.of_losses(lost, Interval(*rows[ours]["in_time"]), least)]


def _merged_frontier(before: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    return merged_strategies(before, new, study("frontier").registered)


def _with_answers(data: Data, of: Callable[[Data, str], Mapping[str, Any]]) -> dict[str, Any]:
    """The rows of an experiment, and the answers that follow from its runs."""
    answers = hypotheses.OF_EXPERIMENT[data.manifest.name.partition("_")[2]](data)
    return {**_rows(data, of), "answers": [each._asdict() for each in answers]}


def _rows(data: Data, of: Callable[[Data, str], Mapping[str, Any]]) -> dict[str, Any]:
    return {
        "rows": {variant: {"runs": len(data.of(variant, "runs")), **of(data, variant)} for variant in data.variants}
    }


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


def _on_real_radio(data: Data, variant: str) -> dict[str, Any]:
    """The figures of `real_radio` for a variant."""
    (total,) = (one for one in strategies(data) if one.variant == variant)
    figure = real_radio.on_a_seed(data, variant, total)
    return {
        "in_time": figure.in_time, "lost": real_radio.clopper_pearson(*figure.lost), "over_bound": figure.over_bound,
        "rmse": _median(data, variant, "rmse"), "energy": hypotheses.mean_of_runs(data, variant, "energy"),
        "cpu": float(data.of(variant, "runs")["cpu_seconds"].mean()),
    }  # fmt: skip


def _asleep(data: Data, variant: str) -> dict[str, Any]:
    runs = data.of(variant, "runs")
    lost = campaigns.ever_lost(runs).astype(int)
    return {
        "rmse": _median(data, variant, "rmse"), "bound": data.bound(variant, "per_trajectory").of_replicates.mean(),
        "energy": hypotheses.mean_of_runs(data, variant, "energy"),
        "in_time": hypotheses.mean_of_runs(data, variant, "tracked"),
        "lost": int(lost.sum()), "lost_by_run": dict(zip(map(str, runs["replicate"]), lost.tolist(), strict=True)),
        "without": hypotheses.mean_of_runs(data, variant, "time_lost"),
    }  # fmt: skip


def _frontier(data: Data) -> dict[str, Any]:
    """The strategies of a campaign, the bound (m), and the answers that compare strategies run by run."""
    found = strategies(data)
    rows = [{**one._asdict(), "runs": len(data.of(one.variant, "runs"))} for one in found]
    paired = [each._asdict() for each in hypotheses.of_pairs(data, found)]
    return {"bound": limit(data), "strategies": rows, "answers": paired}


def _median(data: Data, variant: str, column: str) -> Interval:
    return interval(medians(data.of_runs(variant, column).to_numpy()))


CONTENT: Mapping[str, Callable[[Data], dict[str, Any]]] = {
    **dict.fromkeys(AT_THE_BOUND, lambda data: _with_answers(data, _consistent)),
    **dict.fromkeys(ON_A_RADIO, lambda data: _with_answers(data, _beside_bound)),
    "real_radio": lambda data: _with_answers(data, _on_real_radio),
    WITHOUT_SLOTS: lambda data: _rows(data, _beside_bound),
    ASLEEP: lambda data: _rows(data, _asleep),
    "robustness": lambda data: _with_answers(data, _consistent),
    "frontier": _frontier,
}


def blocks(found: Mapping[str, Any]) -> dict[str, str]:
    """{name of a block of the page: its text}."""
    return {"counts": counts(_by_number(found)), **{name: of(found[part]) for name, (part, of) in TABLES.items()}}


def files(found: Mapping[str, Any]) -> dict[str, str]:
    """{name of a CSV file beside the page: its text}: strategies, what the sweep chose, all other rows, answers."""
    others = [{"experiment": part, "variant": variant, **{key: row[key] for key in row if key != "lost_by_run"}}
              for part in found if "rows" in found[part] for variant, row in found[part]["rows"].items()]  # fmt: skip
    said = [{"hypothesis": each["words"], "found [95 %]": " and ".join(map(_text, each["found"])),
             "answer": each["answer"]} for each in answers(found)]  # fmt: skip
    parts = {"strategies": rows_of(found["frontier"]), "settings": [*_settings()], "rows": others, "answers": said,
             "hypotheses": answer_rows("frontier", {"answer": _by_number(found)})}  # fmt: skip
    return {f"frontier_{name}.csv": as_csv(content) for name, content in parts.items()}


def answers(found: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The answers of all experiments, by the number of their hypothesis."""
    said = [each for name in CONTENT if name in found for each in found[name].get("answers", ())]
    return sorted(said, key=lambda each: int(number(each)))


def _by_number(found: Mapping[str, Any]) -> dict[int, list[str]]:
    """The answers to the tests of each hypothesis."""
    by_number: dict[int, list[str]] = {}
    for each in answers(found):
        by_number.setdefault(int(number(each)), []).append(each["answer"])
    return by_number


def _asleep_table(found: Mapping[str, Any]) -> str:
    head = ["tracker", "RMSE of a run, median, m", "energy, J", "steps in time", "lost"]
    return _table(head, [
        [name.partition(": ")[2], f"{row['rmse'][0]:.2f}", f"{row['energy'][0]:.1f}", f"{row['in_time'][0]:.0%}",
         f"{row['lost']} of {row['runs']}"] for name, row in found["rows"].items()
    ])  # fmt: skip


def _real_radio(found: Mapping[str, Any]) -> str:
    """What each tracker has on the real radio: the least and the largest value of the seeds."""
    by_tracker: dict[str, list[Mapping[str, Any]]] = {}
    for name, row in found["rows"].items():
        by_tracker.setdefault(name.partition(": ")[2].split(", ")[0], []).append(row)
    columns = {"in_time": ".0%", "lost": ".0%", "over_bound": ".2f", "energy": ".0f"}
    return _table(["tracker", "in time", "runs lost", "median error / median bound", "energy, J"], [
        [name, *(_range([row[key][0] for row in rows], form) for key, form in columns.items())]
        for name, rows in by_tracker.items()
    ])  # fmt: skip


def _range(values: Sequence[float], form: str) -> str:
    return " to ".join(dict.fromkeys(f"{each:{form}}" for each in (min(values), max(values))))


TABLES: Mapping[str, tuple[str, Callable[[Mapping[str, Any]], str]]] = {
    "asleep": ("asleep", _asleep_table), "real_radio": ("real_radio", _real_radio), "frontier": ("frontier", followers),
}  # fmt: skip
"""{block of the page: the experiment that it shows, and the function that makes it}."""


def _settings() -> Iterator[dict[str, Any]]:
    """The choices of the stored sweeps, and what the sweeps found of them."""
    for radio, sweep in settings.stored().items():
        results = {one.variant: one for one in sweep.results}
        for name, choice in sweep.choices.items():
            for word, variant in zip(("fair", "frugal"), choice, strict=True):
                one = results[variant]
                said = variant.removeprefix(f"{radio}: {name}").removeprefix(", ") or "the defaults"
                figures = {"RMSE, m": one.rmse, "energy, J": one.energy, "lost": one.lost, "in time": one.in_time}
                yield {"radio": radio, "strategy": name, "choice": word, "setting": said, **figures}


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _text(found: Sequence[float]) -> str:
    value, low, high = (f"{each:.2f}" if abs(each) < MANY_DIGITS else f"{each:.3g}" for each in found)
    return f"{value} [{low}, {high}]"


def _store_sweeps(commits: Sequence[str]) -> None:
    """Store what was swept, beside the strategies that the stored sweeps have and that were not swept again."""
    found = dict(settings.stored())
    for radio, name in SWEEPS.items():
        for data in campaigns_of(name):
            new = settings.sweep_of(data, commits)
            found[radio] = settings.merged(found[radio], new, data.published["sweep"]) if radio in found else new
    settings.store(found)


def draw(part: Mapping[str, Any]) -> None:
    """Draw docs/frontier_frontier.png from the strategies of docs/frontier.json."""
    found = [of_row(row) for row in part["strategies"]]
    (experiment,) = (one for one in study("frontier").experiments if one.name == "frontier")
    (figure,) = experiment.figures
    about = f"{experiment.full} runs of 28 s each"
    drawing = functools.partial(figures.draw_strategies, found=found, bound=part["bound"], about=about)
    write_figure(drawing, PICTURE, figure.size, f"{study('frontier').source}, {figure.caption}")


def main() -> None:
    """Store the sweeps, or write docs/frontier.json, if asked to; then write the blocks of docs/frontier.md."""
    if "--settings" in sys.argv[1:]:
        commits = [word for word in sys.argv[1:] if not word.startswith("--")]
        _store_sweeps(commits)
    before = json.loads(ROWS.read_text(encoding="utf-8")) if ROWS.exists() else {}
    if "--new" in sys.argv[1:]:
        before = json.loads(json.dumps(content(before), default=float))
        ROWS.write_text(json.dumps(before, indent=1) + "\n", encoding="utf-8")
        draw(before["frontier"])
    write_files(files(before))
    write_blocks(PAGE, blocks(before))


if __name__ == "__main__":
    main()
