"""What goes wrong at its time: the script's faults strike whom they are aimed at, and pass when their duration ends.

    Faults(script, site, key, dt).start()

`site` is what faults can reach. Whom a fault hits is settled at its instant: a share of all nodes is a function of the
stream's key and the fault's number alone, so that the rest of a run draws what it would draw without faults. Faults
of one time strike in the order of the script, those that end first; all before the step that begins at that time.
Overlapping faults of a kind hold together: what two have taken down is back when both have passed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import simpy

from wsnsim.base.arrays import Ints
from wsnsim.base.errors import RunError
from wsnsim.base.radio import FaultEvent
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.nodes import Nodes
from wsnsim.network.readings import Defect

NOBODY: Final = -1
SAME: Final = 1e-9
"""A fault that strikes within this share of a step from a step's beginning strikes at it."""


def _no_head(target: int) -> int | None:
    return None


@dataclass(slots=True)
class Site:
    """What faults can reach. `defects` are the sensors'; `head(target)` leads now, or None.

    `crash(node)` takes a living node down with all that it does and knows; `restart(node)` brings back one that is
    down.
    """

    env: simpy.Environment
    fleet: Nodes
    journal: EventLog
    clocks: Clocks
    crash: Callable[[int], None]
    restart: Callable[[int], None]
    head: Callable[[int], int | None] = _no_head
    defects: dict[int, Defect] = field(default_factory=dict)


