"""The port of a MAC: what its mechanism may use of the network, and what it must offer.

See `base.mechanisms` for components and mechanisms in general.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

from wsnsim.base.arrays import Bools, Ints
from wsnsim.base.frames import Burst, Counters, MacFrame, Received
from wsnsim.base.mechanisms import NodeServices
from wsnsim.base.medium_access import FramedMac


class Signal(Protocol):
    """An event that the network waits for."""

    def succeed(self) -> object:
        """Fire the signal, once."""


class OnAir(Protocol):
    """One MAC frame on the air."""

    @property
    def source(self) -> int:
        """The sender."""

    @property
    def frame(self) -> MacFrame:
        """What is sent."""

    @property
    def start(self) -> float:
        """When its first bit is sent, in s."""

    @property
    def end(self) -> float:
        """When its last bit is sent, in s."""

    @property
    def cut(self) -> bool:
        """Whether the sender fell silent before the end."""

    @property
    def listeners(self) -> Ints | None:
        """(m,) the nodes whose radios listened from its start and paid for it, ascending; known at its end.

        They received or overheard it, or lost it to another frame. None on a channel without `Listening`.
        """


class Listening(Protocol):
    """Which radios are on: what a duty-cycled MAC tells its channel. A frame to a radio that is off costs it nothing.

    The level of sleep schedules, faults and empty batteries is below it: the channel asks that itself.
    """

    def hears(self, ids: Ints, since: float) -> Bools:
        """(n,) which of the radios have listened without a break since a time (s) that is not in the future."""


class SharedChannel(Protocol):
    """A channel on which sending takes time, and transmissions collide. It charges, logs and counts every frame."""

    def is_busy(self, node: int) -> bool:
        """Whether a node hears a transmission during the assessment that ends now, or sends itself."""

    def is_sending(self, node: int) -> bool:
        """Whether a node sends or is about to: its radio cannot send another frame."""

    def transmit(
        self,
        source: int,
        frame: MacFrame,
        on_end: Callable[[OnAir, Received], None],
        asleep: Ints | None = None,
    ) -> OnAir:
        """Send a frame, one turnaround from now.

        Args:
            source: The sender, which must not be sending.
            frame: The frame.
            on_end: Called at the end with the transmission and its result.
            asleep: (n,) nodes that have the radio off because they know that the frame is not for them.
        """

    def silence(self, node: int) -> None:
        """Cut the transmission of a node that died or crashed."""


class Fragmenter(Protocol):
    """Splits bursts into MAC frames."""

    def split(self, burst: Burst, on_end: Callable[[], None]) -> list[MacFrame]:
        """Return the frames of a burst, in order; none for a burst without packets.

        The MAC calls `finish` on each of them once. After the last one the burst holds what arrived, and `on_end` is
        called.
        """


class MacServices(NodeServices, Protocol):
    """What a MAC may use of the network."""

    @property
    def step(self) -> int:
        """The number of the present step."""

    @property
    def counters(self) -> Counters:
        """The counters of the run. The channel counts frames; the MAC counts `access_failures` and `retries`."""

    def key(self, stream: str) -> int:
        """Return the key of a random stream, for `derive`."""

    def neighbours(self, node: int) -> Ints:
        """(n,) the nodes that a node's transmissions may reach, ascending."""

    def hold_awake(self, node: int) -> None:
        """Keep a node awake until `release`, because it has a frame to send."""

    def release(self, node: int) -> None:
        """Let a node follow its schedule again."""

    def signal(self) -> Signal:
        """Return a new signal, for the end of bursts."""

    def open_channel(self, mac: FramedMac, assessment: float, listening: Listening | None = None) -> SharedChannel:
        """Return a channel on which the frames of a MAC take time: one for each physical channel.

        Args:
            mac: The parameters.
            assessment: Duration of a clear channel assessment in s.
            listening: Which radios are on; None: those of all nodes that are awake.
        """

    def fragmentation(self, mac: FramedMac) -> Fragmenter:
        """Return what splits bursts into the frames of a MAC."""

    def log_drop(self, node: int, dropped: Burst | MacFrame, reason: str) -> None:
        """Log that a node dropped a burst or a frame without sending it."""


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

    def offer(self, node: int, payload_bits: int, done: Callable[[Received | None], None], code: int = 0) -> None:
        """Broadcast one payload, without a burst.

        Args:
            node: The sender.
            payload_bits: Length of the payload.
            done: Called once with the ids (n,) that received it, or None if it never got the channel.
            code: What the event log calls it.
        """

    def silence(self, node: int) -> None:
        """Stop a node that died or crashed: its frames are lost, and their bursts end."""


@runtime_checkable
class ExpectsMembers(Protocol):
    """Optional port of a MAC mechanism that gives the members of a cluster slots."""

    def expect(self, head: int, members: Sequence[int]) -> None:
        """Note whom a head has appointed: they may have something to send from now on."""


@runtime_checkable
class KeepsIdleSlots(Protocol):
    """Optional port of a MAC mechanism with rounds of slots, which may take time whether or not anybody sends."""

    @property
    def keeps_idle_slots(self) -> bool:
        """Whether `send` without bursts is a round, too, if it has the head that gathers."""

    def schedule(self, head: int, nodes: Sequence[int]) -> None:
        """Give slots to these nodes alone from now on: a head expects nobody else to send (`Gather.expected`)."""


@runtime_checkable
class UsesShortInterval(Protocol):
    """Optional port of a MAC mechanism whose nodes have a short wake interval beside the long one."""

    def use_short_interval(self, nodes: Ints, until: float) -> None:
        """Have nodes (n,) that are up use the short interval until a time in s, later than they were told before."""


@runtime_checkable
class FollowsRestarts(Protocol):
    """Optional port of a MAC mechanism whose nodes must do something when they come back after a crash."""

    def restart(self, node: int) -> None:
        """A node is up again, without anything that it knew."""


@runtime_checkable
class StartsMac(Protocol):
    """A MAC component that brings its own mechanism: what a plug-in offers in addition to `Mac`."""

    def start(self, services: MacServices) -> MacMechanism:
        """Return the mechanism. Called once, before the simulation starts."""
