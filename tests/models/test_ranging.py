"""Sensors of distance: readings, likelihoods, slopes and Fisher's information against closed forms and Monte Carlo."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from wsnsim.base.optional_ports import Detects
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.models.ranging import Range, RangeFromOrigin, Rssi

SENSORS = {
    "range": Range(sd=0.7),
    "noise beyond reach": Range(sd=0.7, reach=40.0, beyond="noise"),
    "range from origin": RangeFromOrigin(sd=0.7),
    "rssi": Rssi(),
}
each_sensor = pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS.keys())
in_plane_and_on_line = pytest.mark.parametrize("columns", [1, 2])
NODES = np.array([[-20.0, 10.0], [35.0, -5.0], [5.0, 28.0]])
NONE = np.empty((3, 0))


def expected(sensor: Any, point: np.ndarray) -> np.ndarray:
    """(3,) mean readings of the nodes, written out from the papers' equations."""
    x, y = point[0], point[1] if len(point) == 2 else 0.0
    distances = np.array([np.hypot(x - a, y - b) for a, b in NODES])
    if isinstance(sensor, RangeFromOrigin):
        return np.full(3, np.hypot(x, y))
    if isinstance(sensor, Rssi):
        return np.array([-37.8 - 10 * 2.3 * np.log10(d) for d in distances])
    return np.where(distances <= (40.0 if sensor.beyond == "noise" else np.inf), distances, 0.0)


def points_of(columns: int) -> np.ndarray:
    return np.array([[3.0, -12.0, 18.0, 0.5], [4.0, 7.0, -9.0, 0.25]])[:columns]


def at(places: np.ndarray, count: int) -> tuple[np.ndarray, ...]:
    """`count` sensors at one place, without traits."""
    return np.tile(places, (count, 1)), np.empty((count, 0))


@each_sensor
@in_plane_and_on_line
def test_a_reading_is_the_papers_mean_and_the_noise_in_standard_deviations(sensor: Any, columns: int) -> None:
    normals = np.random.default_rng(1).standard_normal(50)
    for j in range(4):
        point = points_of(columns)[:, j]
        for node, mean in zip(NODES, expected(sensor, point), strict=True):
            found = sensor.measure(np.tile(point, (50, 1)), *at(node, 50), normals)
            assert found == pytest.approx(mean + sensor.sd * normals, rel=1e-12, abs=1e-12)


@each_sensor
@in_plane_and_on_line
def test_the_likelihood_is_a_product_of_normal_densities(sensor: Any, columns: int) -> None:
    points, readings = points_of(columns), np.array([21.0, 30.0, -1.0])
    truth = [norm.logpdf(readings, expected(sensor, point), sensor.sd).sum() for point in points.T]
    assert sensor.log_likelihood(points, readings, NODES, NONE) == pytest.approx(np.array(truth), rel=1e-9)
    owners = np.array([2, 0, 1, 1])
    own = [norm.logpdf(readings[i], expected(sensor, p)[i], sensor.sd) for i, p in zip(owners, points.T, strict=True)]
    assert sensor.log_likelihood(points, readings, NODES, NONE, owners) == pytest.approx(np.array(own), rel=1e-9)
    assert not sensor.log_likelihood(points, np.empty(0), NODES[:0], NONE[:0]).any()


@each_sensor
@in_plane_and_on_line
@pytest.mark.parametrize("j", range(4))
def test_the_likelihood_integrates_to_one_over_the_readings(sensor: Any, columns: int, j: int) -> None:
    point = points_of(columns)[:, j : j + 1]
    grid = expected(sensor, point[:, 0])[0] + sensor.sd * np.linspace(-10.0, 10.0, 2001)
    logs = sensor.log_likelihood(np.tile(point, 2001), grid, *at(NODES[0], 2001), np.arange(2001))
    assert np.exp(logs).sum() * (grid[1] - grid[0]) == pytest.approx(1.0, abs=1e-9)


