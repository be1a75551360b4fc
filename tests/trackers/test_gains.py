"""Gains estimated beside the state: against a joint filter in plain NumPy, statistically, and across handovers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import wsnsim
from tests.helpers.linear_cluster import VARIANCE, Cluster, LinearSensor, kalman
from wsnsim.base.errors import ScenarioError
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.models.linear import ConstantVelocity
from wsnsim.models.ranging import Range, Rssi
from wsnsim.offline.loopback import silent
from wsnsim.scenario import build
from wsnsim.testing import check_tracker
from wsnsim.trackers.bootstrap_pf import CentralPf, Pf
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.gaussian_pf import GaussianPf
from wsnsim.trackers.shared.gains import Gains, GainsOfParticles, gain_packets

MOTION = ConstantVelocity(start=(5.0, 1.0, 5.0, -1.0), variances=(0.5,), noise_input="diagonal")
SENSOR = Rssi(sd=2.0, gain_spread=4.0)
ESTIMATING = SENSOR.assumed("estimated", False)
EVERY = [ExtendedKalman(), Pf(particles=200), CentralPf(particles=200), GaussianPf(particles=200)]
NAMES = ["ekf", "pf", "central_pf", "gpf"]


class GainedSensor(LinearSensor):
    """z = a x + b y + g + N(0, 2), of which filters estimate g; its variance is 9."""

    gain_prior = 9.0


def filtered(cluster: Cluster, tracker: Any, sensor: Any, steps: int) -> Any:
    """The belief after some steps in which all sense but one, another one each time."""
    belief, _ = cluster.drive(tracker.start(cluster.prior, replace(cluster.scene(0), sensor=sensor)))
    for step in range(1, steps + 1):
        scene = cluster.scene(step, tuple(node for node in cluster.ids if node % 7 != step % 7))
        belief, _ = cluster.drive(tracker.step(belief, replace(scene, sensor=sensor)))
        yield step, belief, scene.ids


@pytest.mark.parametrize(
    ("sensor", "own", "common"),
    [(SENSOR, 16.0, 0.0), (Range(sd=2.0, bias_spread=3.0, clock_spread=5.0), 9.0, 25.0)],
    ids=["gains", "biases"],
)
def test_the_kalman_filter_is_the_joint_filter_of_state_and_all_gains(sensor: Any, own: float, common: float) -> None:
    """The twin has all gains from the start, a batch update and no code of ours but the motion model's matrices."""
    cluster = Cluster(6, MOTION, sensor)
    mean, cov = np.zeros(10), own * np.eye(10) + common
    mean[:4], cov[:4, :], cov[:, :4] = cluster.prior.mean, 0.0, 0.0
    cov[:4, :4] = cluster.prior.cov
    for step, belief, ids in filtered(cluster, ExtendedKalman(), sensor.assumed("estimated", False), 30):
        transition, noise = MOTION.matrices(mean[:4, None], cluster.dt, (step - 1) * cluster.dt)
        moved = np.eye(10)
        moved[:4, :4] = transition[0]
        mean, cov = moved @ mean, moved @ cov @ moved.T
        cov[:4, :4] += noise
        rows = [cluster.ids.index(node) for node in ids]
        z = np.array([cluster.members[node].reading for node in ids])
        apart = mean[[0, 2]] - cluster.positions[rows]
        squares = (apart**2).sum(axis=1)
        slopes = np.zeros((len(rows), 10))
        logs = sensor is SENSOR
        slopes[:, [0, 2]] = (
            -23.0 / np.log(10.0) * apart / squares[:, None] if logs else apart / np.sqrt(squares)[:, None]
        )
        slopes[np.arange(len(rows)), [4 + row for row in rows]] = 1.0
        expected = -37.8 - 11.5 * np.log10(squares) if logs else np.sqrt(squares)
        residual = z - (expected + mean[[4 + row for row in rows]])
        gain = cov @ slopes.T @ np.linalg.inv(slopes @ cov @ slopes.T + 4.0 * np.eye(len(rows)))
        mean, cov = mean + gain @ residual, cov - gain @ slopes @ cov
        assert belief.mean == pytest.approx(mean[:4], rel=1e-9, abs=1e-9)
        assert belief.cov == pytest.approx(cov[:4, :4], rel=1e-7, abs=1e-9)
    order = [4 + cluster.ids.index(node) for node in belief.gains.nodes]
    assert sorted(belief.gains.nodes) == list(cluster.ids)
    assert belief.gains.mean == pytest.approx(mean[order], rel=1e-7)
    assert belief.gains.cov == pytest.approx(cov[np.ix_(order, order)], rel=1e-7, abs=1e-9)
    assert belief.gains.cross == pytest.approx(cov[np.ix_(range(4), order)], rel=1e-7, abs=1e-9)


