"""The study of docs/lifetimes.md: do rankings by joules of a run hold for life?

python -m tests.papers.lifetimes_study FOLDER     simulate what visits the folder lacks, write docs/lifetimes.json, the
                                                  figure and the blocks of the page
python -m tests.papers.lifetimes_study            write figure and blocks from docs/lifetimes.json
"""

from __future__ import annotations

import dataclasses
import functools
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import stats

from tests.bench.page import spliced
from tests.helpers.stored_visits import joined, stored_visit
from tests.lifetimes import validation
from tests.papers.page_files import as_csv, write_files
from wsnsim.base.setups import NetworkSetup
from wsnsim.experiment import load
from wsnsim.lifetimes.estimate import Estimation, Lifetime, LifetimePlan
from wsnsim.lifetimes.library import Library, Visit, make_visit
from wsnsim.lifetimes.paths import Phase
from wsnsim.models.visits import Visits
from wsnsim.scenario.build import build

HOME: Final = Path(__file__).parents[2]
PAGE, ROWS, FIGURE = (HOME / "docs" / name for name in ("lifetimes.md", "lifetimes.json", "lifetimes.png"))
DAY, HOUR = 86_400.0, 3_600.0
DEPLOYMENTS: Final = (1, 2, 3)
VISITS: Final = 24
DRAWS: Final = 40
"""Sample paths, each with loads of its own."""
RATES: Final = (0.1, 1.0, 10.0, 40.0)
"""Intrusions an hour."""
INTERVALS: Final = {"xmac": (125, 250, 500, 1000), "contikimac": (125, 250, 500)}
TRACKERS: Final = ("gmtt", "tsstp", "cluster")
PLACE: Final = {"width": "180 m", "height": "180 m"}
FIELD: Final[dict[str, Any]] = {
    "name": "lifetimes",
    "duration": "100 s",
    "deploy": {"kind": "uniform", "nodes": 40, **PLACE, "cover": False},
    "clusters.quiet": None,
    "clusters.cap": None,
    "energy.battery": "18720 J",
    "battery": {"kind": "linear", "sink_on_mains": True},
    "motion": {"kind": "visits", "of": {"kind": "crossing", **PLACE, "speed": [4, 8]}, "rate": "0.1 1/h"},
}


class Variant(NamedTuple):
    """A tracker on a MAC with a wake interval in ms."""

    tracker: str
    mac: str
    interval: int

    @property
    def name(self) -> str:
        """'gmtt, xmac 250'."""
        return f"{self.tracker}, {self.mac} {self.interval}"


VARIANTS: Final = (
    *(Variant("gmtt", mac, interval) for mac, intervals in INTERVALS.items() for interval in intervals),
    *(Variant(tracker, "xmac", 250) for tracker in TRACKERS[1:]),
)
XMAC: Final = tuple(f"gmtt, xmac {interval}" for interval in INTERVALS["xmac"])
AT_250: Final = tuple(f"{tracker}, xmac 250" for tracker in TRACKERS)
REFERENCE: Final = "gmtt, xmac 250"


def setup_of(variant: Variant, seed: int) -> NetworkSetup:
    """The network of a variant in a deployment."""
    mac = {"kind": variant.mac, "rate": "250 kbit/s", "interval": f"{variant.interval} ms"}
    setup = build(load(variant.tracker, {**FIELD, "mac": mac, "seed": seed}))
    return dataclasses.replace(setup, network=0)


def made(
    folder: Path, name: str, setup: NetworkSetup, visit: Visit, numbers: Sequence[int], dead: frozenset[int]
) -> Library:
    """The visits of some numbers, from the folder."""
    stem = name.replace(", ", "_").replace(" ", "_")
    makes = {each: functools.partial(make_visit, setup, visit, each, dead) for each in numbers}
    return joined([stored_visit(folder / f"{stem}_{setup.seed}_{each}.npz", dead, makes[each]) for each in numbers])


class WithoutEpochs(Estimation):
    """An estimate whose paths end when half of the nodes are dead, with the visits of the whole network until then."""

    def _goals(self, phase: Phase) -> list[int]:
        return [int(np.ceil(0.5 * self._size))]


