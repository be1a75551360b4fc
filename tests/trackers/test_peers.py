"""Our Kalman filters beside those of Stone Soup and FilterPy, on the readings of standalone runs (`make peers`).

Both libraries are an extra of their own: without it these tests are skipped, except by `make peers`.

    Stone Soup: the unscented, the cubature and the iterated extended filter     FilterPy: interacting multiple models
"""

from __future__ import annotations

import importlib
import os
from datetime import datetime, timedelta
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.distribution.versions import REQUIRED
from wsnsim import scenario
from wsnsim.base.tables import RECORDED_BY_DEFAULT, Memory
from wsnsim.experiment import replicate_of

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::SyntaxWarning")
COLUMNS = ("px", "vx", "py", "vy")
STEP, INTENSITY = 0.5, 0.8
ANCHORS = ((-40.0, -40.0), (40.0, -35.0), (30.0, 45.0), (-45.0, 30.0))
PATH = ((0.0, -20.0, -10.0), (8.0, 25.0, -5.0), (14.0, 15.0, 25.0), (20.0, -15.0, 15.0))


def peer(module: str) -> Any:
    """A module of another library; the test is skipped without it, or fails where it is demanded."""
    if os.environ.get(REQUIRED) == "required":
        return importlib.import_module(module)
    return pytest.importorskip(module)


class Standalone(NamedTuple):
    """The prior of a standalone run, traits of sensors, readings (K, 4), and what our filter made of them."""

    mean: np.ndarray
    cov: np.ndarray
    traits: np.ndarray
    readings: np.ndarray
    means: np.ndarray
    covs: np.ndarray
    chances: np.ndarray


def standalone(tracker: dict[str, Any], sensor: dict[str, Any]) -> Standalone:
    """A run among four sensors, all of which have a reading at each step."""
    memory = Memory({**RECORDED_BY_DEFAULT, "readings": True, "covariances": True, "tracker_state": True})
    setup = scenario.build(scenario.load({
        "name": "peers", "network": "none", "seed": 7, "step": STEP, "duration": 20.0, "tracker": tracker,
        "deploy": {"kind": "anchors", "places": [list(place) for place in ANCHORS]}, "sensor": sensor,
        "motion": {"kind": "waypoints", "points": [list(point) for point in PATH], "q": INTENSITY},
        "prior": {"sd": [6.0, 2.0, 6.0, 2.0]},
    }))  # fmt: skip
    noted: list[Any] = []
    start = type(setup.tracker).start
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(setup.tracker), "start", lambda self, *given: (noted.extend(given), start(self, *given))[1])
        patch.setattr(type(setup.tracker), "whole_runs", lambda self, block: None, raising=False)
        replicate_of(setup, 0, memory)
    said, spread, table = memory.table("estimates"), memory.table("covariances"), memory.table("readings")
    covs = np.empty((len(said["step"]), 4, 4))
    for i, one in enumerate(COLUMNS):
        for j, other in enumerate(COLUMNS[i:], i):
            covs[:, i, j] = covs[:, j, i] = spread[f"cov_{one}_{other}"]
    later = table["step"] > 0
    readings = table["reading"][later].reshape(len(said["step"]), -1)
    means = np.column_stack([said[name] for name in COLUMNS])
    chances = memory.table("tracker_state").get("value", np.empty(0)).reshape(len(means), -1)
    prior, scene = noted
    return Standalone(prior.mean, prior.cov, scene.traits, readings, means, covs, chances)


