"""The ports of a radio: what energy, links, channel access, clocks and faults must be able to do.

Behind each stands one or more frozen `@part` classes. SI units throughout; powers in the air in dBm. `keys` are counter
keys (see `base.rng`): equal keys, equal draws.
"""

from __future__ import annotations

import warnings
from enum import IntEnum
from typing import NamedTuple, Protocol, runtime_checkable

from wsnsim.base.arrays import Bools, Floats, Keys


class Mode(IntEnum):
    """What a node does when it neither sends, receives nor computes."""

    DORMANT = 0
    """Processor asleep; sensor and receiver on: a measurement of the target or a frame wakes the node."""
    AWAKE = 1
    """Processor and receiver on."""
    ASLEEP = 2
    """Processor and radio off."""
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
    def battery(self) -> float: ...

    def transmit(self, bits: float, distance: float) -> tuple[float, float]:
        """(electronics, amplifier) joules."""
        ...

    def receive(self, bits: float) -> float: ...

    def compute(self, cycles: float) -> float: ...

    def sense(self) -> float: ...


@runtime_checkable
class ContinuousPower(Protocol):
    """The optional part of an energy model: power over time, and the energy of changes. Without it both are zero.

    While the radio of a node sends or receives, its `mode_power` is not charged; while the processor computes, that of
    the processor is not.
    """

    def mode_power(self, mode: Mode) -> ModePower:
        """Power in a mode; zero where the model knows no such cost."""
        ...

    def switching(self, before: Mode, after: Mode) -> float:
        """Joules of a change of mode."""
        ...

    def turnaround(self) -> float:
        """Joules of one change of the radio between receiving and sending."""
        ...

    def seconds(self, cycles: float) -> float:
        """Seconds for which the processor is busy with `cycles`; 0 where the model does not know."""
        ...


@runtime_checkable
class DrawsPower(Protocol):
    """`ContinuousPower` under the former name of its first method."""

    def draw(self, mode: Mode) -> ModePower: ...

    def switching(self, before: Mode, after: Mode) -> float: ...

    def turnaround(self) -> float: ...

    def seconds(self, cycles: float) -> float: ...


class RenamedPower:
    """The `ContinuousPower` of a model that has the former names."""

    def __init__(self, model: DrawsPower) -> None:
        self.mode_power = model.draw
        self.switching = model.switching
        self.turnaround = model.turnaround
        self.seconds = model.seconds


def continuous_power(energy: EnergyModel) -> ContinuousPower | None:
    """Return the part of an energy model that costs over time, or None if it has none."""
    if isinstance(energy, ContinuousPower):
        return energy
    if isinstance(energy, DrawsPower):
        message = f"{type(energy).__name__}.draw(mode) was renamed to mode_power(mode)"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return RenamedPower(energy)
    return None


class LinkModel(Protocol):
    """Who hears whom, and how well. `reach` is the nominal range in m, `audible` the distance beyond which nobody
    hears anything. `perfect`: every frame that nothing disturbs arrives. `captures`: a frame may survive another that
    overlaps it; otherwise neither arrives where both are heard.
    """

    @property
    def reach(self) -> float: ...

    @property
    def audible(self) -> float: ...

    @property
    def perfect(self) -> bool: ...

    @property
    def captures(self) -> bool: ...

    def powers(self, distances: Floats, pairs: Keys, directions: Keys) -> Floats:
        """(n,) received power in dBm over links of these lengths; -inf where nothing is heard.

        `pairs` are counter keys equal for both directions of a link, `directions` differ.
        """
        ...

    def reception(self, powers: Floats, bits: float, interference: Floats | float) -> Floats:
        """(n,) probability that a frame of so many bits on the air arrives, given what disturbs it (mW, 0: nothing)."""
        ...

    def senses(self, powers: Floats) -> Bools:
        """(n,) whether a node takes the channel for busy when it hears so much (clear channel assessment)."""
        ...


class Mac(Protocol):
    """When a frame gets the channel. `mechanism` names what the network room performs; fields are its parameters."""

    @property
    def mechanism(self) -> str: ...


