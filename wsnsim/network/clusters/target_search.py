"""Nodes that are awake look for a target that nobody follows: who detects it first.

search.first(target, part) -> (node, {node: reading}) or None
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.rng import Streams, derive, derive_all, uniforms
from wsnsim.network.readings import Imperfections, Readings, search_senses
from wsnsim.network.run_context import RunContext


class TargetSearch:
    """What there is to detect at each instant at which nodes look: `parts.polls` times a step, the step's own included.

    At a step's instant the readings are the step's; between, they have noise of their own. Nodes look at the same
    instants, their clocks being in step; who of several is the first to say so is drawn (our choice).
    """

    def __init__(
        self, stage: RunContext, paths: Sequence[Floats], streams: Streams, sensed: Sequence[Readings],
        imperfections: Imperfections,
    ) -> None:  # fmt: skip
        self._stage = stage
        self._sensed = sensed
        self._polls = stage.parts.polls
        self._key = streams.key("search")
        self._between = (
            search_senses(stage.parts, paths, stage.fleet, imperfections, self._key) if self._polls > 1 else []
        )

    def first(self, target: int, part: int) -> tuple[int, dict[int, float]] | None:
        """Who of the nodes that are awake detects a target first, and what all of them read; None: nobody does.

        `part`: at which of the step's instants, the first being the step's own.
        """
        stage = self._stage
        if part:
            readings = self._between[target].readings(stage.step * self._polls + part)
        else:
            readings = self._sensed[target].readings(stage.step)
        awake = {node: value for node, value in readings.items() if stage.fleet.is_awake(node)}
        able = np.array([node for node in awake if stage.able(node)], dtype=np.int64)
        if not able.size:
            return None
        drawn = uniforms(derive_all(derive(self._key, target, stage.step, part), able), 0)
        return int(able[np.argmin(drawn)]), awake
