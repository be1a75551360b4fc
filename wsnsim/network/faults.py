"""The faults of a scenario in simulated time: each begins at its time, and passes when its duration has ended.

    FaultSchedule(faults, site, key, dt).start()

The nodes that a fault hits are chosen at its beginning. A share of all nodes depends on the key and the number of the
fault alone, so that the rest of a run draws the same random numbers as without faults. Of the faults of one time,
those that end come first, then those that begin, in the order of the scenario; all come before the step of that time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.mechanisms import NOBODY, FaultMechanism, FaultServices, SensorDefect, StartsFault
from wsnsim.base.network_ports import FaultEvent
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.network.fault_services import Combination, FaultSite, Outages, RadioDisturbances, SiteServices, Timeline
from wsnsim.network.mechanisms import make_mechanism

CHANGE_READINGS: Final = frozenset({"clock_step", "stuck", "bias"})
"""Built-in mechanisms that change what sensors read."""


class OutageMechanism:
    """The nodes are down for the duration; `alone`: whatever other faults hold them down."""

    def __init__(self, services: FaultServices, alone: bool) -> None:
        self._services = services
        self._take_down = services.take_down_alone if alone else services.take_down

    def begin(self, nodes: Ints) -> None:
        """Log, then crash: the rows of all nodes that are hit come first."""
        _log_starts(self._services, nodes)
        self._take_down(nodes)

    def end(self, nodes: Ints) -> None:
        """Restart them; the restarts are logged in place of the end of the fault."""
        self._services.bring_up()


class DrainMechanism:
    """Nodes lose energy: `joules`, or a `share` of what is left; nodes that are down lose none (our choice)."""

    def __init__(self, services: FaultServices, joules: float | None, share: float | None) -> None:
        self._services = services
        self._joules = joules
        self._share = share

    def begin(self, nodes: Ints) -> None:
        """Drain the nodes that are up, one after the other."""
        up = [node for node in nodes.tolist() if self._services.is_up(node)]
        for node in up:
            self._services.log_start(node, self._services.drain(node, self._amount(node)))
        if not up:
            self._services.log_start(NOBODY)

    def end(self, nodes: Ints) -> None:
        """Charge does not come back."""

    def _amount(self, node: int) -> float:
        if self._joules is not None:
            return self._joules
        assert self._share is not None, "a drain has joules or a share"
        return self._services.residual_energy(node) * self._share if self._share < 1.0 else np.inf


class LastingMechanism:
    """A change to the nodes that is undone after the duration. Both are logged."""

    def __init__(self, services: FaultServices, apply: Callable[[Ints], None], undo: Callable[[Ints], None]) -> None:
        self._services = services
        self._apply = apply
        self._undo = undo

    def begin(self, nodes: Ints) -> None:
        """Log and apply the change."""
        _log_starts(self._services, nodes)
        self._apply(nodes)

    def end(self, nodes: Ints) -> None:
        """Log the end for the nodes that are not dead, and undo the change."""
        for node in nodes.tolist():
            if not self._services.is_dead(node):
                self._services.log_end(node)
        self._undo(nodes)


def _log_starts(services: FaultServices, nodes: Ints) -> None:
    for node in nodes.tolist():
        services.log_start(node)


def _blackout(fault: Any, services: FaultServices) -> FaultMechanism:
    return LastingMechanism(services, services.jam, services.unjam)


def _link_loss(fault: Any, services: FaultServices) -> FaultMechanism:
    return LastingMechanism(services, lambda nodes: services.set_loss(nodes, fault.loss), services.clear_loss)


def _clock_step(fault: Any, services: FaultServices) -> FaultMechanism:
    return LastingMechanism(
        services,
        lambda nodes: services.step_clocks(nodes, fault.offset),
        lambda nodes: services.step_clocks(nodes, -fault.offset),
    )


def _defect(services: FaultServices, fault: Any, **defect: Any) -> FaultMechanism:
    component = getattr(fault, "component", "")
    return LastingMechanism(
        services,
        lambda nodes: services.set_defect(SensorDefect(frozenset(nodes.tolist()), component=component, **defect)),
        lambda nodes: services.clear_defect(),
    )


MECHANISMS: Final[Mapping[str, Callable[[Any, FaultServices], FaultMechanism]]] = {
    "crash": lambda fault, services: OutageMechanism(services, alone=False),
    "restart": lambda fault, services: OutageMechanism(services, alone=True),
    "drain": lambda fault, services: DrainMechanism(services, fault.joules, fault.share),
    "blackout": _blackout,
    "link_loss": _link_loss,
    "clock_step": _clock_step,
    "stuck": lambda fault, services: _defect(services, fault, stuck=True, value=fault.value),
    "bias": lambda fault, services: _defect(services, fault, offset=fault.offset),
}
"""Built-in mechanisms by the name in `fault.mechanism`. The first argument is the component."""


def change_readings(faults: Iterable[FaultEvent]) -> bool:
    """Whether any of the faults may change what sensors read. A plug-in may."""
    return any(fault.mechanism in CHANGE_READINGS or isinstance(fault, StartsFault) for fault in faults)


def make_fault(fault: FaultEvent, services: FaultServices) -> FaultMechanism:
    """Return the mechanism of a fault: its own, or the built-in one of that name.

    Raises:
        RunError: There is neither.
    """
    return make_mechanism("faults", fault, services, StartsFault, ("begin", "end"), MECHANISMS)


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