def lives(variant: Variant, seed: int, folder: Path) -> dict[str, Any]:
    """What a variant spends in a deployment, and how long it lives at each rate."""
    setup = setup_of(variant, seed)
    visits = setup.motions[0]
    assert isinstance(visits, Visits)
    make = functools.partial(made, folder, variant.name)
    found: dict[str, Any] = {"life": {}}
    for rate in RATES:
        visit = Visit(dataclasses.replace(visits, rate=rate / HOUR), 10.0, 14.0, visits.longest)
        plan = LifetimePlan(visit, 200.0 * 365.25 * DAY, VISITS, VISITS, draws=DRAWS, repeats=1, epochs=(0.0,))
        life: Lifetime = WithoutEpochs(setup, plan, make).run()
        days = {name: life.criteria[name].median / DAY for name in ("first_death", "half_dead")}
        found["life"][f"{rate:g}"] = {**days, "two_term": life.baseline / DAY}
    epoch = life.epochs[0]
    mortal = np.setdiff1d(np.arange(len(life.facts.positions)), life.facts.sinks)
    added = epoch.library.added[:, mortal].sum(axis=1)
    quiet = float(epoch.quiet.watts[:, mortal].sum())
    return found | {
        "run": float((added + quiet * epoch.library.seconds).mean()),
        "error": float(added.std(ddof=1) / np.sqrt(len(added))),
        "quiet": quiet / len(mortal),
        "visit": float(added.mean()) / len(mortal),
        "tracked": float(np.average(epoch.library.tracked, weights=epoch.library.seconds)),
    }


def kept(variant: Variant, seed: int, folder: Path) -> dict[str, Any]:
    """The same, from the folder if it is there."""
    path = folder / f"{variant.name.replace(', ', '_').replace(' ', '_')}_{seed}.json"
    if not path.exists():
        path.write_text(json.dumps(lives(variant, seed, folder)), encoding="utf-8")
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


Rows = dict[str, list[dict[str, Any]]]
"""{variant: [its outcome in each deployment]}"""


def of(rows: Rows, names: Sequence[str], value: Callable[[dict[str, Any]], float]) -> np.ndarray:
    """(variants, deployments) a value of some variants."""
    return np.array([[value(row) for row in rows[name]] for name in names])


def life(rate: float, criterion: str = "half_dead") -> Callable[[dict[str, Any]], float]:
    """The value: days of life at a rate."""
    return lambda row: row["life"][f"{rate:g}"][criterion]


def joules(row: dict[str, Any]) -> float:
    """The value: J of the nodes in a run that a target takes to cross the field."""
    return row["run"]


def taus(rows: Rows, rate: float, criterion: str = "half_dead") -> list[float]:
    """In each deployment, Kendall's tau of the orders by joules of a run, fewest first, and by life, longest first."""
    spent, days = of(rows, list(rows), joules), of(rows, list(rows), life(rate, criterion))
    return [float(stats.kendalltau(spent[:, i], -days[:, i]).statistic) for i in range(spent.shape[1])]


def best(rows: Rows, rate: float, criterion: str = "half_dead", names: Sequence[str] = XMAC) -> list[str]:
    """The variant that lives longest in each deployment."""
    return [names[i] for i in of(rows, names, life(rate, criterion)).argmax(axis=0)]


def baseline_errors(rows: Rows) -> np.ndarray:
    """(rates, variants, deployments) half-dead time of the two terms over that of the engine, less 1."""
    return np.array([of(rows, list(rows), life(r, "two_term")) / of(rows, list(rows), life(r)) - 1.0 for r in RATES])


def spread(values: np.ndarray) -> np.ndarray:
    """(deployments,) the largest over the smallest of variants."""
    return values.max(axis=0) / values.min(axis=0)


def tracking(rows: Rows, share: float = 0.9) -> list[list[str]]:
    """In each deployment, the X-MAC variants that track at least a share of what the shortest interval tracks."""
    tracked = of(rows, XMAC, lambda row: row["tracked"])
    return [[name for name, each in zip(XMAC, one, strict=True) if each >= share * one[0]] for one in tracked.T]


def best_tracking(rows: Rows, rate: float) -> list[str]:
    """In each deployment, the one of these that lives longest."""
    return [best(rows, rate, names=names)[i] for i, names in enumerate(tracking(rows))]


