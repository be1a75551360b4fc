"""What a head makes of its belief to wake the nodes that will sense the target next, and a count of those that woke."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats, Ints, planar
from wsnsim.base.optional_ports import Foresees, Portable
from wsnsim.base.ports import Scene
from wsnsim.base.sleeping import Point, WakeUpPlan
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.clusters.track import Track
from wsnsim.network.clusters.wake_up_service import WakeUpService

Needed: TypeAlias = Callable[[Sequence[int]], bool]


class WakeAhead:
    """Starts a wake-up round for every step, unless no node is woken in this scenario: then there is no `service`.

    `wakes_nodes`: whether nodes are woken at all.
    """

    def __init__(self, network: NetworkView, service: WakeUpService | None) -> None:
        self.wakes_nodes = service is not None
        self._network = network
        self._service = service
        self._sequence = 0
        tracker = network.setup.tracker  # asked once: to check a protocol takes longer than to plan
        self._foresees = tracker.foresees if isinstance(tracker, Foresees) else (lambda belief: True)
        self._belief_bits = tracker.belief_bits if isinstance(tracker, Portable) else (lambda belief: 0)

    def wake(
        self, track: Track, head: int, belief: Any, scene: Scene, last_sensed: float, needed: Needed | None = None
    ) -> None:
        """Have nodes woken for the next step, if there is one; returns at once.

        Args:
            track: the track, which gets the wake-up round.
            head: the cluster head.
            belief: the head's belief.
            scene: the scene of the belief.
            last_sensed: time in s of the last measurement.
            needed: asked whether a message must be sent, given the nodes of its region to which the head has a link.
                None: one is sent in any case.
        """
        setup = self._network.setup
        if self._service is None or self._network.clock.step >= setup.steps:
            return
        self._sequence += 1
        plan = self._plan(track.target, head, belief, scene, last_sensed)
        message = setup.wakeup.compose(plan, belief if setup.wakeup.carries_belief else None)
        if needed is None or needed(self._service.addressed(head, message)):
            self._service.start(track, head, message, plan.foreseen)

    def _plan(self, target: int, head: int, belief: Any, scene: Scene, last_sensed: float) -> WakeUpPlan:
        network, setup, nodes = self._network, self._network.setup, self._network.nodes
        motion = setup.filter_motion(target)
        mean = setup.tracker.estimate(belief).mean
        due = network.clock.next_step
        return WakeUpPlan(
            target=target,
            step=network.clock.step + 1,
            sequence=self._sequence,
            sender=head,
            place=(nodes.assumed.x[head], nodes.assumed.y[head]),
            fix=_point(planar(mean[list(motion.position)])),
            heading=_heading(mean, motion.columns),
            prediction=_point(network.predicted_position(target, belief, scene)),
            foreseen=self._foresees(belief),
            due=due,
            ahead=due - last_sensed,
            sensing=setup.sensor.reach,
            reach=nodes.reach,
            payload_bits=self._belief_bits(belief),
        )


def _heading(mean: Floats, columns: tuple[str, ...]) -> Point:
    """The velocity of the target; (0, 0) where the state has none."""
    if "vx" not in columns or "vy" not in columns:
        return 0.0, 0.0
    return _point(mean[[columns.index("vx"), columns.index("vy")]])


def _point(values: Floats) -> Point:
    x, y = np.asarray(values, dtype=np.float64).tolist()
    return x, y


class WakeUpCounters:
    """Counts wake-ups. One is unnecessary if the target is out of the node's sensing range.

    `woken` (targets, steps + 1, 2) holds the nodes that woke and, of these, the unnecessary wake-ups. `points` holds
    the true positions (steps + 1, P) of each target; none where readings name no target: nothing is counted then.
    """

    def __init__(self, network: NetworkView, points: Sequence[Floats]) -> None:
        self._network = network
        self._points = points
        self.woken: Ints = np.zeros((len(points), network.setup.steps + 1, 2), dtype=np.int64)

    def count_wake(self, node: int, target: int, by_frame: bool) -> None:
        """Count a wake-up at its step: it is unnecessary if a frame caused it and the node does not sense the target.

        Where nodes are woken ahead, wake-ups are counted by round instead.
        """
        if self._network.setup.wakeup.mechanism != "none" or not self._points:
            return
        unnecessary = by_frame and node not in self._network.readings[target]
        self.woken[target, self._network.clock.step] += (1, unnecessary)

    def count_rounds(self, track: Track) -> None:
        """Count the nodes that the wake-up rounds for the present step have woken, and complete the rounds."""
        nodes, step = self._network.nodes, self._network.clock.step
        latest = itertools.takewhile(lambda one: one.message.step >= step, reversed(track.rounds))
        rounds = [one for one in latest if one.message.step == step]
        if not rounds:
            return
        point, reach = planar(self._points[track.target][step]), self._network.setup.sensor.reach
        woken: set[int] = set()
        unnecessary: set[int] = set()
        for one in rounds:
            tracking = [node for node in one.tracking if nodes.alive[node]]
            apart = nodes.positions[np.array(tracking, dtype=np.int64)] - point
            beyond = ~(np.hypot(apart[:, 0], apart[:, 1]) <= reach)  # NaN: the target is absent
            one.woken, one.ineffective = len(tracking), int(beyond.sum())
            one.dismissed = len(one.reached.difference(one.tracking))
            woken.update(tracking)
            unnecessary.update(itertools.compress(tracking, beyond.tolist()))
        self.woken[track.target, step] += (len(woken), len(unnecessary))
