"""Nodes whose positions are known approximately: what filters and heads assume, and what stays as it is."""

from __future__ import annotations

import numpy as np
import pytest

import wsnsim
from tests.network.radio_network import RadioNetwork
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.rng import Streams
from wsnsim.base.tables import Memory
from wsnsim.bounds import bound
from wsnsim.network.node_states import Places
from wsnsim.offline.loopback import OfflineCluster
from wsnsim.scenario.registry import kinds
from wsnsim.scenario.sweep import load_sweep

GRID = {
    "name": "grid",
    "duration": "4 s",
    "deploy": {"kind": "grid", "nodes": 81, "width": "400 m", "height": "400 m", "cover": False},
    "motion": {"kind": "bounded_velocity", "start": [-45, -20, -50, -35]},
    "sensor": {"kind": "acoustic_energy"},
    "clusters": {"kind": "central"},
    "link": {"kind": "disk", "reach": "600 m"},
    "energy": {"kind": "first_order"},
    "tracker": {"kind": "ekf"},
}
OFFLINE = {key: value for key, value in GRID.items() if key not in ("clusters", "link", "energy")} | {"network": "none"}


def setup_of(scenario: dict, error: float):
    return wsnsim.scenario.build(wsnsim.load(scenario, [f"deploy.position_error={error} m"]))


def recorded(scenario: dict, error: float, replicate: int = 0) -> Memory:
    memory = Memory(dict.fromkeys(("truth", "estimates", "nodes", "events", "energy", "links"), True))
    wsnsim.experiment.simulate_run(wsnsim.load(scenario, [f"deploy.position_error={error} m"]), replicate, memory)
    return memory


@pytest.mark.thorough
def test_the_errors_of_assumed_positions_are_gaussian_on_each_axis_and_of_their_own_stream() -> None:
    known = sample_initial_conditions(setup_of(OFFLINE, 0.0), 0)
    assert known.assumed is known.positions
    errors = []
    for replicate in range(30):
        exact = sample_initial_conditions(setup_of(OFFLINE, 0.0), replicate)
        found = sample_initial_conditions(setup_of(OFFLINE, 2.0), replicate)
        for name in ("positions", "traits", "truths"):
            assert np.array_equal(getattr(found, name), getattr(exact, name))
        assert np.array_equal(found.priors[0].mean, exact.priors[0].mean)
        errors.append(found.assumed - found.positions)
    x, y = np.concatenate(errors).T
    assert [x.std(), y.std()] == pytest.approx([2.0, 2.0], rel=0.05), "2430 draws"
    assert [x.mean(), y.mean()] == pytest.approx([0.0, 0.0], abs=0.12)
    assert abs(np.corrcoef(x, y)[0, 1]) < 0.06
    assert abs(np.corrcoef(errors[0][:, 0], errors[1][:, 0])[0, 1]) < 0.4, "another run has other errors"
    twice = sample_initial_conditions(setup_of(OFFLINE, 4.0), 0)
    assert twice.assumed - twice.positions == pytest.approx(2.0 * errors[0], rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("kind", sorted(kinds("deploy")))
def test_every_deployment_has_the_parameter(kind: str, tmp_path) -> None:
    (tmp_path / "nodes.csv").write_text("x,y\n0,0\n50,0\n0,50\n", encoding="utf-8")
    own = {"file": {"path": str(tmp_path / "nodes.csv")}, "anchors": {"places": [[0, 0], [50, 0], [0, 50]]}}
    deploy = {"kind": kind, "cover": False, **own.get(kind, {})}
    conditions = sample_initial_conditions(setup_of({**OFFLINE, "deploy": deploy}, 2.0), 0)
    assert np.all(conditions.assumed != conditions.positions)


def test_without_a_network_a_filter_gets_the_same_readings_at_other_positions() -> None:
    scenes, readings = [], []
    for error in (0.0, 5.0):
        setup = setup_of(OFFLINE, error)
        cluster = OfflineCluster(setup, 0, sample_initial_conditions(setup, 0), Streams(setup.seed, 0))
        scenes.append(cluster.scene(1, 1))
        readings.append([member.reading for member in cluster.members.values()])
        for node, position in zip(scenes[-1].ids, scenes[-1].positions, strict=True):
            assert np.array_equal(cluster.members[node].position, position)
    assert readings[0] == readings[1] and scenes[0].ids == scenes[1].ids
    assert np.all(scenes[0].positions != scenes[1].positions)


@pytest.mark.thorough
def test_in_a_network_only_the_estimates_change_while_the_same_node_leads() -> None:
    exact, wrong = recorded(GRID, 0.0), recorded(GRID, 5.0)
    for table in ("truth", "events", "energy"):
        before, after = exact.table(table), wrong.table(table)
        assert before and all(np.array_equal(before[name], after[name]) for name in before), table
    nodes = wrong.table("nodes")
    for name in ("x", "y", "gain", "energy_left"):
        assert np.array_equal(nodes[name], exact.table("nodes")[name])
    assert np.array_equal(exact.table("nodes")["x_assumed"], nodes["x"])
    assert np.std(nodes["x_assumed"] - nodes["x"]) == pytest.approx(5.0, rel=0.4)
    assert np.array_equal(exact.table("estimates")["active"], wrong.table("estimates")["active"])


@pytest.mark.thorough
@pytest.mark.parametrize("scenario", [GRID, OFFLINE], ids=["network", "offline"])
def test_an_extended_kalman_filter_that_assumes_wrong_positions_is_worse_on_the_same_readings(scenario: dict) -> None:
    def rmse(error: float, replicate: int) -> float:
        settled = recorded(scenario, error, replicate).table("estimates")["error"][50:]
        return float(np.sqrt(np.mean(settled**2)))

    exact, wrong = (np.median([rmse(error, replicate) for replicate in range(5)]) for error in (0.0, 2.0))
    assert wrong > 5.0 * exact, "0.24 m and 2.9 m"


def test_a_greedy_path_follows_assumed_positions_over_links_that_exist() -> None:
    net = RadioNetwork([(0, 0), (50, 10), (60, -10), (120, 0)], weight="greedy")
    assert net.router.path(0, 3) == [0, 2, 3]
    net.nodes.assumed = Places(np.array([(0.0, 0.0), (70.0, 10.0), (50.0, -10.0), (120.0, 0.0)]))
    net.router.forget_links()
    assert net.router.path(0, 3) == [0, 1, 3]


def test_a_bound_says_that_it_takes_positions_as_known() -> None:
    overrides = ["duration=0.4 s", "deploy.position_error=2 m"]
    assert any("node positions" in text for text in bound(wsnsim.load("ekf_real", overrides), range(2)).cautions)


def test_runs_with_and_without_wrong_positions_are_paired() -> None:
    worlds = [load_sweep("jiang_field", (), [f"deploy.position_error={error} m"]).points[0].world for error in (0, 2)]
    assert worlds[0] == worlds[1]
