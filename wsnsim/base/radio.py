"""The ports of energy models, links, clocks, processors, sinks, workloads, faults and routing.

The ports of MACs are in `base.medium_access`, and can be imported from here too.

Each port is implemented by frozen `@part` classes. Quantities are in SI units, received powers in dBm. `keys` are
counter keys (see `base.rng`): equal keys give equal random numbers.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple, Protocol, runtime_checkable

from wsnsim.base.arrays import Bools, Floats, Keys
from wsnsim.base.deprecation import renamed
from wsnsim.base.medium_access import ContendingMac as ContendingMac
from wsnsim.base.medium_access import FramedMac as FramedMac
from wsnsim.base.medium_access import IdealAccess as IdealAccess
from wsnsim.base.medium_access import Mac as Mac
from wsnsim.base.medium_access import Packing as Packing
from wsnsim.base.medium_access import SlottedMac as SlottedMac


class Mode(IntEnum):
    """What a node does when it neither sends, receives nor computes."""

    DORMANT = 0
    """Processor asleep; sensor and receiver on: a measurement of the target or a frame wakes the node."""
    AWAKE = 1
    """Processor and receiver on."""
    ASLEEP = 2
    """Processor and radio asleep."""
    DOWN = 3
    """Crashed or dead: no power."""
    SCHEDULED = 4
    """AWAKE or ASLEEP, by the sleep schedule of the node (see `base.sleeping`)."""


class ModePower(NamedTuple):
    """The power of a node in a mode, in W, and whether each part is booked as sleep (otherwise as idle)."""

    radio: float
    radio_sleeps: bool
    processor: float
    processor_sleeps: bool


class EnergyModel(Protocol):
    """The energy of each act, in joules. `battery` is the initial charge of a node in J."""

    @property
    def battery(self) -> float:
        """Initial charge of a node in J."""

    def transmit(self, bits: float, distance: float) -> tuple[float, float]:
        """(electronics, amplifier) joules."""

    def receive(self, bits: float) -> float:
        """Joules of receiving bits."""

    def compute(self, cycles: float) -> float:
        """Joules of processor cycles."""

    def sense(self) -> float:
        """Joules of one reading."""


@runtime_checkable
class ContinuousPower(Protocol):
    """The optional part of an energy model: power over time, and the energy of changes. Without it both are zero.

    While the radio of a node sends or receives, its `mode_power` is not charged; while the processor computes, that of
    the processor is not.
    """

    def mode_power(self, mode: Mode) -> ModePower:
        """Power in a mode; zero where the model knows no such cost."""

    def switching(self, before: Mode, after: Mode) -> float:
        """Joules of a change of mode."""

    def turnaround(self) -> float:
        """Joules of one change of the radio between receiving and sending."""

    def seconds(self, cycles: float) -> float:
        """Seconds for which the processor is busy with `cycles`; 0 where the model does not know."""


class LinkModel(Protocol):
    """Which nodes receive each other's frames, with which power and probability.

    A model that knows each link by itself also has the port `recorded_links.RecordsLinks`.
    """

    @property
    def reach(self) -> float:
        """The nominal communication range in m."""

    @property
    def audible(self) -> float:
        """The distance in m beyond which no node hears another."""

    @property
    def perfect(self) -> bool:
        """Whether every undisturbed frame within range arrives."""

    @property
    def captures(self) -> bool:
        """Whether a frame may survive an overlapping one; otherwise both are lost where both are heard.

        If so, `reception` must be the product of that of the bits of a frame, and must not rise with the interference;
        `capture_margin` (dB, 3 if missing) says how much stronger a later frame must be to take over a receiver.
        """

    def powers(self, distances: Floats, pairs: Keys, directions: Keys) -> Floats:
        """(n,) received power in dBm over links of these lengths; -inf where nothing is heard.

        Args:
            distances: (n,) lengths in m.
            pairs: (n,) counter keys, equal for both directions of a link.
            directions: (n,) counter keys of the directions; those of the two directions of a link are complements (~)
                of each other.
        """

    def reception(self, powers: Floats, bits: float, interference: Floats | float) -> Floats:
        """(n,) probability that a frame arrives.

        Args:
            powers: (n,) received power in dBm.
            bits: Length of the frame on the air.
            interference: Power of overlapping frames in mW; 0 for none.
        """

    def senses(self, powers: Floats) -> Bools:
        """(n,) whether a node that receives these powers takes the channel for busy (clear channel assessment)."""


class Cpu(Protocol):
    """The time of computations. `cycles_per_flop`: processor cycles of one operation stated by a tracker."""

    @property
    def cycles_per_flop(self) -> float:
        """Processor cycles of one operation stated by a tracker."""

    def seconds(self, cycles: float) -> float:
        """Simulated seconds that `cycles` take; 0 if computing takes no time."""


class Clock(Protocol):
    """The rates of the clocks of nodes."""

    def rates(self, keys: Keys) -> Floats:
        """(n,) seconds that pass on the clock of each node per true second, given one counter key per node."""


@runtime_checkable
class StartsWithOffsets(Protocol):
    """Optional port of a `Clock`: clocks that do not show the true time at the start."""

    def offsets(self, keys: Keys) -> Floats:
        """(n,) seconds by which the clock of each node is ahead at time 0, given one counter key per node."""


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


class Workload(Protocol):
    """What the network does. `mechanism`: 'tracking', or 'beacons', a network without targets.

    A workload that brings its own mechanism (`mechanisms.StartsWorkload`) is one without targets.
    """

    @property
    def mechanism(self) -> str: ...


class BeaconWorkload(Workload, Protocol):
    """Every node broadcasts a payload of `bits` once per `period` (s) of its own clock."""

    @property
    def period(self) -> float: ...

    @property
    def bits(self) -> int: ...


class CollectionWorkload(Workload, Protocol):
    """Every node sends a report of `bits` to a sink once per `period` (s) of its own clock, after `start_at` s."""

    @property
    def period(self) -> float: ...

    @property
    def bits(self) -> int: ...

    @property
    def start_at(self) -> float: ...


class FaultEvent(Protocol):
    """An injected fault: its `mechanism`, its beginning (`at`, s), its `duration` (s; None: until the end of the run).

    The nodes it hits are given by exactly one of `nodes` (ids), `fraction` (of all, sampled), `region` (x, y, radius in
    m) and `head` (the cluster head of that target when the fault begins). A plug-in also offers `start`: see
    `mechanisms.StartsFault`.
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