def interval(name: str) -> int:
    """The wake interval in ms of a variant's name."""
    return int(name.rpartition(" ")[2])


def tests(rows: Rows) -> dict[int, list[bool]]:
    """{hypothesis: whether it holds in each deployment}."""
    low, high = RATES[0], RATES[-1]
    early = [of(rows, [REFERENCE], life(r, "first_death"))[0] / of(rows, [REFERENCE], life(r))[0] for r in (low, high)]
    tracked = of(rows, XMAC, lambda row: row["tracked"])
    longest = [XMAC.index(name) for name in best(rows, low)]
    fewer = [tracked[0, i] - tracked[which, i] for i, which in enumerate(longest)]
    pairs = zip(best_tracking(rows, low), best_tracking(rows, high), strict=True)
    return {
        1: [max(both) < 0.5 for both in zip(taus(rows, low), taus(rows, RATES[1]), strict=True)],
        2: [tau < 0.7 for tau in taus(rows, high)],
        3: ((np.abs(baseline_errors(rows)) <= 0.02).mean(axis=(0, 1)) >= 0.9).tolist(),
        4: [set(names) == {XMAC[-1]} for names in zip(*(best(rows, rate) for rate in RATES), strict=True)],
        5: [interval(one) > interval(other) for one, other in pairs],
        6: ((early[0] > 0.95) & (early[1] < 0.8)).tolist(),
        7: ((spread(of(rows, AT_250, joules)) > 1.1) & (spread(of(rows, AT_250, life(low))) < 1.02)).tolist(),
        8: [each >= 0.2 for each in fewer],
    }


def answer(held: Sequence[bool]) -> str:
    """The answer to a hypothesis, from those of the deployments."""
    return "yes" if all(held) else "no" if not any(held) else "undecided"


WORDS: Final = {
    1: "tau of joules and life < 0.5 at 0.1 and at 1 an hour",
    2: "tau < 0.7 at 40 an hour",
    3: "two terms within 2 % of life in 90 % of cases",
    4: "X-MAC lives longest at 1000 ms at every rate",
    5: "best interval that tracks: shorter at 40 than at 0.1 an hour",
    6: "first death / life > 0.95 at 0.1, < 0.8 at 40 an hour",
    7: "trackers: joules > 1.1 times apart, lives < 1.02 times",
    8: "the interval of the longest life tracks 20 points less",
}


def blocks(rows: Rows) -> dict[str, str]:
    """{name of a block of the page: its text}."""
    return {"answers": _answers(rows), "conclusions": _conclusions(rows), "rows": _table_of(rows)}


def _answers(rows: Rows) -> str:
    lines = ["|  | hypothesis | found in deployments 1, 2, 3 | answer |", "| --- | --- | --- | --- |"]
    found = _found(rows)
    for number, held in tests(rows).items():
        lines.append(f"| {number} | {WORDS[number]} | {found[number]} | **{answer(held)}** |")
    return "\n".join(lines)


def _found(rows: Rows) -> dict[int, str]:
    """What was found, in words, for each hypothesis."""
    low, high = RATES[0], RATES[-1]
    errors = np.abs(baseline_errors(rows))
    early = {r: of(rows, [REFERENCE], life(r, "first_death"))[0] / of(rows, [REFERENCE], life(r))[0] for r in RATES}
    tracked = of(rows, XMAC, lambda row: row["tracked"]) * 100.0
    longest = [XMAC.index(name) for name in best(rows, low)]
    fewer = [tracked[0, i] - tracked[which, i] for i, which in enumerate(longest)]
    return {
        1: f"{_said(taus(rows, low))}; {_said(taus(rows, RATES[1]))}",
        2: _said(taus(rows, high)),
        3: _said(100.0 * (errors <= 0.02).mean(axis=(0, 1)), ".0f") + " % of cases",
        4: "; ".join(_intervals(best(rows, rate)) for rate in RATES) + " ms",
        5: "; ".join(_intervals(best_tracking(rows, rate)) for rate in (low, high)) + " ms",
        6: f"{_said(early[low])}; {_said(early[high])}",
        7: f"{_said(spread(of(rows, AT_250, joules)))}; {_said(spread(of(rows, AT_250, life(low))), '.3f')}",
        8: _said(fewer, ".0f") + " points",
    }


