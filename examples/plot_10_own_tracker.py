"""
A tracker of one's own
======================

The estimate is the centroid of the nodes that sense the target, weighted by what they hear. The class is passed to the
simulation as an object. It is simple, and far from the Kalman filter that has the same packets.
"""

import matplotlib.pyplot as plt
import numpy as np

import wsnsim
from wsnsim import Compute, GatherReadings, part
from wsnsim.plugins import GaussianBelief, HeadFilter


@part
class Centroid(HeadFilter):
    """The centroid of the nodes that sense the target, weighted by their measurements."""

    def step(self, belief, scene):
        heard = yield GatherReadings()
        yield Compute(cycles=10 * len(heard.ids))
        mean, weights = belief.mean.copy(), np.maximum(heard.values, 0.0)
        if weights.sum() > 0.0:
            where = [scene.ids.index(node) for node in heard.ids]
            mean[list(scene.motion.position)] = weights @ scene.positions[where] / weights.sum()
        return GaussianBelief(mean, belief.cov, scene.head)


figure, axes = plt.subplots(figsize=(6.5, 3.8), layout="constrained")
for name, tracker in {"Centroid": Centroid(), "ekf": "ekf"}.items():
    estimates = wsnsim.simulate("jiang_field", tracker=tracker, duration="10 s").estimates
    axes.semilogy(estimates["time"], estimates["error"], label=name)
axes.set(xlabel="time [s]", ylabel="position error [m]")
axes.legend()
plt.show()