@pytest.mark.thorough
def test_the_bias_of_a_node_is_in_its_95_per_cent_interval_as_often_as_it_should_be() -> None:
    """250 runs of four anchors: 1000 biases with a common part, whose intervals hold 95 % but for three deviations."""
    law = {"kind": "range", "sd": "0.3 m", "reach": ".inf", "bias_spread": "1 m", "clock_spread": "2 m"}
    scenario = {"extends": "range_anchors", "name": "x", "duration": "16 s", "replicates": 250, "sensor": law}
    tracker = {"kind": "ekf", "assumes": {"gains": "estimated"}}
    setup = build(wsnsim.load(scenario | {"tracker": tracker}))
    state = wsnsim.run(scenario | {"tracker": tracker}, keep=["tracker_state"]).table("tracker_state")
    last = state[state["step"] == state["step"].max()]
    inside = []
    for run, rows in last.groupby("replicate"):
        truth = sample_initial_conditions(setup, run).traits[:, 0]
        named = {name: part["value"].to_numpy() for name, part in rows.groupby("name", observed=True)}
        errors = named["bias"] - truth[named["gain_node"].astype(int)]
        inside += list(np.abs(errors) < 1.96 * named["bias_sd"])
    assert len(inside) == 1000
    # the biases of a run are correlated: 250 to 1000 independent ones
    assert abs(np.mean(inside) - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / 250)


def test_given_each_particle_the_gains_are_gaussian_and_the_joint_moments_those_of_the_kalman_filter() -> None:
    """A linear sensor, 200 000 particles of the prior: mean and covariance of state and gains to the sampling error."""
    rng = np.random.default_rng(2)
    mean, cov = np.array([1.0, -2.0]), np.array([[4.0, 1.0], [1.0, 3.0]])
    gains = Gains(
        (7, 3), np.array([0.5, -1.0]), np.array([[2.0, 0.3], [0.3, 1.5]]), np.array([[0.4, 0.0], [-0.2, 0.6]])
    )
    cloud = mean[:, None] + np.linalg.cholesky(cov) @ rng.standard_normal((2, 200_000))
    slopes, readings = np.array([[1.0, 0.5], [-0.3, 1.0]]), np.array([1.7, -4.0])
    seen: Any = type("Seen", (), {"ids": (3, 7), "readings": readings})
    given, logs = GainsOfParticles.given(gains, mean, cov, cloud).weighed(
        slopes @ cloud, np.full((2, cloud.shape[1]), VARIANCE), seen
    )
    weights = np.exp(logs - logs.max())
    centre = cloud @ weights / weights.sum()
    found = given.joint(cloud, centre, logs)
    joint, full = np.block([[cov, gains.cross], [gains.cross.T, gains.cov]]), np.concatenate([mean, gains.mean])
    design = np.column_stack([slopes, [[0.0, 1.0], [1.0, 0.0]]])
    lift = joint @ design.T @ np.linalg.inv(design @ joint @ design.T + VARIANCE * np.eye(2))
    after, spread = full + lift @ (readings - design @ full), joint - lift @ design @ joint
    assert centre == pytest.approx(after[:2], abs=0.03) and found.mean == pytest.approx(after[2:], abs=0.03)
    assert found.cov == pytest.approx(spread[2:, 2:], abs=0.03)
    assert found.cross == pytest.approx(spread[:2, 2:], abs=0.03)


