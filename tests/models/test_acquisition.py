"""Track initiation: around the true start, and from readings."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from wsnsim.base.arrays import Estimate
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.models.acquire import AroundTruth, FromReadings
from wsnsim.models.clusters import MovingHead, StrongestSignal
from wsnsim.models.mobility import CoordinatedTurn
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.ranging import Range, RangeFromOrigin
from wsnsim.models.sensing import AcousticEnergy

SENSOR, MOTION = AcousticEnergy(), BoundedVelocity()
PRIOR = Estimate(mean=np.array([-45.0, -20.0, -50.0, -35.0]), cov=np.diag([25.0, 9.0, 25.0, 9.0]))
TARGET = np.array([30.0, -12.0])


def readings_of(positions, normals=None, target=TARGET):
    count = len(positions)
    traits = np.ones((count, 1))
    normals = np.zeros(count) if normals is None else normals
    return SENSOR.measure(np.tile(target, (count, 1)), positions, traits, normals), positions, traits


def around(count, seed, target=TARGET):
    draw = np.random.default_rng(seed)
    angle, radius = draw.uniform(0, 2 * np.pi, count), 60 * np.sqrt(draw.random(count))
    return target + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def start(readings, positions, traits):
    estimate = FromReadings().estimate(readings, positions, traits, SENSOR, MOTION, PRIOR)
    return estimate, estimate.mean[[0, 2]], estimate.cov[np.ix_([0, 2], [0, 2])]


@pytest.mark.parametrize("seed", range(10))
def test_exact_readings_of_many_nodes_give_the_position(seed):
    _, position, spread = start(*readings_of(around(8, seed)))
    assert np.hypot(*(position - TARGET)) < 2.0
    assert np.all(np.linalg.eigvalsh(spread) >= 1.0 - 1e-9)


def test_the_error_is_as_large_as_the_covariance_says():
    """Normalised squared errors of a 2-D Gaussian have mean 2; the floor of 1 m makes them smaller."""
    squares = []
    for seed in range(60):
        normals = np.random.default_rng(1000 + seed).standard_normal(5)
        _, position, spread = start(*readings_of(around(5, seed), normals))
        squares.append((position - TARGET) @ np.linalg.solve(spread, position - TARGET))
    assert 0.3 < np.mean(squares) < 2.6


def test_many_noisy_readings_give_the_inverse_of_fishers_information():
    """Far nodes, a floor that is not reached, and little information in the variance compared with the mean."""
    ring = TARGET + 40.0 * np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, 2 * np.pi, 6, endpoint=False)])
    sensor = AcousticEnergy(samples=100)
    readings = sensor.measure(np.tile(TARGET, (6, 1)), ring, np.ones((6, 1)), np.zeros(6))
    estimate = FromReadings(floor=0.01).estimate(readings, ring, np.ones((6, 1)), sensor, MOTION, PRIOR)
    _, gradients, variances = sensor.linearise(TARGET[:, None], ring, np.ones((6, 1)))
    fisher = (gradients[:, :, 0].T / variances[:, 0]) @ gradients[:, :, 0]
    assert np.allclose(estimate.cov[np.ix_([0, 2], [0, 2])], np.linalg.inv(fisher), rtol=0.3, atol=0.5)


def test_one_reading_gives_a_ring_about_its_node():
    """A ring of radius r has variance r²/2 on each axis."""
    node = TARGET + np.array([[0.0, 25.0]])
    _, position, spread = start(*readings_of(node))
    assert np.allclose(position, node[0], atol=1e-6)
    assert np.allclose(spread, np.eye(2) * 25.0**2 / 2, rtol=0.1, atol=1.0)


def test_one_loud_reading_puts_the_target_at_its_node():
    node = TARGET + np.array([[0.5, 0.0]])
    _, position, spread = start(*readings_of(node))
    assert np.allclose(position, node[0], atol=0.1)
    assert np.all(np.linalg.eigvalsh(spread) < 2.5)


def test_two_readings_span_both_places_where_their_rings_cross():
    nodes = TARGET + np.array([[-20.0, 15.0], [20.0, 15.0]])
    _, position, spread = start(*readings_of(nodes))
    assert np.allclose(position, TARGET + np.array([0.0, 15.0]), atol=1.5)
    assert spread[1, 1] == pytest.approx(15.0**2, rel=0.15)
    assert spread[0, 0] < 25.0


@pytest.mark.parametrize("false_reading", [1e4, 1e-3, 500.0, 0.0, -50.0])
def test_a_false_reading_among_many_has_little_effect(false_reading):
    for seed in range(5):
        readings, positions, traits = readings_of(around(16, seed))
        readings[3] = false_reading
        _, position, _ = start(readings, positions, traits)
        assert np.hypot(*(position - TARGET)) < 5.0


def test_readings_that_are_not_finite_are_ignored():
    readings, positions, traits = readings_of(around(9, 2))
    readings[[0, 4]] = np.nan, np.inf
    _, position, _ = start(readings, positions, traits)
    assert np.hypot(*(position - TARGET)) < 2.0
    _, position, spread = start(np.full(9, np.nan), positions, traits)
    assert np.all(np.isfinite(position))
    assert np.all(np.linalg.eigvalsh(spread) <= SENSOR.reach**2 + 1e-6)


def test_only_the_position_is_estimated_from_readings():
    estimate, _, _ = start(*readings_of(around(8, 1)))
    assert estimate.mean[1] == estimate.mean[3] == 0.0
    assert estimate.cov[1, 1] == pytest.approx(20.0**2 + 9.0)
    assert estimate.cov[3, 3] == pytest.approx(35.0**2 + 9.0)
    assert np.array_equal(estimate.cov[[1, 3]][:, [0, 2]], np.zeros((2, 2)))
    assert np.all(np.linalg.eigvalsh(estimate.cov) > 0.0)


def test_positions_far_from_the_origin_are_found_as_well():
    far = np.array([1e5, -3e4])
    _, position, _ = start(*readings_of(around(8, 3, far), target=far))
    assert np.hypot(*(position - far)) < 2.0


def test_the_prior_is_drawn_around_the_start():
    begin = np.array(MOTION.start)
    means = np.array([AroundTruth().draw(begin, np.random.default_rng(seed)).mean for seed in range(2000)])
    assert np.allclose(means.mean(axis=0), begin, atol=0.4)
    assert np.allclose(means.std(axis=0), [5, 3, 5, 3], rtol=0.06)
    assert np.array_equal(AroundTruth().draw(begin, np.random.default_rng(0)).cov, np.diag([25.0, 9.0, 25.0, 9.0]))


def test_a_prior_may_be_given():
    given = AroundTruth(sd=(1, 1, 1, 1), mean=(0, 1, 2, 3)).draw(np.array(MOTION.start), np.random.default_rng(0))
    assert np.array_equal(given.mean, [0.0, 1.0, 2.0, 3.0])


def test_a_prior_of_another_dimension_is_an_issue():
    parts = SimpleNamespace(motions=(MOTION,))
    [issue] = AroundTruth(sd=(5.0, 3.0)).check(parts)
    assert issue.path == ("prior", "sd")
    assert "2 values for a state of 4 columns" in issue.message
    assert [issue.path for issue in AroundTruth(mean=(1.0,)).check(parts)] == [("prior", "mean")]
    assert not list(AroundTruth().check(parts))


def test_a_default_prior_that_does_not_fit_the_motion_names_one_that_does():
    [issue] = AroundTruth().check(SimpleNamespace(motions=(CoordinatedTurn(),)))
    assert issue.message.endswith("this is the default, give prior: {sd: [5, 3, 5, 3, 0.1]}")


LINE = SimpleNamespace(position=(0,), columns=("px", "vx", "ax"))
LINE_PRIOR = Estimate(mean=np.array([1.0, 0.1, 0.01]), cov=np.diag([1.0, 0.01, 0.0001]))
MARKS = np.array([[-1.0, 10.0], [150.0, 10.0], [300.0, 10.0], [450.0, 10.0]])


def on_line(x, nodes=MARKS, normals=None, **given):
    sensor = Range(**given)
    traits, normals = np.empty((len(nodes), 0)), np.zeros(len(nodes)) if normals is None else normals
    readings = sensor.measure(np.full((len(nodes), 1), x), nodes, traits, normals)
    return FromReadings(floor=0.01).estimate(readings, nodes, traits, sensor, LINE, LINE_PRIOR)


@pytest.mark.parametrize("x", [-30.0, 150.0, 217.0, 380.0])
def test_on_a_line_exact_ranges_give_the_position_and_the_inverse_of_fishers_information(x):
    estimate = on_line(x)
    assert estimate.mean[0] == pytest.approx(x, abs=0.1)
    slopes = (x - MARKS[:, 0]) / np.hypot(x - MARKS[:, 0], 10.0)
    assert estimate.cov[0, 0] == pytest.approx(1.0 / (slopes**2).sum(), rel=0.15)
    assert np.array_equal(estimate.mean[1:], [0.0, 0.0])
    assert np.allclose(np.diag(estimate.cov)[1:], [0.01 + 0.1**2, 0.0001 + 0.01**2])
    assert np.count_nonzero(estimate.cov) == 3


def test_on_a_line_the_error_is_as_large_as_the_covariance_says():
    """Normalised squared errors of one coordinate have mean 1; over 100 draws its deviation is 0.14."""
    squares = []
    for seed in range(100):
        estimate = on_line(217.0, normals=np.random.default_rng(seed).standard_normal(4))
        squares.append((estimate.mean[0] - 217.0) ** 2 / estimate.cov[0, 0])
    assert 0.55 < np.mean(squares) < 1.45


def test_on_a_line_one_range_spans_the_places_on_both_sides_of_its_node():
    estimate = on_line(180.0, nodes=MARKS[1:2])
    assert estimate.mean[0] == pytest.approx(150.0, abs=0.5)
    assert estimate.cov[0, 0] == pytest.approx(30.0**2, rel=0.1)


def test_an_infinite_sensing_range_is_an_issue():
    for sensor, count in ((Range(reach=np.inf), 1), (RangeFromOrigin(), 1), (Range(), 0), (SENSOR, 0)):
        found = [issue.path for issue in FromReadings().check(SimpleNamespace(sensor=sensor, unlabelled=False))]
        assert found == [("sensor",)] * count
        assert not list(FromReadings().check(SimpleNamespace(sensor=sensor, unlabelled=True)))


def test_the_prior_of_a_line_is_drawn_in_its_own_dimension():
    prior = AroundTruth(sd=(1.0, 0.1, 0.01))
    assert prior.draw(np.array([1.0, 0.1, 0.01]), np.random.default_rng(0)).mean.shape == (3,)
    assert not list(prior.check(SimpleNamespace(motions=(LINE,))))


@pytest.mark.parametrize(("poll", "step", "whole"), [
    (None, 2.0, True), (1.0, 2.0, True), (2.0, 2.0, True), (0.1, 0.3, True), (1.0, 10.0, True),
    (3.0, 2.0, False), (0.7, 2.0, False), (0.9999, 2.0, False), (4.0, 2.0, False),
])  # fmt: skip
@pytest.mark.parametrize("policy", [MovingHead(), StrongestSignal()], ids=["moves", "stands"])
def test_with_moving_heads_a_step_is_a_whole_number_of_search_intervals(poll, step, whole, policy):
    names = dict.fromkeys(field.name for field in dataclasses.fields(NetworkSetup))
    company = NetworkSetup(**names | {"sensor": SENSOR, "clusters": policy, "dt": step, "steps": 100})
    found = list(FromReadings(poll=poll).check(company))
    assert [issue.path for issue in found] == ([] if whole or not company.nodes_search else [("acquire", "poll")])


def test_a_run_with_too_many_searches_is_an_issue():
    names = dict.fromkeys(field.name for field in dataclasses.fields(NetworkSetup))
    for steps, faults in ((10_000, 0), (10_001, 1)):
        company = NetworkSetup(**names | {"sensor": SENSOR, "clusters": MovingHead(), "dt": 1.0, "steps": steps})
        assert len(list(FromReadings(poll=0.01).check(company))) == faults


def test_without_a_network_the_search_interval_is_not_checked():
    names = dict.fromkeys(field.name for field in dataclasses.fields(TrackingSetup))
    assert not list(FromReadings(poll=0.7).check(TrackingSetup(**names | {"sensor": SENSOR, "dt": 2.0})))


def test_messages_of_track_initiation_have_one_packet_by_default():
    assert (FromReadings().poll, FromReadings().detection_bits, FromReadings().answer_bits) == (None, 96, 96)


def test_the_default_prior_is_refused_for_four_columns_in_other_units():
    motion = SimpleNamespace(columns=("px", "py", "speed", "heading"), units=("m", "m", "m/s", "rad"))
    [issue] = AroundTruth().check(SimpleNamespace(motions=(motion,)))
    assert issue.message.startswith("the default is for columns in m, m/s, m, m/s; the state is px in m, py in m, ")
    assert not list(AroundTruth(sd=(5.0, 5.0, 1.0, 0.2)).check(SimpleNamespace(motions=(motion,))))
