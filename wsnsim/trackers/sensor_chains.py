"""Kalman filters that weigh sensors by the probabilities of a Markov chain: RKF, IMSF.

After Liu, Wang (2012). RKF is one filter that is relayed from sensor to sensor (section 3), IMSF one filter per sensor,
mixed at each step (section 4). The sensors are the nodes that sense (`scene.ids`); in the paper all of them sense at
every step. How sensors that join or leave, and lost packets, are treated is our choice; the docstrings say how.
Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

import numpy as np

from wsnsim.base.arrays import Estimate, Floats, Ints, near
from wsnsim.base.initial_conditions import BlockEstimates, StandaloneBlock
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow, Send
from wsnsim.kernels.relay import filter_each, mix
from wsnsim.trackers.shared.heads import GaussianBelief, HeadFilter
from wsnsim.trackers.shared.moments import predicted
from wsnsim.trackers.shared.readings import (
    Linear,
    arrived_groups,
    arrived_probabilities,
    gather_readings,
    linearised,
    moment_packets,
    number_packets,
    parcel,
)
from wsnsim.trackers.shared.whole_runs import HEAD, Outcome, priors, scenes_of
from wsnsim.trackers.shared.whole_runs import predicted as predicted_runs

LIKELIHOOD_CYCLES = 30.0
"""CPU cycles to linearise one reading and to compute its log-likelihood."""


@dataclass(frozen=True, slots=True)
class ChainBelief(GaussianBelief):
    """Mean, covariance, and the probability (n,) of each of the sensors `ids`."""

    ids: tuple[int, ...] = ()
    probabilities: Floats = field(default_factory=lambda: np.empty(0))


class SensorChain(HeadFilter):
    """The base of filters that weigh sensors by the probabilities of a Markov chain."""

    vector_readings: ClassVar[bool] = False
    relative_readings: ClassVar[bool] = False
    assumes_gaussian: ClassVar[bool] = True

    def report_state(self, belief: ChainBelief) -> dict[str, Floats]:
        """The sensors and their probabilities, for the table `tracker_state`."""
        return {"node": np.array(belief.ids, dtype=np.float64), "probability": belief.probabilities}


@part
class RelayKalman(SensorChain):
    """One (extended) Kalman filter in the head that weights every reading by the probability that it is the target's.

    P⁺ is that of eq. 14; `spread` adds the spread of the updated means, which the paper leaves out. A sensor that joins
    gets probability 0. A sensor that no longer senses is removed, and the others are renormalised. If a reading is
    lost, its sensor keeps the predicted probability, and the others share the remainder by their likelihoods; without
    any reading all keep the predicted ones. Missed steps are steps of the chain. (All our choice: in the paper every
    sensor has a reading at each step.)

    Source: Liu, Wang (2012), eqs. 8-20.
    """

    stay: Annotated[float, Quantity("", ge=0, le=1), "diagonal of M; the other entries are equal"] = 0.93
    spread: Annotated[bool, "whether the covariance includes the spread of the updated means"] = False

    def start(self, prior: Estimate, scene: Scene) -> Flow[ChainBelief]:
        """The prior, with equal probabilities of the sensors."""
        return ChainBelief(
            prior.mean, prior.cov, scene.head, ids=scene.ids, probabilities=carried((), np.empty(0), scene.ids)
        )
        yield  # a flow without requests

    def step(self, belief: ChainBelief, scene: Scene) -> Flow[ChainBelief]:
        """One step: N_act - 1 readings reach the head, which predicts and updates; with none, it predicts."""
        readings = yield from chain_readings(scene)
        yield Compute(self._cycles(belief.mean.size, len(scene.motion.position), scene.active, scene.steps))
        mean, cov = predicted(belief.mean, belief.cov, scene)
        chances = carried(belief.ids, belief.probabilities, scene.ids)
        if scene.ids:
            chances = chances.copy()
            place = np.array(scene.motion.position)
            linear = linearised(mean[place, None], scene.sensor, scene.positions, scene.traits)
            readings = near(scene.sensor, readings, linear[0][:, 0])
            mean, cov = self._updated(mean, cov, chances, readings, linear, place, scene.steps)
        return ChainBelief(mean, cov, scene.head, ids=scene.ids, probabilities=chances)

    def whole_runs(self, block: StandaloneBlock) -> BlockEstimates:
        """All steps of many standalone runs: `WholeRuns`."""
        outcome, motion, dt = Outcome(block), block.motion, block.dt
        place = np.array(motion.position)
        (means, covs), ids = priors(block), [heard.ids(0) for heard in outcome.heard]
        chances = [carried((), np.empty(0), now) for now in ids]
        for step in range(1, block.steps + 1):
            means, covs = predicted_runs(means, covs, motion, dt, (step - 1) * dt)
            for run, heard in enumerate(outcome.heard):
                before, ids[run] = ids[run], heard.ids(step)
                chances[run] = carried(before, chances[run], ids[run]).copy()
            for run, readings, linear in outcome.linearised(means[:, place], block.sensor, step):
                means[run], covs[run] = self._updated(means[run], covs[run], chances[run], readings, linear, place, 1)
            outcome.means[:, step - 1], outcome.covs[:, step - 1] = means, covs
        return outcome.closed(outcome.sums(lambda count: self._cycles(len(motion.columns), place.size, count, 1)))

    def _updated(
        self, mean: Floats, cov: Floats, chances: Floats, readings: Floats, linear: Linear, place: Ints, steps: int
    ) -> tuple[Floats, Floats]:
        """Mean and covariance with the readings; the probabilities in place. Each sensor starts from the prediction."""
        size, count = mean.size, readings.size
        means, covs = np.repeat(mean[:, None], count, axis=1), np.repeat(cov[:, :, None], count, axis=2)
        stay, predicted_already = stay_after(self.stay, count, steps), np.empty((size, size, 0))
        mean, cov = np.empty(size), np.empty((size, size))
        filter_each(
            means, covs, chances, predicted_already, cov, *linear, readings, place, stay, self.spread, mean, cov
        )
        return mean, cov

    def hand_over(self, belief: ChainBelief, scene: Scene, successor: int) -> Flow[ChainBelief | None]:
        """The packets of mean and covariance, and ceil(n / 4) of probabilities. Without all of the former, nothing.

        Probabilities that are lost share what is missing to one. The new head takes them by the rule of sensors that
        join and drop out.
        """
        first = moment_packets(belief.mean.size)
        packets = first + number_packets(len(belief.ids))
        payload = (belief.mean, belief.cov, belief.ids, belief.probabilities)
        mask = yield Send(successor, parcel(payload, packets, "handover"))
        if not mask[:first].all():
            return None
        chances = arrived_probabilities(belief.probabilities, mask[first:])
        return ChainBelief(belief.mean, belief.cov, successor, ids=belief.ids, probabilities=chances)

    def _cycles(self, size: int, place: int, sensors: int, steps: int) -> float:
        """Operations of a step: those of the prediction, and those of the update a sensor."""
        prediction = steps * (4.0 * size**3 + 2.0 * size**2)  # eqs. 15, 17
        chain = 2.0 * sensors + 4.0  # eqs. 18, 20: a product and a sum of n, and their quotient
        innovation = 2.0 * place * size + 2.0 * place + LIKELIHOOD_CYCLES  # eqs. 12, 13, 19
        update = 3.0 * size + 8.0 * size**2  # eqs. 10, 11; 14 in Joseph's form
        return prediction + sensors * (chain + innovation + update + (3.0 * size**2 if self.spread else 0.0))


@dataclass(frozen=True, slots=True)
class InteractingBelief(ChainBelief):
    """The mixture's moments, and those of each sensor's filter: means (D, n), covariances (D, D, n)."""

    means: Floats = field(default_factory=lambda: np.empty((0, 0)))
    covs: Floats = field(default_factory=lambda: np.empty((0, 0, 0)))


@part
class InteractingKalman(SensorChain):
    """One filter per sensor in the head: each starts from a mixture of all, predicts, and updates with its own reading.

    `mixing: printed` sums the covariances of eq. 23 without their weights, as printed: without readings they grow
    n-fold per step up to a limit of 1e12 (our choice), and the track is soon lost. `corrected` weights them.

    The filter of a sensor that joins starts from the mixture, with probability 0. A sensor that no longer senses is
    removed with its filter, and the other probabilities are renormalised. If a reading is lost, its sensor keeps the
    predicted probability and its filter only predicts; the others share the remainder by their likelihoods. While no
    sensor senses, the mixture predicts as one Gaussian. Missed steps are mixed and predicted. (All our choice: in the
    paper every sensor has a reading at each step.)

    Source: Liu, Wang (2012), eqs. 18-25.
    """

    stay: Annotated[float, Quantity("", ge=0, le=1), "diagonal of M; the other entries are equal"] = 0.93
    mixing: Annotated[Literal["corrected", "printed"], "whether eq. 23 weights the covariances"] = "corrected"

    def start(self, prior: Estimate, scene: Scene) -> Flow[InteractingBelief]:
        """The prior in every filter, with equal probabilities of the sensors."""
        return _with_filters(InteractingBelief(prior.mean, prior.cov, scene.head), scene)
        yield  # a flow without requests

    def step(self, belief: InteractingBelief, scene: Scene) -> Flow[InteractingBelief]:
        """One step: N_act - 1 readings reach the head; its filters mix, predict, and update with one reading each."""
        readings = yield from chain_readings(scene)
        yield Compute(self._cycles(belief.mean.size, len(scene.motion.position), scene.active, scene.steps))
        belief = _with_filters(belief, scene)
        if not belief.ids:
            return InteractingBelief(*predicted(belief.mean, belief.cov, scene), scene.head)
        return self._filtered(belief, readings, scene)

    def whole_runs(self, block: StandaloneBlock) -> BlockEstimates:
        """All steps of many standalone runs: `WholeRuns`. The filters of each run by themselves."""
        outcome, motion = Outcome(block), block.motion
        for run, given in enumerate(block.runs):
            scenes = scenes_of(block, outcome.heard[run])
            belief = InteractingBelief(given.prior.mean, given.prior.cov, HEAD)
            belief = _with_filters(belief, next(scenes))
            for scene in scenes:
                row, belief = scene.step - 1, _with_filters(belief, scene)
                if belief.ids:
                    belief = self._filtered(belief, outcome.heard[run].at(scene.step)[0], scene)
                else:
                    belief = InteractingBelief(*predicted(belief.mean, belief.cov, scene), HEAD)
                outcome.means[run, row], outcome.covs[run, row] = belief.mean, belief.cov
        size, place = len(motion.columns), len(motion.position)
        return outcome.closed(outcome.sums(lambda count: self._cycles(size, place, count, 1)))

    def _filtered(self, belief: InteractingBelief, readings: Floats, scene: Scene) -> InteractingBelief:
        """The belief as the scene's steps have passed: in each, mix and predict; in the last, with the readings."""
        motion, place, printed = scene.motion, np.array(scene.motion.position), self.mixing == "printed"
        means, covs, chances = belief.means, belief.covs, belief.probabilities.copy()
        mean, cov = belief.mean.copy(), belief.cov.copy()
        for step in range(scene.steps):
            now = scene.since + step * scene.dt
            mixed, spreads = np.empty(means.shape), np.empty(covs.shape)
            mix(means, covs, chances, self.stay, printed, mixed, spreads)
            transitions, noise = motion.matrices(mixed, scene.dt, now)
            each = np.array(transitions.transpose(1, 2, 0), order="C")
            means, covs = np.ascontiguousarray(motion.advance(mixed, scene.dt, now)), spreads
            linear = linearised(means[place], scene.sensor, scene.positions, scene.traits)
            heard = readings if step == scene.steps - 1 else np.full(readings.size, np.nan)
            heard = near(scene.sensor, heard, np.diagonal(linear[0]))
            filter_each(means, covs, chances, each, noise, *linear, heard, place, self.stay, True, mean, cov)
        return InteractingBelief(mean, cov, scene.head, ids=belief.ids, means=means, covs=covs, probabilities=chances)

    def hand_over(self, belief: InteractingBelief, scene: Scene, successor: int) -> Flow[InteractingBelief | None]:
        """The packets of n means and covariances, and ceil(n / 4) of probabilities; the filters that arrived whole.

        Probabilities that are lost share what is missing to one; those of the filters that arrived are renormalised.
        Without a filter there is no track. If no node sensed, only the mixture's moments are sent; all must arrive.
        """
        each, count = moment_packets(belief.mean.size), len(belief.ids)
        if not count:
            mask = yield Send(successor, parcel((belief.mean, belief.cov), each, "handover"))
            return InteractingBelief(belief.mean, belief.cov, successor) if mask.all() else None
        packets = count * each + number_packets(count)
        payload = (belief.ids, belief.means, belief.covs, belief.probabilities)
        mask = yield Send(successor, parcel(payload, packets, "handover"))
        whole = arrived_groups(mask, count, each)
        if not whole.any():
            return None
        chances = arrived_probabilities(belief.probabilities, mask[count * each :])
        ids = tuple(node for node, arrived in zip(belief.ids, whole, strict=True) if arrived)
        chances = carried(belief.ids, chances, ids)
        means, covs = (np.ascontiguousarray(moments[..., whole]) for moments in (belief.means, belief.covs))
        mean = means @ chances  # eqs. 24, 25
        around = means - mean[:, None]
        cov = covs @ chances + (around * chances) @ around.T
        return InteractingBelief(mean, cov, successor, ids=ids, means=means, covs=covs, probabilities=chances)

    def _cycles(self, size: int, place: int, sensors: int, steps: int) -> float:
        """Operations of a step, those of one filter times n; without filters, the prediction of the mixture."""
        square = size**2
        prediction = 4.0 * size**3 + 2.0 * square  # eqs. 15, 17
        if not sensors:
            return steps * prediction
        chain = 2.0 * sensors  # eq. 20
        mixing = sensors * (2.0 + 2.0 * size + size + 4.0 * square)  # eqs. 21, 22, 23
        innovation = 2.0 * place * size + 2.0 * place + LIKELIHOOD_CYCLES  # eqs. 12, 13, 19
        update = 3.0 * size + 8.0 * square + 4.0  # eqs. 10, 11; 14 in Joseph's form; 18
        mixture = 3.0 * size + 4.0 * square  # eqs. 24, 25
        return sensors * (steps * (chain + mixing + prediction) + innovation + update + mixture)


