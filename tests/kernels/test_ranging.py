"""The kernels of distance against their NumPy twins, SciPy's normal density and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from wsnsim.kernels import ranging
from wsnsim.kernels.ranging import joint_log_likelihood, linearised, own_log_likelihood

PARTICLES, SENSORS = 300, 12
LAWS = {
    "range": (0.0, 1.0, 0.0, 4.0, np.inf, False),
    "range of noise beyond 40 m": (0.0, 1.0, 0.0, 1.0, 40.0, False),
    "log-distance": (-37.8, -23.0 / np.log(10.0), 0.05, 0.25, np.inf, True),
}
each_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
Arrays = tuple[np.ndarray, ...]


def means_at(x: np.ndarray, y: np.ndarray, positions: np.ndarray, law: ranging.Law) -> Arrays:
    """(S, N) means whatever `within` says, and the distances."""
    offset, slope, floor, _, _, logarithmic = law
    distances = np.hypot(x - positions[:, :1], y - positions[:, 1:])
    floored = np.maximum(distances, floor)
    return offset + slope * (np.log(floored) if logarithmic else floored), distances


def joint_log_likelihood_twin(
    x: np.ndarray, y: np.ndarray, readings: np.ndarray, positions: np.ndarray, law: ranging.Law
) -> np.ndarray:
    """The kernel in NumPy."""
    means, distances = means_at(x, y, positions, law)
    squares = ((readings[:, None] - np.where(distances <= law[4], means, 0.0)) ** 2).sum(axis=0)
    found = -0.5 * (squares / law[3] + readings.size * np.log(2 * np.pi * law[3]))
    return np.where(np.isfinite(x) & np.isfinite(y) & ~np.isnan(found), found, -np.inf)


def own_log_likelihood_twin(
    x: np.ndarray, y: np.ndarray, readings: np.ndarray, positions: np.ndarray, owners: np.ndarray, law: ranging.Law
) -> np.ndarray:
    """The kernel in NumPy."""
    offset, slope, floor, variance, within, logarithmic = law
    distances = np.hypot(x - positions[owners, 0], y - positions[owners, 1])
    floored = np.maximum(distances, floor)
    means = np.where(distances <= within, offset + slope * (np.log(floored) if logarithmic else floored), 0.0)
    found = -0.5 * ((readings[owners] - means) ** 2 / variance + np.log(2 * np.pi * variance))
    return np.where(np.isfinite(x) & np.isfinite(y) & ~np.isnan(found), found, -np.inf)


def linearised_twin(x: np.ndarray, y: np.ndarray, positions: np.ndarray, law: ranging.Law) -> Arrays:
    """The kernel in NumPy."""
    _, slope, floor, variance, _, logarithmic = law
    means, distances = means_at(x, y, positions, law)
    apart = np.stack([x - positions[:, :1], y - positions[:, 1:]], axis=1)
    sloping = distances > floor
    safe = np.where(sloping, distances, 1.0)
    factors = np.where(sloping, slope / (safe**2 if logarithmic else safe), 0.0)
    return means, factors[:, None] * apart, np.full(means.shape, variance)


def scene(law: ranging.Law) -> Arrays:
    """Points (the first at a sensor, the second 1 cm off it), sensors, and noisy readings of the sixth point."""
    draw = np.random.default_rng(4)
    x, y = draw.normal(0.0, 25.0, (2, PARTICLES))
    positions = draw.uniform(-60.0, 60.0, (SENSORS, 2))
    x[:2], y[:2] = positions[3, 0], positions[3, 1] + np.array([0.0, 0.01])
    means, distances = means_at(x, y, positions, law)
    readings = np.where(distances <= law[4], means, 0.0)[:, 5] + np.sqrt(law[3]) * draw.standard_normal(SENSORS)
    return x, y, positions, readings


@each_law
def test_the_joint_likelihood_is_the_sum_of_normal_log_densities(law: ranging.Law) -> None:
    x, y, positions, readings = scene(law)
    means, distances = means_at(x, y, positions, law)
    truth = norm.logpdf(readings[:, None], np.where(distances <= law[4], means, 0.0), np.sqrt(law[3])).sum(axis=0)
    assert joint_log_likelihood(x, y, readings, positions, law) == pytest.approx(truth, rel=1e-9)


@each_law
def test_a_difference_in_height_lengthens_the_distance(law: ranging.Law) -> None:
    x, y, positions, readings = scene(law)
    heights = np.linspace(0.0, 3.0, SENSORS)
    lifted = np.column_stack([positions, heights**2])
    distances = np.sqrt((x - positions[:, :1]) ** 2 + (y - positions[:, 1:]) ** 2 + heights[:, None] ** 2)
    form = np.log(np.maximum(distances, law[2])) if law[5] else np.maximum(distances, law[2])
    means = law[0] + law[1] * form
    truth = norm.logpdf(readings[:, None], np.where(distances <= law[4], means, 0.0), np.sqrt(law[3]))
    assert joint_log_likelihood(x, y, readings, lifted, law) == pytest.approx(truth.sum(axis=0), rel=1e-9)
    owners = np.random.default_rng(5).integers(0, SENSORS, PARTICLES)
    own = own_log_likelihood(x, y, readings, lifted, owners, law)
    assert own == pytest.approx(truth[owners, np.arange(PARTICLES)], rel=1e-9)
    found, gradients, _ = linearised(x, y, lifted, law)
    assert found == pytest.approx(means, rel=1e-9)
    inner = distances > np.maximum(law[2], 1e-9)
    slope = law[1] / np.where(inner, distances, 1.0) ** (2 if law[5] else 1) * inner
    assert gradients[:, 0] == pytest.approx(slope * (x - positions[:, :1]), rel=1e-9, abs=1e-12)


@each_law
def test_a_height_of_zero_changes_no_bit(law: ranging.Law) -> None:
    x, y, positions, readings = scene(law)
    level = np.column_stack([positions, np.zeros(SENSORS)])
    owners = np.arange(PARTICLES) % SENSORS
    plain = joint_log_likelihood(x, y, readings, positions, law)
    assert np.array_equal(plain, joint_log_likelihood(x, y, readings, level, law))
    plain = own_log_likelihood(x, y, readings, positions, owners, law)
    assert np.array_equal(plain, own_log_likelihood(x, y, readings, level, owners, law))
    for array, other in zip(linearised(x, y, positions, law), linearised(x, y, level, law), strict=True):
        assert np.array_equal(array, other)


@each_law
@pytest.mark.parametrize("count", [0, 1, 2, 5, SENSORS])
def test_any_number_of_readings_is_summed_as_the_twin_does(law: ranging.Law, count: int) -> None:
    x, y, positions, readings = scene(law)
    given = (x, y, readings[:count], positions[:count], law)
    assert joint_log_likelihood(*given) == pytest.approx(joint_log_likelihood_twin(*given), rel=1e-9, abs=1e-9)


@each_law
def test_a_particle_is_weighed_with_its_owners_reading_alone(law: ranging.Law) -> None:
    x, y, positions, readings = scene(law)
    owners = np.random.default_rng(5).integers(0, SENSORS, PARTICLES)
    found = own_log_likelihood(x, y, readings, positions, owners, law)
    assert found == pytest.approx(own_log_likelihood_twin(x, y, readings, positions, owners, law), rel=1e-9)
    means, distances = means_at(x, y, positions, law)
    own = (owners, np.arange(PARTICLES))
    truth = norm.logpdf(readings[owners], np.where(distances[own] <= law[4], means[own], 0.0), np.sqrt(law[3]))
    assert found == pytest.approx(truth, rel=1e-9)


@pytest.mark.parametrize("stranger", [-1, SENSORS])
def test_an_owner_without_a_reading_is_refused(stranger: int) -> None:
    x, y, positions, readings = scene(LAWS["range"])
    with pytest.raises(IndexError, match="not there"):
        own_log_likelihood(x, y, readings, positions, np.full(PARTICLES, stranger), LAWS["range"])


def test_beyond_its_reach_a_sensor_reads_noise_about_zero() -> None:
    law = LAWS["range of noise beyond 40 m"]
    x, y = np.array([39.999, 40.0, 40.001, 4000.0]), np.zeros(4)
    found = joint_log_likelihood(x, y, np.array([1.5]), np.zeros((1, 2)), law)
    assert found == pytest.approx(norm.logpdf(1.5, [39.999, 40.0, 0.0, 0.0], 1.0), rel=1e-12)


@each_law
def test_what_is_not_finite_is_impossible_and_hurts_nobody_else(law: ranging.Law) -> None:
    x, y, positions, readings = scene(law)
    owners = np.arange(PARTICLES) % SENSORS
    clean = joint_log_likelihood(x, y, readings, positions, law)
    own = own_log_likelihood(x, y, readings, positions, owners, law)
    x[10], y[11], x[12], x[13] = np.nan, np.inf, -np.inf, 1e300
    untouched = np.setdiff1d(np.arange(PARTICLES), [10, 11, 12, 13])
    for found, before in (
        (joint_log_likelihood(x, y, readings, positions, law), clean),
        (own_log_likelihood(x, y, readings, positions, owners, law), own),
    ):
        assert np.all(np.isneginf(found[10:13])) and not np.isnan(found[13])
        assert np.array_equal(found[untouched], before[untouched])


@each_law
@pytest.mark.parametrize("reading", [np.nan, np.inf, -np.inf])
def test_a_reading_that_is_no_number_makes_every_point_impossible(law: ranging.Law, reading: float) -> None:
    x, y, positions, readings = scene(law)
    readings[2] = reading
    assert np.all(np.isneginf(joint_log_likelihood(x, y, readings, positions, law)))


@pytest.mark.thorough
@each_law
def test_linearisation_agrees_with_its_twin(law: ranging.Law) -> None:
    x, y, positions, _ = scene(law)
    for found, twin in zip(linearised(x, y, positions, law), linearised_twin(x, y, positions, law), strict=True):
        assert found == pytest.approx(twin, rel=1e-9, abs=1e-12)


@each_law
def test_gradients_are_those_of_finite_differences(law: ranging.Law) -> None:
    x, y, positions, _ = scene(law)
    far, step = slice(2, None), 1e-5
    gradients = linearised(x, y, positions, law)[1]
    for axis, (dx, dy) in enumerate(((step, 0.0), (0.0, step))):
        above, below = means_at(x + dx, y + dy, positions, law)[0], means_at(x - dx, y - dy, positions, law)[0]
        assert gradients[:, axis, far] == pytest.approx(((above - below) / (2 * step))[:, far], rel=1e-5, abs=1e-6)


@each_law
def test_at_the_sensor_there_is_no_slope_and_at_infinity_none_either(law: ranging.Law) -> None:
    x, y, positions, _ = scene(law)
    x[20], y[21], x[22] = np.nan, np.inf, 1e300
    means, gradients, variances = linearised(x, y, positions, law)
    assert np.all(gradients[3, :, 0] == 0.0) and np.all(gradients[:, :, 20:23] == 0.0)
    assert np.all(np.isinf(means[:, 20:23])) and np.all(np.sign(means[:, 20:23]) == np.sign(law[1]))
    assert np.all(np.isfinite(means[:, :20])) and np.all(variances == law[3])
    if not law[2]:
        assert np.hypot(*gradients[3, :, 1]) == pytest.approx(1.0)
