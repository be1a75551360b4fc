"""Stone Soup (extra `stonesoup`): its updaters as trackers in a cluster head, and results as its tracks and detections.

    tracker: {kind: "wsnsim.interop.stonesoup:StoneSoupFilter", updater: unscented}        in a scenario
    to_tracks(result) -> {Track}        to_detections(result) -> [(time, {Detection})]     for its metrics and plots

Stone Soup is imported where it is used. Its times are dates: `START` is the time 0 of a run.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from datetime import datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import Floats, near, rows
from wsnsim.base.errors import Issue, ResultError, UsageError
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene, SensorModel
from wsnsim.base.requests import Compute, Flow
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.shared.heads import GaussianBelief, HeadFilter, only_predicted
from wsnsim.trackers.shared.moments import predicted, symmetric
from wsnsim.trackers.shared.readings import Evidence, gather_readings

START: Final = datetime(2000, 1, 1)
"""The date of the time 0 of a run."""
MISSING: Final = "Stone Soup is not installed: pip install 'wsnsim[stonesoup]'"
UPDATERS: Final = {
    "extended": "ExtendedKalmanUpdater", "unscented": "UnscentedKalmanUpdater", "cubature": "CubatureKalmanUpdater",
    "iterated": "IteratedKalmanUpdater",
}  # fmt: skip


def is_installed() -> bool:
    """Whether Stone Soup can be imported."""
    return importlib.util.find_spec("stonesoup") is not None


@part
class StoneSoupFilter(HeadFilter):
    """A Kalman filter in the head whose update is Stone Soup's, with all readings that arrived as one measurement.

    wsnsim gathers the readings, predicts with the scenario's motion model, and pays for packets and operations. Angles
    are compared at their shortest difference, by moving them to the nearest of what is expected at the prediction.
    The variance of a reading is that at the predicted mean. The number of operations is our choice.
    """

    linear_gaussian: ClassVar[bool] = True

    updater: Annotated[Literal["extended", "unscented", "cubature", "iterated"], "Stone Soup's updater"] = "unscented"
    cycles: Annotated[float, Quantity("", ge=0, le=1e12), "CPU cycles of the update with a reading"] = 2000.0

    def step(self, belief: GaussianBelief, scene: Scene) -> Flow[GaussianBelief]:
        """One step: the readings reach the head; it predicts, and Stone Soup updates."""
        seen = yield from gather_readings(scene)
        yield Compute(self.cycles * max(1, seen.readings.size))
        if not seen.ids:
            return only_predicted(belief, scene)
        return GaussianBelief(*_updated(self.updater, belief, seen, scene), scene.head)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if Stone Soup is not installed."""
        if not is_installed():
            yield Issue(("tracker", "kind"), MISSING)


