"""Association by global nearest neighbour and JPDA beside Stone Soup's, on the same scans (`make peers`)."""

from __future__ import annotations

import time
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from tests.helpers.target_scans import driven, facts_of, prior_of, ring, scans_of, straight
from tests.trackers.test_peers import peer
from wsnsim.kernels.association import associate
from wsnsim.models.linear import ConstantVelocity
from wsnsim.models.ranging import Range
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.multi_target.management import KnownTargets
from wsnsim.trackers.multi_target.single_gaussian import Gnn, Jpda

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::SyntaxWarning")
BEGIN = datetime(2026, 1, 1)
INTENSITY = 0.05
MOTION = ConstantVelocity(noise_input="direct", variances=(1e-9, INTENSITY, 1e-9, INTENSITY))
SENSOR, GATE = Range(sd=1.0, reach=1e4), 0.9999
FIVE = [
    [-20.0, 1.0, 0.0, 0.5],
    [20.0, -1.0, 3.0, 0.3],
    [0.0, 0.5, 20.0, -1.0],
    [5.0, 0.0, -15.0, 1.0],
    [0.0, 1.0, 0.0, 0.0],
]


class StoneSoup:
    """Its trackers of the same scans: extended filters, known starts, one sensor after the other."""

    def __init__(self, nodes: Any, facts: Any, joint: bool) -> None:
        base, linear = peer("stonesoup.base"), peer("stonesoup.models.transition.linear")
        nonlinear, array = peer("stonesoup.models.measurement.nonlinear"), peer("stonesoup.types.array")
        hypothesiser = peer("stonesoup.hypothesiser.probability").PDAHypothesiser

        class RangeTo(nonlinear.NonLinearGaussianMeasurement):
            node: Any = base.Property(doc="Position of the node")

            @property
            def ndim_meas(self) -> int:
                return 1

            def function(self, state: Any, noise: Any = False, **_: Any) -> Any:
                apart = np.asarray(state.state_vector, dtype=float)[[0, 2], 0] - self.node
                return array.StateVector([[np.hypot(*apart)]])

            def jacobian(self, state: Any, **_: Any) -> np.ndarray:
                apart = np.asarray(state.state_vector, dtype=float)[[0, 2], 0] - self.node
                result = np.zeros((1, 4))
                result[0, [0, 2]] = apart / np.hypot(*apart)
                return result

            def rvs(self, num_samples: int = 1, **_: Any) -> Any:
                raise NotImplementedError

            def pdf(self, *_: Any, **__: Any) -> Any:
                raise NotImplementedError

        axis = np.array([[1.0, 1.0], [0.0, 1.0]])
        moving = linear.LinearGaussianTimeInvariantTransitionModel(
            transition_matrix=np.kron(np.eye(2), axis), covariance_matrix=np.diag(MOTION.variances)
        )
        self.models = {
            node: RangeTo(ndim_state=4, mapping=(0, 2), noise_covar=np.array([[SENSOR.sd**2]]), node=position)
            for node, position in zip(nodes.ids, nodes.positions, strict=True)
        }
        self.predictor = peer("stonesoup.predictor.kalman").KalmanPredictor(moving)
        self.updater = peer("stonesoup.updater.kalman").ExtendedKalmanUpdater(measurement_model=None)
        pairs = hypothesiser(
            predictor=None, updater=self.updater, clutter_spatial_density=facts.clutter / facts.volume,
            prob_detect=facts.probability, prob_gate=GATE, normalise=joint,
        )  # fmt: skip
        pairs.predictor = self
        probabilistic = peer("stonesoup.dataassociator.probability").JPDA
        nearest = peer("stonesoup.dataassociator.neighbour").GNNWith2DAssignment
        self.pairs, self.joint = pairs, joint
        self.associator = probabilistic(pairs) if joint else nearest(self)

    def predict(self, track: Any, timestamp: Any = None, **_: Any) -> Any:
        """The prediction of a track, which is predicted once a step."""
        prediction = peer("stonesoup.types.prediction").GaussianStatePrediction
        state = track[-1]
        return prediction(state.state_vector, state.covar, timestamp=timestamp)

    def hypothesise(self, track: Any, detections: Any, timestamp: Any, **_: Any) -> Any:
        """Hypotheses of its own hypothesiser with minus the log-probability as distance: it maximises the product.

        With the probabilities themselves, its nearest neighbour would maximise their sum.
        """
        several = peer("stonesoup.types.multihypothesis").MultipleHypothesis
        single = peer("stonesoup.types.hypothesis").SingleDistanceHypothesis
        found = self.pairs.hypothesise(track, detections, timestamp)
        return several([
            single(one.prediction, one.measurement, -float(np.log(float(one.probability))), one.measurement_prediction)
            for one in found
        ])  # fmt: skip

    def tracked(self, priors: Any, every: Any) -> tuple[np.ndarray, list[np.ndarray]]:
        """Positions (K, T, 2) after each step, and the association probabilities (T, M + 1) of each scan."""
        types, array = peer("stonesoup.types.state"), peer("stonesoup.types.array")
        detection, track = peer("stonesoup.types.detection").Detection, peer("stonesoup.types.track").Track
        tracks = [
            track([types.GaussianState(array.StateVector(prior.mean[:, None]), prior.cov, timestamp=BEGIN)])
            for prior in priors
        ]
        places, shares = [], []
        for scans in every:
            now = BEGIN + timedelta(seconds=scans[0].time)
            for each in tracks:
                each.append(self.predictor.predict(each[-1], timestamp=now))
            for scan in sorted(scans, key=lambda scan: scan.node):
                values = np.sort(scan.detections[:, 0])
                made = [
                    detection(array.StateVector([[value]]), timestamp=now, measurement_model=self.models[scan.node])
                    for value in values
                ]
                found = self.associator.associate(set(tracks), set(made), now)
                shares.append(np.zeros((len(tracks), len(made) + 1)))
                for row, each in enumerate(tracks):
                    for one in found[each] if self.joint else [found[each]]:
                        shares[-1][row, 1 + made.index(one.measurement) if one else 0] = (
                            float(one.probability) if self.joint else 1.0
                        )
                    each.append(self.updated(found[each]))
            places.append([np.asarray(each[-1].state_vector, dtype=float)[[0, 2], 0] for each in tracks])
        return np.array(places), shares

    def updated(self, hypothesis: Any) -> Any:
        """The state after a hypothesis, or the moments of the mixture over several."""
        if not self.joint:
            return self.updater.update(hypothesis) if hypothesis else hypothesis.prediction
        reduce, array = peer("stonesoup.functions").gm_reduce_single, peer("stonesoup.types.array")
        states = [self.updater.update(one) if one else one.prediction for one in hypothesis]
        means = array.StateVectors([state.state_vector for state in states])
        mean, cov = reduce(
            means,
            np.stack([state.covar for state in states], axis=2),
            np.array([float(one.probability) for one in hypothesis]),
        )
        return peer("stonesoup.types.state").GaussianState(mean, cov, timestamp=states[0].timestamp)


