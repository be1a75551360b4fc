"""Phase lock: what senders of ContikiMAC know of the times at which their destinations wake.

    locks.learn(node, to, start, period)     an acknowledgement answered the copy that began at `start`
    locks.next(node, to, after) -> s or None when the destination is next expected to have woken

The destination woke during the copy before the one that it acknowledged. It wakes again after multiples of the
interval, by its clock; the sender counts them by its own.

Source: Dunkels (2011), SICS T2011:13, section 2.4, after WiseMAC (El-Hoiydi, Decotignie 2004).
"""

from __future__ import annotations

from math import ceil

import numpy as np

from wsnsim.network.radio.mac_services import NetworkMacServices


class PhaseLocks:
    """What all senders know."""

    def __init__(self, services: NetworkMacServices, interval: float) -> None:
        self._clocks = services.clocks
        self._interval = interval
        self._known: dict[tuple[int, int], tuple[float, float]] = {}
        """{(sender, destination): (start of the copy that was acknowledged on the sender's clock, its period)}"""

    def learn(self, node: int, to: int, start: float, period: float) -> None:
        """Note which copy a destination has acknowledged."""
        self._known[node, to] = self._local(node, start), period

    def forget(self, node: int, to: int) -> None:
        """Forget when a destination wakes: it did not answer."""
        self._known.pop((node, to), None)

    def forget_all(self, node: int) -> None:
        """Forget what a node knows: it crashed."""
        for pair in [pair for pair in self._known if pair[0] == node]:
            del self._known[pair]

    def next(self, node: int, to: int, now: float, lead: float) -> tuple[float, float] | None:
        """Return between which times (s) a destination wakes next, the first of them at least `lead` after now."""
        known = self._known.get((node, to))
        if known is None:
            return None
        start, period = known
        local = self._local(node, now)
        turns = ceil((local + lead + period - start) / self._interval)
        expected = now + (start + turns * self._interval - local)
        return expected - period, expected

    def _local(self, node: int, time: float) -> float:
        return float(self._clocks.local(np.array([node]), time)[0])