def _updated(updater: str, belief: GaussianBelief, seen: Evidence, scene: Scene) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) predicted by wsnsim and updated by Stone Soup."""
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.prediction import GaussianStatePrediction

    mean, cov = predicted(belief.mean, belief.cov, scene)
    place = tuple(scene.motion.position)
    expected, _, variances = scene.sensor.linearise(mean[list(place), None], seen.positions, seen.traits)
    known = np.isfinite(expected[:, 0]) & (variances[:, 0] > 0.0) & np.isfinite(variances[:, 0])
    measured = near(scene.sensor, rows(scene.sensor, seen.readings), expected[:, 0])
    known &= np.isfinite(measured)
    if not known.any():
        return mean, cov
    model = _model_class()(
        ndim_state=mean.size, mapping=place, noise_covar=np.diag(variances[known, 0]), sensor=scene.sensor,
        positions=seen.positions, traits=seen.traits, anchor=expected[:, 0], known=known,
    )  # fmt: skip
    time = START + timedelta(seconds=float(scene.time))
    prediction = GaussianStatePrediction(mean.reshape(-1, 1), cov, timestamp=time)
    detection = Detection(measured[known].reshape(-1, 1), timestamp=time, measurement_model=model)
    posterior = _updater(updater).update(SingleHypothesis(prediction, detection))
    return np.asarray(posterior.state_vector, dtype=np.float64).ravel(), symmetric(np.asarray(posterior.covar, float))


@cache
def _updater(name: str) -> Any:
    """An updater of Stone Soup; a Gaussian is assumed in the unscented transform (α = 1, β = 2, κ = 0), as in `ukf`."""
    from stonesoup.updater import iterated, kalman

    if name == "iterated":
        home = iterated if hasattr(iterated, "IteratedKalmanUpdater") else kalman
        return home.IteratedKalmanUpdater(max_iterations=20)
    options = {"alpha": 1.0, "beta": 2.0, "kappa": 0.0} if name == "unscented" else {}
    return getattr(kalman, UPDATERS[name])(**options)


@cache
def _model_class() -> Any:
    """The class of Stone Soup's measurement model around a sensor model of wsnsim."""
    from stonesoup.base import Property
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.types.array import StateVector, StateVectors

    class StoneSoupMeasurement(NonLinearGaussianMeasurement):  # type: ignore[misc]
        """What several nodes read: a vector of the readings that are known."""

        sensor: Any = Property(doc="Sensor model of wsnsim")
        positions: Any = Property(doc="Positions (S, 2) of the nodes")
        traits: Any = Property(doc="Traits (S, T) of the nodes")
        anchor: Any = Property(doc="Readings to whose neighbourhood angles are moved")
        known: Any = Property(doc="Which of the readings count")

        @property
        def ndim_meas(self) -> int:
            return int(np.count_nonzero(self.known))

        def function(self, state: Any, noise: Any = False, **_: Any) -> Any:
            points = np.asarray(state.state_vector, dtype=np.float64).reshape(self.ndim_state, -1)
            expected = self._linearised(points)[0]
            values = near(self.sensor, expected, self.anchor[:, None])[self.known]
            values = values + (self.rvs(num_samples=values.shape[1]) if isinstance(noise, bool) and noise else 0.0)
            return StateVectors(values) if values.shape[1] > 1 else StateVector(values)

        def jacobian(self, state: Any, **_: Any) -> Any:
            point = np.asarray(state.state_vector, dtype=np.float64).reshape(self.ndim_state, -1)[:, :1]
            slopes = np.zeros((self.ndim_meas, self.ndim_state))
            slopes[:, list(self.mapping)] = self._linearised(point)[1][self.known, :, 0]
            return slopes

        def _linearised(self, points: Floats) -> tuple[Floats, Floats, Floats]:
            sensor: SensorModel = self.sensor
            return sensor.linearise(np.ascontiguousarray(points[list(self.mapping)]), self.positions, self.traits)

    return StoneSoupMeasurement


def to_tracks(result: Any, replicate: int | None = None) -> set[Any]:
    """The estimates of a result as tracks of Stone Soup, one per Monte Carlo run and target.

    Args:
        result: A result of `wsnsim.simulate` or `run`, or the path of a result file.
        replicate: The Monte Carlo run; None for all.

    Returns:
        Tracks whose states have the whole covariance where the table `covariances` was recorded
        (`keep=["covariances"]`), and no covariance elsewhere. The metadata of a track hold `replicate` and `target`;
        `timestamp` is `START` plus the time of the step.

    Raises:
        UsageError: Stone Soup is not installed.
        ResultError: Readings name no target.
    """
    estimates = _table(result, "estimates", replicate)
    from stonesoup.types.state import GaussianState, State
    from stonesoup.types.track import Track

    names = list(estimates.columns[list(estimates.columns).index("issued") + 1 : list(estimates.columns).index("sd_x")])
    covariances = _covariances(result, names, replicate)
    tracks = set()
    for (run, target), rows_ in estimates.groupby(["replicate", "target"], observed=True):
        track = Track(init_metadata={"replicate": int(run), "target": int(target)})
        for step, time, *mean in rows_[["step", "time", *names]].itertuples(index=False):
            vector, at = np.array(mean, dtype=np.float64).reshape(-1, 1), START + timedelta(seconds=float(time))
            cov = covariances.get((int(run), int(target), int(step)))
            track.append(State(vector, timestamp=at) if cov is None else GaussianState(vector, cov, timestamp=at))
        tracks.add(track)
    return tracks


