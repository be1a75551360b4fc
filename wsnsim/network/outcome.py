"""What a run of a network leaves behind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.counters import Counters
from wsnsim.network.clusters.track import Track
from wsnsim.network.nodes import Nodes


def _none_woken() -> Ints:
    return np.zeros((0, 1, 2), dtype=np.int64)


@dataclass(frozen=True, slots=True)
class NetworkOutcome:
    """The state of a network at the end of a run.

    Attributes:
        nodes: with the energy that each has spent.
        counts: what the radio counted.
        event_fingerprint: of the event log.
        awake: share of the nodes' time that they were awake.
        cycles: operations that trackers computed.
        steps: the last step.
        tracks: one per target; none in a network without targets.
        woken: (targets, steps + 1, 2) nodes that woke, and how many of them unnecessarily.
        received: time in s at which the sink received the estimate of (target, step).
    """

    nodes: Nodes
    counts: Counters
    event_fingerprint: int
    awake: float
    cycles: float = 0.0
    steps: int = 0
    tracks: tuple[Track, ...] = ()
    woken: Ints = field(default_factory=_none_woken)
    received: Mapping[tuple[int, int], float] = field(default_factory=dict)