def _said(values: Any, form: str = ".2f") -> str:
    return ", ".join(f"{value:{form}}" for value in values)


def _intervals(names: Sequence[str]) -> str:
    return _said([interval(name) for name in names], ".0f")


def _conclusions(rows: Rows) -> str:
    errors, rate = 100.0 * np.abs(baseline_errors(rows)), RATES[-1]
    early = 1.0 - of(rows, list(rows), life(rate, "first_death")) / of(rows, list(rows), life(rate, "two_term"))
    return (
        f"Two terms differ from half dead by {np.median(errors):.2f} % (median) and {errors.max():.1f} % (largest of"
        f" {errors.size}). At {rate:g} an hour the first death comes {100 * early.min():.0f} to"
        f" {100 * early.max():.0f} % earlier than they say."
    )


def _table_of(rows: Rows) -> str:
    heads = ["variant", "run, J", "tracked, %", *(f"{rate:g}/h" for rate in RATES)]
    lines = ["| " + " | ".join(heads) + " |", "| --- " * len(heads) + "|"]
    for name in rows:
        days = [f"{of(rows, [name], life(rate)).mean():.0f}" for rate in RATES]
        spent, tracked = (of(rows, [name], value).mean() for value in (joules, lambda row: row["tracked"]))
        lines.append(f"| {name} | {spent:.2f} | {100 * tracked:.0f} | {' | '.join(days)} |")
    return "\n".join(lines)


def files(rows: Rows) -> dict[str, str]:
    """{name of the CSV file beside the page: its text}: a row for each variant and deployment, with days of life."""
    named = [{"variant": name, "deployment": seed, **row} for name, each in rows.items()
             for seed, row in zip(DEPLOYMENTS, each, strict=True)]  # fmt: skip
    return {"lifetimes.csv": as_csv(named)}


def draw(rows: Rows) -> None:
    """Draw life against tracked share, and the life over the rate, of all variants."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    families = {
        "gmtt, X-MAC": XMAC,
        "gmtt, ContikiMAC": [name for name in rows if "contikimac" in name],
        "tsstp, X-MAC": [AT_250[1]],
        "cluster, X-MAC": [AT_250[2]],
    }
    for (label, names), colour in zip(families.items(), ("C0", "C1", "C2", "C3"), strict=True):
        tracked = 100.0 * of(rows, names, lambda row: row["tracked"]).mean(axis=1)
        for rate, marker, style in ((RATES[1], "o", "-"), (RATES[-1], "s", "--")):
            days = of(rows, names, life(rate)).mean(axis=1)
            left.plot(tracked, days, marker + style, color=colour, label=f"{label}, {rate:g} an hour")
            for name, *place in zip(names, tracked, days, strict=True):
                left.annotate(f" {interval(name)}", place, color=colour, fontsize=8)
    rates = np.array(RATES)
    for name in XMAC:
        days = np.array([of(rows, [name], life(rate)).mean() for rate in RATES])
        right.plot(rates, days, "o-", label=f"{interval(name)} ms")
    left.set(xlabel="tracked share [%]", ylabel="half dead [days]", yscale="log", title="life against tracked share")
    right.set(xlabel="intrusions an hour", xscale="log", yscale="log", title="gmtt on X-MAC, by wake interval")
    left.legend(frameon=False, fontsize=7)
    right.legend(frameon=False, fontsize=8)
    figure.savefig(FIGURE, dpi=150)


def main() -> None:
    """Make what is missing if a folder is given; write rows, figure and page."""
    if len(sys.argv) > 1:
        folder = Path(sys.argv[1])
        folder.mkdir(parents=True, exist_ok=True)
        new = {each.name: [kept(each, seed, folder) for seed in DEPLOYMENTS] for each in VARIANTS}
        ROWS.write_text(json.dumps(new, indent=1) + "\n", encoding="utf-8")
    rows: Rows = json.loads(ROWS.read_text(encoding="utf-8"))
    draw(rows)
    write_files(files(rows))
    text = PAGE.read_text(encoding="utf-8")
    held = json.loads(validation.HELD.read_text(encoding="utf-8"))
    for name, block in {**blocks(rows), "validation": validation.markdown(held)}.items():
        text = spliced(text, name, block)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
