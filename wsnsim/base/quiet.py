"""Ports of what a network does while there is no target: what nodes send for its upkeep, and what radios do for that.

From components that say so, the power of a quiet network follows in closed form. Where one does not, it is measured in
a run. Times in s.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

from wsnsim.base.arrays import Floats

OfLinks: TypeAlias = Floats | float
"""(E,) a number for each of E links, or one for all."""


class Upkeep(NamedTuple):
    """A broadcast that every node sends again and again.

    Attributes:
        bits: Length of its payload.
        period: Seconds on the clock of a node from one to the next, on average.
        settles: Seconds after which a network that starts does so.
        steady: Whether it does in this setup: otherwise the power that this takes has no closed form.
    """

    bits: int
    period: float
    settles: float = 0.0
    steady: bool = True


@runtime_checkable
class SendsUpkeep(Protocol):
    """Optional port of a MAC, of time synchronisation or of routing."""

    def upkeep(self, setup: Any) -> tuple[Upkeep, ...]:
        """What nodes broadcast without a target."""


class SentFrames(NamedTuple):
    """Frames that a radio sends or receives, a number for each broadcast on average.

    Attributes:
        bits: Length of a frame on the air.
        seconds: For how long the radio is busy with it.
        number: How many there are.
        held: Whether the radio is held on meanwhile; otherwise it follows its duty.
    """

    bits: int
    seconds: float
    number: OfLinks = 1.0
    held: bool = False


class RadioUse(NamedTuple):
    """What a radio does for one broadcast in addition to its duty, on average.

    Attributes:
        frames: What it sends or receives.
        held: Seconds for which it is held on, frames included.
        starts: How often it is switched on and off; negative if the broadcast takes the place of a wake-up.
        listening: Seconds of listening in addition to that of its duty.
        together: A node that hears several broadcasts within as many seconds pays for one of them.
    """

    frames: tuple[SentFrames, ...]
    held: OfLinks = 0.0
    starts: OfLinks = 0.0
    listening: OfLinks = 0.0
    together: float = 0.0


class Hearing(NamedTuple):
    """How well broadcasts are heard over E links.

    Attributes:
        arrives: bits -> (E,) probability that a frame of this length on the air arrives.
        senses: (E,) 1 where the receiver takes the channel for busy, else 0.
        off_time: Seconds for which a radio is off at least.
    """

    arrives: Callable[[int], Floats]
    senses: Floats
    off_time: float


@runtime_checkable
class UsesRadios(Protocol):
    """Optional port of a MAC: what radios do for a broadcast that nothing disturbs, where all nodes are awake."""

    def broadcast_use(self, bits: int, hearing: Hearing) -> tuple[RadioUse, RadioUse]:
        """What a payload of `bits` takes of its sender, and at the other end of each link (E,)."""


@runtime_checkable
class KnowsLongRun(Protocol):
    """Optional port of a sleep schedule whose nodes are `SCHEDULED`."""

    @property
    def long_run(self) -> tuple[float, float]:
        """The share of the time in which a node is awake, and its switches per second."""
