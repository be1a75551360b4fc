"""Nodes that woke for each target and step, and how many of them did so unnecessarily."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from wsnsim.base.arrays import Floats, Ints, planar
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.clusters.track import Track


class WakeUpCounters:
    """Counts wake-ups. One is unnecessary if the target is out of the node's sensing range.

    `woken` (targets, steps + 1, 2) holds the nodes that woke and, of these, the unnecessary wake-ups. `points` holds
    the true positions (steps + 1, P) of each target.
    """

    def __init__(self, network: NetworkView, points: Sequence[Floats]) -> None:
        self._network = network
        self._points = points
        self.woken: Ints = np.zeros((len(points), network.setup.steps + 1, 2), dtype=np.int64)

    def count_wake(self, node: int, target: int, by_frame: bool) -> None:
        """Count a wake-up at its step: it is unnecessary if a frame caused it and the node does not sense the target.

        For networks that wake no nodes ahead.
        """
        unnecessary = by_frame and node not in self._network.readings[target]
        self.woken[target, self._network.clock.step] += (1, unnecessary)

    def count_rounds(self, track: Track) -> None:
        """Count the nodes that the wake-up rounds for the present step have woken, and complete the rounds."""
        nodes, step = self._network.nodes, self._network.clock.step
        rounds = list(track.rounds_for(step))
        if not rounds:
            return
        point, reach = planar(self._points[track.target][step]), self._network.setup.sensor.reach
        woken: set[int] = set()
        unnecessary: set[int] = set()
        for one in rounds:
            tracking = [node for node in one.tracking if nodes.alive[node]]
            apart = nodes.positions[np.array(tracking, dtype=np.int64)] - point
            beyond = np.hypot(apart[:, 0], apart[:, 1]) > reach
            one.woken, one.ineffective = len(tracking), int(beyond.sum())
            one.dismissed = len(one.reached.difference(one.tracking))
            woken.update(tracking)
            unnecessary.update(itertools.compress(tracking, beyond.tolist()))
        self.woken[track.target, step] += (len(woken), len(unnecessary))