def cases(seed: int, steps: int, sensors: int) -> tuple[Any, Any, Any, Any, Any]:
    """Nodes, facts, truth, priors and scans of a run with five targets."""
    nodes, rng = ring(sensors), np.random.default_rng(seed)
    facts = facts_of(SENSOR, MOTION, probability=0.9, clutter=2.0, volume=150.0)
    truth = straight(FIVE, steps)
    every = [scans_of(truth, step, nodes, facts, rng, 0.0, 150.0) for step in range(1, steps + 1)]
    return nodes, facts, truth, [prior_of(state, rng=rng) for state in truth[0]], every


def ours(method: Any, nodes: Any, facts: Any, priors: Any, every: Any) -> tuple[np.ndarray, list[np.ndarray]]:
    """Positions (K, T, 2) and association probabilities of our tracker."""
    tracker, noted = method(filter=ExtendedKalman(), management=KnownTargets(), gate=GATE), []
    plain = method.associated
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(method, "associated", lambda *given: noted.append(plain(*given)) or noted[-1])
        belief = tracker.begin(priors, 0.0, facts)
        steps = [outcome.belief for outcome in driven(tracker, belief, every, nodes, facts)]
    places = [[one.mean[[0, 2]] for one in tracker.estimates(belief, facts)] for belief in steps]
    return np.array(places), noted


@pytest.mark.parametrize("method", [Gnn, Jpda])
def test_the_probabilities_of_a_scan_are_those_of_stone_soup(method: Any) -> None:
    """Those of the first sensor of a step: later ones start from other linearisations."""
    for seed in range(20):
        nodes, facts, _, priors, every = cases(seed, 1, 1)
        _, theirs = StoneSoup(nodes, facts, method is Jpda).tracked(priors, every)
        _, mine = ours(method, nodes, facts, priors, every)
        assert mine[0] == pytest.approx(theirs[0], abs=1e-6)


def test_belief_propagation_ends_at_the_fixed_point_of_stone_soup() -> None:
    theirs, rng = peer("stonesoup.dataassociator.probability").JPDAwithLBP, np.random.default_rng(1)
    for _ in range(50):
        tracks, count = rng.integers(2, 7, 2)
        ratios = rng.exponential(2.0, (tracks, count))
        found = theirs._loopy_belief_propagation(np.column_stack([np.ones(tracks), ratios]), 2000, 1e-3)
        assert associate(ratios, np.ones(tracks), np.ones(count), 0) == pytest.approx(found, abs=1e-6)


def mean_gospa(places: np.ndarray, truth: np.ndarray, cutoff: float = 10.0) -> float:
    """The mean over steps of GOSPA (p = α = 2) of as many tracks as targets."""
    values = []
    for estimates, targets in zip(places, truth[1:, :, [0, 2]], strict=True):
        costs = np.minimum(((estimates[:, None] - targets[None]) ** 2).sum(axis=-1), cutoff**2)
        values.append(np.sqrt(costs[linear_sum_assignment(costs)].sum()))
    return float(np.mean(values))


@pytest.mark.thorough
@pytest.mark.parametrize("method", [Gnn, Jpda])
def test_mean_gospa_is_that_of_stone_soup_at_fifty_times_its_speed(method: Any) -> None:
    errors, seconds = np.zeros((50, 2)), np.zeros(2)
    for seed in range(-1, 50):  # the first one compiles
        nodes, facts, truth, priors, every = cases(seed % 1000, 8, 10)
        begun = time.process_time()
        mine, _ = ours(method, nodes, facts, priors, every)
        between = time.process_time()
        theirs, _ = StoneSoup(nodes, facts, method is Jpda).tracked(priors, every)
        if seed >= 0:
            seconds += between - begun, time.process_time() - between
            errors[seed] = mean_gospa(mine, truth), mean_gospa(theirs, truth)
    own, other = errors.mean(axis=0)
    ratio = seconds[1] / seconds[0]
    print(f"{method.__name__}: mean GOSPA {own:.3f} m, Stone Soup {other:.3f} m; {ratio:.0f} times as fast")
    assert own == pytest.approx(other, rel=0.05)
    assert ratio > 50.0
