"""Ports of deployments, routing, workloads, sinks and injected faults. Frozen `@part` classes implement them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from wsnsim.base.arrays import Bools, Floats


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
    m) and `head` (the cluster head of that target when the fault begins). A plug-in also offers `start`: see
    `StartsFault`; with a class attribute `standalone = True` it acts without a network, too, on readings alone.
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
