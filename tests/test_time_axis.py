"""A run has the instants 0, step, ..., duration - step, and consumes for exactly its duration (ADR 12)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wsnsim
from tests.helpers.thorough import thorough
from wsnsim.base.errors import ScenarioError

LISTENING = 0.062
"""Watts of a CC2420 that listens, to 0.1 %."""
NODES: dict[str, Any] = {
    "name": "idle", "seed": 5, "deploy": {"kind": "anchors", "places": [[0, 0], [20, 0], [0, 20]]},
    "energy": {"kind": "states", "radio": "cc2420", "processor": "msp430f1611"}, "link": {"kind": "disk", "reach": 50},
    "mac": {"kind": "csma"},
}  # fmt: skip
TRACKING: dict[str, Any] = {
    "prior": {"sd": [5, 1, 5, 1]}, "motion": {"kind": "waypoints", "points": [[0, 5000, 5000], [1, 5000, 5000]]},
    "sensor": {"kind": "range", "sd": 1.0, "reach": 30.0}, "tracker": {"kind": "ekf"},
}  # fmt: skip
"""A target that nobody senses."""
WORKLOAD: dict[str, Any] = {"workload": {"kind": "beacons", "period": 1e6}}
"""Beacons that fall into no run: their phases are uniform over the period."""


def joules(**changes: Any) -> np.ndarray:
    """(3,) what each node consumes in a run."""
    nodes = wsnsim.simulate(NODES | changes).table("nodes")
    return (nodes.energy_initial - nodes.energy_left).to_numpy()


@pytest.mark.parametrize(("duration", "step"), [(20, 0.5), (20, 2), (20, 10), (40, 20)])
def test_nodes_that_only_listen_consume_for_the_duration_at_every_step(duration: float, step: float) -> None:
    energy = wsnsim.simulate(NODES | TRACKING, duration=duration, step=step).energy
    idle = energy[energy.cause == "idle"].groupby("node").joules.sum().to_numpy()
    assert idle == pytest.approx([LISTENING * duration] * 3, rel=1e-3)


@pytest.mark.parametrize(
    "change",
    [
        {"mac": {"kind": "xmac"}},
        {"sleep": {"kind": "duty_cycle", "period": 3, "awake_share": 0.3}},
        *thorough(
            [
                {},
                {"mac": {"kind": "contikimac"}},
                {"mac": {"kind": "tsch"}},
                {"sleep": {"kind": "ris", "period": 4, "probability": 0.5}, "clock": {"kind": "drift", "sd": "50 ppm"}},
            ]
        ),
    ],
    ids=str,
)
def test_a_network_whose_target_nobody_senses_consumes_what_a_workload_without_frames_does(change: Any) -> None:
    lasts = {"duration": 20, "step": 2}
    assert joules(**TRACKING, **lasts, **change) == pytest.approx(joules(**WORKLOAD, **lasts, **change), rel=1e-9)


@pytest.mark.parametrize("network", [TRACKING, WORKLOAD], ids=["target", "workload"])
def test_a_battery_for_25_seconds_lives_through_20_and_not_through_30(network: dict[str, Any]) -> None:
    battery = {"energy": NODES["energy"] | {"battery": LISTENING * 25}}
    alive, dead = (
        wsnsim.simulate(NODES | network | battery, duration=seconds, step=10).runs.first_death[0]
        for seconds in (20, 30)
    )
    assert np.isnan(alive) and dead == pytest.approx(25.0, rel=1e-3)


@pytest.mark.parametrize("change", [{}, {"network": "none"}, {"network": "none", "replicates": 2}], ids=str)
def test_instants_begin_at_0_and_end_a_step_before_the_end(change: dict[str, Any]) -> None:
    seen = wsnsim.run("liu_network", duration=10, step=2, keep=["truth", "estimates", "energy_steps"], **change)
    for number in range(change.get("replicates", 1)):
        truth, estimates = (t[t.replicate == number] for t in (seen.table("truth"), seen.estimates))
        assert truth.time.tolist() == [0, 2, 4, 6, 8] and estimates.time.tolist() == [2, 4, 6, 8]
    assert set(seen.runs.steps) == {4}
    if not change:
        assert sorted(set(seen.table("energy_steps").step)) == [0, 1, 2, 3, 4]


def test_a_run_that_tracks_has_at_least_two_steps() -> None:
    for change in ({}, {"network": "none"}):
        with pytest.raises(ScenarioError, match=r"duration: error: 2 s is one step of 2 s.* give at least 4 s"):
            wsnsim.simulate("liu_network", duration=2, step=2, **change)
        assert len(wsnsim.simulate("liu_network", duration=4, step=2, **change).estimates) == 1
    assert joules(**WORKLOAD, duration=20, step=20) == pytest.approx(joules(**WORKLOAD, duration=20, step=2), rel=1e-9)


BEFORE = {
    "rkf": (10, 1, 0.381765508511109, np.nan),
    "pso_mhpf": (0.4, 0.04, 5.263423282245251, 0.02082692371004319),
    "li_xmac": (20, 2, 2.422844558768886, 3.7121639139255427),
    "information_driven_asleep": (0.4, 0.04, np.nan, 0.09621508695784164),
    "two_targets": (0.4, 0.04, 3.8443840331146326, 0.04823430172967803),
    "recorded_network": (5, 0.5, 1.8201274235004965, 4.091311571219375),
}
"""(duration, step, RMSE, joules) of scenarios, as wsnsim 0.2.0 gave them; the joules of `li_xmac` (there 3.7085) as
they are since a radio that was turned off takes its time to start."""


@pytest.mark.parametrize("name", BEFORE)
def test_a_run_of_version_0_2_is_one_that_lasts_a_step_longer(name: str) -> None:
    duration, step, rmse, energy = BEFORE[name]
    run = wsnsim.simulate(name, duration=round(duration + step, 9)).runs.iloc[0]
    assert run.steps == round(duration / step)
    assert [run.rmse, run.energy] == pytest.approx([rmse, energy], rel=1e-6, nan_ok=True)
