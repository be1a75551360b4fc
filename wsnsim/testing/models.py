"""The contract checks of motion models and of sensor models: `check_motion`, `check_sensor`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, Keys, components_of, is_relative, near, periods_of, rows
from wsnsim.base.errors import RunError
from wsnsim.base.optional_ports import Detects, FewReadings
from wsnsim.base.ports import MotionModel, SensorModel
from wsnsim.base.rng import derive_all
from wsnsim.testing.table import demand, demand_each, examined

STEPS = 40
MOTION_SAMPLES = 4000
ROUNDING = 1e-9


def check_motion(motion: MotionModel, dt: float = 0.5, seed: int = 1) -> None:
    """Check a motion model against the rules of its port (`wsnsim.MotionModel`).

    Args:
        motion: An instance of the model.
        dt: Length of a step in s.
        seed: Seed of the trajectory and of all keys.

    Raises:
        AssertionError: The model breaks a rule, which the message names. columns: names, units and the position's
            columns fit together. truth: a finite trajectory of the right shape, the same for the same seed. shapes:
            states (D, N) stay (D, N), and arguments are not changed. keys: the noise of a particle is a function of
            its key alone. linearisation: `matrices` holds the derivative of `advance`, and a symmetric, positive
            semidefinite covariance. noise: `propagate` is `advance` on average. density: `log_transition` is a number
            or -inf, and greater for a likely successor than for an unlikely one. assumed: `assumed(4)` has four times
            the covariance.
    """
    motion = examined(motion, MotionModel)
    with demand("columns"):
        _check_columns(motion)
    with demand("truth"):
        truth = _checked_truth(motion, dt, seed)
    states = np.ascontiguousarray(truth[:: max(1, len(truth) // 8)].T)
    keys = derive_all(seed, np.arange(states.shape[1]))
    demand_each(MOTION_CHECKS, motion, states, dt, keys)


def _check_columns(motion: MotionModel) -> None:
    size = len(motion.columns)
    assert size and len(set(motion.columns)) == size, f"columns must have different names: {motion.columns}"
    assert len(motion.units) == size, f"{size} columns and {len(motion.units)} units"
    assert 1 <= len(motion.position) <= 2, "position must name one column (x) or two (x and y)"
    assert all(0 <= column < size for column in motion.position), f"position {motion.position} is not among the columns"


def _checked_truth(motion: MotionModel, dt: float, seed: int) -> Floats:
    first, again = (motion.truth(STEPS, dt, np.random.default_rng(seed)) for _ in range(2))
    wanted = (STEPS + 1, len(motion.columns))
    assert first.shape == wanted, f"truth has the shape {first.shape}, expected {wanted}: steps + 1 rows"
    assert np.isfinite(first).all(), "truth is not finite"
    assert np.array_equal(first, again), "the same generator gives two different trajectories"
    return first


def _check_shapes(motion: MotionModel, states: Floats, dt: float, keys: Keys) -> None:
    before = states.copy()
    for name, after in (
        ("advance", motion.advance(states, dt, 0.0)),
        ("propagate", motion.propagate(states, dt, keys, 0.0)),
    ):
        assert after.shape == states.shape, f"{name} turns states {states.shape} into {after.shape}"
        assert np.isfinite(after).all(), f"{name} gives states that are not finite"
        assert np.array_equal(states, before), f"{name} changes the states that it is given"


def _check_keys(motion: MotionModel, states: Floats, dt: float, keys: Keys) -> None:
    whole = motion.propagate(states, dt, keys, 0.0)
    order = np.arange(states.shape[1])[::-1]
    turned = motion.propagate(np.ascontiguousarray(states[:, order]), dt, keys[order], 0.0)
    assert np.allclose(whole[:, order], turned, rtol=ROUNDING, atol=ROUNDING), (
        "the noise of a particle depends on other particles or on the order of calls, not on its key alone"
    )
    _, noise = motion.matrices(states, dt, 0.0)
    if np.trace(noise) > 0.0:
        other = motion.propagate(states, dt, derive_all(7, keys), 0.0)
        assert not np.array_equal(whole, other), "other keys give the same noise"


def _check_motion_linearisation(motion: MotionModel, states: Floats, dt: float, *_: object) -> None:
    size, count = states.shape
    transitions, noise = motion.matrices(states, dt, 0.0)
    assert transitions.shape == (count, size, size), f"F has the shape {transitions.shape}, expected (N, D, D)"
    assert noise.shape == (size, size), f"Q has the shape {noise.shape}, expected (D, D)"
    assert np.allclose(noise, noise.T, rtol=ROUNDING, atol=0.0), "Q is not symmetric"
    assert np.linalg.eigvalsh(noise)[0] >= -ROUNDING * max(np.trace(noise), 1e-300), "Q is not positive semidefinite"
    for column in range(size):
        width = 1e-5 * max(1.0, float(np.abs(states[column]).max()))
        shift = width * np.eye(size)[:, [column]]
        slopes = (motion.advance(states + shift, dt, 0.0) - motion.advance(states - shift, dt, 0.0)) / (2.0 * width)
        error = np.abs(slopes - transitions[:, :, column].T).max()
        assert error <= 1e-3 * max(1.0, np.abs(slopes).max()), (
            f"F is not the derivative of advance by {motion.columns[column]}: they differ by {error:g}"
        )


def _check_noise(motion: MotionModel, states: Floats, dt: float, keys: Keys) -> None:
    state = states[:, :1]
    _, noise = motion.matrices(state, dt, 0.0)
    many = derive_all(int(keys[0]), np.arange(MOTION_SAMPLES))
    samples = motion.propagate(np.ascontiguousarray(np.repeat(state, MOTION_SAMPLES, axis=1)), dt, many, 0.0)
    expected = motion.advance(state, dt, 0.0)[:, 0]
    deviations = np.sqrt(np.diag(noise))
    error = np.abs(samples.mean(axis=1) - expected)
    allowed = SIGMAS * deviations / np.sqrt(MOTION_SAMPLES) + ROUNDING * np.maximum(1.0, np.abs(expected))
    assert (error <= allowed).all(), f"the mean of propagate differs from advance by {error}, allowed {allowed}"
    spread = samples.std(axis=1)
    assert (np.abs(spread - deviations) <= SIGMAS * deviations / np.sqrt(2.0 * MOTION_SAMPLES) + ROUNDING).all(), (
        f"the standard deviations of propagate are {spread}, and by Q they are {deviations}"
    )


def _check_density(motion: MotionModel, states: Floats, dt: float, keys: Keys) -> None:
    likely = motion.propagate(states, dt, keys, 0.0)
    _, noise = motion.matrices(states, dt, 0.0)
    far = likely + 20.0 * np.sqrt(np.diag(noise))[:, None]
    try:
        near_logs, far_logs = (motion.log_transition(after, states, dt, 0.0) for after in (likely, far))
    except RunError:
        return  # a singular covariance: the message says so to the user
    assert near_logs.shape == (states.shape[1],), f"log_transition has the shape {near_logs.shape}, expected (N,)"
    assert not np.isnan(near_logs).any() and not np.isnan(far_logs).any(), "log_transition gives NaN"
    assert (near_logs > far_logs).all(), "an unlikely successor has a greater density than a likely one"


def _check_assumed(motion: MotionModel, states: Floats, dt: float, *__: object) -> None:
    _, noise = motion.matrices(states, dt, 0.0)
    _, scaled = motion.assumed(4.0).matrices(states, dt, 0.0)
    assert np.allclose(scaled, 4.0 * noise, rtol=1e-6, atol=0.0), "assumed(4) does not have four times the covariance"


MOTION_CHECKS: Final[dict[str, Callable[..., object]]] = {
    "shapes": _check_shapes, "keys": _check_keys, "linearisation": _check_motion_linearisation, "noise": _check_noise,
    "density": _check_density, "assumed": _check_assumed,
}  # fmt: skip


SENSOR_SAMPLES = 2000
WIDTH = 1e-5
"""m: half the width of a finite difference."""
NEAR = (0.1, 0.6)
"""The distances of targets from the first sensor, as shares of the sensing range."""
SIGMAS = 6.0
"""Standard errors by which a mean of samples may be wrong: no seed fails by chance."""
TURNS = (2.0 * np.pi, 360.0)
"""A whole turn in rad and in degrees."""
AROUND = 720
"""Points on a circle around a sensor."""
SMALL = 0.02
"""Share of a turn by which an expected reading may change from one of these points to the next."""
LONGEST = 60.0
"""m: the sensing range that is taken for a sensor without one."""


class _SensorField(NamedTuple):
    """Sensors, their constants and targets in range of all of them."""

    points: Floats
    positions: Floats
    traits: Floats


def check_sensor(sensor: SensorModel, columns: int = 2, seed: int = 1) -> None:
    """Check a sensor model against the rules of its port (`wsnsim.SensorModel`).

    Args:
        sensor: An instance of the model.
        columns: Columns of the target's position: 2 in the plane, 1 on a line.
        seed: Seed of positions, constants and noise.

    Raises:
        AssertionError: The model breaks a rule, which the message names. traits: a row of constants per node, the
            same for the same seed. measure: readings are finite, and change with the noise, or are among the few values
            that a model has (`FewReadings`). detects: bool of (points, sensors), if the model has that method.
            linearisation: `linearise` holds the readings without noise, or the means of those that are not Gaussian,
            their gradients and positive variances. angles: an expected reading that jumps by a whole turn has a period.
            likelihood: the likelihood of several readings is the product of theirs, no readings give 1, points that
            are not finite -inf, and whole periods of angles change nothing. truth: on average no other point is more
            likely than the true one. assumed: the model of a filter has the same methods.
    """
    sensor = examined(sensor, SensorModel)
    rng = np.random.default_rng(seed)
    reach = min(sensor.reach, LONGEST)
    with demand("traits"):
        field = _field(sensor, columns, reach, rng)
    demand_each(SENSOR_CHECKS, sensor, field, reach, rng)


def _field(sensor: SensorModel, columns: int, reach: float, rng: np.random.Generator) -> _SensorField:
    assert reach > 0.0, f"reach is {sensor.reach}, must be greater than 0"
    positions = rng.uniform(-0.1, 0.1, (4, 2)) * reach
    first, again = (sensor.draw_traits(len(positions), np.random.default_rng(1)) for _ in range(2))
    wanted = (len(positions), len(sensor.trait_names))
    assert first.shape == wanted, f"draw_traits gives the shape {first.shape}, expected {wanted}: (nodes, traits)"
    assert np.array_equal(first, again), "the same generator gives two different sets of constants"
    away, turn = rng.uniform(*NEAR, 5) * reach, rng.uniform(-np.pi, np.pi, 5)
    points = np.stack([away * np.cos(turn), away * np.sin(turn)])[:columns]
    return _SensorField(points + 0.25 * reach, positions, first)


def _measured(sensor: SensorModel, field: _SensorField, noise: Floats) -> Floats:
    """Return the readings (S, ...) of the first target by all sensors."""
    points = np.repeat(field.points[:, :1].T, len(field.positions), axis=0)
    return sensor.measure(points, field.positions, field.traits, noise)


def _noise(sensor: SensorModel, count: int, rng: np.random.Generator) -> Floats:
    components = len(components_of(sensor))
    return rng.standard_normal((count, components) if components > 1 else count)


def _check_measure(sensor: SensorModel, field: _SensorField, _: float, rng: np.random.Generator) -> None:
    noise = _noise(sensor, len(field.positions), rng)
    readings = _measured(sensor, field, noise)
    assert readings.shape == noise.shape, f"measure gives the shape {readings.shape}, expected {noise.shape}"
    assert np.isfinite(readings).all(), "measure gives readings that are not finite"
    if (values := _values_of(sensor)).size:
        assert np.isin(readings, values).all(), f"measure gives {readings}, and `reading_values` are {values}"
        return
    assert not np.array_equal(readings, _measured(sensor, field, -noise)), "readings do not change with the noise"


def _check_sensor_linearisation(sensor: SensorModel, field: _SensorField, *_: object) -> None:
    expected, gradients, variances = sensor.linearise(field.points, field.positions, field.traits)
    axes, count = field.points.shape
    sensors = len(field.positions) * len(components_of(sensor))
    for name, array, wanted in (
        ("expected readings", expected, (sensors, count)),
        ("gradients", gradients, (sensors, axes, count)),
        ("variances", variances, (sensors, count)),
    ):
        assert array.shape == wanted, f"linearise: {name} have the shape {array.shape}, expected {wanted}"
        assert np.isfinite(array).all(), f"linearise: {name} are not finite"
    assert (variances > 0.0).all(), "linearise: variances must be greater than 0"
    if _values_of(sensor).size or getattr(sensor, "constant_gaussian", None) is False:
        _check_moments(sensor, field, expected[:, 0], variances[:, 0])
    else:
        _check_quiet(sensor, field, expected[:, 0])
    if is_relative(sensor):
        assert np.allclose(expected.mean(axis=0), 0.0, atol=1e-6), "linearise: relative readings must have the mean 0"
    for axis in range(axes):
        shift = WIDTH * np.eye(axes)[:, [axis]]
        above, below = (sensor.linearise(field.points + s, field.positions, field.traits)[0] for s in (shift, -shift))
        slopes = (near(sensor, above, below) - below) / (2.0 * WIDTH)
        error = np.abs(slopes - gradients[:, axis])
        assert (error <= 1e-3 * np.maximum(1e-3, np.abs(slopes).max())).all(), (
            f"linearise: gradients along axis {axis} are not the derivatives of the expected readings: {error.max():g}"
        )


def _values_of(sensor: SensorModel) -> Floats:
    """What a reading can be; nothing if it can be any number."""
    return sensor.reading_values if isinstance(sensor, FewReadings) else np.empty(0)


def _check_quiet(sensor: SensorModel, field: _SensorField, expected: Floats) -> None:
    silence = np.zeros_like(_noise(sensor, len(field.positions), np.random.default_rng(0)))
    quiet = rows(sensor, _measured(sensor, field, silence))
    error = np.abs(near(sensor, quiet, expected) - expected)
    assert (error <= 1e-6 * np.maximum(1.0, np.abs(expected))).all(), (
        f"linearise expects {expected}, and measure without noise gives {quiet}"
    )


def _check_moments(sensor: SensorModel, field: _SensorField, expected: Floats, variances: Floats) -> None:
    """Demand the mean and the variance of readings that are not Gaussian, of samples of the first target."""
    many = SENSOR_SAMPLES * len(expected)
    places, traits = (np.tile(each, (SENSOR_SAMPLES, 1)) for each in (field.positions, field.traits))
    points = np.repeat(field.points[:, :1].T, many, axis=0)
    sampled = sensor.measure(points, places, traits, _noise(sensor, many, np.random.default_rng(0)))
    apart = near(sensor, sampled.reshape(SENSOR_SAMPLES, -1).T, expected[:, None]) - expected[:, None]
    width = max(np.ptp([*_values_of(sensor), 0.0]), np.abs(apart).max())
    allowed = SIGMAS * np.sqrt(variances / SENSOR_SAMPLES)
    rare = SIGMAS * width / SENSOR_SAMPLES  # a few readings that were to be expected hardly once
    assert (np.abs(apart.mean(axis=1)) <= allowed + rare).all(), (
        f"linearise expects {expected}, and readings of measure have the mean {expected + apart.mean(axis=1)}"
    )
    spread = (apart**2).mean(axis=1)
    assert (np.abs(spread - variances) <= width * (allowed + rare)).all(), (
        f"linearise gives the variances {variances}, and readings of measure have {spread}"
    )


def _check_angles(sensor: SensorModel, field: _SensorField, reach: float, _: object) -> None:
    """Demand a period of a component that jumps by a whole turn on a circle around the first sensor, in the plane."""
    if len(field.points) < 2:
        return
    turn = np.linspace(-np.pi, np.pi, AROUND, endpoint=False) + 0.1
    points = field.positions[0][:, None] + NEAR[0] * reach * np.stack([np.cos(turn), np.sin(turn)])
    names = components_of(sensor)
    periods = periods_of(sensor) if any(periods_of(sensor)) else (0.0,) * len(names)
    expected, _, _ = sensor.linearise(points, field.positions[:1], field.traits[:1])
    for name, period, readings in zip(names, periods, expected, strict=True):
        jumps = np.abs(np.diff(readings, append=readings[0]))
        largest, usual = float(jumps.max()), float(np.median(jumps))
        for whole in () if period else TURNS:
            assert usual > SMALL * whole or abs(largest - whole) > SMALL * whole, (
                f"the component '{name}' is expected to jump by {largest:.4g} from one point to the next on a circle "
                f"around the sensor, as an angle does at half a turn, and its period is 0, so that filters take the "
                f"long way round. Say so in `periods` (2π for an angle in rad), and wrap differences in log_likelihood"
            )


def _check_likelihood(sensor: SensorModel, field: _SensorField, _: float, rng: np.random.Generator) -> None:
    readings = _measured(sensor, field, _noise(sensor, len(field.positions), rng))
    whole = sensor.log_likelihood(field.points, readings, field.positions, field.traits)
    assert whole.shape == (field.points.shape[1],), f"log_likelihood has the shape {whole.shape}, expected (N,)"
    each = [
        sensor.log_likelihood(field.points, readings[i : i + 1], field.positions[i : i + 1], field.traits[i : i + 1])
        for i in range(len(readings))
    ]
    scale = 1e-9 * np.abs(each).sum(axis=0) + 1e-9
    if is_relative(sensor):
        moved = sensor.log_likelihood(field.points, readings + 7.0, field.positions, field.traits)
        assert np.allclose(moved, whole, rtol=1e-6, atol=1e-6), "of relative readings, only the differences may count"
    else:
        assert (np.abs(np.sum(each, axis=0) - whole) <= scale).all(), (
            "the likelihood of several readings is not the product of theirs"
        )
    owners = np.arange(field.points.shape[1]) % len(readings)
    own = sensor.log_likelihood(field.points, readings, field.positions, field.traits, owners)
    wanted = np.array(each)[owners, np.arange(owners.size)]
    assert np.allclose(own, wanted, rtol=1e-9, atol=1e-9), "with owners, reading owners[j] alone counts for particle j"
    none = sensor.log_likelihood(field.points, readings[:0], field.positions[:0], field.traits[:0])
    assert np.array_equal(none, np.zeros(field.points.shape[1])), "no readings: a log-likelihood of 0 is expected"
    shifts = np.array([period if period else 0.0 for period in periods_of(sensor)])
    if shifts.any():
        moved = readings + (shifts if readings.ndim > 1 else shifts[0])
        shifted = sensor.log_likelihood(field.points, moved, field.positions, field.traits)
        assert np.allclose(shifted, whole, rtol=1e-6, atol=1e-6), (
            "a reading and the same reading and a whole period must have the same likelihood"
        )
    with np.errstate(all="ignore"):
        lost = sensor.log_likelihood(np.full_like(field.points, np.nan), readings, field.positions, field.traits)
    assert np.array_equal(lost, np.full(lost.shape, -np.inf)), "log_likelihood is -inf at points that are not finite"


def _check_detects(sensor: SensorModel, field: _SensorField, *_: object) -> None:
    if not isinstance(sensor, Detects):
        return
    found = np.asarray(sensor.detects(field.points.T, field.positions))
    wanted = (field.points.shape[1], len(field.positions))
    assert found.shape == wanted and found.dtype == np.bool_, (
        f"detects gives {found.dtype} of the shape {found.shape}, expected bool of {wanted}: (points, sensors)"
    )


def _check_truth(sensor: SensorModel, field: _SensorField, reach: float, rng: np.random.Generator) -> None:
    """Demand E log p(z | true point) >= E log p(z | other point): Gibbs' inequality, on samples."""
    node = slice(0, 1)
    true = field.points[:, :1]
    points = np.repeat(true.T, SENSOR_SAMPLES, axis=0)
    positions, traits = (np.repeat(array[node], SENSOR_SAMPLES, axis=0) for array in (field.positions, field.traits))
    readings = sensor.measure(points, positions, traits, _noise(sensor, SENSOR_SAMPLES, rng))
    owners = np.arange(SENSOR_SAMPLES)

    def logs(at: Floats) -> Floats:
        return sensor.log_likelihood(np.repeat(at, SENSOR_SAMPLES, axis=1), readings, positions, traits, owners)

    right = logs(true)
    for share in (-0.02, 0.02, 0.1):
        more = right - logs(true + share * reach)
        error = SIGMAS * more.std() / np.sqrt(SENSOR_SAMPLES)
        assert more.mean() >= -error - 1e-9, (
            f"readings of a target at {true[:, 0]} are more likely {share * reach:g} m beside it: "
            "measure and log_likelihood disagree"
        )


def _check_filter_model(sensor: SensorModel, *_: object) -> None:
    assumed = sensor.assumed("known", False)
    for name in ("log_likelihood", "linearise"):
        assert callable(getattr(assumed, name, None)), f"the assumed model lacks {name}"


SENSOR_CHECKS: Final[dict[str, Callable[..., object]]] = {
    "measure": _check_measure, "detects": _check_detects, "linearisation": _check_sensor_linearisation,
    "angles": _check_angles, "likelihood": _check_likelihood, "truth": _check_truth, "assumed": _check_filter_model,
}  # fmt: skip