class Routing(Protocol):
    """The path of a datagram that leaves its cluster."""

    @property
    def weight(self) -> str:
        """What it minimises: 'energy' or 'hop'; or 'greedy': each hop goes nearest to the destination.

        Nodes know the paths for nothing. With 'etx' they pay for what they know: see `TreeRouting`.
        """


class TreeRouting(Routing, Protocol):
    """Routing over a collection tree, whose `weight` is 'etx': the expected number of transmissions."""

    @property
    def i_min(self) -> float:
        """The shortest interval of the Trickle timer of beacons in s."""

    @property
    def i_max(self) -> float:
        """The longest interval in s."""

    @property
    def retries(self) -> int:
        """How often a datagram is sent again over one hop, retransmissions of the MAC included."""

    @property
    def hysteresis(self) -> float:
        """By how many transmissions a route must be cheaper than that over the parent."""

    @property
    def table(self) -> int:
        """The number of neighbours whose routes a node keeps."""

    @property
    def queue(self) -> int:
        """The number of datagrams that a node holds."""

    @property
    def packet_time(self) -> float:
        """Seconds of one packet: pauses between frames are multiples of it."""

    @property
    def patience(self) -> float:
        """Seconds for which a datagram waits for a route."""

    @property
    def places(self) -> int:
        """The number of neighbours whose positions a node keeps."""

    @property
    def candidates(self) -> int:
        """The number of bursts that a node sends of a datagram to another node than a sink."""


def __getattr__(name: str) -> Any:
    return renamed(__name__, name)
