"""How long a network lives: quiet power, a library of visits, posterior loads, sample paths, criteria.

    estimate(setup, plan) -> Lifetime

The library grows until the error of the first death is small enough. When enough nodes have died, visits are simulated
anew in the network that is left, the one of the median path.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.setups import NetworkSetup
from wsnsim.lifetimes.criteria import LATTICE, Criteria
from wsnsim.lifetimes.library import Library, Visit, make_visit
from wsnsim.lifetimes.paths import Paths, Phase
from wsnsim.lifetimes.quiet import Quiet, quiet_power
from wsnsim.lifetimes.rates import Loads, fit_loads
from wsnsim.lifetimes.stores import Stores
from wsnsim.network.inspection import NetworkFacts, inspect_network

YEAR: Final = 365.25 * 86_400.0
EPOCHS: Final = (0.0, 0.1, 0.3, 0.5)
"""Shares of dead nodes at which visits are simulated anew."""
LEVEL: Final = 0.95


@dataclasses.dataclass(frozen=True)
class Plan:
    """How a lifetime is estimated.

    Attributes:
        visit: the window of a visit.
        horizon: end of the sample paths in s.
        least: number of visits simulated first; doubled until `error` holds.
        most: largest number of visits.
        error: half width of the 95 % confidence interval of the first death, as a share of it, that is small enough.
        draws: draws of the nodes' loads, each with `repeats` paths.
        epochs: shares of dead nodes at which visits are simulated anew.
        later: visits that are simulated in each later epoch.
    """

    visit: Visit
    horizon: float = 10.0 * YEAR
    least: int = 12
    most: int = 192
    error: float = 0.05
    draws: int = 50
    repeats: int = 4
    epochs: tuple[float, ...] = EPOCHS
    later: int = 12
    seed: int = 0
    tolerance: float = 0.0
    coverage: float = 0.9
    connected: float = 0.5
    tracked: float = 0.9


class Interval(NamedTuple):
    """Two ends, in s."""

    low: float
    high: float


class Estimate(NamedTuple):
    """When a criterion is met.

    Attributes:
        median: over the paths in s; infinite if half of them do not meet it before the horizon.
        mean: over the paths in s; NaN if some do not meet it.
        prediction: where it lies for one network with 95 %.
        confidence: where its mean lies with 95 %, given what few visits tell of the loads; NaN as `mean`.
        met: share of the paths that meet it before the horizon.
    """

    median: float
    mean: float
    prediction: Interval
    confidence: Interval
    met: float


class Epoch(NamedTuple):
    """A network with its dead nodes: its quiet power, its library, and the posterior loads."""

    dead: frozenset[int]
    quiet: Quiet
    library: Library
    loads: Loads


@dataclasses.dataclass(frozen=True)
class Lifetime:
    """How long a network lives.

    Attributes:
        plan: how it was estimated.
        facts: the network.
        criteria: {criterion: when it is met}.
        times: {criterion: (draws, repeats) s of each path}.
        events: (E, 4) deaths and returns: path, node, time in s, whether it is back.
        epochs: the networks that were simulated.
        baseline: s that the mean node lives by its battery / (quiet power + rate of visits × joules of a visit).
    """

    plan: Plan
    facts: NetworkFacts
    criteria: dict[str, Estimate]
    times: dict[str, Floats]
    events: Floats
    epochs: tuple[Epoch, ...]
    baseline: float


Make = Callable[[NetworkSetup, Visit, Sequence[int], frozenset[int]], Library]
"""Simulates the visits of some numbers."""


def make_serially(setup: NetworkSetup, visit: Visit, numbers: Sequence[int], dead: frozenset[int]) -> Library:
    """The library of several visits, simulated one after the other."""
    library = make_visit(setup, visit, numbers[0], dead)
    for number in numbers[1:]:
        library = library.joined(make_visit(setup, visit, number, dead))
    return library


class Estimation:
    """One estimate of a lifetime, in the making."""

    def __init__(self, setup: NetworkSetup, plan: Plan, make: Make) -> None:
        self._setup = dataclasses.replace(setup, network=0) if setup.network is None else setup
        self._plan, self._make = plan, make
        self._facts = inspect_network(self._setup, 0)
        size = len(self._facts.positions)
        self._stores = Stores(np.full(size, setup.energy.battery), np.ones(size, dtype=np.bool_))
        self._size, self._paths = size, plan.draws * plan.repeats
        self._rng = np.random.default_rng([self._setup.seed, plan.seed])
        self._epochs: list[Epoch] = []
        self._loads = np.zeros((self._paths, size))

    def run(self) -> Lifetime:
        """Make the estimate."""
        self._begin()
        plan, paths = self._plan, self._new_paths()
        for share, following in zip(plan.epochs, (*plan.epochs[1:], 0.6), strict=True):
            if share:
                dead = self._dead(paths)
                if dead is None:
                    break
                self._epochs.append(self._epoch(dead, plan.later, first=round(1e6 * share)))
            paths.advance(self._phase(self._epochs[-1]), int(np.ceil(following * self._size)))
        return self._result(paths)

    def _new_paths(self) -> Paths:
        return Paths(self._stores, self._plan.visit.visits, self._rng, self._paths, self._plan.horizon)

    def _begin(self) -> None:
        """Enlarge the first library until the first death is known well enough."""
        plan, dead = self._plan, frozenset(np.flatnonzero(~self._stores.alive).tolist())
        epoch = self._epoch(dead, plan.least, 0)
        while len(epoch.library.tracked) < plan.most and not self._is_enough(epoch):
            count = len(epoch.library.tracked)
            library = epoch.library.joined(self._make(self._setup, plan.visit, range(count, 2 * count), dead))
            epoch = epoch._replace(library=library, loads=fit_loads(library.added))
        self._epochs.append(epoch)

    def _is_enough(self, epoch: Epoch) -> bool:
        paths = self._new_paths()
        paths.advance(self._phase(epoch), 1)
        first = np.full(self._paths, np.inf)
        for path, _, time, _ in np.concatenate(paths.events or [np.zeros((0, 4))]):
            first[int(path)] = min(first[int(path)], time)
        known = self._estimated(first)
        width = known.confidence.high - known.confidence.low
        return not known.met or width / 2.0 <= self._plan.error * known.mean

    def _epoch(self, dead: frozenset[int], count: int, first: int) -> Epoch:
        library = self._make(self._setup, self._plan.visit, range(first, first + count), dead)
        quiet = quiet_power(self._setup, self._plan.visit, dead)
        return Epoch(dead, quiet, library, fit_loads(library.added))

    def _phase(self, epoch: Epoch) -> Phase:
        """What drains batteries in an epoch; nodes that are dead in its library but not in a path spend as before."""
        new = np.repeat(epoch.loads.draw(self._rng, self._plan.draws), self._plan.repeats, axis=0)
        gone, watts = sorted(epoch.dead), epoch.quiet.watts.sum(axis=0)
        if self._epochs:
            new[:, gone] = self._loads[:, gone]
            watts[gone] = self._epochs[0].quiet.watts.sum(axis=0)[gone]
        self._loads = new
        return Phase(watts, epoch.library.added, epoch.library.seconds, new)

    def _dead(self, paths: Paths) -> frozenset[int] | None:
        """The dead nodes of the median path; None if no path goes on."""
        going = np.flatnonzero(paths.time < self._plan.horizon)
        if not going.size:
            return None
        path = going[np.argsort(paths.time[going])[going.size // 2]]
        return frozenset(np.flatnonzero(~paths.alive[path]).tolist())

    def _result(self, paths: Paths) -> Lifetime:
        plan, events = self._plan, np.concatenate(paths.events or [np.zeros((0, 4))])
        events = events[events[:, 2] <= plan.horizon]
        knots = np.array([(len(e.dead) / self._size, e.library.tracked.mean()) for e in self._epochs]).T
        criteria = Criteria(
            self._near(), self._facts.links, np.array(self._facts.sinks, dtype=int), knots, plan.coverage,
            plan.connected, plan.tracked, plan.tolerance, plan.horizon,
        )  # fmt: skip
        times = criteria.times(events, self._stores.alive, self._paths)
        return Lifetime(
            plan, self._facts, {name: self._estimated(each) for name, each in times.items()}, times, events,
            tuple(self._epochs), self._baseline(),
        )  # fmt: skip

    def _estimated(self, times: Floats) -> Estimate:
        """The estimate of a criterion from the times (R,) at which paths meet it."""
        median, low, high = np.quantile(times, [0.5, (1 - LEVEL) / 2, (1 + LEVEL) / 2], method="nearest")
        met, missing = float(np.isfinite(times).mean()), Interval(np.nan, np.nan)
        if met < 1.0:
            return Estimate(float(median), np.nan, Interval(float(low), float(high)), missing, met)
        draws = times.reshape(self._plan.draws, self._plan.repeats)
        within = draws.var(axis=1, ddof=1).mean() if draws.shape[1] > 1 else 0.0
        between = max(float(draws.mean(axis=1).var(ddof=1)) - within / draws.shape[1], 0.0)
        half, mean = 1.96 * float(np.sqrt(between + within / times.size)), float(times.mean())
        return Estimate(float(median), mean, Interval(float(low), float(high)), Interval(mean - half, mean + half), met)

    def _near(self) -> np.ndarray:
        field = self._setup.deploy.field
        x, y = (length * ((np.arange(LATTICE) + 0.5) / LATTICE - 0.5) for length in (field.width, field.height))
        cells = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) + field.centre
        apart = np.linalg.norm(cells[:, None] - self._facts.positions, axis=2)
        return apart <= self._setup.sensor.reach

    def _baseline(self) -> float:
        first, visits = self._epochs[0], self._plan.visit.visits
        rate = visits.rate or len(visits.times or ()) / self._plan.horizon
        finite = np.isfinite(self._stores.joules)
        power = first.quiet.watts.sum(axis=0)[finite].mean() + rate * first.library.added[:, finite].mean()
        return float(self._stores.joules[finite].mean() / power)
