"""RKF: one Kalman filter that is relayed from sensor to sensor by the probabilities of a Markov chain.

After Liu, Wang (2012), section 3. Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.arrays import Estimate, Floats, Ints, near
from wsnsim.base.initial_conditions import BlockEstimates, StandaloneBlock
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow, Send
from wsnsim.kernels.relay import filter_each
from wsnsim.trackers.shared.heads import GaussianBelief, HeadFilter
from wsnsim.trackers.shared.moments import predicted
from wsnsim.trackers.shared.readings import (
    LIKELIHOOD_CYCLES,
    Linear,
    arrived_probabilities,
    carried,
    chain_readings,
    linearised,
    moment_packets,
    parcel,
    stay_after,
    weight_packets,
)
from wsnsim.trackers.shared.whole_runs import Outcome, priors
from wsnsim.trackers.shared.whole_runs import predicted as predicted_runs


@dataclass(frozen=True, slots=True)
class RelayBelief(GaussianBelief):
    """Mean, covariance, and the probability (n,) of each of the sensors `ids`."""

    ids: tuple[int, ...] = ()
    probabilities: Floats = field(default_factory=lambda: np.empty(0))


@part
class RelayKalman(HeadFilter):
    """One (extended) Kalman filter in the head that weights every reading by the probability that it is the target's.

    P⁺ is that of eq. 14; `spread` adds the spread of the updated means, which the paper leaves out. A sensor that joins
    gets probability 0. A sensor that no longer senses is removed, and the others are renormalised. If a reading is
    lost, its sensor keeps the predicted probability, and the others share the remainder by their likelihoods; without
    any reading all keep the predicted ones. Missed steps are steps of the chain. (All our choice: in the paper every
    sensor has a reading at each step.)

    Source: Liu, Wang (2012), eqs. 8-20.
    """

    vector_readings: ClassVar[bool] = False

    stay: Annotated[float, Quantity("", ge=0, le=1), "diagonal of M; the other entries are equal"] = 0.93
    spread: Annotated[bool, "whether the covariance includes the spread of the updated means"] = False

    def start(self, prior: Estimate, scene: Scene) -> Flow[RelayBelief]:
        """The prior, with equal probabilities of the sensors."""
        return RelayBelief(
            prior.mean, prior.cov, scene.head, ids=scene.ids, probabilities=carried((), np.empty(0), scene.ids)
        )
        yield  # a flow without requests

    def step(self, belief: RelayBelief, scene: Scene) -> Flow[RelayBelief]:
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
        return RelayBelief(mean, cov, scene.head, ids=scene.ids, probabilities=chances)

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

    def hand_over(self, belief: RelayBelief, scene: Scene, successor: int) -> Flow[RelayBelief | None]:
        """The packets of mean and covariance, and ceil(n / 4) of probabilities. Without all of the former, nothing.

        Probabilities that are lost share what is missing to one. The new head takes them by the rule of sensors that
        join and drop out.
        """
        first = moment_packets(belief.mean.size)
        packets = first + weight_packets(len(belief.ids))
        payload = (belief.mean, belief.cov, belief.ids, belief.probabilities)
        mask = yield Send(successor, parcel(payload, packets, "handover"))
        if not mask[:first].all():
            return None
        chances = arrived_probabilities(belief.probabilities, mask[first:])
        return RelayBelief(belief.mean, belief.cov, successor, ids=belief.ids, probabilities=chances)

    def report_state(self, belief: RelayBelief) -> dict[str, Floats]:
        """The sensors and their probabilities, for the table `tracker_state`."""
        return {"node": np.array(belief.ids, dtype=np.float64), "probability": belief.probabilities}

    def _cycles(self, size: int, place: int, sensors: int, steps: int) -> float:
        """Operations of a step: those of the prediction, and those of the update a sensor."""
        prediction = steps * (4.0 * size**3 + 2.0 * size**2)  # eqs. 15, 17
        chain = 2.0 * sensors + 4.0  # eqs. 18, 20: a product and a sum of n, and their quotient
        innovation = 2.0 * place * size + 2.0 * place + LIKELIHOOD_CYCLES  # eqs. 12, 13, 19
        update = 3.0 * size + 8.0 * size**2  # eqs. 10, 11; 14 in Joseph's form
        return prediction + sensors * (chain + innovation + update + (3.0 * size**2 if self.spread else 0.0))
