"""The lifetime of a network against full simulations of it, with batteries that are small enough for these.

python -m tests.lifetime.validation FOLDER       make what is missing of the registered runs, keep it in the folder, and
                                                 write the outcomes into validation.json beside this file

A full run and the engine have the same list of visits: when each begins, and which of a few chords the target takes. A
chord stands in the library of visits with two runs of its own. What differs between full run and engine is noise of
sensors and radios, and what the engine leaves out. All else is the engine's own code: its epochs, quiet power, paths,
batteries and criteria.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy import stats

from tests.helpers.stored_visits import joined, stored_visit
from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import Memory
from wsnsim.experiment import load, replicate_of
from wsnsim.lifetime.estimate import Estimation, Lifetime, Plan
from wsnsim.lifetime.library import Library, Visit, make_visit
from wsnsim.lifetime.paths import Paths, Phase
from wsnsim.models.visits import Visits
from wsnsim.scenario.build import build

DEPLOYMENTS: Final = (1, 2, 3)
RUNS: Final = 8
CHORDS: Final = 16
EACH: Final = 2
"""Simulated visits of each chord."""
GAP: Final = 20.0
"""Mean time (s) from the end of a visit to the begin of the next."""
BATTERY: Final = 1.0
HORIZON: Final = 2000.0
LIMITS: Final = {"first_death": 0.05, "half_dead": 0.02, "coverage": 0.02}
"""Registered limits of the mean difference: its 90 % interval lies within."""
HELD: Final = Path(__file__).with_name("validation.json")
FIRST_RUN: Final = 100_000
"""Number of the first full run: its noise is not that of a visit in a library."""
PLACE: Final = {"width": "180 m", "height": "180 m"}
SCENARIO: Final[dict[str, Any]] = {
    "extends": "gmtt",
    "name": "validation",
    "duration": HORIZON,
    "deploy": {"kind": "uniform", "nodes": 40, **PLACE, "cover": False},
    "mac": {"kind": "xmac", "rate": "250 kbit/s", "interval": "250 ms"},
    "clusters": {"quiet": None, "cap": None},
    "energy": {"battery": BATTERY},
    "battery": {"kind": "linear", "sink_on_mains": True},
    "motion": {"kind": "visits", "of": {"kind": "crossing", **PLACE, "speed": [8, 8]}, "times": [10]},
}


@dataclasses.dataclass(frozen=True)
class Listed(Visits):
    """Visits at listed times, each on the chord of a listed number."""

    numbers: tuple[int, ...] = ()

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, D) the visits, NaN between them."""
        states = np.full((steps + 1, len(self.columns)), np.nan)
        for begin, number in zip(self.begins, self.numbers, strict=bool(self.begins.size)):
            chord = self.of.truth(round(self.longest / dt) + 1, dt, np.random.default_rng([7, number]))
            chord = chord[np.isfinite(chord[:, 0])][: max(steps + 1 - round(begin / dt), 0)]
            states[round(begin / dt) : round(begin / dt) + len(chord)] = chord
        return states


class ListedPaths(Paths):
    """Paths each of which has its own list of visits: begins (R, V) in s and chords (R, V)."""

    def listing(self, begins: Floats, numbers: Ints) -> ListedPaths:
        """These paths with their lists."""
        self._begins = np.column_stack([begins, np.full(len(begins), np.inf)])
        self._numbers = np.column_stack([numbers, numbers[:, 0]])
        return self

    def _listed(self, chosen: Ints, phase: Phase) -> None:
        following = (self._begins[chosen] < self.time[chosen, None]).sum(axis=1)
        begins = self._begins[chosen, following]
        coming = begins < self._horizon
        self._spend(chosen, phase.quiet, np.minimum(begins, self._horizon) - self.time[chosen])
        going = chosen[coming]
        if going.size:
            rows = np.arange(len(phase.added))[None] % CHORDS
            counts = (rows == self._numbers[going, following[coming], None]) / (len(phase.added) / CHORDS)
            stay = counts @ phase.seconds
            self._spend(going, phase.quiet + self._joules(counts, phase, going) / stay[:, None], stay)


class ListedEstimation(Estimation):
    """An estimate whose paths have given lists of visits, and whose loads are those of the library."""

    def __init__(self, deployment: Deployment, runs: Sequence[int], epochs: Sequence[float]) -> None:
        visit, count = deployment.visit, CHORDS * EACH
        plan = Plan(visit, HORIZON, count, count, draws=len(runs), repeats=1, epochs=tuple(epochs), later=count)
        super().__init__(deployment.setup, plan, deployment.make)
        lists = [deployment.listed(run) for run in runs]
        self._lists = tuple(np.array([each[i] for each in lists]) for i in (0, 1))

    def _new_paths(self, horizons: float = 1.0) -> Paths:
        paths = ListedPaths(self._stores, self._plan.visit.visits, self._rng, self._paths, self._plan.horizon)
        return paths.listing(*self._lists)

    def _phase(self, epoch: Any) -> Phase:
        phase = super()._phase(epoch)
        mean = epoch.library.added.mean(axis=0)
        self._loads = np.where(mean > 0.0, mean, phase.loads)
        return phase._replace(loads=self._loads)


