"""What passes between heads: the mission that one is given, the crew that it may call on, the word for a loss."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.track import Election, Track


@dataclass(slots=True)
class Handover:
    """What a new head starts from: a belief that reached it, or, for a new track, the readings that it knows.

    Either is of step `belief_step`. `elected`: a network-wide election has already chosen this head. `at_once`: it
    acts in the present step, not at the next tick.

    Of heads that move: `detected`, {node: reading} of a target that nobody follows, which this head takes up;
    `looks_ahead`: it has nodes woken before it does anything else; `fixed_at`: when the target was last sensed, in s;
    `belief_time`: when the belief holds, None: at its step's instant.
    """

    belief_step: int
    belief: Any = None
    readings: Mapping[int, float] | None = None
    previous_head: int = -1
    hops: int = 0
    bits: int = 0
    elected: bool = False
    at_once: bool = False
    detected: Mapping[int, float] | None = None
    looks_ahead: bool = False
    fixed_at: float = 0.0
    belief_time: float | None = None


@dataclass(slots=True)
class Crew:
    """How processes reach each other: give a node the lead, have candidates stand, tell members their role.

    `woke(node, target, by_frame)` is told of each wake.
    """

    appoint: Callable[[Track, int, Handover], None]
    call_election: Callable[[Track, Election], None]
    enlist: Callable[[Track, Cluster], None]
    release: Callable[[Track, Cluster], None]
    dismiss: Callable[[Track, int], None]
    woke: Callable[[int, int, bool], None]
    end_run: Callable[[], None]


class TrackLost(Exception):
    """The belief is gone though the head lives; the message is the word for the log."""
