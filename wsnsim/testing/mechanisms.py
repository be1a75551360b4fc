"""The contract checks of faults, of time synchronisation and of workloads."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import simpy

from wsnsim.base.arrays import Floats
from wsnsim.base.mechanisms import SyncMechanism, SyncServices, TimeSync
from wsnsim.base.network_ports import FaultEvent, Workload
from wsnsim.base.tables import KIND, RECORDED_BY_DEFAULT, Memory
from wsnsim.models.hardware import NoSync, PerfectClock
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog
from wsnsim.network.faults import FaultSchedule, FaultSite
from wsnsim.network.mechanisms import make_mechanism
from wsnsim.network.nodes import Nodes
from wsnsim.testing.table import demand, demand_same_events, demand_silence_of_the_down, examined, run_with

FEWEST: Final = 10
SPACING: Final = 10.0
BATTERY: Final = 2.0
STEP: Final = 0.1
HEAD: Final = 3
AFTERWARDS: Final = 3600.0
"""Seconds after its beginning in which a fault without a duration must do harm."""


def check_fault(fault: FaultEvent) -> None:
    """Check a fault component against its contract, on a few idle nodes.

    Args:
        fault: The component, built. It must be aimed at something: `nodes`, `fraction`, `region` or `head`.

    Raises:
        AssertionError: Names the demand that fails. aim: the fault begins at a time and hits nodes. log: each of them
            is logged at that time, under the fault's `mechanism`. harm: the fault changes something. end: after its
            duration, nodes are up again unless their batteries are empty, and radios, clocks and sensors are as
            before. repeatable: the same key gives the same events.
    """
    fault = examined(fault, FaultEvent)
    with demand("aim"):
        assert fault.at >= 0.0 and fault.mechanism, "it has no time or no name"
        network = _FaultyNetwork(fault)
        aimed = network.schedule.aimed(0)
        assert aimed, "it hits no node"
    with demand("harm"):
        assert network.run(), "nothing changes in the network"
    with demand("log"):
        network.check_log(fault, aimed)
    with demand("end"):
        assert fault.duration is None or network.is_sound(), "something is still changed after the duration"
    with demand("repeatable"):
        again = _FaultyNetwork(fault)
        again.run()
        assert again.events() == network.events(), "the same key gives other events"


class _FaultyNetwork:
    """Nodes without a task, one fault, and the log."""

    def __init__(self, fault: FaultEvent) -> None:
        self._env = simpy.Environment()
        self._memory = Memory()
        self._log = EventLog(self._memory, 0)
        positions = _positions(fault)
        size = len(positions)
        self._nodes = Nodes(positions, np.ones((size, 1)), BATTERY, 75.0)
        self._nodes.on_death = self._note_death
        self._clocks = Clocks(PerfectClock(), 1, size)
        actions = self._crash, lambda node: self._nodes.restart(node, self._env.now), lambda target: HEAD
        self._site = FaultSite(self._env, self._nodes, self._log, self._clocks, *actions)
        self.schedule = FaultSchedule([fault], self._site, 11, STEP)
        self._crashed = False
        self._until = fault.at + (AFTERWARDS if fault.duration is None else fault.duration + STEP)

    def run(self) -> bool:
        """Run to the end of the fault; returns whether anything was changed at any time."""
        before = self._state()
        self.schedule.start()
        harmed = self._state() != before
        while self._env.peek() <= self._until:
            self._env.step()
            harmed |= self._state() != before
        return harmed or self._crashed

    def is_sound(self) -> bool:
        """Whether all nodes but the dead are up, and radios, clocks and sensors undisturbed."""
        nodes = self._nodes
        up = set(np.flatnonzero(nodes.living).tolist()) | set(nodes.died_at)
        radios = nodes.jammed.any() or nodes.loss.any() or nodes.disturbed
        return len(up) == nodes.size and not (radios or self._clock_errors().any() or self._site.defects)

    def check_log(self, fault: FaultEvent, aimed: list[int]) -> None:
        """Assert that the log names the fault at its time for each node at which it is aimed."""
        words = self._memory.words.all()
        rows = [row for row in self.events() if row["kind"] == KIND["fault"] and words[row["what"]] == fault.mechanism]
        logged = {row["node"] for row in rows}
        assert logged == set(aimed), f"aimed at {aimed}, but the log names {sorted(logged)} (services.log_start)"
        late = [row["time"] for row in rows if abs(row["time"] - fault.at) > STEP]
        assert not late, f"it begins at {fault.at:g} s and is logged at {late[0]:g} s"

    def events(self) -> list[dict[str, Any]]:
        """The rows of the event log."""
        self._log.flush(everything=True)
        table = self._memory.table("events")
        return [dict(zip(table, row, strict=True)) for row in zip(*map(np.ndarray.tolist, table.values()), strict=True)]

    def _crash(self, node: int) -> None:
        self._crashed = True
        self._nodes.crash(node)

    def _note_death(self, node: int) -> None:
        self._nodes.died_at[node] = self._env.now

    def _clock_errors(self) -> Floats:
        return self._clocks.error(np.arange(self._nodes.size), 0.0)

    def _state(self) -> tuple[Any, ...]:
        nodes = self._nodes
        arrays = nodes.living, nodes.jammed, nodes.loss, nodes.ledger.spent, self._clock_errors()
        return (*(array.tobytes() for array in arrays), tuple(sorted(self._site.defects.items())))


def _positions(fault: FaultEvent) -> Floats:
    """(N, 2) nodes on a line, so many that the fault can hit some of them."""
    size = max(FEWEST, *(node + 1 for node in fault.nodes or ()), 0)
    if fault.fraction:
        size = max(size, math.ceil(1.0 / fault.fraction))
    x, y, radius = fault.region or (0.0, 0.0, SPACING * size)
    along = np.arange(size) * min(SPACING, radius / size)
    return np.column_stack([x + along, np.full(size, y)])


CRASH: Final = {"kind": "crash", "at": 905.0, "duration": 3.0, "nodes": [4, 8]}
"""Two nodes are down for a while between two steps."""


def check_sync(sync: TimeSync) -> None:
    """Check a component of time synchronisation against its contract, in a grid of nine nodes that hear each other.

    The kind 'none' has no messages and passes.

    Args:
        sync: The component.

    Raises:
        AssertionError: Names the demand that fails. agreement: after half an hour clocks differ by less than a tenth of
            what they differ by without synchronisation, and some node takes its clock for synchronised; paid: nodes
            send something; forgets: a node that crashes no longer takes its clock for synchronised; down: no node sends
            while it is down; repeatable: the same seed gives the same run.
    """
    if sync.mechanism == "none":
        return
    sync = examined(sync, TimeSync)
    watched = _Watched(sync)
    first, crashed, alone = _run_synced(sync), _run_synced(watched, CRASH), _run_synced(NoSync())
    clocks = first.table("clocks")
    with demand("agreement"):
        apart, unsynchronised = clocks["spread_max"][-1], alone.table("clocks")["spread_max"][-1]
        assert apart < 0.1 * unsynchronised, (
            f"clocks differ by {apart:.3g} s after half an hour; without synchronisation by {unsynchronised:.3g} s"
        )
        assert clocks["synchronised"][-1] > 0.0, "no node takes its clock for synchronised"
    with demand("paid"):
        assert (first.table("events")["kind"] == KIND["send"]).any(), "clocks agree, and nothing was sent"
    with demand("forgets"):
        assert watched.forgotten == [False, False], "a node that crashed still takes its clock for synchronised"
    with demand("down"):
        demand_silence_of_the_down(crashed.table("events"))
    with demand("repeatable"):
        demand_same_events(first, _run_synced(sync))


class _Watched:
    """A component whose nodes are asked after each crash whether they take their clocks for synchronised."""

    mechanism = "watched"

    def __init__(self, sync: TimeSync) -> None:
        self._sync = sync
        self.forgotten: list[bool] = []

    def start(self, services: SyncServices) -> SyncMechanism:
        """The mechanism of the component, watched."""
        mechanism: SyncMechanism = make_mechanism("sync", self._sync, services)
        forget = mechanism.forget

        def forget_and_ask(node: int) -> None:
            forget(node)
            self.forgotten.append(mechanism.is_synchronised(node))

        mechanism.forget = forget_and_ask  # type: ignore[method-assign]
        return mechanism


def _run_synced(sync: TimeSync, *faults: dict[str, Any]) -> Memory:
    """The tables of one run of the grid."""
    return run_with("sync", {"faults": list(faults)}, {**RECORDED_BY_DEFAULT, "clocks": True}, sync=sync)


def check_workload(workload: Workload) -> None:
    """Check a workload component against its contract.

    The workload 'tracking' has no mechanism of its own and passes.

    Args:
        workload: the component.

    Raises:
        AssertionError: names the demand that fails. sends: nodes send within 10 s; down: no node that is down sends;
            repeatable: the same seed gives the same run.
    """
    if workload.mechanism == "tracking":
        return
    workload = examined(workload, Workload)
    first = run_with("workload", workload=workload)
    events = first.table("events")
    with demand("sends"):
        assert (events["kind"] == KIND["send"]).any(), "no node sends anything in 10 s"
    with demand("down"):
        demand_silence_of_the_down(events)
    with demand("repeatable"):
        demand_same_events(first, run_with("workload", workload=workload))
