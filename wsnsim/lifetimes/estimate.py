"""How long a network lives: quiet power, a library of visits, posterior loads, sample paths, criteria.

    Estimation(setup, plan, make).run() -> Lifetime

The library grows until the error of the first death is small enough. When enough nodes have died, visits are simulated
anew in the network that is left, the one of the median path.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy import stats

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import CAUSES
from wsnsim.lifetimes import limits
from wsnsim.lifetimes.criteria import LATTICE, Criteria
from wsnsim.lifetimes.library import Library, Visit
from wsnsim.lifetimes.paths import Paths, Phase
from wsnsim.lifetimes.quiet import QuietPower, quiet_power
from wsnsim.lifetimes.rates import Loads, fit_loads
from wsnsim.lifetimes.stores import draw_stores
from wsnsim.network.radio.radio_stack import NetworkFacts, inspect_network
from wsnsim.scenario.lifetime import CRITERIA, YEAR

EPOCHS: Final = (0.0, 0.1, 0.3, 0.5)
"""Shares of dead nodes at which visits are simulated anew."""
ROUTES: Final = 0.9
"""Share of the living nodes with a path to a sink, below which routes have changed: visits are simulated anew."""
LEVEL: Final = 0.95
FURTHER: Final = 10.0
"""Horizons for which paths go on while the library grows, so that a late first death is known, too."""


@dataclasses.dataclass(frozen=True)
class LifetimePlan:
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
        last: share of dead nodes at which paths end; above 1, they do not.
        known: criteria that are known by then.
        tolerance, coverage, connected, tracked: see `criteria.Criteria`.
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
    last: float = 0.6
    known: tuple[str, ...] = CRITERIA
    seed: int = 0
    tolerance: float = 0.0
    coverage: float = 0.9
    connected: float = 0.5
    tracked: float = 0.9


class CriterionTime(NamedTuple):
    """When a criterion is met.

    Attributes:
        median: over the paths in s; infinite if half of them do not meet it before the horizon.
        low, high: where it lies for one network with 95 %.
        mean: over the paths in s; NaN if some do not meet it.
        mean_low, mean_high: where its mean lies with 95 %, given what few visits tell of the loads; NaN as `mean`.
        met: share of the paths that meet it before the horizon.
    """

    median: float
    low: float
    high: float
    mean: float
    mean_low: float
    mean_high: float
    met: float


class Epoch(NamedTuple):
    """A network with its dead nodes: its quiet power, its library, and the posterior loads."""

    dead: frozenset[int]
    quiet: QuietPower
    library: Library
    loads: Loads


@dataclasses.dataclass(frozen=True)
class Lifetime:
    """How long a network lives.

    Attributes:
        plan: how it was estimated.
        facts: the network.
        criteria: {criterion: when it is met}.
        times: {criterion: (draws × repeats,) s of each path; the paths of a draw of loads follow each other}.
        events: (E, 4) deaths and returns: path, node, time in s, whether it is back.
        epochs: the networks that were simulated.
        mortal: numbers of the nodes that live at the start and are not on mains; if there are none, of all that live.
        rules: what decides when a path meets a criterion.
        lost_limit: error in m above which a track is lost.
        baseline: s that the mean node lives by its battery / (quiet power + rate of visits × joules of a visit).
        not_modelled: what is left out, each with its size.
        notes: what is special about this network.
    """

    plan: LifetimePlan
    facts: NetworkFacts
    criteria: dict[str, CriterionTime]
    times: dict[str, Floats]
    events: Floats
    epochs: tuple[Epoch, ...]
    mortal: Ints
    rules: Criteria
    lost_limit: float
    baseline: float
    not_modelled: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


Make = Callable[[NetworkSetup, Visit, Sequence[int], frozenset[int]], Library]
"""Simulates the visits of some numbers."""


class Estimation:
    """One estimate of a lifetime, in the making."""

    def __init__(self, setup: NetworkSetup, plan: LifetimePlan, make: Make) -> None:
        self._setup = dataclasses.replace(setup, network=0) if setup.network is None else setup
        self._facts = inspect_network(self._setup, 0)
        self._size, self._paths = len(self._facts.positions), plan.draws * plan.repeats
        self._stores = draw_stores(self._setup, self._size, self._facts.sinks)
        if self._stores.restarts:  # nodes come back: no number of them is down for good
            plan = dataclasses.replace(plan, epochs=plan.epochs[:1], last=2.0)
        self._plan, self._make = plan, make
        self._rng = np.random.default_rng([self._setup.seed, plan.seed])
        self._epochs: list[Epoch] = []
        self._strays: list[float] = []
        self._loads = np.zeros((self._paths, self._size))

    def run(self) -> Lifetime:
        """Make the estimate.

        Raises:
            RunError: batteries do not fit the network, or a simulation failed.
        """
        self._begin()
        phase = self._phase(self._epochs[0])
        goals = self._goals(phase)
        paths = self._new_paths()
        paths.advance(phase, goals[0])
        for goal, following in itertools.pairwise(goals):
            dead = self._dead(paths)
            if dead is None:
                break
            if dead != self._epochs[-1].dead and len(dead) < self._size:  # else several goals were passed at once
                self._epochs.append(self._epoch(dead, self._plan.later, first=1_000_000 * goal))
                phase = self._phase(self._epochs[-1])
            paths.advance(phase, following)
        return self._result(paths)

    def _new_paths(self, horizons: float = 1.0) -> Paths:
        plan = self._plan
        return Paths(self._stores, plan.visit.visits, self._rng, self._paths, horizons * plan.horizon)

    def _begin(self) -> None:
        """Enlarge the first library until the first death is known well enough."""
        plan, dead = self._plan, frozenset(np.flatnonzero(~self._stores.alive).tolist())
        epoch = self._epoch(dead, plan.least, 0)
        while 1 < len(epoch.library.tracked) < plan.most and not self._is_enough(epoch):
            count = len(epoch.library.tracked)
            more = range(count, min(2 * count, plan.most))
            library = epoch.library.joined(self._make(self._setup, plan.visit, more, dead))
            epoch = epoch._replace(library=library, loads=self._fitted(library))
        self._epochs.append(epoch)

    def _is_enough(self, epoch: Epoch) -> bool:
        paths = self._new_paths(FURTHER)
        paths.advance(self._phase(epoch), int((~self._stores.alive).sum()) + 1)
        first = np.full(self._paths, np.inf)
        events = paths.noted()
        np.minimum.at(first, events[:, 0].astype(int), events[:, 2])
        return self._error(self._estimated(first)) <= self._plan.error

    def _error(self, known: CriterionTime) -> float:
        """Half the 95 % interval of a mean, as a share of it; 0 where some paths have none."""
        return 0.0 if known.met < 1.0 else (known.mean_high - known.mean_low) / 2.0 / max(known.mean, 1e-300)

    def _goals(self, phase: Phase) -> list[int]:
        """Numbers of dead nodes at which visits are simulated anew, and the last: that at which paths end.

        Where routes to the sinks change in the median path, if visits stay the same, is one of them.
        """
        begun = int((~self._stores.alive).sum())
        last = max(int(np.ceil(self._plan.last * self._size)), begun + 1)
        goals = {int(np.ceil(share * self._size)) for share in self._plan.epochs} | {last}
        if self._facts.sinks and last <= self._size:
            paths = self._new_paths()
            paths.advance(phase, last)
            events, median = paths.noted(), np.argsort(paths.time)[self._paths // 2]
            rows = events[events[:, 0] == median]
            now = self._criteria().series(rows[np.argsort(rows[:, 2])], self._stores.alive)[1]
            changed = np.flatnonzero((now["connected"] < ROUTES) & (now["connected"][0] >= ROUTES))
            goals |= set(np.rint(now["dead"][changed[:1]] * self._size).astype(int).tolist())
        return sorted(goal for goal in goals if begun < goal <= last)

    def _epoch(self, dead: frozenset[int], count: int, first: int) -> Epoch:
        plan, size = self._plan, self._size
        if not plan.visit.visits.frequency(plan.horizon):
            library = Library(np.zeros((1, len(CAUSES), size)), np.full(1, np.nan), np.ones(1), dead)
        else:
            library = self._make(self._setup, plan.visit, range(first, first + count), dead)
        return Epoch(dead, quiet_power(self._setup, dead), library, self._fitted(library))

    def _mortal(self, dead: frozenset[int]) -> Ints:
        """The nodes that can die now; all living ones, if all of them are on mains."""
        living = np.setdiff1d(np.arange(self._size), sorted(dead))
        mortal = living[np.isfinite(self._stores.joules[living])]
        return mortal if mortal.size else living

    def _fitted(self, library: Library) -> Loads:
        """The posterior loads of the nodes that can die: the others tell nothing about these."""
        return fit_loads(library.added[:, self._mortal(library.dead)])

    def _phase(self, epoch: Epoch) -> Phase:
        """What drains batteries in an epoch; nodes that are dead in its library but not in a path spend as before."""
        new = np.repeat(epoch.library.added.mean(axis=0)[None], self._paths, axis=0)
        draws = epoch.loads.draw(self._rng, self._plan.draws)
        new[:, self._mortal(epoch.dead)] = np.repeat(draws, self._plan.repeats, axis=0)
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
        gone = ~paths.alive[going]
        dead = gone[np.argsort(paths.time[going])[going.size // 2]]
        self._strays.append(float(((gone & ~dead).sum(axis=1) / gone.sum(axis=1)).mean()))
        return frozenset(np.flatnonzero(dead).tolist())

    def _criteria(self) -> Criteria:
        plan = self._plan
        knots = np.array([(len(e.dead) / self._size, e.library.tracked.mean()) for e in self._epochs]).T
        return Criteria(
            self._near(), self._facts.links, np.array(self._facts.sinks, dtype=int), knots, plan.coverage,
            plan.connected, plan.tracked, plan.tolerance, plan.horizon,
        )  # fmt: skip

    def _result(self, paths: Paths) -> Lifetime:
        plan, events = self._plan, paths.noted()
        events = events[events[:, 2] <= plan.horizon]
        rules = self._criteria()
        times = rules.times(events, self._stores.alive, self._paths)
        criteria = {name: self._estimated(each) for name, each in times.items()}
        first, visit = self._epochs[0], plan.visit
        spoken, baseline = (first.quiet, first.library, self._stores, visit), self._baseline()
        notes = [*limits.notes(*spoken, plan.horizon)]
        if (reached := self._error(criteria["first_death"])) > plan.error:
            known = f"known to {reached:.1%} with {len(first.library.tracked)} visits, {plan.error:.1%} was asked for"
            notes.append(f"the mean first death is {known}: allow more episodes")
        left_out = limits.not_modelled(self._setup, *spoken, self._strays, min(max(1.0, baseline), plan.horizon))
        most = max(len(each.dead) for each in self._epochs) / self._size
        return Lifetime(
            plan, self._facts, criteria, times, events, tuple(self._epochs), self._mortal(first.dead), rules,
            self._setup.lost_limit, baseline, (*left_out, limits.thinned(most, self._stores.restarts)), tuple(notes),
        )  # fmt: skip

    def _estimated(self, times: Floats) -> CriterionTime:
        """The estimate of a criterion from the times (R,) at which paths meet it."""
        median = float(np.quantile(times, 0.5, method="nearest"))
        met = float(np.isfinite(times).mean())
        if met < 1.0:
            return CriterionTime(median, *_interval(times), np.nan, np.nan, np.nan, met)
        draws = times.reshape(self._plan.draws, self._plan.repeats)
        within = draws.var(axis=1, ddof=1).mean() / draws.shape[1] if draws.shape[1] > 1 else 0.0
        means, mean = draws.mean(axis=1), float(times.mean())
        total = float(means.var(ddof=1)) if means.size > 1 else 0.0
        # means of few paths spread more than loads do; of that, the mean of all draws keeps a small share
        variance = max(total - within, 0.0) + within / means.size
        half = float(stats.t.ppf(0.5 + LEVEL / 2.0, max(means.size - 1, 1)) * np.sqrt(variance))
        return CriterionTime(median, *_interval(times), mean, mean - half, mean + half, met)

    def _near(self) -> Bools:
        field = self._setup.deploy.field
        x, y = (length * ((np.arange(LATTICE) + 0.5) / LATTICE - 0.5) for length in (field.width, field.height))
        cells = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) + field.centre
        apart = np.linalg.norm(cells[:, None] - self._facts.positions, axis=2)
        near: Bools = apart <= self._setup.sensor.reach
        return near

    def _baseline(self) -> float:
        """Two terms: quiet power, and visits; of the nodes that live at the start and are not on mains."""
        first, visits, nodes = self._epochs[0], self._plan.visit.visits, self._mortal(self._epochs[0].dead)
        quiet, added = first.quiet.watts.sum(axis=0)[nodes].mean(), first.library.added[:, nodes].mean()
        joules = self._stores.joules[nodes].mean()
        with np.errstate(divide="ignore", invalid="ignore"):
            if visits.rate is not None:
                return float(joules / np.float64(quiet + visits.rate * added))
            lives = (joules - np.arange(visits.begins.size + 1) * added) / quiet  # after 0, 1, 2, ... visits
        which = int((lives <= np.append(visits.begins, np.inf)).argmax())
        return float(max(lives[which], np.append(0.0, visits.begins)[which]))


def _interval(values: Floats) -> tuple[float, float]:
    """Where a further value lies with 95 %: two of the values in their order."""
    ordered = np.sort(values, axis=None)
    first = max(int((1.0 - LEVEL) / 2.0 * (ordered.size + 1)), 1)
    return float(ordered[first - 1]), float(ordered[-first])
