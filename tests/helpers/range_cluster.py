"""A target on a given path, and nodes that read its distance: for trackers that fix it anew at each step."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.helpers.linear_cluster import Cluster
from wsnsim.base.arrays import Estimate
from wsnsim.base.requests import Compute, GatheredReadings, GatherReadings, Send
from wsnsim.models.linear import ConstantVelocity
from wsnsim.models.ranging import Range

SHARP = Range(sd=1e-6, reach=1e4)


def straight(start: tuple[float, float], velocity: tuple[float, float], steps: int, dt: float) -> np.ndarray:
    """(steps + 1, 4) of px vx py vy."""
    times = dt * np.arange(steps + 1)
    columns = [start[0] + velocity[0] * times, np.full(steps + 1, velocity[0]), start[1] + velocity[1] * times]
    return np.stack([*columns, np.full(steps + 1, velocity[1])], axis=1)


class Chase(Cluster):
    """Nodes 100, 101, ... at the given places, the first of them the head; a step takes `dt` s."""

    def __init__(self, path: np.ndarray, places: Any, sensor: Any = SHARP, dt: float = 2.0, seed: int = 0) -> None:
        super().__init__(len(places), ConstantVelocity(noise_input="diagonal", variances=(0.1,)), sensor, seed)
        self.truth, self.positions, self.dt = path, np.array(places, dtype=float), dt
        self.renew()

    @property
    def prior(self) -> Estimate:
        return Estimate(self.truth[0], np.diag([25.0, 9.0, 25.0, 9.0]))

    def follow(self, tracker: Any, steps: int) -> Any:
        """The belief after so many steps with all readings."""
        belief, _ = self.drive(tracker.start(self.prior, self.scene(0)))
        for step in range(1, steps + 1):
            belief, _ = self.drive(tracker.step(belief, self.scene(step)))
        return belief


def asked(flow: Any, answer: Any = None) -> tuple[Any, list[Any]]:
    """A flow's result and its asks; a Send is answered with `answer`. No reading arrives, and nothing is carried."""
    asks: list[Any] = []
    reply = None
    while True:
        try:
            ask = flow.send(reply)
        except StopIteration as end:
            return end.value, asks
        asks.append(ask)
        assert isinstance(ask, Compute | GatherReadings | Send)
        reply = (
            GatheredReadings.of({}) if isinstance(ask, GatherReadings) else answer if isinstance(ask, Send) else None
        )