@cache
def models() -> tuple[Any, Any]:
    """Stone Soup's near-constant velocity, and its model of the ranges to all sensors."""
    linear = peer("stonesoup.models.transition.linear")
    nonlinear, types = peer("stonesoup.models.measurement.nonlinear"), peer("stonesoup.types.array")

    class Ranges(nonlinear.NonLinearGaussianMeasurement):
        @property
        def ndim_meas(self) -> int:
            return len(ANCHORS)

        def function(self, state: Any, noise: Any = False, **_: Any) -> Any:
            places = np.asarray(state.state_vector, dtype=float)[[0, 2]]
            apart = places[None] - np.array(ANCHORS)[:, :, None]
            kind = types.StateVectors if places.shape[1] > 1 else types.StateVector
            return np.hypot(apart[:, 0], apart[:, 1]).view(kind)

        def jacobian(self, state: Any, **_: Any) -> np.ndarray:
            apart = np.asarray(state.state_vector, dtype=float)[[0, 2], 0] - np.array(ANCHORS)
            result = np.zeros((len(ANCHORS), 4))
            result[:, [0, 2]] = apart / np.hypot(*apart.T)[:, None]
            return result

        def rvs(self, num_samples: int = 1, **_: Any) -> Any:
            raise NotImplementedError

        def pdf(self, *_: Any, **__: Any) -> Any:
            raise NotImplementedError

    axis = linear.ConstantVelocity(INTENSITY)
    moving = linear.CombinedLinearGaussianTransitionModel([axis, axis])
    return moving, Ranges(ndim_state=4, mapping=(0, 2), noise_covar=np.eye(len(ANCHORS)) * 1.5**2)


def tracked(run: Standalone, predictor: Any, updater: Any, measured: Any, readings: np.ndarray) -> Any:
    """(means, covariances) of a filter of Stone Soup."""
    state, array = peer("stonesoup.types.state"), peer("stonesoup.types.array")
    detections, hypotheses = peer("stonesoup.types.detection"), peer("stonesoup.types.hypothesis")
    begin = datetime(2026, 1, 1)
    now = state.GaussianState(array.StateVector(run.mean[:, None]), run.cov, timestamp=begin)
    means, covs = [], []
    for step, row in enumerate(readings, 1):
        time = begin + timedelta(seconds=step * STEP)
        detection = detections.Detection(array.StateVector(row[:, None]), timestamp=time, measurement_model=measured)
        predicted = predictor.predict(now, timestamp=time)
        now = updater.update(hypotheses.SingleHypothesis(predicted, detection))
        means.append(np.asarray(now.state_vector, dtype=float)[:, 0])
        covs.append(np.asarray(now.covar, dtype=float))
    return np.array(means), np.array(covs)


def apart(run: Standalone, means: np.ndarray, covs: np.ndarray) -> tuple[float, float]:
    """The largest differences of means and of covariances, in the filter's standard deviations."""
    sd = np.sqrt(np.diagonal(run.covs, axis1=1, axis2=2))
    return (
        float(np.abs((run.means - means) / sd).max()),
        float(np.abs((run.covs - covs) / (sd[:, :, None] * sd[:, None, :])).max()),
    )


@pytest.mark.parametrize("rule", [(0.5, 2.0, -1.0), (1.0, 2.0, 0.0), (0.1, 2.0, -1.0)], ids=str)
def test_the_unscented_filter_is_that_of_stone_soup(rule: tuple[float, float, float]) -> None:
    words = dict(zip(("alpha", "beta", "kappa"), rule, strict=True))
    kalman, update = peer("stonesoup.predictor.kalman"), peer("stonesoup.updater.kalman")
    run = standalone({"kind": "ukf", **words}, {"kind": "range", "sd": 1.5, "reach": 1e3})
    moving, measured = models()
    theirs = tracked(
        run, kalman.UnscentedKalmanPredictor(moving, **words), update.UnscentedKalmanUpdater(**words), measured,
        run.readings,
    )  # fmt: skip
    assert max(apart(run, *theirs)) < 1e-9


