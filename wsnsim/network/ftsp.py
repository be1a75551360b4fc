"""The Flooding Time Synchronization Protocol: all nodes follow the clock of the node of lowest id that they hear of.

Source: Maróti, Kusy, Simon, Lédeczi (2004), and TimeSyncP.nc of TinyOS, whose rules these are. Ours: a node that sleeps
when its message is due sends it in its next awake spell; a node forgets its reference points when it gives way to a
root whose time does not agree with them (in TinyOS a line may run through points of two clocks); a root sends what its
clock shows, even if it had too few points to correct it; and the MAC writes root, sequence number and time stamp into a
message when it leaves, so that they belong together however long the message waited.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.mechanisms import SyncServices
from wsnsim.base.rng import derive, derive_all, normals, uniforms
from wsnsim.models.hardware import Ftsp

PATIENCE: Final = 3
"""Outliers in a row that are left out; the next one makes a node forget its reference points."""
PHASE, WAIT, STAMP = 0, 1, 2
"""In a random key, what a number is for: a node's first message, its time in an awake spell, a time stamp."""


class ReferencePoints:
    """The last `most` reference points of a node, and the line through them. Without any, the other clock is its own.

    The line runs through the offset over the own clock, both relative to their means: numbers of microseconds beside
    numbers of seconds lose no digits. Source: Maróti et al. (2004), section 6; TimeSyncP.nc, calculateConversion.
    """

    __slots__ = ("_offset", "_own", "_points", "_skew")

    def __init__(self, most: int) -> None:
        self._points: deque[tuple[float, float]] = deque(maxlen=most)
        self._own = self._offset = self._skew = 0.0

    def __len__(self) -> int:
        return len(self._points)

    @property
    def rate(self) -> float:
        """Seconds on the own clock per second on the other clock."""
        return 1.0 / (1.0 + self._skew)

    def other(self, own: float) -> float:
        """What the other clock shows when the own clock shows `own`, in s."""
        return own + self._offset + self._skew * (own - self._own)

    def add(self, own: float, other: float) -> None:
        """Note what both clocks showed at one instant. The oldest of `most` points is forgotten."""
        self._points.append((own, other - own))
        self._fit()

    def clear(self) -> None:
        """Forget the points. The line stays until there are new ones."""
        self._points.clear()

    def restart(self) -> None:
        """Forget the points and the line."""
        self._points.clear()
        self._own = self._offset = self._skew = 0.0

    def _fit(self) -> None:
        """The line by least squares. Through one point goes the line with the slope of before."""
        count, points = len(self._points), self._points
        self._own = sum([own for own, _ in points]) / count
        self._offset = sum([offset for _, offset in points]) / count
        spread = sum([(own - self._own) ** 2 for own, _ in points])
        if spread > 0.0:
            self._skew = sum([(own - self._own) * (offset - self._offset) for own, offset in points]) / spread


class _Node:
    """What one node knows.

    Attributes:
        root: The id of the root; None: it knows of none.
        sequence: The greatest sequence number of the root that it received, or as the root its own.
        beats: Periods since it last heard of a root of lower id than its own.
        points: Its reference points of the root's clock.
        outliers: Outliers in a row.
        has_message: Whether it has a message to send: it waits until the node is awake, or in the MAC.
    """

    __slots__ = ("beats", "has_message", "outliers", "points", "root", "sequence")

    def __init__(self, entries: int) -> None:
        self.root: int | None = None
        self.sequence = 0
        self.beats = 0
        self.points = ReferencePoints(entries)
        self.outliers = 0
        self.has_message = False


