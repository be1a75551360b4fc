"""The radios of nodes that listen once an interval: when they are on, and for what they are held on.

    radios.hold(node, reason)    radios.release(node, reason)    radios.hold_until(node, reason, time)
    radios.offsets(ids, time)[0] -> (n,) s since the last wake-up on the nodes' clocks

A wake-up that hears nothing is no event: it is a function of the time, of the phase of its node and of its clock. What
such wake-ups cost is in the duty of the MAC (`base.medium_access`). Here is what differs: a radio that is held on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.rng import derive_all, uniforms
from wsnsim.network.event_log import then
from wsnsim.network.radio.mac_services import MacPart, NetworkMacServices

SENDS, RECEIVES, EXPECTS = 1, 2, 4
"""Why a radio is held on: its node wants the channel; it exchanges a frame; it knows that a broadcast follows."""
NEVER: Final = np.inf
ROUNDING: Final = 1e-9
"""Times (s) nearer than this are equal: what is left is rounding."""


class LowPowerRadios(MacPart):
    """When the radios of all nodes are on.

    Args:
        services: The services of the network.
        interval: The wake interval in s.
        near: The short wake interval in s, of nodes that were told to use it; `interval` divided by a power of two.

    Attributes:
        on_since: (N,) since when radios have been held on; infinite where they are not.
        on_hold: Called with a node whose radio is about to be held on; returns since when it has been on, or infinity.
        on_release: Called with a node whose radio has just been turned off.
    """

    def __init__(self, services: NetworkMacServices, interval: float, near: float) -> None:
        super().__init__(services)
        size = self._nodes.size
        self._interval, self._near = interval, near
        self._phases = interval * uniforms(derive_all(services.key("wake_up"), np.arange(size)), 0)
        self.on_since = np.full(size, NEVER)
        self._near_until = np.zeros(size)
        self.on_hold: Callable[[int], float] = lambda node: NEVER
        self.on_release: Callable[[int], None] = lambda node: None
        self._reasons: dict[int, int] = {}
        self._held_from: dict[int, float] = {}
        self._busy: set[int] = set()
        self._until: dict[tuple[int, int], float] = {}

    def offsets(self, ids: Ints, time: float) -> tuple[Floats, Floats | float]:
        """(n,) s from the last wake-up of nodes to a time, and their intervals (n,), or one; on their own clocks."""
        local = self._clocks.local_times(ids, time) - self._phases[ids]
        if self._near == self._interval:
            return local % self._interval, self._interval
        intervals = np.where(self._near_until[ids] > time, self._near, self._interval)
        return local % intervals, intervals

    def is_held(self, node: int, reasons: int = SENDS | RECEIVES | EXPECTS) -> bool:
        """Whether a radio is held on for one of these reasons."""
        return bool(self._reasons.get(node, 0) & reasons)

    def hold(self, node: int, reason: int, since: float = NEVER) -> bool:
        """Hold a radio on; return whether its node lives on.

        Args:
            node: The node.
            reason: What for.
            since: When it began to listen without a break, if its wake-up heard something: it need not be started.
        """
        self._nodes.begin_sending(node)
        if not self._nodes.alive[node]:
            return False
        reasons = self._reasons.get(node, 0)
        if not reasons and since == NEVER:
            since = self.on_hold(node)
        self._reasons[node] = reasons | reason
        if not reasons:
            self._held_from[node] = now = self._env.now
            self.on_since[node] = min(since, now)
            self._nodes.hold_radio(node, on=since <= now)
        return bool(self._nodes.alive[node])

    def release(self, node: int, reason: int) -> None:
        """Turn a radio off, unless it is held on for another reason, too."""
        reasons = self._reasons.get(node, 0)
        if not reasons & reason:
            return
        self._until.pop((node, reason), None)
        if reasons != reason:
            self._reasons[node] = reasons & ~reason
            return
        del self._reasons[node]
        self.on_since[node] = NEVER
        self._nodes.release_radio(node, self._wake_ups(node, self._held_from.pop(node)))
        self.on_release(node)
        self._let_sleep(node)

    def begin_sending(self, node: int) -> None:
        """Keep a node awake that has frames to send, whether its radio is on or off."""
        self._busy.add(node)
        self._nodes.begin_sending(node)

    def end_sending(self, node: int) -> None:
        """Note that a node has no more frames to send."""
        self._busy.discard(node)
        self._let_sleep(node)

    def _let_sleep(self, node: int) -> None:
        """A node that neither has frames to send nor its radio on follows its sleep schedule."""
        if node not in self._busy and node not in self._reasons:
            self._nodes.end_sending(node)

    def _wake_ups(self, node: int, since: float) -> float:
        """How often a node would have woken since a time: its radio was on already."""
        now = self._env.now
        offsets, intervals = self.offsets(np.array([node]), now)
        return float(np.ceil((now - since - offsets) / intervals)[0])

    def hold_until(self, node: int, reason: int, time: float, since: float = NEVER) -> None:
        """`hold` a radio on until a time, or until it is released. A later call replaces the time."""
        if self.hold(node, reason, since):
            self._until[node, reason] = time
            then(self._env.timeout(time - self._env.now), self._elapsed, node, reason)

    def _elapsed(self, node: int, reason: int) -> None:
        if self._until.get((node, reason), NEVER) <= self._env.now + ROUNDING:
            self.release(node, reason)

    def forget(self, node: int) -> None:
        """Note that a node is down: its radio is off."""
        self._held_from.pop(node, None)
        self._busy.discard(node)
        self._reasons.pop(node, None)
        self.on_since[node] = NEVER
        self._near_until[node] = 0.0
        for reason in (SENDS, RECEIVES, EXPECTS):
            self._until.pop((node, reason), None)

    def use_short_interval(self, nodes: Sequence[int], until: float) -> None:
        """Have nodes that are up use the short interval until a time in s; it is not before what they were told."""
        if self._near == self._interval:
            return
        now = self._env.now
        for node in nodes:
            was_near = self._near_until[node] > now
            self._near_until[node] = until
            if not was_near:
                self._nodes.set_duty(node, 1)
            if self._nodes.alive[node]:
                then(self._env.timeout(until - now), self._use_long_interval, node)

    def _use_long_interval(self, node: int) -> None:
        if 0.0 < self._near_until[node] <= self._env.now + ROUNDING and self._nodes.alive[node]:
            self._nodes.set_duty(node, 0)
