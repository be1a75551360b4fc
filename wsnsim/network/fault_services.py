"""What faults may reach in a network, and the state that overlapping faults share.

Overlapping faults combine: a node restarts when the last fault that holds it down has passed, a radio is jammed while
any fault jams it, and losses multiply.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import simpy

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.mechanisms import SensorDefect
from wsnsim.base.network_ports import FaultEvent
from wsnsim.base.rng import derive
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog, event, then
from wsnsim.network.mechanisms import NetworkServices
from wsnsim.network.nodes import Nodes

LEAK: Final = CAUSE["leak"]
ROUNDING: Final = 1e-9
"""A fault within this share of a step of the beginning of a step happens at that beginning."""


class NodeControl(NamedTuple):
    """How faults act on whole nodes.

    Attributes:
        crash: Takes down a node that is up, with all that it does and knows.
        restart: Brings back a node that is down.
        head_of: Returns the cluster head of a target, or None.
    """

    crash: Callable[[int], None]
    restart: Callable[[int], None]
    head_of: Callable[[int], int | None]


@dataclass(frozen=True, slots=True)
class FaultSite:
    """The parts of a network that faults act on. `defects` are the sensor defects of this instant, by fault number."""

    env: simpy.Environment
    nodes: Nodes
    log: EventLog
    clocks: Clocks
    control: NodeControl
    defects: dict[int, SensorDefect] = field(default_factory=dict)


class Timeline:
    """Calls actions at simulated times. `dt` is the length of a step in s."""

    def __init__(self, env: simpy.Environment, log: EventLog, dt: float) -> None:
        self._env = env
        self._log = log
        self._dt = dt

    def snapped(self, time: float) -> float:
        """Return a time, or the beginning of a step that it misses only by rounding."""
        step = round(time / self._dt)
        return step * self._dt if abs(time - step * self._dt) <= ROUNDING * self._dt else time

    def call_at(self, time: float, action: Callable[[], None]) -> None:
        """Call an action at a time, at once if that is not in the future."""
        if time <= self._env.now:
            self._call(action)
            return
        then(self._env.timeout(time - self._env.now), self._call, action)

    def _call(self, action: Callable[[], None]) -> None:
        """Call an action. At the beginning of a step it belongs to that step, although the world has not begun it."""
        self._log.step = max(self._log.step, math.floor(self._env.now / self._dt + ROUNDING))
        action()


class Outages:
    """Which faults hold which nodes down."""

    def __init__(self) -> None:
        self._held: dict[int, set[int]] = {}

    def hold(self, fault: int, nodes: Ints) -> None:
        """A fault holds nodes down."""
        self._held[fault] = set(nodes.tolist())

    def free(self, nodes: Ints) -> None:
        """No fault holds these nodes down any longer."""
        for held in self._held.values():
            held.difference_update(nodes.tolist())

    def release(self, fault: int) -> list[int]:
        """A fault has passed; returns the nodes that no other fault holds down, ascending."""
        held = self._held.pop(fault)
        return sorted(held.difference(*self._held.values()))


class RadioDisturbances:
    """Which faults jam which radios, and which make frames of a node get lost."""

    def __init__(self, nodes: Nodes) -> None:
        self._nodes = nodes
        self._jams: dict[int, int] = {}
        self._losses: dict[int, dict[int, float]] = {}

    def jam(self, nodes: Ints, change: int) -> None:
        """`change` more faults jam the radios of nodes; fewer if it is negative."""
        for node in nodes.tolist():
            self._jams[node] = self._jams.get(node, 0) + change
            if not self._jams[node]:
                del self._jams[node]
            self._nodes.jammed[node] = node in self._jams
        self._note_disturbance()

    def set_loss(self, fault: int, nodes: Ints, probability: float) -> None:
        """A fault loses frames from and to nodes."""
        for node in nodes.tolist():
            self._losses.setdefault(node, {})[fault] = probability
            self._combine_losses(node)
        self._note_disturbance()

    def clear_loss(self, fault: int, nodes: Ints) -> None:
        """A fault no longer loses frames of nodes."""
        for node in nodes.tolist():
            del self._losses[node][fault]
            self._combine_losses(node)
            if not self._losses[node]:
                del self._losses[node]
        self._note_disturbance()

    def _combine_losses(self, node: int) -> None:
        self._nodes.loss[node] = 1.0 - math.prod(1.0 - loss for loss in self._losses[node].values())

    def _note_disturbance(self) -> None:
        self._nodes.disturbed = bool(self._jams or self._losses)


class Combination(NamedTuple):
    """What all faults of a run share."""

    timeline: Timeline
    outages: Outages
    radios: RadioDisturbances
    key: int


class SiteServices(NetworkServices):
    """The services of one fault: see `base.mechanisms.FaultServices`. `number` is its place in the scenario's list."""

    def __init__(self, site: FaultSite, shared: Combination, fault: FaultEvent, number: int) -> None:
        super().__init__(site.env, site.nodes, site.clocks)
        self._site = site
        self._shared = shared
        self._name = fault.mechanism
        self._target = -1 if fault.head is None else fault.head
        self._number = number
        self.key = derive(shared.key, number, 1)
        self.positions: Floats = site.nodes.positions

    def residual_energy(self, node: int) -> float:
        """Joules left in a node now."""
        return self._nodes.residual_energy(node)

    def head_of(self, target: int) -> int | None:
        """The cluster head of a target, or None."""
        return self._site.control.head_of(target)

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call an action after `seconds` of simulated time, among the faults of that time in their order."""
        self._shared.timeline.call_at(self.now + seconds, action)

    def log_start(self, node: int, joules: float = 0.0) -> None:
        """Log that the fault hits a node, or NOBODY, and the charge that it took."""
        self._log("fault", node, self._name, joules)

    def log_end(self, node: int) -> None:
        """Log that the fault of a node has passed."""
        self._log("fault", node, f"{self._name}_over")

    def take_down(self, nodes: Ints) -> None:
        """Crash the nodes that are up, and hold all of them down until `bring_up`."""
        self._shared.outages.hold(self._number, nodes)
        for node in nodes.tolist():
            if self.is_up(node):
                self._site.control.crash(node)
                if not self.is_dead(node):
                    self._log("crash", node)

    def take_down_alone(self, nodes: Ints) -> None:
        """As `take_down`; other faults no longer hold these nodes down."""
        self._shared.outages.free(nodes)
        self.take_down(nodes)

    def bring_up(self) -> None:
        """Restart the nodes that this fault alone holds down."""
        for node in self._shared.outages.release(self._number):
            if not self.is_dead(node) and not self.is_up(node):
                self._log("restart", node)
                self._site.control.restart(node)

    def drain(self, node: int, joules: float) -> float:
        """Take charge from a node; returns the joules taken. Infinity empties the battery."""
        return self._nodes.spend(node, LEAK, joules)

    def jam(self, nodes: Ints) -> None:
        """The radios of the nodes neither receive nor are received, until `unjam`."""
        self._shared.radios.jam(nodes, 1)

    def unjam(self, nodes: Ints) -> None:
        """Undo one `jam` of this fault."""
        self._shared.radios.jam(nodes, -1)

    def set_loss(self, nodes: Ints, probability: float) -> None:
        """Lose frames from and to the nodes with this probability, in addition to other losses."""
        self._shared.radios.set_loss(self._number, nodes, probability)

    def clear_loss(self, nodes: Ints) -> None:
        """Undo `set_loss`."""
        self._shared.radios.clear_loss(self._number, nodes)

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