class FtspMechanism:
    """FTSP on all nodes of a network."""

    def __init__(self, component: Ftsp, services: SyncServices) -> None:
        self._component = component
        self._services = services
        self._nodes = [_Node(component.entries) for _ in range(services.size)]
        self._timers: list[Callable[[], None]] = [partial(self._beat, node) for node in range(services.size)]
        self._draws = 0

    def begin(self) -> None:
        """Set the timer of every node's first message, at a random phase of the period."""
        phases = uniforms(derive_all(derive(self._services.key, PHASE), np.arange(len(self._nodes))), 0)
        for timer, phase in zip(self._timers, (phases * self._component.period).tolist(), strict=True):
            self._services.call_later(phase, timer)

    def forget(self, node: int) -> None:
        """A node crashed: it knows of no root and has no reference points."""
        self._nodes[node] = _Node(self._component.entries)

    def is_synchronised(self, node: int) -> bool:
        """Whether a node is the root, or has reference points enough."""
        state = self._nodes[node]
        return state.root == node or len(state.points) >= self._component.entries_to_sync

    def _beat(self, node: int) -> None:
        """A period of a node has passed: it has a message, unless the last one has not been sent yet."""
        services, state = self._services, self._nodes[node]
        if services.is_dead(node):
            return
        services.call_later(services.lasts(node, self._component.period), self._timers[node])
        if services.is_up(node) and not state.has_message and self._has_something_to_say(node, state):
            state.has_message = True
            self._send_awake(node, state)

    def _has_something_to_say(self, node: int, state: _Node) -> bool:
        """Whether a node knows enough of the root's clock. It declares itself the root if it has heard of none."""
        component = self._component
        if state.root is None:
            state.beats += 1
            if state.beats < component.root_timeout:
                return False
            state.root = node
        elif state.root != node and state.beats >= component.root_timeout:
            state.root, state.beats = node, 0
            state.sequence += 1
        if state.root == node or len(state.points) >= component.entries_to_send:
            return True
        state.beats += 1
        return False

    def _send_awake(self, node: int, state: _Node) -> None:
        """Send a message now if the node is awake, otherwise when it wakes."""
        services = self._services
        if services.is_awake(node):
            self._send(node, state)
        else:
            wakes = max(services.next_change(node) - services.now, 0.0)
            services.call_later(wakes, partial(self._wait_awake, node, state))

    def _wait_awake(self, node: int, state: _Node) -> None:
        """A node may have woken: it sends at a random time of its awake spell, since others woke at the same time."""
        services = self._services
        if not services.is_up(node) or self._nodes[node] is not state:
            return
        if not services.is_awake(node):
            self._send_awake(node, state)
            return
        self._draws += 1
        chance = float(uniforms(derive_all(derive(services.key, WAIT, node), np.array([self._draws])), 0)[0])
        spell = min(services.next_change(node) - services.now, self._component.period)
        services.call_later(chance * spell, partial(self._send, node, state))

    def _send(self, node: int, state: _Node) -> None:
        """Broadcast what the node knows of the root's clock."""
        if state.root is None or not self._services.is_up(node) or self._nodes[node] is not state:
            return
        self._services.broadcast(node, self._component.bits, partial(self._sent, node, state))

    def _sent(self, node: int, sender: _Node, received: Ints | None) -> None:
        """A message has been sent, unless `received` is None: its receivers note it, unless it tells no time."""
        sender.has_message = False
        root, sequence = sender.root, sender.sequence
        if received is None or root is None or self._nodes[node] is not sender:  # it has crashed
            return
        if root != node and len(sender.points) < self._component.entries_to_send:  # it has a new root since
            return
        sender.beats += 1
        if sender.root == node:
            sender.sequence += 1
        self._draws += 1
        services = self._services
        stamp = services.clock(node) if root == node else sender.points.other(services.own_clock(node))
        keys = derive_all(derive(services.key, STAMP, self._draws), received)
        errors = (self._component.jitter * normals(keys, 0)).tolist()
        for receiver, error in zip(received.tolist(), errors, strict=True):
            self._receive(receiver, root, sequence, stamp, error)

    def _receive(self, node: int, root: int, sequence: int, stamp: float, error: float) -> None:
        """A node has received a message: it is about a better root, or new, or ignored."""
        state, component = self._nodes[node], self._component
        own = self._services.own_clock(node) + error
        is_new_root = state.root == node and state.beats < component.ignore_root
        if (state.root is None or root < state.root) and not is_new_root:
            state.root = root
            if not self.is_synchronised(node) or self._is_outlier(state, own, stamp):
                state.points.restart()
        elif state.root != root or sequence <= state.sequence:
            return
        state.sequence = sequence
        if root < node:
            state.beats = 0
        self._note(node, state, own, stamp)

    def _note(self, node: int, state: _Node, own: float, stamp: float) -> None:
        """Add a reference point, unless it is an outlier, and correct the clock if there are enough."""
        points = state.points
        if self.is_synchronised(node) and self._is_outlier(state, own, stamp):
            state.outliers += 1
            if state.outliers > PATIENCE:
                points.clear()
            return
        state.outliers = 0
        points.add(own, stamp)
        if self.is_synchronised(node):
            self._services.set_clock(node, points.other(self._services.own_clock(node)), points.rate)

    def _is_outlier(self, state: _Node, own: float, stamp: float) -> bool:
        """Whether a node would not have expected that the root's clock shows `stamp` when its own one shows `own`."""
        return abs(state.points.other(own) - stamp) > self._component.outlier
