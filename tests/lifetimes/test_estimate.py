"""Estimates of lifetimes: in synthetic networks whose life is known, and in a small simulated one."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from tests.helpers.stored_visits import joined
from tests.helpers.thorough import THOROUGH
from tests.lifetimes.test_rates import visits_of
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import CAUSE, CAUSES
from wsnsim.lifetimes import estimate, limits, outcome
from wsnsim.lifetimes.estimate import Estimation, Lifetime, LifetimePlan
from wsnsim.lifetimes.library import Library, Visit, make_visit, window_setup
from wsnsim.lifetimes.paths import Paths, Phase
from wsnsim.lifetimes.quiet import QuietPower
from wsnsim.models.batteries import Linear
from wsnsim.models.faults import Crash
from wsnsim.models.harvest import Harvester
from wsnsim.models.visits import Crossing, Visits
from wsnsim.network.radio.radio_stack import NetworkFacts
from wsnsim.scenario import build, load

HOUR, YEAR = 3600.0, 365.25 * 86_400.0
NODES, QUIET, RATE, STAY = 40, 2.75e-4, 10 / HOUR, 20.0
AREA: Final = Crossing(width=100.0, height=100.0)
VISIT: Final = Visit(Visits(of=AREA, lasting=STAY, rate=RATE), 4.0, 30.0, STAY)
PLAN: Final = LifetimePlan(VISIT, horizon=20 * YEAR, least=12, most=12, draws=50, repeats=2, epochs=(0.0,))


def setup_of(**values: Any) -> NetworkSetup:
    """A small field with a target that visits it."""
    motion = {"kind": "visits", "rate": "10/h", "of": {"kind": "crossing", "width": 100, "height": 100}}
    small = {"deploy.nodes": 12, "deploy.width": 80.0, "deploy.height": 80.0, "step": 2.0, "duration": "40 s"}
    made = build(load("gmtt", {"motion": motion, **small, **values}))
    assert isinstance(made, NetworkSetup)
    return made


@pytest.fixture
def synthetic(monkeypatch: pytest.MonkeyPatch) -> NetworkSetup:
    """A setup of which the network, its sink and its quiet power are given, not simulated."""
    rng = np.random.default_rng(0)
    facts = NetworkFacts(rng.uniform(-40.0, 40.0, (NODES, 2)), (), np.ones((NODES, NODES), dtype=bool))
    watts = np.zeros((len(CAUSES), NODES))
    watts[CAUSE["sleep"]] = QUIET
    monkeypatch.setattr(estimate, "inspect_network", lambda setup, replicate: facts)
    monkeypatch.setattr(estimate, "quiet_power", lambda *_: QuietPower(watts.copy(), np.zeros_like(watts)))
    return setup_of()


class Synthetic:
    """Makes visits of known mean loads."""

    def __init__(self, theta: np.ndarray, rng: np.random.Generator) -> None:
        self.theta, self.rng = theta, rng
        self.asked: list[tuple[int, frozenset[int]]] = []

    def __call__(self, setup: Any, visit: Visit, numbers: Any, dead: frozenset[int]) -> Library:
        joules = np.zeros((len(numbers), len(CAUSES), NODES))
        joules[:, CAUSE["rx"]] = visits_of(self.theta, len(numbers), self.rng)
        joules[:, :, sorted(dead)] = 0.0
        self.asked += [(number, dead) for number in numbers]
        return Library(joules, np.full(len(numbers), 0.9 - 0.01 * len(dead)), np.full(len(numbers), STAY), dead)


def life_of(theta: np.ndarray, estimation: Estimation, rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 2) first death and half dead of a network with these loads, from its own visits."""
    added = visits_of(theta, 400, rng)  # of which paths keep the shape alone, and not the mean
    walk = Paths(estimation._stores, VISIT.visits, rng, count, 20 * YEAR)
    walk.advance(Phase(np.full(NODES, QUIET), added, np.full(400, STAY), np.tile(theta, (count, 1))), NODES // 2)
    times = np.full((count, NODES), np.inf)
    events = walk.noted()
    times[events[:, 0].astype(int), events[:, 1].astype(int)] = events[:, 2]
    return np.sort(times, axis=1)[:, [0, NODES // 2 - 1]]


def test_intervals_hold_one_life_and_the_mean_life_as_often_as_they_say(synthetic: NetworkSetup) -> None:
    networks, held = 240 if THOROUGH else 8, []
    for number in range(networks):
        rng = np.random.default_rng(number)
        theta = (
            0.0127
            * [np.ones(NODES), np.exp(0.2 * rng.normal(size=NODES)), 1.0 + 1.5 * (np.arange(NODES) < 2)][number % 3]
        )
        plan = dataclasses.replace(PLAN, seed=number)
        estimation = Estimation(synthetic, plan, Synthetic(theta, rng))
        found = estimation.run().criteria
        lives = life_of(theta, estimation, rng, 8)
        for k, name in enumerate(("first_death", "half_dead")):
            known = found[name]
            held.append((
                known.low <= lives[0, k] <= known.high,
                known.mean_low <= lives[:, k].mean() <= known.mean_high,
            ))  # fmt: skip
    shares = np.array(held).reshape(networks, 4).mean(axis=0)
    assert (shares >= 0.95 - 2.0 * np.sqrt(0.95 * 0.05 / networks)).all(), shares


def test_the_library_grows_until_the_first_death_is_known(synthetic: NetworkSetup) -> None:
    theta = np.full(NODES, 0.0127)
    plans = [dataclasses.replace(PLAN, most=96, error=error) for error in (0.5, 0.001)]
    coarse, fine = (Estimation(synthetic, plan, Synthetic(theta, np.random.default_rng(1))) for plan in plans)
    known, unknown = coarse.run(), fine.run()
    assert len(known.epochs[0].library.tracked) == 12
    assert len(unknown.epochs[0].library.tracked) == 96
    assert not any("was asked for" in note for note in known.notes)
    assert any("with 96 visits, 0.1% was asked for" in note for note in unknown.notes)


def test_visits_are_simulated_anew_when_nodes_have_died_and_when_the_sink_is_cut_off(
    synthetic: NetworkSetup, monkeypatch: pytest.MonkeyPatch
) -> None:
    theta = np.full(NODES, 0.0127)
    theta[3] = 0.2
    make = Synthetic(theta, np.random.default_rng(1))
    links = np.zeros((NODES, NODES), dtype=bool)
    links[3] = links[:, 3] = True  # all routes to the sink go over node 3
    facts = NetworkFacts(np.zeros((NODES, 2)), (0,), links)
    monkeypatch.setattr(estimate, "inspect_network", lambda setup, replicate: facts)
    found = Estimation(synthetic, dataclasses.replace(PLAN, epochs=(0.0, 0.2)), make).run()
    assert [len(epoch.dead) for epoch in found.epochs][:2] == [0, 1]
    assert 8 <= len(found.epochs[2].dead) <= 12  # several nodes may die in a chunk
    assert found.epochs[1].dead == {3}
    assert found.criteria["sink"].median == found.criteria["first_death"].median
    assert found.criteria["tracked"].met == 1.0


def test_epochs_that_paths_reach_at_once_are_simulated_once(synthetic: NetworkSetup) -> None:
    make = Synthetic(np.full(NODES, 1e-9), np.random.default_rng(1))
    weak = Linear(residual=(1e-6,) * 16 + (10.0,) * (NODES - 16))  # 16 nodes die in the first chunk
    plan = dataclasses.replace(PLAN, epochs=(0.0, 0.1, 0.2, 0.3))
    found = Estimation(dataclasses.replace(synthetic, battery=weak), plan, make).run()
    dead = [epoch.dead for epoch in found.epochs]
    assert len(set(dead)) == len(dead)
    assert all(len({number // 1_000_000 for number, which in make.asked if which == each}) == 1 for each in dead)


@pytest.mark.parametrize(("tolerance", "met"), [(0.0, 1.0), (20 * HOUR, 0.0)])
def test_nights_without_sun_end_a_life_unless_they_are_tolerated(
    synthetic: NetworkSetup, tmp_path: Path, tolerance: float, met: float
) -> None:
    """Nodes draw 0.275 mW from 10 J: they are down from 10.1 h of each night of 18 h on, and up again by day."""
    path = tmp_path / "sun.csv"
    path.write_text("time,power\n0,0\n43200,0.01\n64800,0\n86400,0\n")
    energy = dataclasses.replace(synthetic.energy, battery=10.0)
    sunny = dataclasses.replace(
        synthetic, energy=energy, battery=Linear(harvest=Harvester(path=str(path), repeats=True))
    )
    plan = dataclasses.replace(PLAN, horizon=5 * 24 * HOUR, tolerance=tolerance, epochs=(0.0, 0.1))
    found = Estimation(sunny, plan, Synthetic(np.full(NODES, 1e-9), np.random.default_rng(1))).run()
    assert found.criteria["half_dead"].met == met
    assert len(found.epochs) == 1
    assert any("all nodes are up in simulated visits" in each for each in found.not_modelled)


def test_an_interval_of_a_mean_is_never_a_point_and_listed_visits_count_in_the_two_terms(
    synthetic: NetworkSetup,
) -> None:
    for seed in range(5):
        make = Synthetic(np.full(NODES, 0.0127), np.random.default_rng(seed))
        found = Estimation(synthetic, dataclasses.replace(PLAN, draws=4, seed=seed), make).run().criteria["half_dead"]
        assert found.mean_low < found.mean < found.mean_high
    visits = Visits(of=AREA, lasting=STAY, times=tuple(range(0, 10_000_000, 1000)))
    energy = dataclasses.replace(synthetic.energy, battery=100.0)
    listed = dataclasses.replace(PLAN, visit=VISIT._replace(visits=visits))
    found = Estimation(dataclasses.replace(synthetic, energy=energy), listed, make).run()
    load = found.epochs[0].library.added.mean()
    assert found.baseline == pytest.approx(100.0 / (QUIET + load / 1000.0), abs=1000.0)


@pytest.mark.parametrize(
    ("values", "motion", "words"),
    [
        ({}, Visits(of=AREA, lasting=STAY, times=()), "no target comes before the horizon"),
        ({}, Visits(of=AREA, lasting=STAY, times=(5.0, 100.0)), "quiet from then on"),
        ({"joules": 0.01}, VISIT.visits, "one visit can empty the batteries"),
        ({"battery": Linear(residual=(0.0, *(9.0,) * (NODES - 1)))}, VISIT.visits, "dead at the start, with nothing"),
        ({"battery": Linear(mains=tuple(range(NODES)))}, VISIT.visits, "none can die"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("years", [1.0, 900.0])
def test_what_is_special_is_said(
    values: dict[str, Any], motion: Visits, words: str, years: float, synthetic: NetworkSetup
) -> None:
    energy = dataclasses.replace(synthetic.energy, battery=values.get("joules", 9.0))  # type: ignore[type-var]
    setup = dataclasses.replace(synthetic, battery=values.get("battery", Linear()), energy=energy)
    plan = dataclasses.replace(PLAN, visit=VISIT._replace(visits=motion), horizon=years * YEAR)
    found = Estimation(setup, plan, Synthetic(np.full(NODES, 0.0127), np.random.default_rng(1))).run()
    assert any(words in note for note in found.notes), found.notes
    met = found.criteria["first_death"].met
    assert met == (0.0 if words == "none can die" else 1.0)
    if motion.times == ():
        assert found.criteria["first_death"].median == pytest.approx(9.0 / QUIET)
        assert found.baseline == pytest.approx(9.0 / QUIET)
        watts = found.epochs[0].quiet.watts  # all nodes die at the same time
        assert [row["share"] for row in outcome._first(found, watts, 0.0 * watts)] == [1.0] * outcome.NAMED


def test_what_is_left_out_has_its_size(synthetic: NetworkSetup) -> None:
    setup = dataclasses.replace(synthetic, faults=(Crash(at=1.0, nodes=(1,)),))
    found = Estimation(setup, PLAN, Synthetic(np.full(NODES, 0.0127), np.random.default_rng(1))).run()
    said = "\n".join(found.not_modelled)
    assert limits.overlap(VISIT) == pytest.approx(1.0 - np.exp(-RATE * STAY))
    for words in ("residual energy", "memory between visits: 8.4%", "overlap: 5.4%", "faults of the scenario: 1"):
        assert words in said


def simulated() -> Lifetime:
    setup = setup_of()
    visits: Any = setup.motions[0]
    visit = Visit(visits, 4.0, 12.0, float(2 * np.ceil(visits.longest / 2)))
    plan = LifetimePlan(visit, horizon=10 * YEAR, least=2, most=2, later=2, draws=10, repeats=2, epochs=(0.0, 0.3))
    return Estimation(setup, plan, lambda *given: joined([make_visit(*given[:2], n, given[3]) for n in given[2]])).run()


def test_a_small_network_is_simulated_and_estimated_the_same_way_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    quiet = np.full((len(CAUSES), 12), QUIET / len(CAUSES))
    monkeypatch.setattr(estimate, "quiet_power", lambda *_: QuietPower(quiet, np.zeros_like(quiet)))
    first, second = simulated(), simulated()
    assert first.criteria == second.criteria
    np.testing.assert_array_equal(first.events, second.events)
    deaths = [first.criteria[name].median for name in ("first_death", "dead_10", "half_dead")]
    assert 0.0 < deaths[0] <= deaths[1] <= deaths[2] < 10 * YEAR


def test_a_visit_costs_what_its_window_costs_more_than_the_one_without_it() -> None:
    setup = dataclasses.replace(setup_of(), battery=Linear(residual=(1e-9,) * 12), network=0)
    visits: Any = setup.motions[0]
    visit = Visit(visits, 4.0, 12.0, float(2 * np.ceil(visits.longest / 2)))
    one, dead = make_visit(setup, visit, 0), make_visit(setup, visit, 0, frozenset({2}))
    assert one.added.shape == (1, 12)
    assert one.added.sum() > 0.0  # batteries of the scenario do not matter
    assert one.seconds[0] > 2.0
    assert not dead.added[0, 2]
    both = one.joined(make_visit(setup, visit, 1))
    assert both.tracked.shape == both.false_time.shape == both.rmse.shape == (2,)
    assert np.isfinite(one.rmse).all() == (one.tracked > 0.0).all()
    window = window_setup(setup, visit, present=False)
    assert window.duration == visit.window
    assert not window.motions[0].begins.size  # type: ignore[attr-defined]
