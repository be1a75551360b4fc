"""Protocols of mechanisms: the objects that act in simulated time for a component.

A component is frozen data. `component.start(services)` returns its mechanism; `services` is all of the network that
the mechanism may use. The built-in components have no `start`: `network` binds them by the name in `mechanism`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.counters import Counters
from wsnsim.base.frames import Burst, MacFrame, Received
from wsnsim.base.radio import FramedMac

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


class Signal(Protocol):
    """An event that the network waits for."""

    def succeed(self) -> object:
        """Fire the signal, once."""
        ...


class OnAir(Protocol):
    """One MAC frame on the air, from `start` to `end` (s)."""

    @property
    def source(self) -> int: ...

    @property
    def frame(self) -> MacFrame: ...

    @property
    def start(self) -> float: ...

    @property
    def end(self) -> float: ...

    @property
    def cut(self) -> bool:
        """Whether the sender fell silent before the end."""
        ...


class SharedChannel(Protocol):
    """A channel on which sending takes time, and transmissions collide. It charges, logs and counts every frame."""

    def is_busy(self, node: int) -> bool:
        """Whether a node hears a transmission during the assessment that ends now, or sends itself."""
        ...

    def is_sending(self, node: int) -> bool:
        """Whether a node sends or is about to: its radio cannot send another frame."""
        ...

    def transmit(
        self,
        source: int,
        frame: MacFrame,
        ended: Callable[[OnAir, Received], None],
        asleep: Ints | None = None,
    ) -> OnAir:
        """Send a frame, one turnaround from now.

        Args:
            source: The sender, which must not be sending.
            frame: The frame.
            ended: Called at the end with the transmission and its result.
            asleep: (n,) nodes that have the radio off because they know that the frame is not for them.
        """
        ...

    def silence(self, node: int) -> None:
        """Cut the transmission of a node that died or crashed."""
        ...


class Fragmenter(Protocol):
    """Splits bursts into MAC frames."""

    def split(self, burst: Burst, ended: Callable[[], None]) -> list[MacFrame]:
        """Return the frames of a burst, in order; none for a burst without packets.

        The MAC calls `finish` on each of them once. After the last one the burst holds what arrived, and `ended` is
        called.
        """
        ...


class MacServices(Protocol):
    """What a MAC may use of the network. `now` is the simulated time in s, `step` the number of the present step."""

    @property
    def now(self) -> float: ...

    @property
    def step(self) -> int: ...

    @property
    def counters(self) -> Counters: ...

    def key(self, stream: str) -> int:
        """Return the key of a random stream (see `base.rng`)."""
        ...

    def is_up(self, node: int) -> bool:
        """Whether a node is neither dead nor crashed."""
        ...

    def is_awake(self, node: int) -> bool:
        """Whether a node is up and listens."""
        ...

    def neighbours(self, node: int) -> Ints:
        """(n,) the nodes that a node's transmissions may reach, ascending."""
        ...

    def hold_awake(self, node: int) -> None:
        """Keep a node awake until `release`, because it has a frame to send."""
        ...

    def release(self, node: int) -> None:
        """Let a node follow its schedule again."""
        ...

    def true_seconds(self, node: int, seconds: float) -> float:
        """Return how long a timer of a node really runs, by the rate of its clock."""
        ...

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call an action after `seconds` of simulated time."""
        ...

    def signal(self) -> Signal:
        """Return a new signal, for the end of bursts."""
        ...

    def open_channel(self, mac: FramedMac, assessment: float) -> SharedChannel:
        """Return a channel on which the frames of a MAC take time. `assessment`: s of a clear channel assessment."""
        ...

    def fragmentation(self, mac: FramedMac) -> Fragmenter:
        """Return what splits bursts into the frames of a MAC."""
        ...

    def log_drop(self, node: int, dropped: Burst | MacFrame, reason: str) -> None:
        """Log that a node dropped a burst or a frame without sending it."""
        ...


class MacMechanism(Protocol):
    """When the frames of a network get the channel."""

    def send(self, bursts: Sequence[Burst], head: int | None = None) -> Signal:
        """Send bursts; each ends with what arrived written into it.

        Args:
            bursts: The bursts, of any senders.
            head: The cluster head, if all of them are between it and its members.

        Returns:
            A signal from `MacServices.signal` that succeeds when the last burst has ended.
        """
        ...

    def offer(self, node: int, payload_bits: int, done: Callable[[Received | None], None], code: int = 0) -> None:
        """Broadcast one payload, without a burst.

        Args:
            node: The sender.
            payload_bits: Length of the payload.
            done: Called once with the ids (n,) that received it, or None if it never got the channel.
            code: What the event log calls it.
        """
        ...

    def silence(self, node: int) -> None:
        """Stop a node that died or crashed: its frames are lost, and their bursts end."""
        ...


@runtime_checkable
class StartsMac(Protocol):
    """A MAC component that brings its own mechanism: what a plug-in offers in addition to `radio.Mac`."""

    def start(self, services: MacServices) -> MacMechanism:
        """Return the mechanism. Called once, before the simulation starts."""
        ...
