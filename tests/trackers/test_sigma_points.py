"""The unscented and the cubature Kalman filter: where they are exact, angles, sharp readings, packets, operations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tests.helpers.linear_cluster import Cluster, LinearMotion, LinearSensor, kalman, sent
from wsnsim import scenario
from wsnsim.base.errors import ScenarioError
from wsnsim.models.linear import ConstantVelocity
from wsnsim.models.ranging import Range
from wsnsim.offline.loopback import silent
from wsnsim.testing import check_tracker
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.shared.readings import Evidence
from wsnsim.trackers.sigma_points import CubatureKalman, UnscentedKalman, points, predicted, updated

EVERY = [
    UnscentedKalman(),
    UnscentedKalman(alpha=1e-3),
    UnscentedKalman(alpha=0.5, beta=0.0, kappa=-1.0),
    CubatureKalman(),
]
NAMES = ["ukf", "narrow", "a negative weight", "ckf"]
UKF_CKF = pytest.mark.parametrize("tracker", [EVERY[0], EVERY[-1]], ids=["ukf", "ckf"])


class Compass(LinearSensor):
    """The angle at which a node sees the target, or that and the distance."""

    def __init__(self, ranges: bool) -> None:
        self.components = ("bearing", "range") if ranges else ("bearing",)
        self.periods = (math.tau, 0.0)[: len(self.components)]

    def linearise(self, points, positions, traits):
        apart = points[None] - positions[:, :, None]
        squares = (apart**2).sum(axis=1)
        angles = np.arctan2(apart[:, 1], apart[:, 0])
        across = np.stack([-apart[:, 1], apart[:, 0]], axis=1) / squares[:, None]
        along = apart / np.sqrt(squares)[:, None]
        rows = [(angles, across, np.full(angles.shape, 0.01)), (np.sqrt(squares), along, np.full(angles.shape, 0.1))]
        return tuple(
            np.stack(each, axis=1).reshape(-1, *each[0].shape[1:])
            for each in zip(*rows[: len(self.components)], strict=True)
        )


@pytest.mark.parametrize("tracker", EVERY, ids=NAMES)
def test_on_a_linear_gaussian_model_it_is_the_kalman_filter(tracker) -> None:
    cluster = Cluster(5)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    mean, cov = cluster.prior.mean, cluster.prior.cov
    for step in range(1, 31):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        readings, traits = cluster.readings()
        before, spread = kalman(mean, cov, cluster.motion.noise, np.empty(0), np.empty((0, 2)))
        mean, cov = kalman(mean, cov, cluster.motion.noise, readings, traits)
        cov = (cov + cov.T) / 2.0  # rounding makes the truth lopsided, more so from step to step
        assert belief.mean == pytest.approx(mean, rel=1e-8, abs=1e-8)
        assert belief.cov == pytest.approx(cov, rel=1e-8, abs=1e-8)
        rise = np.zeros((len(readings), 4))
        rise[:, [0, 2]] = traits
        error = readings - rise @ before
        nis = error @ np.linalg.solve(rise @ spread @ rise.T + 2.0 * np.eye(len(error)), error)
        assert tracker.estimate(belief).innovation == pytest.approx((nis, len(readings)), rel=1e-7)


@pytest.mark.parametrize("tracker", EVERY, ids=NAMES)
def test_without_a_reading_it_predicts_as_it_forecasts(tracker) -> None:
    cluster = Cluster(4)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    mean, cov = kalman(belief.mean, belief.cov, cluster.motion.noise, np.empty(0), np.empty((0, 2)))
    forecast = tracker.forecast(belief, cluster.scene(0), 1)
    for ids in (cluster.ids[1:], ()):
        after, _ = cluster.drive(tracker.step(belief, cluster.scene(1, ids)), silent)
        assert after.mean == pytest.approx(mean) and after.cov == pytest.approx(cov)
        assert np.array_equal(after.mean, forecast.mean) and np.array_equal(after.cov, forecast.cov)
        assert tracker.estimate(after).innovation.dof == 0
    twice, _ = cluster.drive(tracker.step(belief, cluster.scene(2, (), steps=2)))
    assert np.array_equal(twice.mean, tracker.forecast(belief, cluster.scene(0), 2).mean)


@pytest.mark.parametrize("tracker", EVERY, ids=NAMES)
def test_the_points_have_the_moments_of_the_gaussian(tracker) -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(5, 5))
    mean, cov = rng.normal(size=5), root @ root.T
    weights = tracker.weights(5)
    cloud = points(mean, cov, weights)
    assert np.array_equal(cloud[:, 0], mean) and cloud.shape == (5, 11)
    around = cloud[:, 1:] - mean[:, None]
    assert weights.each * around @ around.T == pytest.approx(cov)
    assert around.sum(axis=1) == pytest.approx(np.zeros(5), abs=1e-9 * np.abs(around).max())


@UKF_CKF
@pytest.mark.parametrize("ranges", [False, True], ids=["bearings", "bearings and ranges"])
def test_an_angle_counts_as_the_nearest_turn_and_a_track_across_the_cut_is_one_beside_it(tracker, ranges) -> None:
    """A world turned by half a turn is the same to the rounding of sines: the cut then lies on the other side."""
    sensor, rng = Compass(ranges), np.random.default_rng(4)
    scene = Cluster(3, LinearMotion(), sensor).scene(0)
    weights, half = tracker.weights(4), np.diag([-1.0, 1.0, -1.0, 1.0])
    mean, cov, places = np.array([-6.0, 0.0, 0.1, 0.0]), np.diag([1.0, 1.0, 4.0, 1.0]), rng.uniform(-1, 1, (3, 2))
    readings = np.array([[math.pi - 0.05, 5.8], [-math.pi + 0.1, 6.0], [math.pi - 0.01, 6.4]])
    readings = readings if ranges else readings[:, 0]
    turned = readings + (np.array([math.pi, 0.0]) if ranges else math.pi)
    again = readings + (np.array([[-7.0], [0.0], [2.0]]) * [math.tau, 0.0] if ranges else [-math.tau, 0.0, math.tau])

    def after(centre, nodes, measured):
        seen = Evidence((0, 1, 2), measured, nodes, np.empty((3, 0)))
        return updated(centre, cov, weights, seen, scene)

    here, there, moved = after(mean, places, readings), after(half @ mean, -places, turned), after(mean, places, again)
    assert half @ there[0] == pytest.approx(here[0], abs=1e-9)
    assert half @ there[1] @ half == pytest.approx(here[1], abs=1e-9)
    assert moved[0] == pytest.approx(here[0], abs=1e-9) and moved[2].nis == pytest.approx(here[2].nis)
    assert np.linalg.norm(here[0] - mean) < 3.0, "no angle counts as almost a whole turn away"


def test_a_negative_weight_makes_no_covariance_indefinite() -> None:
    """Where κ is negative, the textbook's S and P are indefinite here: the central point's term is left out."""
    tracker, ring = UnscentedKalman(alpha=1.0, beta=0.0, kappa=-3.9), np.linspace(0.0, math.tau, 6, endpoint=False)
    scene = Cluster(6, LinearMotion(), Range(sd=0.01, reach=100.0)).scene(0)
    places = np.column_stack([np.cos(ring), np.sin(ring)])
    seen = Evidence(tuple(range(6)), np.full(6, 1.5), places, np.empty((6, 0)))
    mean, cov = np.zeros(4), np.diag([4.0, 1.0, 4.0, 1.0])
    weights = tracker.weights(4)
    after, spread, innovation = updated(mean, cov, weights, seen, scene)
    assert weights.centre < -10.0
    assert np.linalg.eigvalsh(spread)[0] > 0.0 and np.isfinite(after).all() and innovation.nis > 0.0
    _, moved = predicted(mean, cov, weights, ConstantVelocity(), 1.0, 0.0)
    assert np.linalg.eigvalsh(moved)[0] > 0.0


@UKF_CKF
def test_readings_and_expectations_that_are_not_finite_are_left_out(tracker) -> None:
    class Blind(LinearSensor):
        def linearise(self, points, positions, traits):
            expected, gradients, variances = super().linearise(points, positions, traits)
            expected[1, 3], variances[2] = np.inf, np.nan
            return expected, gradients, variances

    scene, rng = Cluster(5, LinearMotion(), Blind()).scene(0), np.random.default_rng(5)
    traits, places = rng.normal(size=(5, 2)), np.zeros((5, 2))
    readings = np.array([1.0, 2.0, 3.0, np.nan, 5.0])
    mean, cov = rng.normal(size=4), np.eye(4)
    all_of_them = updated(mean, cov, tracker.weights(4), Evidence(tuple(range(5)), readings, places, traits), scene)
    good = [0, 4]
    plain = Cluster(2).scene(0)
    two = updated(mean, cov, tracker.weights(4), Evidence((0, 4), readings[good], places[good], traits[good]), plain)
    assert all_of_them[0] == pytest.approx(two[0]) and all_of_them[1] == pytest.approx(two[1])
    assert all_of_them[2].dof == 2
    bad = updated(mean, cov, tracker.weights(4), Evidence((3,), readings[3:4], places[:1], traits[:1]), plain)
    assert bad[0] is mean and bad[1] is cov and bad[2].dof == 0


@UKF_CKF
def test_very_sharp_readings_leave_the_covariance_definite_over_many_steps(tracker) -> None:
    cluster = Cluster(8, ConstantVelocity(variances=(1e-6,)), Range(sd=1e-5, reach=500.0), reach=60.0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    for step in range(1, 61):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        assert np.array_equal(belief.cov, belief.cov.T)
        assert np.linalg.eigvalsh(belief.cov)[0] > 0.0


def test_a_wide_prior_on_a_ring_is_nearer_to_the_posterior_than_linearisation() -> None:
    """One range to a node in the middle of the prior says nothing of the direction: no slope knows that."""
    scene = Cluster(1, LinearMotion(), Range(sd=0.5, reach=100.0)).scene(0)
    mean, cov = np.array([1.0, 0.0, 0.0, 0.0]), np.diag([4.0, 1e-4, 4.0, 1e-4])
    seen = Evidence((0,), np.array([3.0]), np.zeros((1, 2)), np.empty((1, 0)))
    axis = np.linspace(-9.0, 9.0, 241)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    density = multivariate_normal([1.0, 0.0], 4.0 * np.eye(2)).pdf(grid)
    density *= np.exp(-0.5 * (np.hypot(*grid.T) - 3.0) ** 2 / 0.25)
    density /= density.sum()
    centre = density @ grid
    spread = (grid - centre).T @ (density[:, None] * (grid - centre))
    found = [updated(mean, cov, each.weights(4), seen, scene)[1][::2, ::2] for each in (EVERY[0], EVERY[-1])]
    slopes = Range(sd=0.5).linearise(mean[[0, 2], None], seen.positions, seen.traits)[1][0, :, 0]
    linear = 4.0 * np.eye(2) - 16.0 * np.outer(slopes, slopes) / (4.0 + 0.25)
    errors = [np.linalg.norm(each - spread) for each in (*found, linear)]
    assert max(errors[:2]) < 0.8 * errors[2]


@pytest.mark.thorough
@UKF_CKF
def test_on_ranges_its_errors_are_as_large_as_it_says(tracker) -> None:
    """The normalised squared error of the state of four, over sixty runs: its mean is 4 if the filter is consistent."""
    motion, sensor = ConstantVelocity(start=(5.0, 1.0, 5.0, -1.0), variances=(0.5,)), Range(sd=0.5, reach=200.0)
    errors = []
    for seed in range(60):
        cluster = Cluster(6, motion, sensor, seed=seed, reach=60.0)
        belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
        for step in range(1, 31):
            belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        error = belief.mean - cluster.truth[30]
        errors.append(error @ np.linalg.solve(belief.cov, error))
    assert np.mean(errors) == pytest.approx(4.0, abs=4.0 * np.sqrt(8.0 / 60)), "four standard errors"


def test_a_handover_sends_the_moments_and_a_step_costs_what_is_counted() -> None:
    for tracker in (EVERY[0], EVERY[-1]):
        cluster = Cluster(6)
        belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
        after, heard = cluster.drive(tracker.hand_over(belief, cluster.scene(0), 7))
        assert [packet[1:] for packet in heard.packets] == [(7, "handover", 4)] and after.head == 7
        assert cluster.drive(tracker.hand_over(belief, cluster.scene(0), 7), silent)[0] is None
        _, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
        drawn = 64 / 3 + 2 * 8 * 4
        a_reading = 9 * 22 + 16 * 10
        solution = 2 * 512 / 3 + 2 * 64 * 6 + 2 * 4 * 8 * 6
        assert heard.cycles[cluster.head] == pytest.approx(
            drawn + 2 * 9 * 16 + 2 * 8 * 16 + drawn + 6 * a_reading + solution
        )
        assert sent(heard, cluster.head) == {"^reading": 5}


def test_kappa_must_leave_room_for_the_columns_of_the_state() -> None:
    with pytest.raises(ScenarioError, match=r"tracker\.kappa: -4 must be greater than -4, for a state"):
        scenario.build(scenario.load("jiang_field", ["tracker={kind: ukf, kappa: -4}"]))
    scenario.build(scenario.load("jiang_field", ["tracker={kind: ukf, kappa: -3.9}"]))


def test_points_so_near_that_rounding_counts_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"tracker\.alpha"):
        scenario.build(scenario.load("jiang_field", ["tracker={kind: ukf, alpha: 0.0009}"]))
    with pytest.raises(ScenarioError, match=r"tracker\.kappa: alpha² \(columns \+ kappa\) is 5e-08"):
        scenario.build(scenario.load("jiang_field", ["tracker={kind: ukf, alpha: 0.001, kappa: -3.95}"]))
    scenario.build(scenario.load("jiang_field", ["tracker={kind: ukf, alpha: 0.001}"]))


@pytest.mark.thorough
@UKF_CKF
def test_it_keeps_the_rules_of_the_interface(tracker) -> None:
    check_tracker(tracker)


def test_iterations_are_gauss_newton_steps_to_the_mode_and_one_is_the_extended_filter() -> None:
    """Ranges from three nodes: the mode of prior and readings, found here by a fine grid about it."""
    motion, sensor = LinearMotion(1e-9), Range(sd=0.2, reach=200.0)
    cluster = Cluster(3, motion, sensor, seed=2, reach=12.0)
    ends = {}
    for iterations in (1, 2, 40):
        tracker = ExtendedKalman(iterations=iterations)
        belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
        belief, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
        ends[iterations] = belief
        a_reading = (4 * 2 + 2 * 2 * 4 + 20) + 3 * 4 + 8 * 16
        assert heard.cycles == {cluster.head: 4 * 64 + 2 * 16 + 3 * (iterations * a_reading + (iterations - 1) * 4)}
    readings, _ = cluster.readings()
    before, spread = kalman(cluster.prior.mean, cluster.prior.cov, motion.noise, np.empty(0), np.empty((0, 2)))

    def height(state):
        apart = readings - np.hypot(*(state[[0, 2]] - cluster.positions).T)
        return float((state - before) @ np.linalg.solve(spread, state - before) + (apart**2).sum() / 0.04)

    mode, rng = ends[40].mean, np.random.default_rng(6)
    root = np.linalg.cholesky(ends[40].cov)
    assert all(height(mode) <= height(mode + 0.01 * root @ rng.normal(size=4)) for _ in range(200))
    assert height(mode) < height(ends[2].mean) < height(ends[1].mean)
    assert ends[1].innovation == ends[2].innovation == ends[40].innovation