@dataclasses.dataclass(frozen=True)
class Deployment:
    """One network, by its seed, and a folder that keeps what was simulated of it."""

    seed: int
    folder: Path
    changes: dict[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def setup(self) -> NetworkSetup:
        """The network; in it, one visit."""
        setup = build(load({**SCENARIO, "seed": self.seed, **self.changes}))
        return dataclasses.replace(setup, network=0, motions=(self.motion(setup, (10.0,), (0,)),))

    @staticmethod
    def motion(setup: NetworkSetup, times: Sequence[float], numbers: Sequence[int]) -> Listed:
        """Visits at some times on some chords."""
        return Listed(of=setup.motions[0].of, times=tuple(times), numbers=tuple(numbers))

    @property
    def visit(self) -> Visit:
        """The window of a visit."""
        visits = self.setup.motions[0]
        return Visit(visits, lead=10.0, tail=14.0, longest=visits.longest)

    def listed(self, run: int) -> tuple[list[float], list[int]]:
        """When the visits of a run begin in s, and their chords."""
        rng, setup, times, now = np.random.default_rng([self.seed, run]), self.setup, [], 0.0
        numbers = rng.integers(CHORDS, size=int(HORIZON / GAP)).tolist()
        for number in numbers:
            now += setup.dt * np.ceil(rng.exponential(GAP) / setup.dt)
            times.append(float(now))
            one = self.motion(setup, (0.0,), (number,)).truth(100, setup.dt, rng)
            now += setup.dt * np.isfinite(one[:, 0]).sum()
        return times, numbers

    def make(self, setup: NetworkSetup, visit: Visit, numbers: Sequence[int], dead: frozenset[int]) -> Library:
        """The library of visits of some numbers; those of later epochs are on the same chords."""
        name = hashlib.sha256(repr((sorted(dead), self.changes)).encode()).hexdigest()[:12]
        found = []
        for number in (each % 1_000_000 for each in numbers):
            visits = dataclasses.replace(visit.visits, numbers=(number % CHORDS,))
            make = functools.partial(make_visit, setup, visit._replace(visits=visits), number, dead)
            found.append(stored_visit(self.folder / f"visit_{self.seed}_{name}_{number}.npz", dead, make))
        return joined(found)

    def full(self, run: int) -> Floats:
        """(N,) when each node dies in a full simulation, in s; infinite if it does not."""
        path = self.folder / f"full_{self.seed}_{run}.json"
        if not path.exists():
            setup, memory = self.setup, Memory({"nodes": True})
            setup = dataclasses.replace(setup, motions=(self.motion(setup, *self.listed(run)),))
            replicate_of(setup, FIRST_RUN + run, memory)
            died = memory.table("nodes")["died_at"]
            path.write_text(json.dumps(np.where(np.isfinite(died), died, -1.0).tolist()), encoding="utf-8")
        died = np.array(json.loads(path.read_text(encoding="utf-8")))
        return np.where(died < 0.0, np.inf, died)

    def outcomes(self, runs: Sequence[int], epochs: Sequence[float] = (0.0, 0.1, 0.3)) -> list[dict[str, list[float]]]:
        """For each run, {criterion: [s in the full run, s in the engine]}."""
        estimation = ListedEstimation(self, runs, epochs)
        engine: Lifetime = estimation.run()
        full = [self.full(run) for run in runs]
        events = [
            (path, node, died[node], 0.0) for path, died in enumerate(full) for node in np.flatnonzero(died < HORIZON)
        ]
        found = estimation._criteria().times(np.array(events), estimation._stores.alive, len(runs))
        return [{name: [found[name][i], engine.times[name][i]] for name in LIMITS} for i in range(len(runs))]


def verdict(outcomes: dict[str, list[dict[str, list[float]]]]) -> dict[str, dict[str, float | bool]]:
    """For each criterion, the mean logarithm of engine over full run, its 90 % interval, and whether its limit holds.

    Runs of all deployments are pooled; those of one have its library in common.
    """
    found = {}
    for name, limit in LIMITS.items():
        logs = np.array([np.log(run[name][1] / run[name][0]) for runs in outcomes.values() for run in runs])
        half = float(stats.t.ppf(0.95, len(logs) - 1) * stats.sem(logs))
        mean = float(logs.mean())
        found[name] = {
            "mean": mean, "low": mean - half, "high": mean + half, "deviation": float(logs.std(ddof=1)),
            "holds": -limit < mean - half and mean + half < limit,
        }  # fmt: skip
    return found


def main() -> None:
    """Make all runs, and write outcomes and verdict."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    outcomes = {str(seed): Deployment(seed, folder).outcomes(range(RUNS)) for seed in DEPLOYMENTS}
    HELD.write_text(json.dumps({"verdict": verdict(outcomes), "outcomes": outcomes}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
