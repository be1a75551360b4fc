"""What sensors report where there is no network: the readings of a network with the same seed, faults included.

    rows = standalone_reports(setup, conditions, streams, target)      rows(first, count) -> (count, S) readings

Sensors are all that there is: a fault may change their readings, or stop them while their node is down. Nothing else of
a node fails: messages reach it, and it keeps what it knows (our choice).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Keys
from wsnsim.base.initial_conditions import InitialConditions
from wsnsim.base.rng import Streams
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import Memory
from wsnsim.base.vector_readings import components_of
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog
from wsnsim.network.fault_services import FaultSite, NodeControl
from wsnsim.network.faults import FaultSchedule
from wsnsim.network.imperfect_readings import make_readings
from wsnsim.network.nodes import Nodes


def standalone_reports(
    setup: TrackingSetup, conditions: InitialConditions, streams: Streams, target: int
) -> Callable[[int, int], Floats]:
    """Return the function that gives the reports on a target: see `StandaloneReports.rows`."""
    return StandaloneReports(setup, conditions, streams, target).rows


class _TrueTime:
    """Clocks that are right."""

    def rates(self, keys: Keys) -> Floats:
        """(n,) ones."""
        return np.ones(len(keys))


class StandaloneReports:
    """The reports on one target of a run, in the order of steps."""

    def __init__(self, setup: TrackingSetup, conditions: InitialConditions, streams: Streams, target: int) -> None:
        self._dt, self._last = setup.dt, setup.steps
        self._env = env = simpy.Environment()
        self._nodes = nodes = Nodes(conditions.positions, conditions.traits, math.inf, setup.sensor.reach)
        clocks = Clocks(_TrueTime(), 0, nodes.size, env)
        available, imperfections = make_readings(setup, conditions.truths, nodes, clocks, streams.key("sense"))
        self._available = available[target]
        control = NodeControl(nodes.crash, lambda node: nodes.restart(node, env.now), lambda _: None)
        site = FaultSite(env, nodes, EventLog(Memory({}), 0), clocks, control, imperfections.defects)
        FaultSchedule(setup.faults, site, streams.key("faults"), setup.dt).start()
        count = len(components_of(setup.sensor))
        self._shape = (nodes.size,) if count == 1 else (nodes.size, count)

    def rows(self, first: int, count: int) -> Floats:
        """(count, S) or (count, S, M) the reports of the steps from `first` on; NaN where a sensor has none.

        They end with the run. Steps may be left out, but not asked for again.
        """
        reports = np.full((max(0, min(count, self._last + 1 - first)), *self._shape), np.nan)
        for row, step in enumerate(range(first, first + len(reports))):
            while self._env.peek() <= step * self._dt:
                self._env.step()
            for node, reading in self._available.readings(step).items():
                if self._nodes.living[node]:
                    reports[row, node] = reading
        return reports