@pytest.mark.thorough
@pytest.mark.parametrize("tracker", EVERY[1:], ids=NAMES[1:])
def test_particle_filters_follow_the_kalman_filter_on_a_linear_model(tracker: Any) -> None:
    """Their means stay within a third of its standard deviations, with 4 000 particles over 12 steps."""
    tracker = replace(tracker, particles=4000)
    alike = [
        filtered(Cluster(5, sensor=GainedSensor()), each, GainedSensor(), 12) for each in (tracker, ExtendedKalman())
    ]
    for (_, belief, _), (_, truth, _) in zip(*alike, strict=True):
        assert np.all(np.abs(belief.mean - truth.mean) < 0.35 * np.sqrt(np.diag(truth.cov)))
        places = belief.gains.rows(truth.gains.nodes)
        wide = np.sqrt(np.diag(truth.gains.cov))
        assert np.all(np.abs(belief.gains.mean[places] - truth.gains.mean) < 0.35 * wide)
        assert np.sqrt(np.diag(belief.gains.cov))[places] == pytest.approx(wide, rel=0.2)


def test_gains_that_are_known_to_be_zero_change_nothing() -> None:
    """With a prior of next to nothing, the joint filter is the filter of the state alone."""
    sensor = type("Sure", (LinearSensor,), {"gain_prior": 1e-12})()
    cluster = Cluster(5, sensor=sensor)
    mean, cov = cluster.prior.mean, cluster.prior.cov
    belief, _ = cluster.drive(ExtendedKalman().start(cluster.prior, cluster.scene(0)))
    for step in range(1, 10):
        belief, _ = cluster.drive(ExtendedKalman().step(belief, cluster.scene(step)))
        mean, cov = kalman(mean, cov, cluster.motion.noise, *cluster.readings())
        assert belief.mean == pytest.approx(mean, rel=1e-6, abs=1e-6)


@pytest.mark.thorough(fast=["gpf"])
@pytest.mark.parametrize("tracker", EVERY, ids=NAMES)
def test_trackers_that_estimate_gains_keep_the_rules_of_the_interface(tracker: Any) -> None:
    check_tracker(tracker, MOTION, ESTIMATING)


@pytest.mark.parametrize("tracker", EVERY, ids=NAMES)
def test_without_readings_gains_stay_and_their_covariance_with_the_state_moves_on(tracker: Any) -> None:
    cluster = Cluster(5, MOTION, SENSOR)
    *_, (_, belief, _) = filtered(cluster, tracker, ESTIMATING, 4)
    scene = replace(cluster.scene(5, ()), sensor=ESTIMATING)
    after, _ = cluster.drive(tracker.step(belief, scene))
    transition = MOTION.matrices(belief.mean[:, None], cluster.dt, 4 * cluster.dt)[0][0]
    assert np.array_equal(after.gains.mean, belief.gains.mean) and np.array_equal(after.gains.cov, belief.gains.cov)
    assert after.gains.cross == pytest.approx(transition @ belief.gains.cross)


@pytest.mark.parametrize("tracker", EVERY, ids=NAMES)
def test_a_handover_sends_the_gains_of_the_clusters_members_and_pays_for_them(tracker: Any) -> None:
    cluster = Cluster(5, MOTION, SENSOR)
    *_, (_, belief, _) = filtered(cluster, tracker, ESTIMATING, 4)
    scene = replace(cluster.scene(4), roster=cluster.ids[:3])
    after, heard = cluster.drive(tracker.hand_over(belief, scene, 7))
    assert sorted(after.gains.nodes) == list(cluster.ids[:3]), "the target has left the others behind"
    assert heard.total("gains") == gain_packets(3, 4) == 6  # 3 nodes, 3 means, 12 + 6 covariances
    places = belief.gains.rows(after.gains.nodes)
    assert np.array_equal(after.gains.mean, belief.gains.mean[places])
    assert np.array_equal(after.gains.cov, belief.gains.cov[np.ix_(places, places)])
    answers = iter([True, False])
    once, _ = cluster.drive(tracker.hand_over(belief, scene, 7), lambda s, t, p: np.full(p.packets, next(answers)))
    assert once is not None and once.gains is None, "gains that are lost begin again with their prior"
    assert cluster.drive(tracker.hand_over(belief, scene, 7), silent)[0] is None


