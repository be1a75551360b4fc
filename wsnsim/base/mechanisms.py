"""Protocols of mechanisms: the objects that act in simulated time for a component.

A component is frozen data. `component.start(services)` returns its mechanism; `services` is all of the network that
the mechanism may use. The built-in components have no `start`: `network` binds them by the name in `mechanism`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

from wsnsim.base.arrays import Floats, Ints

NOBODY: Final = -1
"""Stands for a node in the log of a fault that hits none."""


@dataclass(frozen=True, slots=True)
class SensorDefect:
    """A fault of some sensors: `offset` is added to their readings, or the readings are stuck at `value`.

    With `value` None a reading is stuck at the last one of the target, or at the first one after the fault began. A
    defect changes what a node reads, not when it reads (our choice).
    """

    nodes: frozenset[int]
    offset: float = 0.0
    stuck: bool = False
    value: float | None = None


class FaultServices(Protocol):
    """What one fault may reach in the network. Overlapping faults are combined by the network.

    `now` is the simulated time in s; `positions` (N, 2) in m; `key` is the random key of this fault (see `base.rng`).
    """

    @property
    def now(self) -> float: ...

    @property
    def positions(self) -> Floats: ...

    @property
    def key(self) -> int: ...

    def is_up(self, node: int) -> bool:
        """Whether a node is neither dead nor crashed."""
        ...

    def is_dead(self, node: int) -> bool:
        """Whether the battery of a node is empty."""
        ...

    def residual_energy(self, node: int) -> float:
        """Joules left in a node now."""
        ...

    def head_of(self, target: int) -> int | None:
        """The cluster head of a target, or None."""
        ...

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call an action after `seconds` of simulated time."""
        ...

    def log_start(self, node: int, joules: float = 0.0) -> None:
        """Log that the fault hits a node, or NOBODY, and the charge that it took."""
        ...

    def log_end(self, node: int) -> None:
        """Log that the fault of a node has passed."""
        ...

    def take_down(self, nodes: Ints) -> None:
        """Crash the nodes that are up, and hold all of them down until `bring_up`."""
        ...

    def take_down_alone(self, nodes: Ints) -> None:
        """As `take_down`; other faults no longer hold these nodes down."""
        ...

    def bring_up(self) -> None:
        """Restart the nodes that this fault alone holds down."""
        ...

    def drain(self, node: int, joules: float) -> float:
        """Take charge from a node; returns the joules taken. Infinity empties the battery."""
        ...

    def jam(self, nodes: Ints) -> None:
        """The radios of the nodes neither receive nor are received, until `unjam`."""
        ...

    def unjam(self, nodes: Ints) -> None:
        """Undo one `jam` of this fault."""
        ...

    def set_loss(self, nodes: Ints, probability: float) -> None:
        """Lose frames from and to the nodes with this probability, in addition to other losses."""
        ...

    def clear_loss(self, nodes: Ints) -> None:
        """Undo `set_loss`."""
        ...

    def step_clocks(self, nodes: Ints, seconds: float) -> None:
        """Put the clocks of the nodes forward; back if `seconds` is negative."""
        ...

    def set_defect(self, defect: SensorDefect) -> None:
        """Change the readings of sensors. A fault has one defect at a time."""
        ...

    def clear_defect(self) -> None:
        """Undo `set_defect`."""
        ...


class FaultMechanism(Protocol):
    """What a fault does to the nodes it hits. It logs each of them with `FaultServices.log_start`."""

    def begin(self, nodes: Ints) -> None:
        """The fault begins at nodes (n,): at least one, ascending, none of them dead."""
        ...

    def end(self, nodes: Ints) -> None:
        """The duration of the fault has passed. `nodes` are those that `begin` was given."""
        ...


@runtime_checkable
class StartsFault(Protocol):
    """A fault component that brings its own mechanism: what a plug-in offers in addition to `radio.FaultEvent`."""

    def start(self, services: FaultServices) -> FaultMechanism:
        """Return the mechanism. Called once, before the simulation starts."""
        ...
