"""What a cluster head foresees, as a cluster policy sees it: the geometry around the predicted target.

An `Outlook` holds the prediction, the models and the nodes; an `Appointment` is what a head announces to its members.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, planar
from wsnsim.base.estimate import Estimate


class NearNodes(NamedTuple):
    """The nodes near a point, as the map of a head has them: those that are down, too.

    Attributes:
        ids: (n,) ascending.
        positions: (n, 2) assumed positions in m.
        traits: (n, T) constants of their sensors.
        able: (n,) whether each is up and holds enough charge to lead.
    """

    ids: Ints
    positions: Floats
    traits: Floats
    able: Bools


NodesNear = Callable[[Floats, float], NearNodes]
"""(point (2,), radius in m) -> the nodes whose assumed position is within the radius of the point."""


@dataclass(frozen=True, slots=True)
class Outlook:
    """What a cluster head foresees when it decides on its cluster.

    Attributes:
        head: the cluster head.
        place: (2,) its assumed position in m.
        members: (m,) the nodes that it takes for members, itself included, whether they sense or not.
        time: the time in s of the next step, for which the forecasts are.
        dt: the length of a step in s.
        forecast: the state predicted for the next step.
        succession: the state from which the next head is chosen; for most trackers the same.
        motion: the motion model that the filter assumes.
        sensor: the sensor model that the filter assumes.
        reach: the communication range in m.
        nodes_near: finds nodes; what it costs depends on how many are near, not on the size of the network.
    """

    head: int
    place: Floats
    members: Ints
    time: float
    dt: float
    forecast: Estimate
    succession: Estimate
    motion: Any
    sensor: Any
    reach: float
    nodes_near: NodesNear

    def path(self, state: Floats, seconds: float) -> Floats:
        """(K, P) the positions that follow from a state (D,) of the next step, at each step of a time to come."""
        return predicted_path(self.motion, state, self.time, self.dt, steps_in(seconds, self.dt))


@dataclass(frozen=True, slots=True)
class Appointment:
    """What a head announces: every node within `radius` of the predicted positions is a member.

    Each node decides by itself: it knows its own assumed position and the motion model.

    Attributes:
        state: (D,) the state predicted for `time`.
        time: in s.
        dt: the length of a step in s.
        steps: the number of predicted positions, that at `time` included.
        radius: in m.
    """

    state: Floats
    time: float
    dt: float
    steps: int
    radius: float

    @property
    def packets(self) -> int:
        """Packets of the announcement: the state, four numbers each, and one of time, steps and radius."""
        return -(-self.state.size // 4) + 1

    def covers(self, positions: Floats, motion: Any) -> Bools:
        """(n,) whether nodes at positions (n, 2) are appointed."""
        path = planar(predicted_path(motion, self.state, self.time, self.dt, self.steps))
        squared = ((positions[:, None, :] - path[None]) ** 2).sum(axis=2)
        near: Bools = (squared <= self.radius**2).any(axis=1)
        return near


def steps_in(seconds: float, dt: float) -> int:
    """The number of steps of `dt` s that begin within a time from one of them on; at least one."""
    return max(1, int(seconds / dt + 1e-9))


def predicted_path(motion: Any, state: Floats, time: float, dt: float, steps: int) -> Floats:
    """(steps, P) the positions of a target without process noise, from its state (D,) at a time in s on."""
    position = list(motion.position)
    moved = np.ascontiguousarray(state, dtype=np.float64).reshape(-1, 1)
    path = np.empty((steps, len(position)))
    for step in range(steps):
        if step:
            moved = motion.advance(moved, dt, time + (step - 1) * dt)
        path[step] = moved[position, 0]
    return path
