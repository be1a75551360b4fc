"""What wrong clocks do to a network that tracks: estimates that lag, nodes that wake early or late, slots."""

import numpy as np
import pytest

from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.rng import Streams
from wsnsim.base.tables import RECORDED_BY_DEFAULT, Memory
from wsnsim.experiment import replicate_of
from wsnsim.network.clocks import Clocks
from wsnsim.network.node_process import NodeProcess
from wsnsim.scenario import build, load

SPEED = 4.0
STRAIGHT = {
    "name": "straight", "seed": 3, "duration": 60.0, "step": 0.5, "prior": {"sd": [1.0, 1.0, 1.0, 1.0]},
    "deploy": {"kind": "grid", "nodes": 36, "width": 300.0, "height": 100.0, "cover": False},
    "motion": {"kind": "waypoints", "points": [[0.0, -120.0, 0.0], [60.0, -120.0 + 60.0 * SPEED, 0.0]]},
    "sensor": {"kind": "range", "reach": 60.0, "sd": 0.5}, "energy": {"kind": "first_order"},
    "link": {"kind": "disk", "reach": 400.0}, "clusters": {"kind": "central"}, "tracker": {"kind": "ekf"},
}  # fmt: skip


def lag(**changes):
    """(T,) by how much estimates lie behind the target in x, in m."""
    setup = build(load({**STRAIGHT, **changes}))
    memory = Memory({**RECORDED_BY_DEFAULT, "clocks": True})
    replicate_of(setup, 0, memory)
    estimates, truth = memory.table("estimates"), memory.table("truth")
    return truth["px"][1:] - estimates["px"], memory


@pytest.mark.thorough
@pytest.mark.parametrize("offset", [0.5, -0.25])
def test_estimates_lag_by_the_speed_of_the_target_times_the_error_of_the_clocks(offset):
    step = [{"kind": "clock_step", "at": 0.0, "fraction": 1.0, "offset": offset}]
    right, wrong = lag()[0][20:], lag(faults=step)[0][20:]
    assert abs(right.mean()) < 0.1
    # A clock that is ahead says that it is time to measure too early: the target is not there yet.
    assert wrong.mean() == pytest.approx(SPEED * offset, abs=0.15)


@pytest.mark.thorough
def test_nodes_whose_clocks_differ_spoil_estimates_and_after_synchronisation_only_the_error_of_the_root_is_left():
    clock = {"kind": "drift", "sd": 30e-6, "offset": 0.5}
    alone, _ = lag(clock=clock)
    together, memory = lag(clock=clock, sync={"kind": "ftsp", "period": 1.0, "root_timeout": 2, "outlier": 0.01})
    clocks = memory.table("clocks")
    assert clocks["synchronised"][60] == 1.0 and clocks["spread_max"][60:].max() < 1e-4
    root = Clocks(build(load({**STRAIGHT, "clock": clock})).clock, Streams(3, 0).key("clock"), 36)
    error = float(root.error(np.array([0]), 45.0)[0])
    assert together[60:].mean() == pytest.approx(SPEED * error, abs=0.15)
    assert together[60:].std() < 0.5 * alone[60:].std()


def test_a_woken_node_stays_awake_until_its_own_clock_shows_that_the_step_is_over(monkeypatch):
    scenario = load("gmtt", ["duration=20 s", "clock={kind: drift, sd: 30 ppm, offset: 0.3 s}"])
    setup = build(scenario)
    kept = []
    keep = NodeProcess.keep_awake

    def noted(self, target, until, why="frame"):
        if why == "frame":
            kept.append((self.index, until))
        keep(self, target, until, why)

    monkeypatch.setattr(NodeProcess, "keep_awake", noted)
    replicate_of(setup, 0, Memory())
    count = len(sample_initial_conditions(setup, 0).positions)
    clocks = Clocks(setup.clock, Streams(setup.seed, 0).key("clock"), count)
    nodes, until = np.array([node for node, _ in kept]), np.array([time for _, time in kept])
    shown = np.array([float(clocks.local_times(nodes[i : i + 1], until[i])[0]) for i in range(len(kept))])
    steps = (shown - setup.wakeup.wait) / setup.dt
    assert len(kept) > 20 and np.abs(steps - np.round(steps)).max() < 1e-9
    assert np.abs(shown - until).max() > 0.1
