"""Periodic beacons: every node broadcasts once per period of its own clock, from a random phase on."""

from __future__ import annotations

from functools import partial

import numpy as np

from wsnsim.base.mechanisms import WorkloadServices
from wsnsim.base.radio import BeaconWorkload
from wsnsim.base.rng import derive_all, uniforms


class Beacons:
    """The built-in workload of a network without targets. `sent` is the number of beacons that nodes tried to send."""

    def __init__(self, component: BeaconWorkload, services: WorkloadServices) -> None:
        self._component = component
        self._services = services
        self._word = services.word("beacon")
        self.sent = 0

    def begin(self) -> None:
        """Set the timer of every node's first beacon."""
        services, period = self._services, self._component.period
        phases = uniforms(derive_all(services.key, np.arange(len(services.positions))), 0)
        for node, phase in enumerate((phases * period).tolist()):
            services.call_later(phase, partial(self._send, node, services.lasts(node, period)))

    def _send(self, node: int, period: float) -> None:
        """Broadcast a node's beacon if it is up and awake, and set the timer of the next one."""
        services = self._services
        if services.is_dead(node):
            return
        if services.is_awake(node):
            self.sent += 1
            services.broadcast(node, self._component.bits, self._word)
        services.call_later(period, partial(self._send, node, period))
