"""A tracker: an extended Kalman filter that asks only the nodes near its prediction for their readings.

    python plugin_name.py           checks the rules between tracker and network (wsnsim.testing.check_tracker)
    wsnsim run plugin_name.yaml     runs the scenario beside this file

A tracker's flows are generators: they yield requests, and the network answers with what arrived. Energy, airtime and
loss belong to the network. Replace `step` by a strategy of your own; `wsnsim list trackers` names those that come with
wsnsim.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from wsnsim import Broadcast, Compute, Estimate, Flow, Gather, Member, Parcel, Quantity, Scene, Send, part
from wsnsim.plugins import near, rows

PACKET_BITS = 96
BITS_OF_A_NUMBER = 16
"""With how many bits a number is sent at a handover."""


@part
class PluginTracker:
    """Extended Kalman filter in the cluster head, on the readings of the members near the predicted position.

    At each step the head broadcasts its prediction in one packet. A member answers with its reading if the predicted
    position is within `radius` of it. All readings are linearised at the predicted mean.
    """

    vector_readings: ClassVar[bool] = True
    angles: ClassVar[bool] = True

    radius: Annotated[float, Quantity("m", gt=0), "distance from the prediction within which members answer"] = 40.0

    def start(self, prior: Estimate, scene: Scene) -> Flow[Estimate]:
        """Start a track from its prior; return the belief."""
        return (yield from self.step(prior, scene))

    def step(self, belief: Estimate, scene: Scene) -> Flow[Estimate]:
        """Predict, ask the members near the prediction, and update with what arrives; return the belief."""
        predicted = self.predicted(belief, scene, scene.steps, scene.since)
        place = predicted.mean[list(scene.motion.position)]

        def answer(member: Member) -> Parcel | None:
            """Return what a member sends. It knows its reading, and the prediction if that has arrived."""
            told = [delivery.payload for delivery in member.take_inbox() if delivery.what == "prediction"]
            point = place if member.id == scene.head else told[-1] if told else None
            if member.reading is None or point is None:
                return None
            away = math.dist(member.position[: point.size], point)
            return Parcel(member.reading, 1, PACKET_BITS, "reading") if away <= self.radius else None

        yield Broadcast(Parcel(place, 1, PACKET_BITS, "prediction"))
        heard = yield Gather(answer)
        yield Compute(cycles=2.0 * predicted.mean.size**3 + 50.0 * len(heard))
        if not heard:
            return predicted
        members = [scene.ids.index(node) for node in heard]
        readings = np.array([reading for reading, _ in heard.values()], dtype=np.float64)
        return self.updated(predicted, scene, readings, members)

    def hand_over(self, belief: Estimate, scene: Scene, successor: int) -> Flow[Estimate | None]:
        """Send mean and covariance to the next head; return what arrived, None if the track is lost."""
        size = belief.mean.size
        bits = BITS_OF_A_NUMBER * (size + size * (size + 1) // 2)
        parcel = Parcel(belief, math.ceil(bits / PACKET_BITS), PACKET_BITS, "estimate")
        arrived = yield Send(successor, parcel)
        return belief if np.all(arrived) else None

    def estimate(self, belief: Estimate) -> Estimate:
        """Return the estimate of a belief."""
        return belief

    def forecast(self, belief: Estimate, scene: Scene, ahead: int) -> Estimate:
        """Return the estimate predicted for `ahead` steps later: nodes are woken there, and the next head is near."""
        return self.predicted(belief, scene, ahead, scene.time)

    def predicted(self, belief: Estimate, scene: Scene, steps: int, time: float) -> Estimate:
        """Return the estimate some steps after the time (s) of the belief, by the motion that the filter assumes."""
        mean, cov = belief.mean[:, None], belief.cov
        for step in range(steps):
            now = time + step * scene.dt
            transitions, noise = scene.motion.matrices(mean, scene.dt, now)
            mean = scene.motion.advance(mean, scene.dt, now)
            cov = transitions[0] @ cov @ transitions[0].T + noise
        return Estimate(mean[:, 0], 0.5 * (cov + cov.T))

    def updated(self, predicted: Estimate, scene: Scene, readings: NDArray[np.float64], members: list[int]) -> Estimate:
        """Return the estimate after readings (S,) or (S, M) of these members, linearised at the predicted mean."""
        axes = list(scene.motion.position)
        mean, cov = predicted.mean, predicted.cov
        expected, gradients, variances = scene.sensor.linearise(
            mean[axes][:, None], scene.positions[members], scene.traits[members]
        )
        measured = near(scene.sensor, rows(scene.sensor, readings), expected[:, 0])  # angles: the shortest difference
        slopes = np.zeros((len(measured), mean.size))
        slopes[:, axes] = gradients[:, :, 0]
        innovation_cov = slopes @ cov @ slopes.T + np.diag(variances[:, 0])
        gain = np.linalg.solve(innovation_cov, slopes @ cov).T
        left = np.eye(mean.size) - gain @ slopes
        cov = left @ cov @ left.T + gain * variances[:, 0] @ gain.T  # Joseph form: stays positive definite
        return Estimate(mean + gain @ (measured - expected[:, 0]), 0.5 * (cov + cov.T))


if __name__ == "__main__":
    from wsnsim.testing import check_tracker

    check_tracker(PluginTracker())
    print("plugin_name: keeps the rules of a tracker")
