"""The ports of workloads and of sinks: what a network does, and where its reports go.

Each port is implemented by frozen `@part` classes. Quantities are in SI units.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable


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
