"""Awake nodes search for a target without a track, several times in a step.

search.first_detection(target, poll) -> (node, {node: reading}) or None
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.vector_readings import Reading
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.sensing.imperfect_readings import Imperfections, make_search_readings
from wsnsim.network.sensing.readings import Readings


class TargetSearch:
    """What awake nodes detect at the `setup.polls` instants of a step at which they search.

    At a step's own instant (poll 0) the readings are those of the step; between steps they have noise of their own.
    All nodes search at the same instants; of several that detect the target, a random one reports first (our choice).
    """

    def __init__(
        self, network: NetworkView, available: Sequence[Readings], paths: Sequence[Floats],
        imperfections: Imperfections, key: int,
    ) -> None:  # fmt: skip
        """`available` and `paths`: per target, its readings at steps, and its trajectory at every poll."""
        self._network = network
        self._available = available
        self._polls = network.setup.polls
        self._key = key
        self._between = (
            make_search_readings(network.setup, paths, network.nodes, imperfections, key) if self._polls > 1 else []
        )

    def first_detection(self, target: int, poll: int) -> tuple[int, dict[int, Reading]] | None:
        """The node that detects a target first at an instant, and the readings of all awake nodes; None: no node."""
        network, step = self._network, self._network.clock.step
        if poll:
            readings = self._between[target].readings(step * self._polls + poll)
        else:
            readings = self._available[target].readings(step)
        awake = {node: value for node, value in readings.items() if network.nodes.is_awake(node)}
        able = np.array([node for node in awake if network.can_lead(node)], dtype=np.int64)
        if not able.size:
            return None
        chances = uniforms(derive_all(derive(self._key, target, step, poll), able), 0)
        return int(able[np.argmin(chances)]), awake