@each_sensor
@in_plane_and_on_line
def test_slopes_are_those_of_finite_differences(sensor: Any, columns: int) -> None:
    points = points_of(columns)
    means, gradients, variances = sensor.linearise(points, NODES, NONE)
    assert means.shape == variances.shape == (3, 4) and gradients.shape == (3, columns, 4)
    assert np.all(variances == pytest.approx(sensor.sd**2))
    for axis in range(columns):
        shift = np.zeros((columns, 1))
        shift[axis] = 1e-5
        above, below = (sensor.linearise(points + s, NODES, NONE)[0] for s in (shift, -shift))
        assert gradients[:, axis] == pytest.approx((above - below) / 2e-5, rel=1e-5, abs=1e-8)


@each_sensor
@in_plane_and_on_line
def test_at_the_sensor_itself_the_slope_is_zero_and_nothing_is_lost(sensor: Any, columns: int) -> None:
    point, node = np.zeros((columns, 1)), np.zeros((1, 2))
    means, gradients, variances = sensor.linearise(point, node, NONE[:1])
    assert not gradients.any() and np.isfinite(means).all() and np.isfinite(variances).all()
    assert not sensor.information(point, node, NONE[:1]).any()
    assert np.isfinite(sensor.log_likelihood(point, means[:, 0], node, NONE[:1])).all()


@each_sensor
@in_plane_and_on_line
def test_information_is_the_covariance_of_the_score(sensor: Any, columns: int) -> None:
    """The score by central differences, over 40 000 readings: four standard deviations of its mean square, 3 %."""
    count, step = 40_000, 1e-4
    normals = np.random.default_rng(3).standard_normal(count)
    point = points_of(columns)[:, 0]
    found = sensor.information(point[:, None], NODES, NONE)
    assert found.shape == (3, columns, columns, 1)
    for s in range(3):
        places, traits = at(NODES[s], count)
        readings = sensor.measure(np.tile(point, (count, 1)), places, traits, normals)
        scores = np.empty((columns, count))
        for axis in range(columns):
            shift = step * (np.arange(columns) == axis)[:, None]
            logs = [
                sensor.log_likelihood(np.tile(point[:, None] + d, count), readings, places, traits, np.arange(count))
                for d in (shift, -shift)
            ]
            scores[axis] = (logs[0] - logs[1]) / (2 * step)
        covariance = scores @ scores.T / count
        assert np.abs(found[s, :, :, 0] - covariance).max() <= 0.03 * np.trace(covariance)


def test_the_information_in_a_range_is_its_direction_over_its_variance() -> None:
    """At (3, 4) from the sensor: u = (0.6, 0.8), I = u uᵀ / R; for the signal's strength, R d² (ln 10 / 10 η)²."""
    point, node = np.array([[3.0], [4.0]]), np.zeros((1, 2))
    direction = np.outer([0.6, 0.8], [0.6, 0.8])
    assert Range(sd=2.0).information(point, node, NONE[:1])[0, :, :, 0] == pytest.approx(direction / 4.0)
    strength = (23.0 / (5.0 * np.log(10.0))) ** 2 / 0.25
    assert Rssi().information(point, node, NONE[:1])[0, :, :, 0] == pytest.approx(strength * direction)


def test_beyond_its_reach_a_sensor_reads_noise_that_tells_nothing_while_the_slope_stays_the_ranges() -> None:
    sensor, point, node = Range(beyond="noise", reach=100.0), np.array([[120.0], [0.0]]), np.zeros((1, 2))
    assert sensor.measure(point.T, node, NONE[:1], np.array([0.3]))[0] == pytest.approx(0.3)
    assert not sensor.information(point, node, NONE[:1]).any()
    means, gradients, _ = sensor.linearise(point, node, NONE[:1])
    assert means[0, 0] == pytest.approx(120.0) and gradients[0, :, 0] == pytest.approx([1.0, 0.0])
    assert sensor.detects(point.T, node).tolist() == [[True]]
    silent = Range(reach=100.0)
    assert silent.measure(point.T, node, NONE[:1], np.array([0.3]))[0] == pytest.approx(120.3)
    assert silent.detects(point.T, node).tolist() == [[False]]
    assert Range(reach=np.inf).detects(point.T, node).tolist() == [[True]]


