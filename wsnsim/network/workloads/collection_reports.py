"""Collection: every node but the sinks sends a report to a sink once per period of its own clock."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from wsnsim.base.mechanisms import WorkloadServices
from wsnsim.base.network_ports import CollectionWorkload
from wsnsim.base.rng import derive_all, uniforms


class CollectionReports:
    """The workload in which all nodes report. A node that is down or asleep when its report is due leaves it out."""

    def __init__(self, component: CollectionWorkload, services: WorkloadServices) -> None:
        self._component = component
        self._services = services
        self._actions: dict[int, Callable[[], None]] = {}

    def begin(self) -> None:
        """Set the timer of every node's first report, at a random phase after `start_at`."""
        services, component = self._services, self._component
        phases = uniforms(derive_all(services.key, np.arange(len(services.positions))), 0).tolist()
        for node, phase in enumerate(phases):
            if node not in services.sinks:
                self._actions[node] = partial(self._report, node)
                services.call_later(component.start_at + phase * component.period, self._actions[node])

    def _report(self, node: int) -> None:
        services = self._services
        if services.is_dead(node):
            return
        if services.is_awake(node):
            services.collect(node, self._component.bits, "report", _ignore)
        services.call_later(services.lasts(node, self._component.period), self._actions[node])


def _ignore(sink: int) -> None:
    """Take where a report arrived: the table `reports` says so."""
