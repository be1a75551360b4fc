"""Ports of the network: deployments, routing, workloads, sinks, injected faults and cluster policies.

Frozen `@part` classes implement them. A cluster policy decides on an `Outlook`: where the target will be, and which
nodes are there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol, runtime_checkable

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats, Ints, planar

LEAST_SIDE: Final = 1.0
"""Least side (m) of a field that is derived from the positions of the nodes, as with one node or nodes on a line."""


@dataclass(frozen=True, slots=True)
class Field:
    """The monitored rectangle.

    Attributes:
        width: along x, in m.
        height: along y, in m.
        centre: (x, y) in m.
    """

    width: float
    height: float
    centre: tuple[float, float] = (0.0, 0.0)

    def contains(self, points: Floats) -> Bools:
        """(N,) whether each of the (N, 2) points lies in the field, its edge included."""
        half = np.array([self.width, self.height]) / 2
        inside: Bools = np.all(np.abs(points - np.array(self.centre)) <= half, axis=-1)
        return inside

    @property
    def diagonal(self) -> float:
        """The longest distance in the field in m; infinite if one node, or nodes on a line, do not span a field."""
        return math.hypot(self.width, self.height) if min(self.width, self.height) > LEAST_SIDE else math.inf


class Deployment(Protocol):
    """Where the nodes stand."""

    @property
    def field(self) -> Field:
        """The monitored rectangle, in which nodes stand."""

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions in m.

        Args:
            reach: The sensing range in m, with which nodes cover the field if the component requires it.
            rng: The source of random numbers.

        Raises:
            RunError: The nodes do not cover the field, after many attempts.
        """


class Routing(Protocol):
    """The path of a datagram that leaves its cluster."""

    @property
    def weight(self) -> str:
        """What it minimises: 'energy' or 'hop'; or 'greedy': each hop goes nearest to the destination.

        Nodes know the paths for nothing. With 'etx' they pay for what they know, as in the collection tree protocol.
        """


class Workload(Protocol):
    """What the network does.

    A workload that brings its own mechanism (`StartsWorkload`) is one without targets.
    """

    @property
    def mechanism(self) -> str:
        """The name of the mechanism: 'tracking'; 'beacons' or another one of a network without targets."""


class Sink(Protocol):
    """The node that collects the estimates."""

    @property
    def point(self) -> tuple[float, float] | None:
        """(x, y) in m; the sink is the node nearest to it. None: no sink. For several, see `HasSeveralSinks`."""

    @property
    def bits(self) -> int:
        """Bits of a report."""

    @property
    def every(self) -> float | None:
        """Seconds between reports; None: every estimate is reported."""


@runtime_checkable
class HasSeveralSinks(Protocol):
    """Optional port of a sink or of a workload without targets: the points of several sinks."""

    @property
    def points(self) -> tuple[tuple[float, float], ...]:
        """(x, y) in m; each sink is the node nearest to one of them. A sink's `point` is the first."""


class FaultEvent(Protocol):
    """An injected fault: its `mechanism`, its beginning (`at`, s), its `duration` (s; None: until the end of the run).

    The nodes it hits are given by exactly one of `nodes` (ids), `fraction` (of all, sampled), `region` (x, y, radius in
    m) and `head` (the cluster head of that target when the fault begins; without heads, the node that reports). A
    plug-in also offers `start`: see `StartsFault`; with a class attribute `standalone = True` it acts without a
    network, too, on readings alone.
    """

    @property
    def mechanism(self) -> str:
        """Name of the mechanism, used in the log."""

    @property
    def at(self) -> float:
        """Beginning in s."""

    @property
    def duration(self) -> float | None:
        """Duration in s; None: until the end of the run."""

    @property
    def nodes(self) -> tuple[int, ...] | None:
        """The nodes it hits."""

    @property
    def fraction(self) -> float | None:
        """The share of all nodes that it hits."""

    @property
    def region(self) -> tuple[float, float, float] | None:
        """The circle (x, y, radius) in m whose nodes it hits."""

    @property
    def head(self) -> int | None:
        """The target whose cluster head it hits."""


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


class ClusterPolicy(Protocol):
    """Which node leads a cluster, and until when.

    `protocol` names what heads do:
    - 'standing': a cluster keeps its head until too few members sense; then the successor leads.
    - 'electing': the same, but the successor calls an election.
    - 'open': the head that `successor` names leads; every node that senses belongs to the cluster, without a frame.
    - 'moving': the head is chosen again at each step; see `MovingPolicy`.
    - 'appointing': the head appoints members from its prediction; see `AppointingPolicy`.
    - 'none': there is no head; see `HeadlessPolicy`.
    """

    @property
    def protocol(self) -> str:
        """The name of what heads do."""

    @property
    def minimum_active(self) -> int:
        """The number of sensing members, the head included, below which a new cluster holds an election."""

    @property
    def threshold(self) -> float | None:
        """The charge in J that a head must exceed; None: the paper's rule."""

    def elect(self, ids: Sequence[int], strengths: Sequence[float], able: Sequence[bool]) -> int | None:
        """The head among candidates; None if none is able.

        Args:
            ids: The candidates.
            strengths: Of the reading of each; larger for a nearer target.
            able: Whether the charge of each exceeds the threshold.
        """

    def must_hand_over(self, active: int, members: int) -> bool:
        """Whether too few of the members sense: `active` of `members`, the head included."""

    def successor(self, forecast: Floats, positions: Floats, able: Bools) -> int | None:
        """The next head; None if no node is able.

        Args:
            forecast: (2,) the predicted position in m.
            positions: (N, 2) of all nodes in m.
            able: (N,) who is up and holds enough charge to lead.
        """


class MovingPolicy(ClusterPolicy, Protocol):
    """A policy of moving heads.

    `main`: the head is the node nearest to the 'prediction' among those woken for the step, or the one that measured
    the target nearest at the step before ('detection'). Measuring takes `sampling` s. The head waits for readings until
    none has come for `quiet` s, at most for `cap` s; None: as long as the MAC needs. Without
    readings it continues its prediction for `patience` s before the track is lost.
    """

    main: str
    sampling: float
    quiet: float | None
    cap: float | None
    patience: float


class HeadlessPolicy(ClusterPolicy, Protocol):
    """A policy without heads.

    A node is a participant while it senses the target, or while its own prediction, known to within `radius` m, is no
    farther from it; None: the communication range. `gateway`: the participant nearest to the 'sink' reports its
    estimate, or the one nearest to its own estimate of the 'target'.
    """

    radius: float | None
    gateway: str


@runtime_checkable
class SeesGeometry(Protocol):
    """Optional port of a cluster policy: decides on handovers from the geometry, not from counts and one point.

    Heads that stand ('standing', 'electing') then ask these methods in place of `must_hand_over` and `successor`.
    """

    def must_appoint(self, outlook: Outlook) -> bool:
        """Whether the cluster must be renewed: by another head, or by more members."""

    def next_head(self, outlook: Outlook) -> int | None:
        """The best head from now on, which may be the present one; None if no node that it considers is able."""


class AppointingPolicy(ClusterPolicy, SeesGeometry, Protocol):
    """A policy of heads that appoint their members.

    If `next_head` names no node, the one that `successor` names leads. Without readings the head continues its
    prediction for `patience` s before the track is lost.
    """

    @property
    def patience(self) -> float:
        """Seconds without a reading after which the track is lost; a single step without one never loses it."""

    def appointment(self, outlook: Outlook) -> Appointment:
        """The rule that the head announces: which nodes are members."""
