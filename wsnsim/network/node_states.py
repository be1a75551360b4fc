"""Where the nodes of a network stand, which of them are up, and which listen."""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, scalars
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.radio import Mode
from wsnsim.network.energy.sleep_states import SleepStates


class Places:
    """Positions of nodes: `positions` (N, 2) in m, single coordinates `x` and `y`, and a `grid` for neighbours."""

    def __init__(self, positions: Floats) -> None:
        self.positions = positions
        self.grid = CellGrid(positions)
        self.x, self.y = scalars(self.grid.x), scalars(self.grid.y)


class NodeStates:
    """The places and states of nodes. What they cost is in `nodes.Nodes`, which changes them.

    Attributes:
        positions: (N, 2) in m where the nodes stand; `x` and `y` give single coordinates, `grid` finds neighbours.
        assumed: The positions that filters, cluster heads, messages and greedy routing use; by default `positions`.
        traits: (N, T) constants of the sensors.
        reach: Communication range in m.
        living: (N,) which nodes are up, that is neither dead nor crashed; `alive[i]` is the same for single nodes.
        all_listen: Whether all nodes are up and listen.
        jammed, loss: (N,) radios that faults jam, and the probability that faults lose a frame from or to a node.
        disturbed: Whether any node is jammed or loses frames.
        sleep_states: The modes of nodes that do not rest, and the sleep schedules of those that do.
    """

    def __init__(self, positions: Floats, traits: Floats, reach: float, sleep_states: SleepStates) -> None:
        self.assumed = places = Places(positions)
        self.positions, self.x, self.y, self.grid = positions, places.x, places.y, places.grid
        self.traits = traits
        self.size = size = len(positions)
        self.reach = reach
        self.living = np.ones(size, dtype=np.bool_)
        self.alive = scalars(self.living)
        self.jammed, self.loss = np.zeros(size, dtype=np.bool_), np.zeros(size)
        self.disturbed = False
        self.sleep_states = sleep_states
        self.follows_schedules = sleep_states.rest is Mode.SCHEDULED
        self.all_listen = not self.follows_schedules
        self._always_awake: set[int] = set()
        self._up_since, self._last_restart = np.zeros(size), 0.0

    def distance(self, a: int, b: int) -> float:
        """Distance in m between two nodes."""
        dx, dy = self.x[a] - self.x[b], self.y[a] - self.y[b]
        return float((dx * dx + dy * dy) ** 0.5)

    def hears(self, ids: Ints, since: float) -> Bools:
        """(n,) which nodes are up and have been listening since a time that is not in the future."""
        hears = self.sleep_states.hears(ids, since, self.living)
        return hears if since >= self._last_restart else hears & (self._up_since[ids] <= since)

    def all_heard(self, since: float) -> bool:
        """Whether all nodes are up and have been listening since a time that is not in the future."""
        return self.all_listen and since >= self._last_restart

    def is_awake(self, node: int) -> bool:
        """Whether a node is up and listens now."""
        return self.alive[node] and (not self.follows_schedules or self.sleep_states.is_awake(node))

    def is_scheduled_awake(self, node: int) -> bool:
        """Whether a node has a schedule that says that it is awake now."""
        return self.follows_schedules and self.sleep_states.scheduled(node) is Mode.AWAKE

    def rest_of(self, node: int) -> Mode:
        """The mode of a node that has nothing to do."""
        return Mode.AWAKE if node in self._always_awake else self.sleep_states.rest

    def _mark_up(self, node: int, now: float) -> None:
        self._up_since[node] = self._last_restart = now
        self.living[node] = True
        self.all_listen = not self.follows_schedules and bool(self.living.all())

    def _mark_down(self, node: int) -> None:
        self.living[node] = False
        self.all_listen = False