def to_truths(result: Any, replicate: int | None = None) -> set[Any]:
    """The ground truth of a result as paths of Stone Soup (`GroundTruthPath`), one per Monte Carlo run and target.

    Args:
        result: A result of `wsnsim.simulate` or `run`, or the path of a result file.
        replicate: The Monte Carlo run; None for all.

    Raises:
        UsageError: Stone Soup is not installed.
    """
    truth = _table(result, "truth", replicate)
    from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState

    names = [name for name in truth.columns if name not in ("replicate", "target", "step", "time")]
    paths = set()
    for (run, target), rows_ in truth.groupby(["replicate", "target"], observed=True):
        path = GroundTruthPath(id=f"{run}/{target}")
        for time, *mean in rows_[["time", *names]].itertuples(index=False):
            path.append(
                GroundTruthState(np.array(mean, float).reshape(-1, 1), timestamp=START + timedelta(seconds=time))
            )
        paths.add(path)
    return paths


def to_detections(result: Any, replicate: int = 0) -> list[tuple[datetime, set[Any]]]:
    """The readings of one Monte Carlo run as detections of Stone Soup, time by time, as its detectors give them.

    Args:
        result: A result of `wsnsim.simulate` or `run` with the table `readings` (`keep=["readings"]`), or its path.
        replicate: The Monte Carlo run.

    Returns:
        (time, detections) of each step. The state vector of a detection has the components of the reading; its metadata
        hold `node`, `target`, and the `x` and `y` (m) at which filters assume the node.

    Raises:
        UsageError: Stone Soup is not installed.
        ResultError: The table `readings` was not recorded.
    """
    readings, nodes = _table(result, "readings", replicate), _table(result, "nodes", replicate)
    from stonesoup.types.detection import Detection

    places = {int(node): (x, y) for node, x, y in nodes[["node", "x_assumed", "y_assumed"]].itertuples(index=False)}
    found: dict[datetime, set[Any]] = {}
    keys = ["time", "target", "node"]
    for (time, target, node), rows_ in readings.groupby(keys, observed=True, sort=True):
        at, (x, y) = START + timedelta(seconds=float(time)), places[int(node)]
        about = {"node": int(node), "target": int(target), "x": float(x), "y": float(y)}
        vector = rows_["reading"].to_numpy(dtype=np.float64).reshape(-1, 1)
        found.setdefault(at, set()).add(Detection(vector, timestamp=at, metadata=about))
    return list(found.items())


def _covariances(result: Any, names: list[str], replicate: int | None) -> dict[tuple[int, int, int], Floats]:
    """{(replicate, target, step): (D, D)}; empty if the table was not recorded."""
    try:
        table = _table(result, "covariances", replicate)
    except ResultError:
        return {}
    columns = [[f"cov_{names[min(i, j)]}_{names[max(i, j)]}" for j in range(len(names))] for i in range(len(names))]
    covs = np.stack([table[row].to_numpy() for row in columns], axis=1)
    keys = table[["replicate", "target", "step"]].itertuples(index=False, name=None)
    return dict(zip(keys, covs, strict=True))


def _table(result: Any, name: str, replicate: int | None) -> Any:
    """A table of a result or of a result file, of one Monte Carlo run or of all; refused without Stone Soup."""
    if not is_installed():
        raise UsageError(MISSING)
    if isinstance(result, str | Path):
        from pandas import DataFrame

        from wsnsim.recording.reader import read_table

        frame = DataFrame(read_table(result, name))
    else:
        frame = result.table(name)
    if name == "estimates" and "target" not in frame:
        raise ResultError("the readings of this result name no target: take its tables estimates and detections")
    return frame if replicate is None else frame[frame["replicate"] == replicate]
