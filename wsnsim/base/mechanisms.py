"""Protocols of mechanisms: the objects that act in simulated time for a component.

A component is frozen data. `component.start(services)` returns its mechanism; `services` is all of the network that
the mechanism may use. The built-in components have no `start`: `network` binds them by the name in `mechanism`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.sleeping import Point, WakeUpMessage, WakeUpRound

HeardMessage = Callable[[int, WakeUpMessage], None]
NOBODY: Final = -1
"""Stands for a node in the log of a fault that hits none."""


@dataclass(frozen=True, slots=True)
class SensorDefect:
    """A fault of some sensors: an offset of their readings, or readings that are stuck.

    A defect changes what a node reads, not when it reads (our choice).

    Attributes:
        nodes: the nodes.
        offset: is added to their readings, in the sensor's unit.
        stuck: whether the readings are stuck at `value`.
        value: None: a reading is stuck at the last one of the target, or at the first one after the fault began.
        component: of readings with several components, the name of the defective one; empty: all.
    """

    nodes: frozenset[int]
    offset: float = 0.0
    stuck: bool = False
    value: float | None = None
    component: str = ""


class NodeServices(Protocol):
    """What every mechanism may use of the network; each role adds its own."""

    @property
    def now(self) -> float:
        """The simulated time in s."""

    def is_up(self, node: int) -> bool:
        """Whether a node is neither dead nor crashed."""

    def is_dead(self, node: int) -> bool:
        """Whether the battery of a node is empty."""

    def is_awake(self, node: int) -> bool:
        """Whether a node is up, and its sleep schedule does not keep it asleep."""

    def lasts(self, node: int, seconds: float) -> float:
        """The seconds that pass while the oscillator of a node counts `seconds`."""

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call an action after `seconds` of simulated time."""


class FaultServices(NodeServices, Protocol):
    """What one fault may reach in the network. Overlapping faults are combined by the network."""

    @property
    def positions(self) -> Floats:
        """(N, 2) positions of the nodes in m."""

    @property
    def key(self) -> int:
        """The random key of this fault, for `derive`."""

    def residual_energy(self, node: int) -> float:
        """Joules left in a node now."""

    def head_of(self, target: int) -> int | None:
        """The cluster head of a target, or None."""

    def log_start(self, node: int, joules: float = 0.0) -> None:
        """Log that the fault hits a node, or NOBODY, and the charge that it took."""

    def log_end(self, node: int) -> None:
        """Log that the fault of a node has passed."""

    def take_down(self, nodes: Ints) -> None:
        """Crash the nodes that are up, and hold all of them down until `bring_up`."""

    def take_down_alone(self, nodes: Ints) -> None:
        """As `take_down`; other faults no longer hold these nodes down."""

    def bring_up(self) -> None:
        """Restart the nodes that this fault alone holds down."""

    def drain(self, node: int, joules: float) -> float:
        """Take charge from a node; returns the joules taken. Infinity empties the battery."""

    def jam(self, nodes: Ints) -> None:
        """The radios of the nodes neither receive nor are received, until `unjam`."""

    def unjam(self, nodes: Ints) -> None:
        """Undo one `jam` of this fault."""

    def set_loss(self, nodes: Ints, probability: float) -> None:
        """Lose frames from and to the nodes with this probability, in addition to other losses."""

    def clear_loss(self, nodes: Ints) -> None:
        """Undo `set_loss`."""

    def step_clocks(self, nodes: Ints, seconds: float) -> None:
        """Put the clocks of the nodes forward; back if `seconds` is negative."""

    def set_defect(self, defect: SensorDefect) -> None:
        """Change the readings of sensors. A fault has one defect at a time."""

    def clear_defect(self) -> None:
        """Undo `set_defect`."""


class FaultMechanism(Protocol):
    """What a fault does to the nodes it hits. It logs each of them with `FaultServices.log_start`."""

    def begin(self, nodes: Ints) -> None:
        """The fault begins at nodes (n,): at least one, ascending, none of them dead."""

    def end(self, nodes: Ints) -> None:
        """The duration of the fault has passed. `nodes` are those that `begin` was given."""


@runtime_checkable
class StartsFault(Protocol):
    """A fault component that brings its own mechanism: what a plug-in offers in addition to `FaultEvent`."""

    def start(self, services: FaultServices) -> FaultMechanism:
        """Return the mechanism. Called once, before the simulation starts."""


