"""The port of time synchronisation: how nodes keep their clocks together, and what a mechanism may use of the network.

See `base.mechanisms` for components and mechanisms in general, and `network.clocks` for the two clocks of a node.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from wsnsim.base.arrays import Ints
from wsnsim.base.mechanisms import NodeServices


class TimeSync(Protocol):
    """How nodes keep their clocks together: the parameters of a mechanism.

    `mechanism` names a built-in one: 'none' or 'ftsp'. A plug-in gives it a name of its own, and starts it: see
    `StartsSync`.
    """

    @property
    def mechanism(self) -> str:
        """The name of the mechanism."""


class SyncServices(NodeServices, Protocol):
    """What time synchronisation may use of the network, which books and logs what nodes send. No node knows `now`."""

    @property
    def size(self) -> int:
        """The number of nodes."""

    @property
    def key(self) -> int:
        """The random key of time synchronisation, for `derive`."""

    def next_change(self, node: int) -> float:
        """The earliest time in s at which the sleep schedule of a node may wake it or let it sleep; infinite: never."""

    def own_clock(self, node: int) -> float:
        """What the own clock of a node shows now, in s: its oscillator, never corrected."""

    def clock(self, node: int) -> float:
        """What the clock of a node shows now, in s: its own clock with all corrections."""

    def set_clock(self, node: int, shows: float, rate: float) -> None:
        """Correct the clock of a node.

        Args:
            node: The node.
            shows: What its clock shows now, in s.
            rate: Seconds on its own clock per second on its clock, from now on.
        """

    def broadcast(self, node: int, bits: int, done: Callable[[Ints | None], None]) -> None:
        """Broadcast a message with a payload of `bits`, at the next opportunity that the MAC gives.

        `done` is called when it has been sent, with the nodes (n,) that received it, or None if it was not sent. Time
        stamps of the MAC layer, of the sender and of the receivers, are what their clocks show at this instant.
        """


class SyncMechanism(Protocol):
    """What nodes do to keep their clocks together."""

    def begin(self) -> None:
        """The simulation starts."""

    def forget(self, node: int) -> None:
        """A node crashed: it has lost its memory. The network has taken its corrections back."""

    def is_synchronised(self, node: int) -> bool:
        """Whether a node takes its clock for synchronised."""


@runtime_checkable
class StartsSync(Protocol):
    """A component that brings its own mechanism: what a plug-in offers in addition to `TimeSync`."""

    def start(self, services: SyncServices) -> SyncMechanism:
        """Return the mechanism. Called once, before the simulation starts."""