def _with_filters(belief: InteractingBelief, scene: Scene) -> InteractingBelief:
    """The belief with the filters of those who sense now; one that joins starts from the mixture."""
    if belief.ids == scene.ids:
        return belief
    row = {node: i for i, node in enumerate(belief.ids)}
    rows = [row.get(node) for node in scene.ids]
    size = belief.mean.size
    means, covs = np.empty((size, len(rows))), np.empty((size, size, len(rows)))
    for i, old in enumerate(rows):
        means[:, i] = belief.mean if old is None else belief.means[:, old]
        covs[..., i] = belief.cov if old is None else belief.covs[..., old]
    chances = carried(belief.ids, belief.probabilities, scene.ids)
    return InteractingBelief(
        belief.mean, belief.cov, scene.head, ids=scene.ids, means=means, covs=covs, probabilities=chances
    )


def chain_readings(scene: Scene) -> Flow[Floats]:
    """Readings (n,) of the sensors `scene.ids`: one packet per member, NaN for a lost one."""
    seen = yield from gather_readings(scene)
    if seen.ids == scene.ids:
        return seen.readings
    arrived = dict(zip(seen.ids, seen.readings.tolist(), strict=True))
    return np.array([arrived.get(node, np.nan) for node in scene.ids], dtype=np.float64)