class WakeUpServices(NodeServices, Protocol):
    """What a wake-up mechanism may use of the network. The network books and logs what it sends."""

    def clock(self, node: int) -> float:
        """What the clock of a node shows now, in s: by this a node decides whether a message has expired."""

    def place(self, node: int) -> Point:
        """The position of a node."""

    def neighbours(self, node: int) -> Ints:
        """(n,) the nodes that a node's transmissions may reach, those included that are down."""

    def within_call(self, node: int) -> Ints:
        """(n,) the nodes that a node's calls on the wake-up radio may wake, ascending."""

    def nodes_within(self, centre: Point, radius: float) -> Ints:
        """(n,) the nodes within `radius` m of a point."""

    def sleepers(self, nodes: Ints) -> set[int]:
        """The nodes, out of the given ones, that are up and asleep now."""

    def broadcast(
        self, round: WakeUpRound, node: int, message: WakeUpMessage, on_heard: HeardMessage, relayed: bool = False
    ) -> None:
        """Broadcast a copy of a message once.

        Args:
            round: the round of the message.
            node: the sender.
            message: what is sent; the copy says who sent it, and where from.
            on_heard: called with each node that heard the copy, ascending, and the copy.
            relayed: the sender forwards the message of another node.
        """

    def call(
        self, round: WakeUpRound, node: int, sleepers: Sequence[int], bits: int, on_awake: Callable[[list[int]], None]
    ) -> None:
        """Call sleeping nodes on the wake-up radio; `on_awake` is called with those that woke.

        A node beyond `within_call` does not hear the call.
        """

    def track(self, round: WakeUpRound, node: int, message: WakeUpMessage) -> None:
        """Note that a node tracks at the message's step, and keep it awake until then and for the waiting time."""

    def release(self, node: int, target: int) -> None:
        """Let a node follow its schedule again."""

    def drop(self, round: WakeUpRound, node: int, message: WakeUpMessage) -> None:
        """Log that a node ignored a message because it had expired."""

    def chance(self, node: int, message: WakeUpMessage) -> float:
        """A uniform random number of a node for a message, in [0, 1)."""


class WakeUpMechanism(Protocol):
    """How nodes are woken ahead of a target."""

    def begin(self, round: WakeUpRound) -> None:
        """A head, `round.node`, wakes nodes for the step of `round.message`; returns at once."""


@runtime_checkable
class StartsWakeUp(Protocol):
    """A wake-up component that brings its own mechanism: what a plug-in offers in addition to `WakeUp`."""

    def start(self, services: WakeUpServices) -> WakeUpMechanism:
        """Return the mechanism. Called once, before the simulation starts."""


class WorkloadServices(NodeServices, Protocol):
    """What a workload without targets may use of the network. The network books and logs what nodes send."""

    @property
    def positions(self) -> Floats:
        """(N, 2) the nodes' positions in m."""

    @property
    def key(self) -> int:
        """The random key of the workload, for `derive`."""

    def code_of(self, what: str) -> int:
        """The code of a word in the column `events.what`."""

    def broadcast(self, node: int, bits: int, code: int) -> None:
        """Broadcast a payload of `bits` to all in range."""

    def send(self, node: int, to: int, bits: int, what: str, on_end: Callable[[bool], None]) -> None:
        """Send a payload of `bits` to a node over the path of `routing`; `on_end(arrived)` is called at the end."""

    @property
    def sinks(self) -> Sequence[int]:
        """The sinks of the scenario: the nodes nearest to the `points` of the workload; none if it has no points."""

    def collect(self, node: int, bits: int, what: str, on_end: Callable[[int], None]) -> None:
        """Send a report of `bits` to whichever sink; `on_end(sink)` is called at the end, with -1 if it was lost."""


class WorkloadMechanism(Protocol):
    """What the nodes of a network without a target do."""

    def begin(self) -> None:
        """The simulation starts."""


@runtime_checkable
class StartsWorkload(Protocol):
    """A workload component that brings its own mechanism: what a plug-in offers in addition to `Workload`."""

    def start(self, services: WorkloadServices) -> WorkloadMechanism:
        """Return the mechanism. Called once, before the simulation starts."""


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
