"""Countdowns: the strobes of a broadcast of X-MAC say when the frame follows, and receivers turn the radio on for it.

    countdowns.hear(source, receivers, seconds)    a strobe says after how many seconds its frame begins
    countdowns.end(transmission)                   the frame has ended

What a receiver expects is its own knowledge: it turns the radio on even if the sender has died meanwhile, and forgets
what it expects when it crashes.
"""

from __future__ import annotations

from typing import Any

import simpy

from wsnsim.base.arrays import Ints
from wsnsim.base.medium_access import StrobingMac, off_time
from wsnsim.network.radio.lpl.radios import EXPECTS, LowPowerRadios
from wsnsim.network.radio.mac_services import NetworkMacServices
from wsnsim.network.radio.transmission import Transmission


class Countdowns:
    """Which broadcasts all nodes expect."""

    def __init__(self, mac: StrobingMac, services: NetworkMacServices, radios: LowPowerRadios) -> None:
        self._env = services.radio.env
        self._nodes = services.radio.nodes
        self._radios = radios
        self._longest = mac.turnaround + mac.airtime(mac.bits(mac.payload_bits)) + mac.turnaround
        """For how long a receiver waits for the end of a broadcast, in s"""
        self._off_time = off_time(services.radio.energy)
        self._expected: dict[int, set[int]] = {}
        """{node: senders of the broadcasts that it expects}"""

    def hear(self, source: int, receivers: Ints, seconds: float) -> None:
        """Nodes (n,) hear after how many seconds a broadcast begins; they stay on if that is too soon to turn off."""
        new = [node for node in receivers.tolist() if source not in self._expected.get(node, ())]
        for node in new:
            self._expected.setdefault(node, set()).add(source)
            if seconds < self._off_time:
                now = self._env.now
                self._radios.hold_until(node, EXPECTS, now + seconds + self._longest, since=now)
        if new:
            self._env.timeout(seconds, (source, new)).callbacks.append(self._turn_on)

    def _turn_on(self, timeout: simpy.Event) -> None:
        """Those who still expect a broadcast, and do not sleep by their schedule, turn the radio on."""
        countdown: Any = timeout.value
        source, nodes = countdown
        for node in nodes:
            expected = self._expected.get(node, set())
            if source in expected:
                expected.discard(source)
                if self._nodes.is_awake(node):
                    self._radios.hold_until(node, EXPECTS, self._env.now + self._longest)

    def end(self, sent: Transmission) -> None:
        """Radios that were on for a broadcast turn off at its end."""
        if sent.listeners is not None:
            for node in sent.listeners.tolist():
                self._radios.release(node, EXPECTS)

    def forget(self, node: int) -> None:
        """Note that a node is down: it expects nothing any more."""
        self._expected.pop(node, None)