def carried(ids: tuple[int, ...], probabilities: Floats, now: tuple[int, ...]) -> Floats:
    """Carry the probabilities of the last step over to the sensors (n,) that sense `now`, before the Markov step.

    A sensor that joins gets probability 0. One that no longer senses is removed, and the others are renormalised, or
    made equal if they are all zero. If no sensor remains, as at the start, all probabilities are equal.
    """
    if ids == now or not now:
        return probabilities if ids == now else np.empty(0)
    before = dict(zip(ids, probabilities.tolist(), strict=True))
    result = np.array([before.get(node, 0.0) for node in now])
    total = float(result.sum())
    if total > 0.0:
        return result / total
    stayed = np.array([node in before for node in now], dtype=np.float64)
    return stayed / stayed.sum() if stayed.any() else np.full(len(now), 1.0 / len(now))


def stay_after(stay: float, sensors: int, steps: int) -> float:
    """The probability of staying after several steps: the diagonal of Mˢ, whose other entries are equal again.

    M = c I + (1 - c) 1 1ᵀ / n with c = stay - (1 - stay) / (n - 1), so that Mˢ has cˢ instead of c.
    """
    if sensors < 2:
        return 1.0
    if steps == 1:
        return stay
    kept = (stay - (1.0 - stay) / (sensors - 1)) ** steps
    return kept + (1.0 - kept) / sensors
