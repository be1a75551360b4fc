"""Ports of energy models, links, clocks and processors, and what an energy model makes of time and of a packet.

Each port is implemented by frozen `@part` classes. Quantities are in SI units, received powers in dBm. `keys` are
counter keys (see `base.rng`): equal keys give equal random numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.requests import PACKET_BITS


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
    """AWAKE or ASLEEP, by the `SleepSchedule` of the node."""


class ModePower(NamedTuple):
    """The power of a node in a mode.

    Attributes:
        radio: of the radio, in W.
        radio_sleeps: whether that is booked as sleep, otherwise as idle.
        processor: of the processor, in W.
        processor_sleeps: whether that is booked as sleep, otherwise as idle.
    """

    radio: float
    radio_sleeps: bool
    processor: float
    processor_sleeps: bool


class EnergyModel(Protocol):
    """The energy of each act of a node, in J."""

    @property
    def battery(self) -> float:
        """Initial charge of a node in J."""

    def transmit(self, bits: float, distance: float) -> tuple[float, float]:
        """(electronics, amplifier) joules of sending bits over a distance in m."""

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

    A model that knows each link by itself also has the port `RecordsLinks`.
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
    """The time of computations."""

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


class HeardLinks(NamedTuple):
    """The links of one sender in one round.

    Attributes:
        ids: (n,) the nodes that hear it, ascending.
        powers: (n,) received power in dBm.
        ratios: (n,) probability that a frame arrives.
    """

    ids: Ints
    powers: Floats
    ratios: Floats


class BurstyLosses(NamedTuple):
    """The Gilbert-Elliott model of a link: it is good or bad, each for an exponentially distributed time.

    Attributes:
        bad_time: Mean duration of a bad state in s.
        good: Probability that a frame arrives in a good state.
        bad: The same in a bad state.
    """

    bad_time: float
    good: float
    bad: float


@runtime_checkable
class RecordsLinks(Protocol):
    """Optional port of a link model that knows each link by itself, for one round after the other."""

    @property
    def losses(self) -> BurstyLosses | None:
        """How losses of one link depend on each other; None if they are independent."""

    def round_end(self, number: int) -> float:
        """The simulated time in s at which a round ends; `number` counts from 0. Infinity: it is the last one."""

    def heard(self, number: int, source: int) -> HeardLinks:
        """The links of a sender in a round."""


class NoPower:
    """The `ContinuousPower` of a model for which time costs nothing."""

    def mode_power(self, mode: Mode) -> ModePower:
        """Return zeros."""
        return ModePower(0.0, False, 0.0, False)

    def switching(self, before: Mode, after: Mode) -> float:
        """Return 0."""
        return 0.0

    def turnaround(self) -> float:
        """Return 0."""
        return 0.0

    def seconds(self, cycles: float) -> float:
        """Return 0."""
        return 0.0


def continuous_power(energy: EnergyModel) -> ContinuousPower | None:
    """Return the part of an energy model that costs over time, or None if it has none."""
    return energy if isinstance(energy, ContinuousPower) else None


@dataclass(frozen=True, slots=True)
class PacketJoules:
    """The energy of one packet of `PACKET_BITS` by an energy model, at the sender and at one receiver."""

    energy: EnergyModel

    def __call__(self, distances: Floats) -> Floats:
        """(n,) J that a packet costs over distances (n,) in m; headers of frames and acknowledgements excluded."""
        transmit, received = self.energy.transmit, self.energy.receive(PACKET_BITS)
        spent = [sum(transmit(PACKET_BITS, distance)) + received for distance in distances.tolist()]
        return np.array(spent, dtype=np.float64)


def free_packets(distances: Floats) -> Floats:
    """(n,) zeros: without a network a packet costs nothing."""
    return np.zeros(len(distances))
