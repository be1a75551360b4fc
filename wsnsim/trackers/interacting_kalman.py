"""IMSF: one Kalman filter per sensor, mixed at each step by the probabilities of a Markov chain over the sensors.

After Liu, Wang (2012), section 4. Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

import numpy as np

from wsnsim.base.arrays import Estimate, Floats, near
from wsnsim.base.initial_conditions import BlockEstimates, StandaloneBlock
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow, Send
from wsnsim.kernels.relay import filter_each, mix
from wsnsim.trackers.shared.heads import GaussianBelief, HeadFilter
from wsnsim.trackers.shared.moments import predicted
from wsnsim.trackers.shared.readings import (
    LIKELIHOOD_CYCLES,
    arrived_groups,
    arrived_probabilities,
    carried,
    chain_readings,
    linearised,
    moment_packets,
    parcel,
    weight_packets,
)
from wsnsim.trackers.shared.whole_runs import HEAD, Outcome, scenes_of


@dataclass(frozen=True, slots=True)
class InteractingBelief(GaussianBelief):
    """The mixture's moments; means (D, n), covariances (D, D, n) and probabilities (n,) of the sensors `ids`."""

    ids: tuple[int, ...] = ()
    means: Floats = field(default_factory=lambda: np.empty((0, 0)))
    covs: Floats = field(default_factory=lambda: np.empty((0, 0, 0)))
    probabilities: Floats = field(default_factory=lambda: np.empty(0))


@part
class InteractingKalman(HeadFilter):
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

    vector_readings: ClassVar[bool] = False

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
        packets = count * each + weight_packets(count)
        payload = (belief.ids, belief.means, belief.covs, belief.probabilities)
        mask = yield Send(successor, parcel(payload, packets, "handover"))
        whole = arrived_groups(mask, count, each)
        if not whole.any():
            return None
        chances = arrived_probabilities(belief.probabilities, mask[count * each :])
        ids = tuple(node for node, arrived in zip(belief.ids, whole, strict=True) if arrived)
        chances = carried(belief.ids, chances, ids)
        means, covs = (np.ascontiguousarray(moments[..., whole]) for moments in (belief.means, belief.covs))
        mean, cov = _mixture(means, covs, chances)
        return InteractingBelief(mean, cov, successor, ids=ids, means=means, covs=covs, probabilities=chances)

    def report_state(self, belief: InteractingBelief) -> dict[str, Floats]:
        """The sensors and their probabilities, for the table `tracker_state`."""
        return {"node": np.array(belief.ids, dtype=np.float64), "probability": belief.probabilities}

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


def _mixture(means: Floats, covs: Floats, chances: Floats) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) of all filters, eqs. 24, 25."""
    mean: Floats = means @ chances
    around = means - mean[:, None]
    return mean, covs @ chances + (around * chances) @ around.T
