"""A wake interval that follows the target: nodes that were told of it wake up more often for a while.

    intervals.shorten(nodes, until)      intervals.shorten_for_next_step(nodes)

Who is told decides: nodes that heard an announcement, a wake-up message or a call of the wake-up radio, or a parcel of
their head, and the head itself. Where the target is plays no part.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numpy as np

from wsnsim.base.mac_mechanisms import MacMechanism, UsesShortInterval
from wsnsim.base.setups import NetworkSetup
from wsnsim.network.event_log import StepClock
from wsnsim.network.nodes import Nodes


class WakeIntervals(Protocol):
    """The wake intervals of nodes."""

    def shorten(self, nodes: Iterable[int], until: float) -> None:
        """Have nodes wake up at the short interval until a time in s at least."""

    def shorten_for_next_step(self, nodes: Iterable[int]) -> None:
        """The same until the next step, and for as long after it as woken nodes wait, but for a step at least."""

    def forget(self, node: int) -> None:
        """A node went down: it restarts at the long interval."""

    def share(self) -> float:
        """Share of the nodes' time so far that was at the short interval; NaN where there is one interval."""


class OneInterval:
    """The radios listen always, or at one interval."""

    def shorten(self, nodes: Iterable[int], until: float) -> None:
        """Do nothing."""

    def shorten_for_next_step(self, nodes: Iterable[int]) -> None:
        """Do nothing."""

    def forget(self, node: int) -> None:
        """Do nothing."""

    def share(self) -> float:
        """NaN."""
        return float("nan")


class TwoIntervals:
    """A short interval for nodes that were told of a target, a long one for all others."""

    def __init__(self, clock: StepClock, wait: float, nodes: Nodes, mechanism: UsesShortInterval) -> None:
        """`wait`: s for which woken nodes wait for the target."""
        self._clock = clock
        self._after = max(wait, clock.dt)
        self._nodes = nodes
        self._mechanism = mechanism
        self._until: dict[int, float] = {}
        self._seconds = 0.0

    def shorten(self, nodes: Iterable[int], until: float) -> None:
        """Tell the MAC about those nodes that are up, and that have not been told for as long."""
        now, alive = self._clock.now, self._nodes.alive
        known = {node: self._until.get(node, now) for node in nodes if alive[node]}
        longer = [node for node, before in known.items() if until > max(before, now)]
        if not longer:
            return
        self._seconds += sum([until - max(known[node], now) for node in longer])
        self._until.update(dict.fromkeys(longer, until))
        self._mechanism.use_short_interval(np.array(longer, dtype=np.int64), until)

    def shorten_for_next_step(self, nodes: Iterable[int]) -> None:
        """`shorten` until the next step and a while after it."""
        self.shorten(nodes, self._clock.next_step + self._after)

    def forget(self, node: int) -> None:
        """Take back the time that a node that went down had left."""
        self._seconds -= max(self._until.pop(node, 0.0) - self._clock.now, 0.0)

    def share(self) -> float:
        """The mean over nodes; the time that some have left is not counted."""
        now = self._clock.now
        left = sum([max(until - now, 0.0) for until in self._until.values()])
        return (self._seconds - left) / (self._nodes.size * now) if now else 0.0


def make_wake_intervals(setup: NetworkSetup, clock: StepClock, nodes: Nodes, mechanism: MacMechanism) -> WakeIntervals:
    """The wake intervals of a scenario and its MAC's mechanism: two where `mac.near` exists and is set."""
    if getattr(setup.mac, "near", None) is None or not isinstance(mechanism, UsesShortInterval):
        return OneInterval()
    return TwoIntervals(clock, setup.wakeup.wait, nodes, mechanism)
