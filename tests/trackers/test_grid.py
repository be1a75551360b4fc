"""The density on a grid in the head: the Kalman filter's, numerical integration's, and by the packet."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from tests.helpers.scenes import make_scene
from wsnsim.base.arrays import Estimate
from wsnsim.base.requests import Compute, Member, Send, all_arrived
from wsnsim.base.rng import normals
from wsnsim.models.motion import BoundedVelocity
from wsnsim.offline.loopback import perfect, perform, silent
from wsnsim.testing import check_tracker
from wsnsim.trackers.grid import GridFilter


class Walk:
    """x⁺ = 0.9 x + 0.5 + w, w ~ N(0, 0.3); or with `bend`, 0.9 x + bend sin(x + t) + 0.5 + w."""

    columns, units, position = ("x",), ("",), (0,)

    def __init__(self, bend=0.0, noise=0.3):
        self.bend, self.noise = bend, noise

    def truth(self, steps, dt, rng):
        states = [np.array([[2.0]])]
        for step in range(steps):
            states.append(self.advance(states[-1], dt, step * dt) + np.sqrt(self.noise) * rng.normal())
        return np.array(states)[:, :, 0]

    def advance(self, states, dt, time):
        return 0.9 * states + self.bend * np.sin(states + time) + 0.5

    def propagate(self, states, dt, keys, time):
        return self.advance(states, dt, time) + np.sqrt(self.noise) * normals(keys, 0)

    def matrices(self, states, dt, time):
        return (0.9 + self.bend * np.cos(states + time))[0][:, None, None], np.array([[self.noise]])

    def log_transition(self, after, before, dt, time):
        return norm.logpdf(after, self.advance(before, dt, time), np.sqrt(self.noise))[0]


class Gauge:
    """z = x + v, or with `fold`, z = x²/4 + v; v ~ N(0, 0.5)."""

    reach, trait_names = 50.0, ("nothing",)

    def __init__(self, fold=False):
        self.fold = fold

    def draw_traits(self, nodes, rng):
        return np.zeros((nodes, 1))

    def of(self, x):
        return x**2 / 4.0 if self.fold else x

    def measure(self, points, positions, traits, noise):
        return self.of(points[:, 0]) + np.sqrt(0.5) * noise

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        assert owners is None
        return norm.logpdf(readings[:, None], self.of(points), np.sqrt(0.5)).sum(axis=0)

    def linearise(self, points, positions, traits):
        count = (len(positions), points.shape[1])
        slope = points / 2.0 if self.fold else np.ones(points.shape)
        shape = (len(positions), *points.shape)
        return np.broadcast_to(self.of(points), count), np.broadcast_to(slope, shape), np.full(count, 0.5)


def bell(x, mean, variance):
    """The normal density, for scalars that are many."""
    return np.exp(-0.5 * (x - mean) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)


FINE = GridFilter(cells=1500, low=-15.0, high=15.0)
PRIOR = Estimate(np.array([1.0]), np.array([[1.5]]))


def scene_of(step, motion, sensor, ids=(4, 2, 9), steps=1):
    places, traits = np.zeros((len(ids), 2)), np.zeros((len(ids), 1))
    return make_scene(step, ids, places, traits, motion, sensor, steps=steps, head=4, roster=(4, 2, 9), key=1)


def step_with(tracker, belief, scene, readings, lose=perfect, watch=None):
    members = {
        node: Member(node, np.zeros(2), np.zeros(1), float(value) if node in scene.ids else None)
        for node, value in zip((4, 2, 9), readings, strict=True)
    }
    return perform(tracker.step(belief, scene), members, 4, lose, watch)


def started(tracker=FINE, prior=PRIOR):
    return perform(tracker.start(prior, scene_of(0, Walk(), Gauge())), {}, 4)


@pytest.mark.thorough
def test_on_a_linear_gaussian_model_it_is_the_kalman_filter_to_a_ten_thousandth() -> None:
    belief, mean, variance = started(), 1.0, 1.5
    rng = np.random.default_rng(0)
    for step in range(1, 16):
        readings = rng.normal(3.0, 1.0, 3)
        belief = step_with(FINE, belief, scene_of(step, Walk(), Gauge()), readings)
        mean, variance = 0.9 * mean + 0.5, 0.81 * variance + 0.3
        gain = 1.0 / (1.0 / variance + 3 / 0.5)
        mean, variance = gain * (mean / variance + readings.sum() / 0.5), gain
        assert belief.mean[0] == pytest.approx(mean, abs=1e-6)
        assert belief.cov[0, 0] == pytest.approx(variance, rel=1e-4)
        density = norm.pdf(FINE.middles, mean, np.sqrt(variance))
        assert belief.masses / FINE.width == pytest.approx(density, abs=1e-4 * density.max())


def test_on_a_bent_motion_and_a_folded_reading_it_is_what_adaptive_quadrature_gives() -> None:
    """Two steps, the second by an integral in an integral; the motion depends on time."""
    motion, sensor, first, second = Walk(bend=1.5), Gauge(fold=True), 1.2, 2.5
    belief = started()
    for step, reading in ((3, first), (4, second)):
        belief = step_with(FINE, belief, scene_of(step, motion, sensor, ids=(4,)), [reading] * 3)
    moved = [lambda x, now=now: motion.advance(x, 1.0, now) for now in (2.0, 3.0)]

    nodes, weights = np.polynomial.legendre.leggauss(80)
    points = 1.5 + 6.5 * nodes

    def predicted(x):
        """The density after the first prediction, by adaptive quadrature."""
        return quad(lambda y: bell(y, 1.0, 1.5) * bell(x, moved[0](y), 0.3), -8.0, 10.0, limit=200, epsabs=1e-10)[0]

    after = np.array([predicted(x) for x in points])
    after *= bell(first, points**2 / 4.0, 0.5) * weights
    images = moved[1](points)

    def posterior(x):
        return (after @ bell(x, images, 0.3)) * bell(second, x**2 / 4.0, 0.5)

    total = quad(posterior, -12.0, 12.0, limit=400)[0]
    mean = quad(lambda x: x * posterior(x), -12.0, 12.0, limit=400)[0] / total
    variance = quad(lambda x: (x - mean) ** 2 * posterior(x), -12.0, 12.0, limit=400)[0] / total
    assert belief.mean[0] == pytest.approx(mean, abs=1e-5)
    assert belief.cov[0, 0] == pytest.approx(variance, rel=1e-4)
    at = FINE.middles[600:900:20]
    density = np.array([posterior(x) for x in at]) / total
    assert belief.masses[600:900:20] / FINE.width == pytest.approx(density, abs=1e-4 * density.max())


def test_without_readings_and_with_missed_steps_it_predicts_and_a_forecast_is_what_prediction_gives() -> None:
    motion, sensor = Walk(bend=1.5), Gauge()
    belief = step_with(FINE, started(), scene_of(1, motion, sensor), [1.0, 2.0, 3.0])
    scene = scene_of(1, motion, sensor)
    ahead = FINE.forecast(belief, scene, 3)
    lost = step_with(FINE, belief, scene_of(4, motion, sensor, ids=(2, 9), steps=3), [0.0] * 3, silent)
    nobody = step_with(FINE, belief, scene_of(4, motion, sensor, ids=(), steps=3), [0.0] * 3)
    one_by_one = belief
    for step in (2, 3, 4):
        one_by_one = step_with(FINE, one_by_one, scene_of(step, motion, sensor, ids=()), [0.0] * 3)
    for other in (nobody, one_by_one):
        assert np.array_equal(other.masses, lost.masses)
    assert np.array_equal(ahead.mean, lost.mean) and np.array_equal(ahead.cov, lost.cov)
    points = np.random.default_rng(1).choice(FINE.middles, 200_000, p=belief.masses)
    for step in (1, 2, 3):
        noise = np.random.default_rng(step).normal(0.0, np.sqrt(0.3), points.size)
        points = motion.advance(points[None], 1.0, float(step))[0] + noise
    assert lost.mean[0] == pytest.approx(points.mean(), abs=4.0 * points.std() / np.sqrt(points.size))
    assert lost.cov[0, 0] == pytest.approx(points.var(), rel=0.02)


def test_a_noise_narrower_than_a_cell_is_widened_to_it_and_to_the_image_of_the_cell() -> None:
    coarse = GridFilter(cells=300, low=-15.0, high=15.0)
    belief = started(coarse, Estimate(np.array([1.0]), np.array([[1e-12]])))
    assert belief.cov[0, 0] == pytest.approx(0.01, rel=1e-6), "a prior too narrow, too, is widened to a cell of 0.1"
    still = step_with(coarse, belief, scene_of(1, Walk(noise=0.0), Gauge(), ids=()), [0.0] * 3)
    assert still.mean[0] == pytest.approx(1.4, abs=1e-6)
    assert still.cov[0, 0] == pytest.approx(0.81 * 0.01 + 0.01, rel=1e-4)
    steep = step_with(coarse, belief, scene_of(1, Walk(bend=5.0, noise=0.0), Gauge(), ids=()), [0.0] * 3)
    slope = 0.9 + 5.0 * np.cos(1.0)
    assert steep.cov[0, 0] == pytest.approx(2.0 * (0.1 * slope) ** 2, rel=0.1)
    assert np.abs(np.diff(steep.masses)).max() < 0.5 * steep.masses.max(), "no gaps between the images"


def test_the_variance_is_never_less_than_that_of_a_cell() -> None:
    belief = started()
    sharp = step_with(FINE, belief, scene_of(1, Walk(), SharpGauge()), [1.01] * 3)
    assert sharp.cov[0, 0] == pytest.approx(FINE.width**2 / 12.0) and sharp.mean[0] == pytest.approx(1.01)


class SharpGauge(Gauge):
    """Of a deviation far below a cell."""

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        return norm.logpdf(readings[:, None], points, 1e-4).sum(axis=0)


def test_a_target_off_the_grid_is_kept_at_its_edge() -> None:
    small = GridFilter(cells=100, low=-1.0, high=1.0)
    belief = started(small, Estimate(np.array([50.0]), np.eye(1)))
    assert belief.mean[0] == pytest.approx(0.99) and belief.masses.sum() == pytest.approx(1.0)
    after = step_with(small, belief, scene_of(1, Walk(), Gauge()), [50.0] * 3)
    assert np.all(np.isfinite(after.masses)) and after.masses.sum() == pytest.approx(1.0)
    assert after.mean[0] == pytest.approx(0.99, abs=0.02)


def handed_over(belief, tracker, arrive):
    """The belief after a handover, and the packets that it took."""
    asks = []

    after = perform(
        tracker.hand_over(belief, scene_of(1, Walk(), Gauge()), 7),
        {},
        4,
        lambda _, __, parcel: arrive(parcel.packets),
        asks.append,
    )
    (send,) = asks
    assert isinstance(send, Send) and send.to == 7 and send.parcel.what == "handover"
    return after, send.parcel.packets


def test_a_handover_sends_four_masses_to_a_packet_and_the_moments() -> None:
    tracker = GridFilter(cells=1001, low=-15.0, high=15.0)
    belief = started(tracker)
    after, packets = handed_over(belief, tracker, all_arrived)
    assert packets == 251 + 2
    assert after.head == 7 and np.array_equal(after.masses, belief.masses) and after.mean == pytest.approx(belief.mean)


def test_masses_lost_on_a_handover_are_read_off_a_line_between_those_that_arrived() -> None:
    belief = started()
    after, _ = handed_over(belief, FINE, lambda packets: np.arange(packets) % 3 != 1)
    expected = belief.masses.copy()
    lost = np.repeat(np.arange(375) % 3 == 1, 4)
    expected[lost] = np.interp(FINE.middles[lost], FINE.middles[~lost], belief.masses[~lost])
    assert after.masses == pytest.approx(expected / expected.sum(), rel=1e-9)
    assert after.mean[0] == pytest.approx(belief.mean[0], abs=1e-3)


def test_without_any_mass_the_moments_give_a_gaussian_and_without_those_the_track_is_lost() -> None:
    belief = step_with(FINE, started(), scene_of(1, Walk(), Gauge(fold=True)), [1.0] * 3)
    after, _ = handed_over(belief, FINE, lambda packets: np.arange(packets) >= packets - 2)
    assert after.mean == pytest.approx(belief.mean, abs=1e-6) and after.cov == pytest.approx(belief.cov, rel=1e-4)
    density = norm.pdf(FINE.middles, belief.mean[0], np.sqrt(belief.cov[0, 0]))
    assert after.masses == pytest.approx(density / density.sum(), abs=1e-9)
    empty, _ = handed_over(belief, FINE, lambda packets: np.isin(np.arange(packets), [0, packets - 2, packets - 1]))
    assert empty.masses == pytest.approx(after.masses), "cells without mass alone are nothing to go by"
    assert handed_over(belief, FINE, lambda packets: np.arange(packets) == packets - 1)[0] is None
    assert handed_over(belief, FINE, lambda packets: np.zeros(packets, bool))[0] is None


def test_a_snapshot_gives_the_cells_as_particles_whose_weights_sum_to_one() -> None:
    belief = step_with(FINE, started(), scene_of(1, Walk(), Gauge()), [1.0] * 3)
    ((node, points, weights),) = FINE.snapshot(belief, [])
    assert node == 4 and points.shape == (1, weights.size) and weights.sum() == pytest.approx(1.0)
    assert points[0] @ weights == pytest.approx(belief.mean[0])


def test_a_step_costs_every_cell_that_a_cell_is_spread_over_and_every_reading_of_every_cell() -> None:
    bill = []
    watch = lambda ask: bill.append(ask.cycles) if isinstance(ask, Compute) else None  # noqa: E731
    step_with(FINE, started(), scene_of(1, Walk(), Gauge()), [1.0] * 3, watch=watch)
    step_with(FINE, started(), scene_of(2, Walk(), Gauge(), ids=(), steps=2), [1.0] * 3, watch=watch)
    reached = 16.0 * np.sqrt(0.3) / 0.02
    assert bill == pytest.approx([1500 * (15 * reached + 30 * 3), 1500 * 2 * 15 * reached])
    assert FINE.member_cycles == 0.0


def test_a_motion_of_more_than_one_column_is_a_fault_and_so_is_a_grid_that_is_upside_down() -> None:
    line = SimpleNamespace(filter_motions=(Walk(),))
    plane = SimpleNamespace(filter_motions=(BoundedVelocity(),))
    assert list(GridFilter().check(line)) == []
    (issue,) = GridFilter().check(plane)
    assert issue.path == ("tracker", "kind")
    assert "a state of one column" in issue.message and "4 (px vx py vy)" in issue.message and "ungm" in issue.message
    (issue,) = replace(FINE, low=1.0, high=-1.0).check(line)
    assert issue.path == ("tracker", "high") and "from low (1) up to high (-1)" in issue.message


@pytest.mark.thorough
@pytest.mark.parametrize("cells", [2, 400])
def test_it_keeps_the_rules_of_the_seam(cells) -> None:
    for motion, sensor in ((Walk(), Gauge()), (Walk(bend=3.0), Gauge(fold=True))):
        check_tracker(GridFilter(cells=cells), motion, sensor)
