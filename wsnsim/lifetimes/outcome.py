"""What an estimate of a lifetime tells, as plain values: what is written to a file, printed, and drawn.

outcome_of(lifetime, scenario) -> {key: value}; see `analysis.lifetime_result`
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.tables import CAUSES
from wsnsim.lifetimes.estimate import Lifetime
from wsnsim.scenario.build import resolved

POINTS: Final = 200
"""Points of the curves over time."""
NAMED: Final = 3
"""Nodes that are named as the first to die."""


def outcome_of(lifetime: Lifetime, scenario: Any) -> dict[str, Any]:
    """The plain values of an estimate."""
    plan, first = lifetime.plan, lifetime.epochs[0]
    paths, size = plan.draws * plan.repeats, len(lifetime.facts.positions)
    alive = np.array([node not in first.dead for node in range(size)])
    most = max(int(np.ceil(plan.last * size)), int((~alive).sum()) + 1)
    events = _until(lifetime.events, most, alive)
    bounds = np.searchsorted(events[:, 0], np.arange(paths + 1))
    series = [lifetime.rules.series(events[a:b], alive) for a, b in itertools.pairwise(bounds)]
    ends = np.array([ts[-1] if round(now["dead"][-1] * size) >= most else plan.horizon for ts, now in series])
    times = {name: np.ravel(lifetime.times[name]) for name in plan.known}
    quiet, added = first.quiet.watts, first.library.joules.mean(axis=0)
    visits, mortal = plan.visit.visits, lifetime.mortal
    rate = visits.frequency(min(max(1.0, lifetime.baseline), plan.horizon))
    return {
        "name": scenario.name, "seed": scenario.seed, "horizon": plan.horizon, "tolerance": plan.tolerance,
        "shares": {name: getattr(plan, name) for name in ("coverage", "connected", "tracked")}, "paths": paths,
        "rate": rate, "seconds": float(first.library.seconds.mean()), "joules": float(added.sum()),
        "libraries": [
            {
                "dead": len(each.dead), "visits": len(each.library.tracked),
                "tracked": float(each.library.tracked.mean()), "error": metrics.rmse(each.library.rmse),
            }
            for each in lifetime.epochs
        ],
        "criteria": [_criterion(name, lifetime, times[name], series) for name in plan.known],
        "end": float(np.median(ends)), "baseline": lifetime.baseline, "lost_limit": lifetime.lost_limit,
        "nodes": {
            "x": lifetime.facts.positions[:, 0], "y": lifetime.facts.positions[:, 1],
            "sink": [node in lifetime.facts.sinks for node in range(size)],
            "quiet": quiet.sum(axis=0), "visits": rate * added.sum(axis=0),
            "died": _deaths(events, size, paths),
        },
        "causes": _by_cause(quiet[:, mortal].mean(axis=1), rate * added[:, mortal].mean(axis=1)),
        "first": _first(lifetime, quiet, rate * added),
        "curves": _curves(series, float(np.median(ends))),
        "not_modelled": list(lifetime.not_modelled), "notes": list(lifetime.notes),
        "lifetimes": {
            "path": np.tile(np.arange(paths), len(times)), "criterion": np.repeat(list(times), paths),
            "time": np.concatenate(list(times.values())),
        },
        "deaths": dict(zip(("path", "node", "time", "back"), events.T, strict=True)),
        "scenario": resolved(scenario),
    }  # fmt: skip


Series = list[tuple[Floats, dict[str, Floats]]]
"""Of each path: times of its changes, and quantities from each of them on."""


def _until(events: Floats, most: int, alive: Bools) -> Floats:
    """The events of each path, in order, until this number of nodes is dead."""
    rows = events[np.lexsort((events[:, 2], events[:, 0]))]
    steps = np.where(rows[:, 3] > 0.0, -1, 1)
    before = np.cumsum(steps) - steps  # of all paths, one after the other
    dead = (~alive).sum() + before - before[np.searchsorted(rows[:, 0], rows[:, 0])]
    return rows[np.flatnonzero(dead < most)]


def _criterion(name: str, lifetime: Lifetime, times: Floats, series: Series) -> dict[str, Any]:
    """A row of the table of criteria, with the share of steps that is tracked when it is met."""
    tracked = [
        now["tracked"][np.searchsorted(changes, time, side="right") - 1]
        for time, (changes, now) in zip(times, series, strict=True)
        if np.isfinite(time)
    ]
    share = float(np.mean(tracked)) if tracked else np.nan
    return {"criterion": name, **lifetime.criteria[name]._asdict(), "tracked": share}


def _deaths(events: Floats, size: int, paths: int) -> Floats:
    """(N,) median time of each node's first death in s; infinite if most paths see none."""
    first = np.full((size, paths), np.inf)
    dead = events[events[:, 3] == 0.0]
    np.minimum.at(first, (dead[:, 1].astype(int), dead[:, 0].astype(int)), dead[:, 2])
    medians: Floats = np.quantile(first, 0.5, axis=1, method="nearest")
    return medians


def _by_cause(quiet: Floats, visits: Floats) -> dict[str, Any]:
    """The mean node's power by cause in W, the largest first."""
    order = [i for i in np.argsort(-(quiet + visits), kind="stable") if quiet[i] or visits[i]]
    return {"cause": [CAUSES[i] for i in order], "quiet": quiet[order], "visits": visits[order]}


def _first(lifetime: Lifetime, quiet: Floats, visits: Floats) -> list[dict[str, Any]]:
    """The nodes that most often die first: in which share of the paths with a death, and on what they spend.

    Of nodes that die at the same time, each is the first.
    """
    events, firsts = lifetime.events[lifetime.events[:, 3] == 0.0], np.ravel(lifetime.times["first_death"])
    is_first = events[:, 2] == firsts[events[:, 0].astype(int)]
    found, counts = np.unique(events[is_first, 1].astype(int), return_counts=True)
    power = (quiet + visits).sum(axis=0)
    mean = max(float(power[lifetime.mortal].mean()), 1e-300)
    return [
        {
            "node": int(found[i]), "share": float(counts[i] / np.isfinite(firsts).sum()),
            "ratio": float(power[found[i]] / mean),
            "quiet": float(quiet[:, found[i]].sum() / max(float(power[found[i]]), 1e-300)),
            "quiet_cause": CAUSES[int(quiet[:, found[i]].argmax())],
            "visits_cause": CAUSES[int(visits[:, found[i]].argmax())],
        }
        for i in np.argsort(-counts, kind="stable")[:NAMED]
    ]  # fmt: skip


def _curves(series: Series, end: float) -> Mapping[str, Any]:
    """Medians and 95 % bands over the paths, until half of them have ended; a path that has ended stays as it is."""
    grid = np.linspace(0.0, end, POINTS)
    rows = [np.searchsorted(changes, grid, side="right") - 1 for changes, _ in series]
    found: dict[str, Any] = {"time": grid}
    for name, key in (("alive", "dead"), ("coverage", "coverage"), ("tracked", "tracked")):
        values = np.array([now[key][row] for row, (_, now) in zip(rows, series, strict=True)])
        values = 1.0 - values if key == "dead" else values
        low, middle, high = np.quantile(values, [0.025, 0.5, 0.975], axis=0)
        found |= {name: middle, f"{name}_low": low, f"{name}_high": high}
    return found
