"""The faults of a scenario in simulated time: each begins at its time, and passes when its duration has ended.

    FaultSchedule(faults, site, key, dt).start()

The nodes that a fault hits are chosen at its beginning. A share of all nodes depends on the key and the number of the
fault alone, so that the rest of a run draws the same random numbers as without faults. Of the faults of one time,
those that end come first, then those that begin, in the order of the scenario; all come before the step of that time.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.mechanisms import NOBODY
from wsnsim.base.network_ports import FaultEvent
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.network.faults.mechanisms import make_fault
from wsnsim.network.faults.services import Combination, FaultSite, Outages, RadioDisturbances, SiteServices, Timeline


class FaultSchedule:
    """The faults of one run. `key` is the random key of all faults, `dt` the length of a step in s."""

    def __init__(self, faults: Sequence[FaultEvent], site: FaultSite, key: int, dt: float) -> None:
        self._faults = tuple(faults)
        self._site = site
        self._key = key
        self._timeline = Timeline(site.env, site.log, dt)
        shared = Combination(self._timeline, Outages(), RadioDisturbances(site.nodes), key)
        self._services = [SiteServices(site, shared, fault, number) for number, fault in enumerate(self._faults)]
        self._mechanisms = [make_fault(*each) for each in zip(self._faults, self._services, strict=True)]
        self._hit: dict[int, Ints] = {}

    def start(self) -> None:
        """Set a timer for each beginning and end, before any other event; a fault at time 0 begins at once."""
        when = self._timeline.snapped
        changes = [(when(fault.at), 1, number) for number, fault in enumerate(self._faults)]
        for number, fault in enumerate(self._faults):
            if fault.duration is not None:
                ends = when(fault.at + fault.duration)
                changes.append((ends, 0 if ends > when(fault.at) else 2, number))
        for time, order, number in sorted(changes):
            act = self._begin if order == 1 else self._end
            self._timeline.call_at(time, partial(act, number))

    def _begin(self, number: int) -> None:
        dead = self._site.nodes.died_at
        hit = [node for node in self.aimed(number) if node not in dead]
        if not hit:
            self._services[number].log_start(NOBODY)
            return
        self._hit[number] = np.array(hit, dtype=np.int64)
        self._mechanisms[number].begin(self._hit[number])

    def _end(self, number: int) -> None:
        nodes = self._hit.pop(number, None)
        if nodes is not None:
            self._mechanisms[number].end(nodes)

    def aimed(self, number: int) -> list[int]:
        """Return the nodes at which a fault is aimed now, ascending, dead ones included."""
        fault = self._faults[number]
        if fault.head is None:
            return places_hit(fault, derive(self._key, number), self._site.nodes.grid)
        head = self._site.control.head_of(fault.head)
        return [] if head is None else [head]


def places_hit(fault: FaultEvent, key: int, grid: CellGrid) -> list[int]:
    """Return at which of the nodes in a grid a fault without `head` is aimed, ascending."""
    size = len(grid.positions)
    if fault.nodes is not None:
        return sorted({node for node in fault.nodes if node < size})
    if fault.fraction is not None:
        samples = uniforms(derive_all(key, np.arange(size)), 0)
        chosen: list[int] = np.argsort(samples, kind="stable")[: round(fault.fraction * size)].tolist()
        return sorted(chosen)
    if fault.region is None:
        return []
    x, y, radius = fault.region
    near: list[int] = grid.within((x, y), radius).tolist()
    return near
