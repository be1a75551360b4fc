"""Ports of medium access control: what a MAC and the packing of its frames must offer, and MACs that switch radios off.

A radio is *on* while it sends, receives or listens; a node *sleeps*, or is awake. A duty-cycled MAC switches the radios
of awake nodes: `network.nodes.Nodes` books what that costs. Times in s.

`head_waits` says how long cluster heads wait for others where a scenario does not: by how long a hop takes on the MAC.
All its figures that are no multiple of a latency are those that heads had before MACs said how long they take.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple, Protocol, runtime_checkable

from wsnsim.base.requests import PACKET_BITS


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


LEAST_QUIET: Final = 12e-3
LEAST_CAP: Final = 50e-3
"""Waits (s) of moving heads on a radio that always listens (our choice)."""
QUIET_HOPS: Final = 1.5
CAP_HOPS: Final = 4.0
JOIN_HOPS: Final = 2.0
ELECTION_HOPS: Final = 6.0
"""The same waits, and those for joins and candidates, in hops of a radio that is mostly off (our choice)."""
CAP_SHARE: Final = 0.6
JOIN_SHARE: Final = 0.3
ELECTION_SHARE: Final = 0.5
"""Shares of a step that these waits take at most (our choice): the rest is for the estimate and what follows it."""


class HeadWaits(NamedTuple):
    """How long cluster heads wait for others, in s.

    Attributes:
        quiet: without a reading, after which a moving head waits no longer.
        cap: for which a moving head waits at most.
        gather: for the parcels that a tracker gathers without a deadline of its own. None: until all have ended.
        joins: for the joins that answer an announcement. None: until all have ended.
        election: the time over which the candidates of an election spread their broadcasts. None: all begin at once.
        closing: when an election closes at the latest, after its beginning. None: once all broadcasts have ended.
    """

    quiet: float
    cap: float
    gather: float | None = None
    joins: float | None = None
    election: float | None = None
    closing: float | None = None

    @property
    def retries_handover(self) -> bool:
        """Whether a head whose belief did not reach the next one goes on and tries again at the next step."""
        return self.gather is not None


def window_of(quiet: float | None, cap: float | None, waits: HeadWaits) -> tuple[float, float]:
    """(quiet, cap) in s of a policy of moving heads; where it says None, what follows from the MAC."""
    cap = waits.cap if cap is None else cap
    return (min(waits.quiet, cap) if quiet is None else quiet), cap


def is_duty_cycled(mac: Any) -> bool:
    """Whether the radios of nodes are mostly off on a MAC."""
    return isinstance(mac, DutyCycledMac)


def head_waits(mac: Any, dt: float) -> HeadWaits:
    """How long heads wait on a MAC, where steps last `dt` s.

    A head knows when everything has arrived or is lost (an idealisation of ours). Where radios are mostly off, that may
    take many steps. There heads go on after some hops, at the latest after a share of a step, if a hop is not longer
    than that.
    """
    unicast, broadcast, granted = hop_latency(mac, PACKET_BITS)
    quiet, cap = max(LEAST_QUIET, QUIET_HOPS * unicast, granted), max(LEAST_CAP, CAP_HOPS * unicast, granted)
    if not is_duty_cycled(mac):
        return HeadWaits(quiet, cap)
    cap = min(cap, max(CAP_SHARE * dt, unicast))
    spread = min(ELECTION_HOPS * broadcast, ELECTION_SHARE * dt)
    return HeadWaits(
        quiet=min(quiet, cap),
        cap=cap,
        gather=cap,
        joins=min(JOIN_HOPS * unicast, JOIN_SHARE * dt),
        election=spread,
        closing=spread + 2.0 * broadcast,
    )
