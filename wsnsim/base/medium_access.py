"""Ports of medium access control: what a MAC and the packing of its frames must offer, and MACs that switch radios off.

A radio is *on* while it sends, receives or listens; a node *sleeps*, or is awake. A duty-cycled MAC switches the radios
of awake nodes: `network.nodes.Nodes` books what that costs. Times in s.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable


class Mac(Protocol):
    """When a frame gets the channel: the parameters of a mechanism.

    `mechanism` names a built-in one. A plug-in gives it a name of its own, and starts it: see `StartsMac`.
    """

    @property
    def mechanism(self) -> str:
        """The name of the mechanism."""


class FramedMac(Mac, Protocol):
    """A MAC whose frames take time."""

    @property
    def rate(self) -> float:
        """Bit/s on the air."""

    @property
    def turnaround(self) -> float:
        """Seconds between receiving and sending."""

    @property
    def acks(self) -> bool:
        """Whether unicasts are acknowledged."""

    @property
    def ack_wait(self) -> float:
        """Seconds for which a sender waits for an acknowledgement."""

    @property
    def max_retries(self) -> int:
        """How often a frame without acknowledgement is sent again."""

    @property
    def ack_bits(self) -> int:
        """Bits of an acknowledgement on the air."""

    @property
    def payload_bits(self) -> int:
        """Bits of the largest payload of a frame."""

    def bits(self, payload_bits: int) -> int:
        """Bits on the air of a frame with this payload, preamble and headers included."""

    def airtime(self, bits: float) -> float:
        """Seconds that a frame of this length on the air takes."""

    def spacing(self, bits: int) -> float:
        """Seconds between the end of a frame of this length and the sender's next one."""


class Packing(Protocol):
    """How many packets of a burst travel in one frame."""

    def packets(self, packet_bits: int, most_bits: int) -> int:
        """The number of packets of `packet_bits` in a frame whose payload holds `most_bits`; at least 1."""


class RadioDuty(NamedTuple):
    """The law of a radio whose node has nothing to send and whose wake-ups hear nothing.

    What it costs is a closed form: no event happens. The time in which the radio is switched on or off belongs neither
    to `on` nor to its sleep.

    Attributes:
        interval: Wake interval or slotframe, in s.
        starts: How often the radio is switched on in an interval.
        on: Seconds in an interval in which it listens.
    """

    interval: float
    starts: float
    on: float


@runtime_checkable
class DutyCycledMac(Protocol):
    """Optional port of a MAC component that switches radios off. A MAC without it listens always."""

    @property
    def duties(self) -> tuple[RadioDuty, ...]:
        """The laws that radios may follow; the first one is that of a node at the start."""


@runtime_checkable
class SwitchesRadio(Protocol):
    """Optional port of an energy model: what it costs to switch the radio alone. Without it, nothing.

    A radio that is off has the power of a sleeping one, or that of a member `radio_off() -> W`, if there is one. The
    processor time of a wake-up is not charged.
    """

    def radio_start(self) -> tuple[float, float]:
        """(s, J) of the radio from its sleep state to listening."""

    def radio_stop(self) -> tuple[float, float]:
        """(s, J) of the radio from listening to its sleep state."""


def off_time(energy: object) -> float:
    """Return the seconds for which a radio is off at least: its stop and its start; 0 if the model does not know."""
    return energy.radio_stop()[0] + energy.radio_start()[0] if isinstance(energy, SwitchesRadio) else 0.0


class Latency(NamedTuple):
    """Seconds that one hop takes at most without contention and retries.

    Attributes:
        unicast: of a unicast.
        broadcast: of a broadcast.
        granted: of the unicasts that a head gathers, where the MAC first gives each sender a time of its own; else 0.
    """

    unicast: float
    broadcast: float
    granted: float = 0.0


NO_LATENCY = Latency(0.0, 0.0)
"""The latency of a MAC that does not know its own, such as the ideal one."""


@runtime_checkable
class KnowsLatency(Protocol):
    """Optional port of a MAC component: how long a hop takes."""

    def latency(self, bits: int) -> Latency:
        """The latency of a payload of `bits`."""


def hop_latency(mac: object, bits: int) -> Latency:
    """Return the latency of a MAC component for a payload of `bits`; zero if it does not know."""
    return mac.latency(bits) if isinstance(mac, KnowsLatency) else NO_LATENCY


@runtime_checkable
class GivesTurns(Protocol):
    """Optional port of a MAC component that gives each member of a cluster a turn of its own, used or not."""

    def turns(self, members: int) -> float:
        """Seconds until each of this number of members has had its turn; 0: only those that send take time."""