def scenario(tracker: str, gains: str, **changed: Any) -> dict[str, Any]:
    """Twelve anchors with gains of 4 dB around a target that turns among them, without a network."""
    motion = {"kind": "waypoints", "q": 0.05, "points": [[0, 2, 2], [20, 18, 4], [40, 16, 16], [60, 3, 14]]}
    return {
        "name": "gains", "network": "none", "seed": 3, "duration": "60 s", "step": "1 s",
        "prior": {"sd": [1, 0.5, 1, 0.5]},
        "deploy": {"kind": "anchors", "places": [[x, y] for x in (0, 7, 14, 21) for y in (0, 9, 18)]},
        "motion": motion, "sensor": {"kind": "rssi", "sd": 3, "gain_spread": 4},
        "tracker": {"kind": tracker, "assumes": {"gains": gains}}, "record": {"tracker_state": True}, **changed,
    }  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("tracker", NAMES)
def test_gains_are_recovered_and_errors_are_smaller_and_nearer_to_what_is_claimed(tracker: str, tmp_path: Any) -> None:
    """In the median of five runs gains of 4 dB are known to less than 2 dB; most errors are as claimed."""
    worse, better = (
        wsnsim.run(wsnsim.load({**scenario(tracker, gains), "replicates": 5}), out=tmp_path / f"{gains}.h5")
        for gains in ("unknown", "estimated")
    )
    for name, factor in (("rmse", 0.7), ("nees", 0.4)):
        ignored, estimated = (one.runs[name].median() for one in (worse, better))
        assert estimated < factor * ignored
    state = wsnsim.read(better.out, "tracker_state")
    last = state[state["step"] == state["step"].max()]
    nodes = wsnsim.read(better.out, "nodes").set_index(["replicate", "node"])["gain"]
    columns = {
        name: last[last["name"] == name].set_index(["replicate", "index"])["value"] for name in set(last["name"])
    }
    truth = np.array([10.0 * np.log10(nodes[run, int(node)]) for (run, _), node in columns["gain_node"].items()])
    errors = columns["gain_db"].to_numpy() - truth
    assert len(truth) == 60 and np.sqrt(np.mean(truth**2)) > 3.0
    assert np.median(np.sqrt(np.mean(errors.reshape(5, 12) ** 2, axis=1))) < 2.0
    assert np.mean(np.abs(errors) < 3.0 * columns["gain_db_sd"].to_numpy()) > 0.75


@pytest.mark.parametrize(
    ("tracker", "sensor", "why"),
    [
        ("trilateration", {"kind": "rssi", "gain_spread": 4},
         "trilateration keeps no gains of sensors beside the state; these do: central_pf, pf, gpf, ekf"),
        ("ekf", {"kind": "range"}, "range has no gains that could be unknown"),
        ("ekf", {"kind": "acoustic_energy"}, "of acoustic_energy are factors of the signal, which no filter"),
        ("pf", {"kind": "quantised", "law": {"kind": "range", "bias_spread": 1}},
         "off a reading that names a cell, and no filter estimates them"),
    ],
)  # fmt: skip
def test_who_cannot_estimate_gains_is_refused_and_who_can_is_named(tracker: str, sensor: Any, why: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        wsnsim.experiment.simulate_run(wsnsim.load(scenario(tracker, "estimated", sensor=sensor)))
    assert why in str(refused.value)


def test_where_gains_do_not_vary_they_need_not_be_estimated() -> None:
    known, estimated = (
        wsnsim.experiment.simulate_run(wsnsim.load(scenario("ekf", gains, sensor={"kind": "rssi", "sd": 3})))
        for gains in ("known", "estimated")
    )
    assert known.run["fingerprint"] == estimated.run["fingerprint"]
