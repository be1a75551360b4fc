"""A tracker whose head waits for a part of the step, and whose members send nothing that is dear."""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from wsnsim import Compute, Estimate, Gather, Parcel, Quantity, Send, part


@dataclass(frozen=True)
class Fix:
    """The estimate, and how long the readings took that it rests on."""

    estimate: Estimate
    delays: tuple[float, ...] = ()


@part
class Punctual:
    """The centroid of the nodes that are heard in time, weighted by their readings."""

    share: Annotated[float, Quantity("", gt=0, le=1), "share of a step for which the head gathers"] = 0.75
    dearest: Annotated[float, Quantity("", ge=1, le=100), "greatest price of a packet; 1: that beside the head"] = 2.0
    lead: Annotated[
        float, Quantity("s", ge=0, le=100), "time ahead of the target for which the next head is chosen"
    ] = 0.5
    sd: Annotated[float, Quantity("m", gt=0), "standard deviation that it claims"] = 20.0

    def start(self, prior, scene):
        return (yield from self.step(Fix(prior), scene))

    def step(self, belief, scene):
        def answer(member):
            away = np.hypot(*(member.position - scene.head_position))
            price, least = scene.packet_joules(np.array([away, 0.0]))
            if price > self.dearest * least:
                return None
            return Parcel(member.reading, packets=1, packet_bits=96, what="reading")

        heard = yield Gather(answer, deadline=self.share * scene.dt)
        yield Compute(cycles=10 * len(heard))
        rows = [row for row, node in enumerate(scene.ids) if node in heard]
        weights = np.maximum([heard[scene.ids[row]][0] for row in rows], 0.0)
        if weights.sum() <= 0.0:
            return replace(belief, delays=())
        axes = list(scene.motion.position)
        mean, cov = belief.estimate.mean.copy(), belief.estimate.cov.copy()
        mean[axes] = (weights @ scene.positions[rows] / weights.sum())[: len(axes)]
        cov[axes] = cov[:, axes] = 0.0
        cov[axes, axes] = self.sd**2
        return Fix(Estimate(mean, cov), tuple(heard.delays.values()))

    def hand_over(self, belief, scene, successor):
        arrived = yield Send(successor, Parcel(belief.estimate, packets=4, packet_bits=96, what="estimate"))
        return Fix(belief.estimate) if np.all(arrived) else None

    def estimate(self, belief):
        return belief.estimate

    def forecast(self, belief, scene, ahead):
        states = belief.estimate.mean[:, None]
        for step in range(ahead):
            states = scene.motion.advance(states, scene.dt, scene.time + step * scene.dt)
        return Estimate(states[:, 0], belief.estimate.cov)

    def successor_forecast(self, belief, scene, ahead):
        return self.forecast(belief, scene, ahead + round(self.lead / scene.dt))

    def report_state(self, belief):
        return {"delay": np.array(belief.delays)}
