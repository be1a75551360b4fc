"""The faults of a scenario in simulated time: each begins at its time, and passes when its duration has ended.

    FaultSchedule(faults, site, key, dt).start()

The nodes that a fault hits are chosen at its beginning. A share of all nodes depends on the key and the number of the
fault alone, so that the rest of a run draws the same random numbers as without faults. Of the faults of one time,
those that end come first, then those that begin, in the order of the scenario; all come before the step of that time.

Overlapping faults combine: a node restarts when the last fault that holds it down has passed, a radio is jammed while
any fault jams it, and losses multiply.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints, rounding
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.mechanisms import NOBODY, FaultMechanism, FaultServices, SensorDefect
from wsnsim.base.network_ports import FaultEvent
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog, event, then
from wsnsim.network.mechanisms import NetworkServices, make_mechanism
from wsnsim.network.nodes import Nodes

LEAK: Final = CAUSE["leak"]
Change = tuple[Callable[[Ints], None], Callable[[Ints], None]]
ROUNDING: Final = 1e-9
"""Share of a step by which the time of an event may be before the beginning of its step."""


@dataclass(frozen=True, slots=True)
class FaultSite:
    """The parts of a network that faults act on.

    Attributes:
        env, nodes, log, clocks: Those of the network.
        crash: Takes down a node that is up, with all that it does and knows.
        restart: Brings back a node that is down.
        head_of: Returns the cluster head of a target, or None.
        defects: The sensor defects of this instant, by fault number.
    """

    env: simpy.Environment
    nodes: Nodes
    log: EventLog
    clocks: Clocks
    crash: Callable[[int], None]
    restart: Callable[[int], None]
    head_of: Callable[[int], int | None]
    defects: dict[int, SensorDefect] = field(default_factory=dict)


class SiteServices(NetworkServices):
    """The services of one fault: see `base.mechanisms.FaultServices`. `number` is its place in the scenario's list."""

    def __init__(self, schedule: FaultSchedule, fault: FaultEvent, number: int) -> None:
        self._site = site = schedule.site
        super().__init__(site.env, site.nodes, site.clocks)
        self._schedule = schedule
        self._name = fault.mechanism
        self._target = -1 if fault.head is None else fault.head
        self._number = number
        self.key = derive(schedule.key, number, 1)
        self.positions: Floats = site.nodes.positions
        self.residual_energy, self.head_of = site.nodes.residual_energy, site.head_of

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call an action after `seconds` of simulated time, among the faults of that time in their order."""
        self._schedule.call_at(self.now + seconds, action)

    def log_start(self, node: int, joules: float = 0.0) -> None:
        """Log that the fault hits a node, or NOBODY, and the charge that it took."""
        self._log("fault", node, self._name, joules)

    def log_end(self, node: int) -> None:
        """Log that the fault of a node has passed."""
        self._log("fault", node, f"{self._name}_over")

    def take_down(self, nodes: Ints) -> None:
        """Crash the nodes that are up, and hold all of them down until `bring_up`."""
        self._schedule.held[self._number] = set(nodes.tolist())
        for node in nodes.tolist():
            if self.is_up(node):
                self._site.crash(node)
                if not self.is_dead(node):
                    self._log("crash", node)

    def take_down_alone(self, nodes: Ints) -> None:
        """As `take_down`; other faults no longer hold these nodes down."""
        for held in self._schedule.held.values():
            held.difference_update(nodes.tolist())
        self.take_down(nodes)

    def bring_up(self) -> None:
        """Restart the nodes that this fault alone holds down."""
        held = self._schedule.held.pop(self._number)
        for node in sorted(held.difference(*self._schedule.held.values())):
            if not self.is_dead(node) and not self.is_up(node):
                self._log("restart", node)
                self._site.restart(node)

    def drain(self, node: int, joules: float) -> float:
        """Take charge from a node; returns the joules taken. Infinity empties the battery, but not that of mains."""
        if math.isinf(joules) and math.isinf(self.residual_energy(node)):
            return 0.0
        return self._nodes.spend(node, LEAK, joules)

    def jam(self, nodes: Ints) -> None:
        """The radios of the nodes neither receive nor are received, until `unjam`."""
        self._schedule.jam(nodes, 1)

    def unjam(self, nodes: Ints) -> None:
        """Undo one `jam` of this fault."""
        self._schedule.jam(nodes, -1)

    def set_loss(self, nodes: Ints, probability: float) -> None:
        """Lose frames from and to the nodes with this probability, in addition to other losses."""
        self._schedule.set_loss(self._number, nodes, probability)

    def clear_loss(self, nodes: Ints) -> None:
        """Undo `set_loss`."""
        self._schedule.set_loss(self._number, nodes, 0.0)

    def step_clocks(self, nodes: Ints, seconds: float) -> None:
        """Put the clocks of the nodes forward; back if `seconds` is negative."""
        self._clocks.step(nodes.tolist(), seconds)

    def set_defect(self, defect: SensorDefect) -> None:
        """Change the readings of sensors. A fault has one defect at a time."""
        self._site.defects[self._number] = defect

    def clear_defect(self) -> None:
        """Undo `set_defect`."""
        self._site.defects.pop(self._number, None)

    def _log(self, kind: str, node: int, what: str = "", joules: float = 0.0) -> None:
        log, cause = self._site.log, EVENT_CAUSE["leak" if joules else "none"]
        log.add(event(self.now, log.step, self._target, node, KIND[kind], log.code(what), joules=joules, cause=cause))


class OutageMechanism:
    """The nodes are down for the duration; a `restart` also ends the outages that other faults cause."""

    def __init__(self, fault: Any, services: FaultServices) -> None:
        self._services = services
        self._take_down = services.take_down_alone if fault.mechanism == "restart" else services.take_down

    def begin(self, nodes: Ints) -> None:
        """Log, then crash: the rows of all nodes that are hit come first."""
        _log_starts(self._services, nodes)
        self._take_down(nodes)

    def end(self, nodes: Ints) -> None:
        """Restart them; the restarts are logged in place of the end of the fault."""
        self._services.bring_up()


class DrainMechanism:
    """Nodes lose energy: `joules`, or a `share` of what is left; nodes that are down lose none (our choice)."""

    def __init__(self, fault: Any, services: FaultServices) -> None:
        self._services = services
        self._joules: float | None = fault.joules
        self._share: float | None = fault.share

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

    def __init__(self, fault: Any, services: FaultServices) -> None:
        self._services = services
        self._apply, self._undo = CHANGES[fault.mechanism](fault, services)

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


def _defect(fault: Any, services: FaultServices, **defect: Any) -> Change:
    component = getattr(fault, "component", "")
    return (
        lambda nodes: services.set_defect(SensorDefect(frozenset(nodes.tolist()), component=component, **defect)),
        lambda nodes: services.clear_defect(),
    )


CHANGES: Final[Mapping[str, Callable[[Any, FaultServices], Change]]] = {
    "blackout": lambda fault, services: (services.jam, services.unjam),
    "link_loss": lambda fault, services: (lambda nodes: services.set_loss(nodes, fault.loss), services.clear_loss),
    "clock_step": lambda fault, services: (
        lambda nodes: services.step_clocks(nodes, fault.offset),
        lambda nodes: services.step_clocks(nodes, -fault.offset),
    ),
    "stuck": lambda fault, services: _defect(fault, services, stuck=True, value=fault.value),
    "bias": lambda fault, services: _defect(fault, services, offset=fault.offset),
}
"""What a lasting fault does to nodes, and what undoes it."""


class FaultSchedule:
    """The faults of one run, and what overlapping ones share. `key`: their random key; `dt`: length of a step in s.

    `held`: {fault: the nodes that it holds down}.
    """

    def __init__(self, faults: Sequence[FaultEvent], site: FaultSite, key: int, dt: float) -> None:
        self.site, self.key = site, key
        self.held: dict[int, set[int]] = {}
        self._faults = tuple(faults)
        self._dt = dt
        self._jams = np.zeros(site.nodes.size, dtype=np.int64)
        self._losses: dict[int, Floats] = {}
        self._services = [SiteServices(self, fault, number) for number, fault in enumerate(self._faults)]
        pairs = zip(self._faults, self._services, strict=True)
        self._mechanisms: list[FaultMechanism] = [make_mechanism("faults", *each) for each in pairs]
        self._hit: dict[int, Ints] = {}

    def start(self) -> None:
        """Set a timer for each beginning and end, before any other event; a fault at time 0 begins at once."""
        when = self.snapped
        changes = [(when(fault.at), 1, number) for number, fault in enumerate(self._faults)]
        for number, fault in enumerate(self._faults):
            if fault.duration is not None:
                ends = when(fault.at + fault.duration)
                changes.append((ends, 0 if ends > when(fault.at) else 2, number))
        for time, order, number in sorted(changes):
            act = self._begin if order == 1 else self._end
            self.call_at(time, partial(act, number))

    def holds(self, node: int) -> bool:
        """Whether a fault holds a node down."""
        return any(node in nodes for nodes in self.held.values())

    def _begin(self, number: int) -> None:
        dead = self.site.nodes.died_at
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
            return places_hit(fault, derive(self.key, number), self.site.nodes.grid)
        head = self.site.head_of(fault.head)
        return [] if head is None else [head]

    def snapped(self, time: float) -> float:
        """Return a time, or the beginning of a step that it misses only by rounding."""
        step = round(time / self._dt)
        return step * self._dt if abs(time - step * self._dt) <= rounding(self._dt) else time

    def call_at(self, time: float, action: Callable[[], None]) -> None:
        """Call an action at a time, at once if that is not in the future."""
        env = self.site.env
        if time <= env.now:
            self._call(action)
        else:
            then(env.timeout(time - env.now), self._call, action)

    def _call(self, action: Callable[[], None]) -> None:
        """Call an action. At the beginning of a step it belongs to that step, although the world has not begun it."""
        log = self.site.log
        log.step = max(log.step, math.floor(self.site.env.now / self._dt + ROUNDING))
        action()

    def jam(self, nodes: Ints, change: int) -> None:
        """`change` more faults jam the radios of nodes; fewer if it is negative."""
        np.add.at(self._jams, nodes, change)
        self.site.nodes.jammed[nodes] = self._jams[nodes] > 0
        self._note_disturbance()

    def set_loss(self, fault: int, nodes: Ints, probability: float) -> None:
        """A fault loses frames from and to nodes with a probability; 0: no longer."""
        loss = self._losses.setdefault(fault, np.zeros(self._jams.size))
        loss[nodes] = probability
        if not loss.any():
            del self._losses[fault]
        kept = np.ones(loss.size)
        for each in self._losses.values():
            kept *= 1.0 - each
        self.site.nodes.loss[:] = 1.0 - kept
        self._note_disturbance()

    def _note_disturbance(self) -> None:
        self.site.nodes.disturbed = bool(self._jams.any() or self._losses)


def places_hit(fault: FaultEvent, key: int, grid: CellGrid) -> list[int]:
    """Return at which of the nodes in a grid a fault without `head` is aimed, ascending."""
    size = len(grid.positions)
    if fault.nodes is not None:
        return sorted({node for node in fault.nodes if node < size})
    if fault.fraction is not None:
        samples = uniforms(derive_all(key, np.arange(size)), 0)
        return sorted(np.argsort(samples, kind="stable")[: round(fault.fraction * size)].tolist())
    if fault.region is None:
        return []
    x, y, radius = fault.region
    return list(grid.within((x, y), radius).tolist())
