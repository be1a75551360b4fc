"""Sample paths: against the exact case of independent nodes, and against batteries over one span."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from typing import Any, Final

import networkx as nx
import numpy as np
import pytest
from scipy.stats import poisson

from wsnsim.lifetimes.criteria import Criteria
from wsnsim.lifetimes.paths import Paths, Phase
from wsnsim.lifetimes.stores import Stores
from wsnsim.models.batteries import BatteryFields, Diffusion, Kinetic, Linear
from wsnsim.models.harvest import Harvester
from wsnsim.models.visits import Crossing, Visits
from wsnsim.scenario.lifetime import CRITERIA

HOUR, DAY, YEAR = 3600.0, 86_400.0, 365.25 * 86_400.0
NODES: Final = 6
JOULES: Final = 20.0
"""In visits that hit the node; quiet power takes as much as the visits."""
LINKS: Final = [(0, 1), (1, 2), (0, 3), (3, 4), (4, 5), (2, 5)]


def stores_of(battery: BatteryFields, joules: float, nodes: int = NODES) -> Stores:
    """The batteries of a network."""
    setup: Any = type("Setup", (), {"energy": type("Energy", (), {"battery": joules})})
    return Stores(battery, battery.draw(setup, nodes, (), np.random.default_rng(0)))


def poisson_visits(rate: float) -> Visits:
    """Visits so short that their process is that of Poisson."""
    return Visits(of=Crossing(), lasting=1e-4 / rate, rate=rate)


NEVER = Visits(of=Crossing(), lasting=1.0, times=())


def criteria() -> Criteria:
    """Those of a small network with a sink, whose nodes each see their own cells and the next node's."""
    near = np.repeat(np.eye(NODES, dtype=bool) | np.eye(NODES, k=1, dtype=bool), 3, axis=0)
    links = np.zeros((NODES, NODES), dtype=bool)
    for a, b in LINKS:
        links[a, b] = links[b, a] = True
    knots = np.array([[0.0, 0.5], [1.0, 0.4]])
    return Criteria(near, links, np.array([0]), knots, coverage=0.9, connected=0.9, tracked=0.9, horizon=np.inf)


def met_in(state: tuple[int, ...]) -> dict[str, bool]:
    """Whether each criterion holds while these nodes live: by the definition, one by one."""
    dead, rule = NODES - len(state), criteria()
    graph = nx.Graph(LINKS).subgraph(state)
    reach = len(nx.node_connected_component(graph, 0)) / len(state) if 0 in state else 0.0
    return {
        "first_death": dead >= 1,
        "dead_10": dead >= 1,
        "half_dead": dead >= 3,
        "coverage": rule.near[:, list(state)].any(axis=1).mean() < 0.9,
        "sink": reach < 0.9,
        "tracked": 1.0 - 0.6 * min(dead / NODES, 0.5) / 0.5 < 0.9,
    }


