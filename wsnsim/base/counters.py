"""Counters of the radio: what the table `runs` reports of the frames of a run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Counters:
    """Totals of one run, over all nodes.

    Attributes:
        transmissions: MAC frames on the air, acknowledgements included. The other counters leave those out.
        frames_sent: Frames sent; on an ideal channel, bursts.
        frames_lost: Of these, frames that did not reach every node that they were meant for.
        packets_sent: Packets in the frames sent.
        in_range: Receptions that were intended: one per frame and node that it was meant for.
        delivered: Of these, receptions that succeeded.
        collided: Of these, receptions lost because another transmission overlapped.
        access_failures: Frames dropped because the channel was busy at every assessment.
        retries: Frames sent again because no acknowledgement came.
    """

    transmissions: int = 0
    frames_sent: int = 0
    frames_lost: int = 0
    packets_sent: int = 0
    in_range: int = 0
    delivered: int = 0
    collided: int = 0
    access_failures: int = 0
    retries: int = 0
