"""When a network's life ends: criteria over sample paths, each with a tolerance of interruptions.

    ends = Criteria(...).times(events, paths) -> {criterion: (R,) s, infinite where it is not met before the horizon}

A criterion is met once it holds for longer than the tolerance, from the begin of that time on (Dietrich, Dressler 2009,
"On the lifetime of wireless sensor networks"). Without harvesting, dead nodes
stay dead, and the tolerance has no effect.
"""

from __future__ import annotations

import dataclasses
import itertools
from typing import Final

import numpy as np
from scipy.sparse.csgraph import connected_components

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.scenario.lifetime import CRITERIA

FIRST, TENTH, HALF, COVERAGE, SINK, TRACKED = CRITERIA
LATTICE: Final = 50
"""Cells along each side of the field, at whose centres coverage is evaluated."""


@dataclasses.dataclass(frozen=True)
class Criteria:
    """The criteria of one network of N nodes.

    Attributes:
        near: (cells, N) whether a node senses a cell of the field.
        links: (N, N) whether nodes can communicate.
        sinks: the nodes of the sinks; none: no sink can be cut off.
        coverage: share of the cells covered at the start, below which coverage has ended.
        connected: share of the living nodes with a path to a sink, below which the sinks are cut off.
        tracked: share of what was tracked at the start, below which tracking has ended.
        knots: (2, E) share of dead nodes, and share of steps tracked, for which visits were simulated.
        tolerance: how long an interruption may last in s.
        horizon: end of the paths in s.
    """

    near: Bools
    links: Bools
    sinks: Ints
    knots: Floats
    coverage: float = 0.9
    connected: float = 0.5
    tracked: float = 0.9
    tolerance: float = 0.0
    horizon: float = np.inf

    def times(self, events: Floats, alive: Bools, paths: int) -> dict[str, Floats]:
        """{criterion: (R,) s} of events (E, 4) as `Paths` notes them, and the nodes (N,) alive at the start."""
        order = np.lexsort((events[:, 2], events[:, 0]))
        bounds = np.searchsorted(events[order, 0], np.arange(paths + 1))
        found = [self._of_path(events[order[a:b]], alive) for a, b in itertools.pairwise(bounds)]
        return {name: np.array([times[name] for times in found]) for name in CRITERIA}

    def series(self, rows: Floats, alive: Bools) -> tuple[Floats, dict[str, Floats]]:
        """Times (E + 1,) of the changes of one path, and {quantity: (E + 1,)} from each of them on."""
        steps = np.where(rows[:, 3] > 0.0, 1, -1)
        dead = (np.cumsum(np.concatenate([[(~alive).sum()], -steps]))) / len(alive)
        seen, covered = self.near[:, alive].sum(axis=1), []
        for node, step in [(-1, 0), *zip(rows[:, 1].astype(int), steps, strict=True)]:
            seen = seen + step * self.near[:, node]
            covered.append(np.count_nonzero(seen) / len(seen))
        return np.concatenate([[0.0], rows[:, 2]]), {
            "dead": dead,
            "coverage": np.array(covered),
            "connected": self._connected(rows, alive),
            "tracked": np.interp(dead, *self.knots),
        }

    def _of_path(self, rows: Floats, alive: Bools) -> dict[str, float]:
        times, now = self.series(rows, alive)
        count, begun = np.rint(now["dead"] * len(alive)), int((~alive).sum())
        least = {FIRST: begun + 1, TENTH: int(np.ceil(0.1 * len(alive))), HALF: int(np.ceil(0.5 * len(alive)))}
        met = {name: count >= number for name, number in least.items()}
        met[COVERAGE] = now["coverage"] < self.coverage * now["coverage"][0]
        met[SINK] = now["connected"] < self.connected
        met[TRACKED] = now["tracked"] < self.tracked * now["tracked"][0]
        return {name: self._begin(times, flags) for name, flags in met.items()}

    def _begin(self, times: Floats, met: Bools) -> float:
        """The begin of the first time for which a criterion holds longer than the tolerance; infinite without one."""
        ends = np.flatnonzero(np.diff(met, prepend=False, append=False)).reshape(-1, 2)
        until = np.append(times, self.horizon)
        for first, after in ends:
            if until[after] - times[first] > self.tolerance:
                return float(times[first])
        return np.inf

    def _connected(self, rows: Floats, alive: Bools) -> Floats:
        """(E + 1,) share of the living nodes that reach a sink; 1 without sinks, 0 if no sink lives."""
        result, alive = np.ones(len(rows) + 1), alive.copy()
        if not self.sinks.size:
            return result
        for i in range(len(result)):
            if i:
                alive[int(rows[i - 1, 1])] = rows[i - 1, 3] > 0.0
            labels = connected_components(self.links & alive & alive[:, None], directed=False)[1]
            ours = labels[self.sinks[alive[self.sinks]]]
            result[i] = np.isin(labels[alive], ours).sum() / max(alive.sum(), 1)
        return result