class IdealAccess(Mac, Protocol):
    """An ideal channel. `rate` in bit/s; None: sending takes no time."""

    @property
    def rate(self) -> float | None: ...


class FramedMac(Mac, Protocol):
    """A MAC whose frames take time: `rate` bit/s, `turnaround` s between receiving and sending, whether unicasts are
    acknowledged (`acks`, by `ack_bits` on the air, awaited for `ack_wait` s, repeated `max_retries` times).

    `payload_bits`: what a frame can carry.
    """

    rate: float
    turnaround: float
    acks: bool
    ack_wait: float
    max_retries: int

    @property
    def ack_bits(self) -> int: ...

    @property
    def payload_bits(self) -> int: ...

    def bits(self, payload_bits: int) -> int:
        """Bits on the air of a frame with such a payload, preamble and headers included."""
        ...

    def airtime(self, bits: float) -> float:
        """Seconds that so many bits on the air take."""
        ...

    def spacing(self, bits: int) -> float:
        """Seconds that a sender leaves after a frame of so many bits on the air."""
        ...


class ContendingMac(FramedMac, Protocol):
    """Carrier sense with collision avoidance: slots of `backoff` s, 2^BE of them, BE from `min_be` to `max_be`; given
    up after `max_backoffs` further attempts; a channel is assessed for `cca` s.
    """

    backoff: float
    min_be: int
    max_be: int
    max_backoffs: int
    cca: float


class SlottedMac(ContendingMac, Protocol):
    """Slots inside a cluster, contention outside. `guard` s at either end of a slot; `slot` s, None: as long as needed;
    `schedule_bits` an entry of the schedule that the head broadcasts.
    """

    guard: float
    slot: float | None
    schedule_bits: int

    def slot_needed(self, bits: int) -> float:
        """Seconds that a frame of so many bits on the air needs: turnaround, acknowledgement and guards included."""
        ...


class Packing(Protocol):
    """How many packets of a burst travel in one frame."""

    def packets(self, packet_bits: int, most_bits: int) -> int:
        """Of this size, in a frame whose payload holds so many bits; at least 1."""
        ...


class Cpu(Protocol):
    """The time of computations. `cycles_per_flop`: processor cycles of one operation stated by a tracker."""

    @property
    def cycles_per_flop(self) -> float: ...

    def seconds(self, cycles: float) -> float:
        """Simulated seconds that `cycles` take; 0 if computing takes no time."""
        ...


class Clock(Protocol):
    """The rates of the clocks of nodes."""

    def rates(self, keys: Keys) -> Floats:
        """(n,) seconds that pass on the clock of each node per true second, given one counter key per node."""
        ...


class Sink(Protocol):
    """The sink of estimates: the node nearest to `point` (2,), or none if that is None. A report has `bits`."""

    @property
    def point(self) -> tuple[float, float] | None: ...

    @property
    def bits(self) -> int: ...

    @property
    def every(self) -> float | None:
        """Seconds between reports; None: every estimate is reported."""
        ...


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


class FaultEvent(Protocol):
    """An injected fault: its `mechanism`, its beginning (`at`, s), its `duration` (s; None: until the end of the run).

    The nodes it hits are given by exactly one of `nodes` (ids), `fraction` (of all, sampled), `region` (x, y, radius in
    m) and `head` (the cluster head of that target when the fault begins). A plug-in also offers `start`: see
    `mechanisms.StartsFault`.
    """

    @property
    def mechanism(self) -> str: ...

    @property
    def at(self) -> float: ...

    @property
    def duration(self) -> float | None: ...

    @property
    def nodes(self) -> tuple[int, ...] | None: ...

    @property
    def fraction(self) -> float | None: ...

    @property
    def region(self) -> tuple[float, float, float] | None: ...

    @property
    def head(self) -> int | None: ...


class Routing(Protocol):
    """What a relayed message minimises: `weight` is 'energy' or 'hop'; 'greedy': each hop goes nearest to the goal."""

    @property
    def weight(self) -> str: ...
