"""Periodic beacons: every node broadcasts once per period of its own clock, from a random phase on."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from wsnsim.base.mechanisms import WorkloadServices
from wsnsim.base.network_ports import BeaconWorkload
from wsnsim.base.rng import derive_all, uniforms


class Beacons:
    """The built-in workload of a network without targets. `sent` is the number of beacons that nodes tried to send."""

    def __init__(self, component: BeaconWorkload, services: WorkloadServices) -> None:
        self._component = component
        self._services = services
        self._word = services.word("beacon")
        self._periods: list[float] = []
        self._actions: list[Callable[[], None]] = []
        self.sent = 0

    def begin(self) -> None:
        """Set the timer of every node's first beacon."""
        services, period = self._services, self._component.period
        phases = uniforms(derive_all(services.key, np.arange(len(services.positions))), 0)
        self._periods = [services.lasts(node, period) for node in range(len(services.positions))]
        self._actions = [partial(self._send, node) for node in range(len(services.positions))]
        for action, phase in zip(self._actions, (phases * period).tolist(), strict=True):
            services.call_later(phase, action)

    def _send(self, node: int) -> None:
        """Broadcast a node's beacon if it is up and awake, and set the timer of the next one."""
        services = self._services
        if services.is_dead(node):
            return
        if services.is_awake(node):
            self.sent += 1
            services.broadcast(node, self._component.bits, self._word)
        services.call_later(self._periods[node], self._actions[node])