class Faults:
    """A scenario's faults in simulated time. `dt` is the length of a step in s."""

    def __init__(self, script: Sequence[FaultEvent], site: Site, key: int, dt: float) -> None:
        self._script: tuple[Any, ...] = tuple(script)
        self._site = site
        self._key = key
        self._dt = dt
        self._hit: dict[int, Ints] = {}
        self._down: dict[int, set[int]] = {}
        self._jams: dict[int, float] = {}
        self._losses: dict[int, dict[int, float]] = {}
        self._begin: dict[str, Callable[[int, Any, Ints], None]] = {
            "crash": self._crash,
            "restart": self._reboot,
            "drain": self._drain,
            "blackout": self._disturb,
            "link_loss": self._disturb,
            "clock_step": self._step_clocks,
            "stuck": self._spoil,
            "bias": self._spoil,
        }
        for fault in script:
            if fault.mechanism not in self._begin:
                known = ", ".join(self._begin)
                raise RunError(f"faults: no mechanism '{fault.mechanism}' in this network; known: {known}")

    def start(self) -> None:
        """Set the alarms, before anything else is set; a fault at time 0 strikes at once."""
        alarms = [(self._when(fault.at), 1, number) for number, fault in enumerate(self._script)]
        for number, fault in enumerate(self._script):
            if fault.duration is not None:
                ends = self._when(fault.at + fault.duration)
                alarms.append((ends, 0 if ends > self._when(fault.at) else 2, number))
        for time, order, number in sorted(alarms):
            act = self._strike if order == 1 else self._pass
            if time <= self._site.env.now:
                act(number)
            else:
                self._at(time, act, number)

    def _at(self, time: float, act: Callable[[int], None], number: int) -> None:
        alarm = self._site.env.timeout(time - self._site.env.now)
        assert alarm.callbacks is not None
        alarm.callbacks.append(lambda _: act(number))

    def _when(self, time: float) -> float:
        """A time, or the beginning of a step that it only misses by rounding."""
        step = round(time / self._dt)
        return step * self._dt if abs(time - step * self._dt) <= SAME * self._dt else time

    def _strike(self, number: int) -> None:
        self._begin_step()
        fault, fleet = self._script[number], self._site.fleet
        aimed = [node for node in self._aimed(number, fault).tolist() if node not in fleet.died_at]
        if fault.mechanism == "drain":
            aimed = [node for node in aimed if fleet.alive[node]]
        nodes = self._hit[number] = np.array(aimed, dtype=np.int64)
        if not aimed:
            self._log(fault, NOBODY, fault.mechanism)
        elif fault.mechanism != "drain":
            for node in aimed:
                self._log(fault, node, fault.mechanism)
        self._begin[fault.mechanism](number, fault, nodes)

    def _begin_step(self) -> None:
        """What happens at a step's beginning is of that step, though its clock has not yet ticked."""
        journal, now = self._site.journal, self._site.env.now
        journal.step = max(journal.step, math.floor(now / self._dt + SAME))

    def _aimed(self, number: int, fault: FaultEvent) -> Ints:
        """(n,) whom a fault is aimed at, ascending, living or not."""
        fleet = self._site.fleet
        if fault.nodes is not None:
            found = sorted({node for node in fault.nodes if node < fleet.size})
        elif fault.fraction is not None:
            drawn = uniforms(derive_all(derive(self._key, number), np.arange(fleet.size)), 0)
            found = sorted(np.argsort(drawn, kind="stable")[: round(fault.fraction * fleet.size)].tolist())
        elif fault.region is not None:
            x, y, radius = fault.region
            found = sorted(fleet.tree.query_ball_point((x, y), radius))
        else:
            head = None if fault.head is None else self._site.head(fault.head)
            found = [] if head is None else [head]
        return np.array(found, dtype=np.int64)

    def _pass(self, number: int) -> None:
        """A fault's duration has ended."""
        self._begin_step()
        fault, nodes = self._script[number], self._hit.pop(number)
        if fault.mechanism in ("crash", "restart"):
            self._come_back(number)
            return
        for node in nodes.tolist():
            if node not in self._site.fleet.died_at:
                self._log(fault, node, f"{fault.mechanism}_over")
        if fault.mechanism in ("blackout", "link_loss"):
            self._disturb(number, fault, nodes)
        elif fault.mechanism == "clock_step":
            self._site.clocks.step(nodes.tolist(), -fault.offset)
        else:
            self._site.defects.pop(number, None)

    def _crash(self, number: int, fault: Any, nodes: Ints) -> None:
        held = self._down[number] = set(nodes.tolist())
        for node in sorted(held):
            if self._site.fleet.alive[node]:
                self._site.crash(node)
                if node not in self._site.fleet.died_at:
                    self._log(fault, node, "", "crash")

    def _reboot(self, number: int, fault: Any, nodes: Ints) -> None:
        """Whoever is up goes down; whoever was down before waits for this one fault alone."""
        for held in self._down.values():
            held.difference_update(nodes.tolist())
        self._crash(number, fault, nodes)

    def _come_back(self, number: int) -> None:
        fault, held = self._script[number], self._down.pop(number)
        still = set().union(*self._down.values())
        for node in sorted(held - still):
            if node not in self._site.fleet.died_at and not self._site.fleet.alive[node]:
                self._log(fault, node, "", "restart")
                self._site.restart(node)

    def _drain(self, number: int, fault: Any, nodes: Ints) -> None:
        """Charge flows from whoever is up; a node that is down keeps what it has (our choice)."""
        fleet = self._site.fleet
        for node in nodes.tolist():
            joules = fault.joules
            if joules is None:
                joules = fleet.left(node) * fault.share if fault.share < 1.0 else np.inf
            spent = fleet.spend(node, CAUSE["leak"], joules)
            self._log(fault, node, fault.mechanism, joules=spent)

    def _disturb(self, number: int, fault: Any, nodes: Ints) -> None:
        """One more fault holds these nodes' radios, or one less: jammed while any does, lossy by all together."""
        fleet, begins, jams = self._site.fleet, number in self._hit, fault.mechanism == "blackout"
        for node in nodes.tolist():
            held = self._jams if jams else self._losses.setdefault(node, {})
            key, value = (node, self._jams.get(node, 0) + (1 if begins else -1)) if jams else (number, fault.loss)
            held[key] = value
            if not (value if jams else begins):
                del held[key]
            fleet.jammed[node] = node in self._jams
            fleet.loss[node] = 1.0 - math.prod(1.0 - loss for loss in self._losses.get(node, {}).values())
        self._losses = {node: held for node, held in self._losses.items() if held}
        fleet.disturbed = bool(self._jams or self._losses)

    def _step_clocks(self, number: int, fault: Any, nodes: Ints) -> None:
        self._site.clocks.step(nodes.tolist(), fault.offset)

    def _spoil(self, number: int, fault: Any, nodes: Ints) -> None:
        hit = frozenset(nodes.tolist())
        if fault.mechanism == "stuck":
            self._site.defects[number] = Defect(hit, stuck=True, value=fault.value)
        else:
            self._site.defects[number] = Defect(hit, offset=fault.offset)

    def _log(self, fault: FaultEvent, node: int, what: str, kind: str = "fault", joules: float = 0.0) -> None:
        journal, target = self._site.journal, -1 if fault.head is None else fault.head
        code, cause = journal.code(what), EVENT_CAUSE["leak" if joules else "none"]
        now = self._site.env.now
        journal.add(event(now, journal.step, target, node, KIND[kind], code, joules=joules, cause=cause))