def direct(samples: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """{criterion: (M,) times} of nodes whose deaths are independent, each with the exact distribution."""
    grid = np.linspace(0.0, 4.0 * JOULES, 40_001)
    quiet = 1.0  # visits a node's share of the time, in units of the mean time between its visits
    left = np.ceil(np.maximum(JOULES - quiet * grid, 0.0) - 1e-12)
    cumulative = 1.0 - poisson.cdf(left - 1.0, grid)
    deaths = np.interp(rng.random((samples, NODES)), np.maximum.accumulate(cumulative), grid)
    order = np.argsort(deaths, axis=1)
    table = {state: met_in(state) for n in range(NODES + 1) for state in itertools.combinations(range(NODES), n)}
    holds = {name: np.zeros(2**NODES, dtype=bool) for name in CRITERIA}
    for state, met in table.items():
        for name in CRITERIA:
            holds[name][sum(1 << node for node in state)] = met[name]
    found = {name: np.full(samples, np.inf) for name in CRITERIA}
    now = np.full(samples, 2**NODES - 1)
    for k in range(NODES):
        now = now - (1 << order[:, k])
        time = np.take_along_axis(deaths, order[:, k : k + 1], axis=1)[:, 0]
        for name in CRITERIA:
            first = holds[name][now] & np.isinf(found[name])
            found[name][first] = time[first]
    return found


@pytest.mark.parametrize(
    ("paths", "samples", "tolerance"),
    [(1500, 100_000, 0.04), pytest.param(20_000, 1_000_000, 0.01, marks=pytest.mark.thorough)],
)
def test_quantiles_of_every_criterion_are_those_of_independent_nodes(
    paths: int, samples: int, tolerance: float
) -> None:
    """Each visit hits one node, so that nodes have independent Poisson processes. 5, 25, 50, 75 and 95 %."""
    rng = np.random.default_rng(8)
    rate = NODES / HOUR
    walk = Paths(stores_of(Linear(), JOULES), poisson_visits(rate), rng, paths, 1e4 * HOUR)
    visits = np.full(NODES, 1e-4 / rate)
    walk.advance(Phase(np.full(NODES, 1.0 / HOUR), np.eye(NODES), visits, np.full((paths, NODES), 1.0 / NODES)), NODES)
    found = criteria().times(walk.noted(), np.ones(NODES, dtype=bool), paths)
    shares = [0.05, 0.25, 0.5, 0.75, 0.95]
    for name, expected in direct(samples, rng).items():
        np.testing.assert_allclose(
            np.quantile(found[name] / HOUR, shares, method="nearest"),
            np.quantile(expected, shares, method="nearest"), rtol=tolerance, err_msg=name,
        )  # fmt: skip


def test_chunks_of_many_visits_have_the_mean_and_the_spread_of_single_ones() -> None:
    rate, paths = 1.0 / HOUR, 400
    watts, added = np.full(4, 1e-4), np.array([[1.0, 0.0, 0.5, 0.2], [0.0, 1.0, 0.5, 0.2]]) * 2.0
    walk = Paths(stores_of(Linear(), 2000.0, 4), poisson_visits(rate), np.random.default_rng(1), paths, 10 * YEAR)
    walk.advance(Phase(watts, added, np.full(2, 0.36), np.tile(added.mean(axis=0), (paths, 1))), 4)
    times = np.full((paths, 4), np.inf)
    events = walk.noted()
    times[events[:, 0].astype(int), events[:, 1].astype(int)] = events[:, 2]
    mean, square = added.mean(axis=0), (added**2).mean(axis=0)
    life = 2000.0 / (watts + rate * mean)
    # of a renewal process with rewards: variance rate × life × E[joules²] of what is spent
    spread = np.sqrt(rate * life * square) / (watts + rate * mean)
    np.testing.assert_allclose(times.mean(axis=0), life, atol=4.0 * float((spread / np.sqrt(paths)).max()))
    np.testing.assert_allclose(times.std(axis=0), spread, rtol=0.15)


@pytest.mark.parametrize("battery", [Linear(), Linear(self_discharge=0.2, usable=0.8), Kinetic(), Diffusion()])
def test_a_quiet_node_lives_as_long_as_its_battery_says(battery: BatteryFields) -> None:
    watts, stores = np.array([1e-3, 2e-3, 5e-3]), stores_of(battery, 900.0, 3)
    walk = Paths(stores, NEVER, np.random.default_rng(0), 2, 100 * YEAR)
    none = np.zeros((1, 3))
    walk.advance(Phase(watts, none, np.ones(1), np.zeros((2, 3))), 3)
    expected = battery.advance(stores.start, watts, 100 * YEAR).died_after
    events = walk.noted()
    assert len(events) == 6
    np.testing.assert_allclose(events[:, 2], expected[events[:, 1].astype(int)], rtol=1e-9)


def test_linear_batteries_die_at_their_charge_over_their_power() -> None:
    rng, stores = np.random.default_rng(4), stores_of(Linear(), 3.0, 500)
    watts, seconds = rng.uniform(0.01, 2.0, 500), rng.uniform(0.0, 4.0, 500)
    change = stores.advance(stores.full(1), np.ones(500, dtype=bool), watts, np.zeros(500), seconds)
    dead = 3.0 - watts * seconds <= 0.0
    np.testing.assert_array_equal(np.sort(change.column), np.flatnonzero(dead))
    np.testing.assert_allclose(change.after, 3.0 / watts[change.column], rtol=1e-13)
    np.testing.assert_array_equal(change.state.left[~dead], (3.0 - watts * seconds)[~dead])
    assert not change.back.any()


@pytest.fixture
def sun(tmp_path: Path) -> Harvester:
    """A harvester that offers 20 mW for a quarter of each day."""
    path = tmp_path / "sun.csv"
    path.write_text("time,power\n" + "".join(f"{h * 3600},{0.02 if 9 <= h < 15 else 0}\n" for h in range(24)))
    return Harvester(path=str(path), repeats=True, charging=0.9, restart=0.3)


def test_nodes_that_harvest_go_down_at_night_and_come_back(sun: Harvester) -> None:
    battery, watts = Linear(harvest=sun), np.array([2e-3, 5e-3])
    stores = stores_of(battery, 100.0, 2)
    walk = Paths(stores, NEVER, np.random.default_rng(0), 1, 10 * DAY)
    walk.advance(Phase(watts, np.zeros((1, 2)), np.ones(1), np.zeros((1, 2))), 3)
    # the same, minute by minute
    left, up, expected = np.full(2, 100.0), np.ones(2, dtype=bool), []
    for minute in range(10 * 24 * 60):
        power = 0.9 * (0.02 if 9 <= minute // 60 % 24 < 15 else 0.0)
        left = np.minimum(left + 60.0 * (power - np.where(up, watts, 0.0)), 100.0)
        for node in np.flatnonzero(np.where(up, left <= 0.0, left >= 30.0)):
            up[node] = not up[node]
            expected.append((node, minute * 60.0 + 60.0, up[node]))
        left = np.maximum(left, 0.0)
    events = walk.noted()[np.lexsort((walk.noted()[:, 1], walk.noted()[:, 2]))]
    wanted = np.array(expected, float)
    assert len(wanted) > 10
    np.testing.assert_array_equal(events[:, [1, 3]], wanted[:, [0, 2]])
    np.testing.assert_allclose(events[:, 2], wanted[:, 1], atol=120.0)


def test_listed_visits_come_at_their_times_and_the_rest_is_quiet() -> None:
    visits = Visits(of=Crossing(), lasting=10.0, times=(100.0, 200.0, 300.0))
    walk = Paths(stores_of(Linear(), 25.0, 1), visits, np.random.default_rng(0), 1, 10_000.0)
    walk.advance(Phase(np.full(1, 0.01), np.full((1, 1), 10.0), np.full(1, 10.0), np.full((1, 1), 10.0)), 1)
    # 21 J and 2.1 J of quiet power until 210 s; 1 J of the third visit after 0.99 s of it
    expected = 300.0 + (25.0 - 20.0 - 3.0) / (0.01 + 1.0)
    assert walk.noted()[0, 2] == pytest.approx(expected)


@pytest.mark.parametrize("years", [10.0, 1000.0])
def test_nodes_on_mains_let_paths_end_at_the_horizon(years: float) -> None:
    stores = stores_of(Linear(mains=(0, 1, 2, 3)), 1.0)
    walk = Paths(stores, poisson_visits(1 / HOUR), np.random.default_rng(0), 2, years * YEAR)
    walk.advance(Phase(np.full(NODES, 1e-3), np.eye(NODES), np.full(NODES, 0.3), np.full((2, NODES), 0.1)), 4)
    assert {int(node) for node in walk.noted()[:, 1]} == {4, 5}
    np.testing.assert_array_equal(walk.time, years * YEAR)


def test_a_node_with_next_to_nothing_does_not_make_all_chunks_short() -> None:
    stores = stores_of(Linear(residual=(1e-6, 18_720.0, 18_720.0)), 18_720.0, 3)
    walk = Paths(stores, poisson_visits(40 / HOUR), np.random.default_rng(0), 2, 10 * YEAR)
    walk.advance(Phase(np.full(3, 3e-4), np.full((5, 3), 0.01), np.full(5, 0.01), np.full((2, 3), 0.01)), 3)
    assert len(walk.noted()) == 6
    assert len(walk.events) < 20_000


@pytest.mark.parametrize(("tolerance", "expected"), [(0.0, 10.0), (4.0, 10.0), (6.0, 30.0), (80.0, np.inf)])
def test_interruptions_that_are_tolerated_end_no_life(tolerance: float, expected: float) -> None:
    rule = dataclasses.replace(criteria(), tolerance=tolerance, horizon=100.0)
    events = np.array([[0, 0, 30.0, 0], [0, 0, 15.0, 1], [0, 0, 10.0, 0], [1, 5, 99.0, 0]])
    found = rule.times(events, np.ones(NODES, dtype=bool), 3)
    np.testing.assert_array_equal(found["first_death"], [expected, 99.0 if tolerance < 1.0 else np.inf, np.inf])
    assert found["sink"][0] == expected  # the sink is node 0


def test_nodes_that_are_dead_at_the_start_are_no_first_death() -> None:
    alive = np.arange(NODES) > 0
    found = criteria().times(np.array([[0, 3, 7.0, 0]]), alive, 1)
    assert found["first_death"][0] == 7.0
    assert found["half_dead"][0] == np.inf