@in_plane_and_on_line
def test_who_sees_its_own_cell_only_is_the_nearest_within_reach(columns: int) -> None:
    draw = np.random.default_rng(2)
    nodes, points = draw.uniform(-100, 100, (15, 2)), draw.uniform(-150, 150, (200, columns))
    sensor = Range(reach=40.0, own_cell=True)
    assert isinstance(sensor, Detects)
    found = sensor.detects(points, nodes)
    for point, row in zip(points, found, strict=True):
        y = point[1] if columns == 2 else 0.0
        distances = [float(np.hypot(point[0] - a, y - b)) for a, b in nodes]
        nearest = min(range(15), key=distances.__getitem__)
        assert np.nonzero(row)[0].tolist() == ([nearest] if distances[nearest] <= 40.0 else [])
    assert 0 < found.any(axis=1).sum() < 200
    assert sensor.detects(np.zeros((1, columns)), np.array([[-5.0, 0.0], [5.0, 0.0]])).tolist() == [[True, False]]
    assert sensor.detects(points, nodes[:0]).shape == (200, 0)


def test_a_reading_without_noise_gives_its_distance_back() -> None:
    distances = np.array([0.05, 0.3, 1.0, 7.0, 250.0])
    points, node = np.stack([distances, np.zeros(5)], axis=1), np.zeros((5, 2))
    for sensor in (Range(), Rssi(), Rssi(z0=10.0, eta=4.0, d0=2.0)):
        readings = sensor.measure(points, node, np.empty((5, 0)), np.zeros(5))
        assert sensor.ranges(readings) == pytest.approx(distances, rel=1e-9)
    assert Range().ranges(np.array([-1.5, 2.0])).tolist() == [0.0, 2.0]
    assert Rssi().ranges(np.array([1e6, 30.0])).tolist() == [0.05, 0.05]
    assert np.isfinite(Rssi(eta=1e-3, d0=1e7).ranges(np.array([-1e6])))[0]


def test_no_distance_counts_as_less_than_the_floor_of_the_signals_strength() -> None:
    near = np.array([[0.0, 0.0], [0.01, 0.02], [0.05, 0.0]])
    readings = Rssi().measure(near, np.zeros((3, 2)), np.empty((3, 0)), np.zeros(3))
    assert readings == pytest.approx(-37.8 - 23.0 * np.log10(0.05))


@each_sensor
def test_there_is_nothing_to_calibrate(sensor: Any) -> None:
    assert sensor.trait_names == () and sensor.draw_traits(5, np.random.default_rng(0)).shape == (5, 0)
    assert sensor.assumed("unknown", True) is sensor


def problem(with_network: bool) -> TrackingSetup:
    """A scenario of which only the kind matters: with a network or without."""
    kind = NetworkSetup if with_network else TrackingSetup
    return kind(**dict.fromkeys(field.name for field in dataclasses.fields(kind)))


@pytest.mark.parametrize(
    ("sensor", "with_network", "paths"),
    [
        (Range(), True, []),
        (Range(beyond="noise"), False, []),
        (Range(beyond="noise"), True, [("sensor", "beyond")]),
        (Range(beyond="noise", own_cell=True), False, [("sensor", "own_cell")]),
        (Range(beyond="noise", bias_spread=1.0), False, [("sensor", "beyond")]),
        (Range(beyond="noise", blocked=0.1), False, [("sensor", "beyond")]),
        (Range(reach=1e300), False, [("sensor", "reach")]),
        (Range(reach=np.inf), False, []),
        (Rssi(reach=1e8), False, [("sensor", "reach")]),
        (Rssi(reach=1e7), False, []),
    ],
)
def test_what_cannot_be_is_a_fault(sensor: Any, with_network: bool, paths: list[Any]) -> None:
    assert [issue.path for issue in sensor.check(problem(with_network))] == paths