def test_the_unscented_filter_of_bearings_is_that_of_stone_soup_but_for_the_mean_of_angles() -> None:
    """Stone Soup takes the circular mean of the sigma points' angles; ours is relative to the central point.

    They part by the third power of the angles' spread, which is largest at the first step.
    """
    kalman, update = peer("stonesoup.predictor.kalman"), peer("stonesoup.updater.kalman")
    nonlinear, array = peer("stonesoup.models.measurement.nonlinear"), peer("stonesoup.types.array")
    words = {"alpha": 1.0, "beta": 2.0, "kappa": 0.0}
    run = standalone({"kind": "ukf", **words}, {"kind": "bearing", "sd": 0.02, "reach": 1e3})
    each = [
        nonlinear.Cartesian2DToBearing(
            ndim_state=4, mapping=(0, 2), noise_covar=np.array([[0.02**2]]),
            translation_offset=array.StateVector(np.array(place)[:, None]),
        )
        for place in ANCHORS
    ]  # fmt: skip
    measured = nonlinear.CombinedReversibleGaussianMeasurementModel(each)
    theirs = tracked(
        run, kalman.UnscentedKalmanPredictor(models()[0], **words), update.UnscentedKalmanUpdater(**words), measured,
        run.readings,
    )  # fmt: skip
    assert 1e-6 < max(apart(run, *theirs)) < 0.01
    later = run._replace(means=run.means[10:], covs=run.covs[10:])
    assert max(apart(later, theirs[0][10:], theirs[1][10:])) < 1e-3


def test_the_cubature_filter_is_that_of_stone_soup() -> None:
    kalman, update = peer("stonesoup.predictor.kalman"), peer("stonesoup.updater.kalman")
    run = standalone({"kind": "ckf"}, {"kind": "range", "sd": 1.5, "reach": 1e3})
    moving, measured = models()
    theirs = tracked(
        run, kalman.CubatureKalmanPredictor(moving), update.CubatureKalmanUpdater(), measured, run.readings
    )
    assert max(apart(run, *theirs)) < 1e-9


@pytest.mark.parametrize("iterations", [1, 30])
def test_the_extended_filter_is_that_of_stone_soup_iterated_too(iterations: int) -> None:
    kalman, update = peer("stonesoup.predictor.kalman"), peer("stonesoup.updater.kalman")
    run = standalone({"kind": "ekf", "iterations": iterations}, {"kind": "range", "sd": 1.5, "reach": 1e3})
    moving, measured = models()
    updater = update.ExtendedKalmanUpdater() if iterations == 1 else update.IteratedKalmanUpdater(tolerance=1e-13)
    theirs = tracked(run, kalman.ExtendedKalmanPredictor(moving), updater, measured, run.readings)
    assert max(apart(run, *theirs)) < 1e-9


def test_the_interacting_models_are_those_of_filterpy_where_all_is_linear() -> None:
    filters = peer("filterpy.kalman")
    chain, variances = np.array([[0.92, 0.08], [0.25, 0.75]]), (0.05, 6.0)
    listed = [{"kind": "constant_velocity", "variances": [each]} for each in variances]
    tracker = {"kind": "imm", "models": listed, "transition": chain.tolist()}
    run = standalone(tracker, {"kind": "coordinate", "sd": 1.5})
    rise = np.zeros((len(ANCHORS), 4))
    rise[:, 0], rise[:, 2] = np.cos(run.traits[:, 0]), np.sin(run.traits[:, 0])
    lever = np.kron(np.eye(2), [[STEP**2 / 2.0], [STEP]])
    bank = []
    for variance in variances:
        one = filters.KalmanFilter(dim_x=4, dim_z=len(ANCHORS))
        one.x, one.P = run.mean.copy(), run.cov.copy()
        one.F, one.H = np.kron(np.eye(2), [[1.0, STEP], [0.0, 1.0]]), rise
        one.Q, one.R = variance * lever @ lever.T, 1.5**2 * np.eye(len(ANCHORS))
        bank.append(one)
    theirs = filters.IMMEstimator(bank, [0.5, 0.5], chain)
    means, covs, chances = [], [], []
    for row in run.readings:
        theirs.predict()
        theirs.update(row)
        means.append(theirs.x.copy())
        covs.append(theirs.P.copy())
        chances.append(theirs.mu.copy())
    assert max(apart(run, np.array(means), np.array(covs))) < 1e-9
    assert run.chances == pytest.approx(np.array(chances), abs=1e-9)
    assert np.ptp(run.chances[:, 1]) > 0.3, "the modes change"
