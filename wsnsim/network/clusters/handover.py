"""What passes from one head of a track to the next, and how a head's lead can end otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wsnsim.base.vector_readings import Reading


@dataclass(frozen=True, slots=True)
class Handover:
    """What a new head, `successor`, starts from: a belief that reached it or, for a new track, readings that it knows.

    Attributes:
        belief_step: the step of the belief or of the readings.
        hops: number of hops of the belief to the successor.
        bits: bits sent on these hops.
        elected: a network-wide election has chosen the successor.
        at_once: the successor acts in the present step, not at the next tick.
        detected: {node: reading} of a target without a track. This and the following are used by moving heads only.
        wakes_nodes: the successor has nodes woken before it does anything else.
        last_sensed: time in s at which the target was last sensed.
        belief_time: time in s of the belief; None: the instant of its step.
    """

    successor: int
    belief_step: int
    belief: Any = None
    readings: Mapping[int, Reading] | None = None
    previous_head: int = -1
    hops: int = 0
    bits: int = 0
    elected: bool = False
    at_once: bool = False
    detected: Mapping[int, Reading] | None = None
    wakes_nodes: bool = False
    last_sensed: float = 0.0
    belief_time: float | None = None


class TrackLost(Exception):
    """The track was lost while its cluster head is alive. The argument is the reason that is logged."""


class NotDelivered(TrackLost):
    """Nothing of a belief arrived at the next head. A patient head goes on with it, others lose the track."""

    def __init__(self) -> None:
        super().__init__("handover_lost")


class LastClusterDone(Exception):
    """The scenario ends with this cluster (`until.clusters`)."""