def test_biases_are_drawn_with_a_part_in_common_or_listed_and_heights_count_in_space() -> None:
    sensor = Range(bias_spread=3.0, clock_spread=4.0)
    drawn = np.array([sensor.draw_traits(2, np.random.default_rng(seed))[:, 0] for seed in range(4000)])
    assert np.cov(drawn.T) == pytest.approx(np.array([[25.0, 16.0], [16.0, 25.0]]), rel=0.1)
    listed = Range(sd=0.5, biases=(1.0, -2.0, 0.0), target_height=2.0)
    traits = listed.draw_traits(3, np.random.default_rng(0))
    traits[:, 1] = 8.0, 2.0, 5.0
    point = np.tile([4.0, 7.0], (3, 1))
    squares = ((point - NODES) ** 2).sum(axis=1)
    wanted = np.sqrt(squares + np.array([36.0, 0.0, 9.0])) + np.array([1.0, -2.0, 0.0])
    readings = listed.measure(point, NODES, traits, np.zeros(3))
    assert readings == pytest.approx(wanted, rel=1e-12)
    assert listed.ranges_in_plane(readings, traits) == pytest.approx(np.sqrt(squares), rel=1e-12)
    at_seven = np.column_stack([point, np.full(3, 7.0)])  # the target's own height counts where it is known
    assert listed.measure(at_seven, NODES, traits, np.zeros(3))[1] == pytest.approx(np.sqrt(squares[1] + 25.0) - 2.0)


def score_of_mixture(error: float) -> float:
    """The score of an error of the mixture below, times the root of its density."""

    def density(z: float) -> float:
        return float(0.7 * norm.pdf(z, 0.0, 0.5) + 0.3 * norm.pdf(z, 6.0, np.hypot(0.5, 1.5)))

    return (density(error + 1e-5) - density(error - 1e-5)) / 2e-5 / np.sqrt(density(error))


def test_a_blocked_line_of_sight_makes_a_mixture_whose_likelihood_filters_use() -> None:
    sensor = Range(sd=0.5, blocked=0.3, detour=6.0, detour_sd=1.5)
    place, point, none = np.zeros((1, 2)), np.array([[20.0], [0.0]]), np.empty((1, 0))
    late = norm(26.0, np.hypot(0.5, 1.5))
    for reading in (19.0, 20.4, 24.0, 30.0):
        wanted = np.log(0.7 * norm.pdf(reading, 20.0, 0.5) + 0.3 * late.pdf(reading))
        assert sensor.log_likelihood(point, np.array([reading]), place, none) == pytest.approx([wanted], rel=1e-12)
    normals = norm.ppf((np.arange(100_000) + 0.5) / 100_000)
    readings = sensor.measure(np.tile([20.0, 0.0], (normals.size, 1)), *at(np.zeros(2), normals.size), normals)
    for threshold in (19.5, 20.5, 24.0, 27.0):
        chance = 0.7 * norm.cdf(threshold, 20.0, 0.5) + 0.3 * late.cdf(threshold)
        assert (readings < threshold).mean() == pytest.approx(chance, abs=2e-5)
    mean, _, variance = sensor.linearise(point, place, none)
    assert (mean.item(), variance.item()) == pytest.approx((readings.mean(), readings.var()), rel=1e-3)
    exact = quad(lambda z: score_of_mixture(z) ** 2, -5.0, 25.0, points=[0.0, 6.0], limit=200)[0]
    found = sensor.information(point, place, none)[0, 0, 0, 0]
    assert exact < found < 1.05 * exact  # known lines of sight say more: a bound for all filters
