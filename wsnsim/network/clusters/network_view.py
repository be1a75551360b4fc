"""What heads use of the network: setup, log, nodes, readings, wake intervals; what they foresee; target search."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats, Reading, planar
from wsnsim.base.mac_mechanisms import MacMechanism, UsesShortInterval
from wsnsim.base.network_ports import NearNodes, Outlook
from wsnsim.base.optional_ports import ForecastsSuccession
from wsnsim.base.ports import MotionModel, Scene
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.setups import NetworkSetup
from wsnsim.network.event_log import ProtocolLog, StepClock
from wsnsim.network.imperfect_readings import Imperfections, make_readings
from wsnsim.network.nodes import Nodes
from wsnsim.network.sensing import Readings


class NetworkView(NamedTuple):
    """The network as heads and clusters see it. Through this view they log events, but change nothing else.

    `readings[target]` is {node: reading} of the living nodes that sense a target now. A head must hold more than
    `threshold` joules. `tracker_key` is the counter key of the trackers' random numbers.
    """

    setup: NetworkSetup
    clock: StepClock
    log: ProtocolLog
    nodes: Nodes
    readings: Mapping[int, Mapping[int, Reading]]
    threshold: float
    tracker_key: int

    def can_lead(self, node: int) -> bool:
        """Whether a node is up and holds more than the threshold (Jiang 2013, section 4, step 2)."""
        return self.nodes.alive[node] and self.nodes.holds_more(node, self.threshold)

    def who_can_lead(self) -> Bools:
        """(N,) the same of every node."""
        return self.nodes.able(self.threshold)

    def nodes_near(self, point: Floats, radius: float) -> NearNodes:
        """The nodes whose assumed position is within a radius in m of a point (2,).

        The map that every head has does not tell who is down, but who can lead.
        """
        nodes = self.nodes
        ids = nodes.assumed.grid.within(point, radius)
        able = np.array([self.can_lead(node) for node in ids.tolist()], dtype=np.bool_)
        return NearNodes(ids, nodes.assumed.positions[ids], nodes.traits[ids], able)

    def predicted_position(self, target: int, belief: Any, scene: Scene) -> Floats:
        """(2,) the position that a belief predicts for the next step: where nodes are woken."""
        return self._position(target, self.setup.tracker.forecast(belief, scene, self._ahead(scene)))

    def successor_position(self, target: int, belief: Any, scene: Scene) -> Floats:
        """(2,) the position near which the next head is looked for; see `ForecastsSuccession`."""
        return self._position(target, self.setup.successor_forecast(belief, scene, self._ahead(scene)))

    def _ahead(self, scene: Scene) -> int:
        """The steps from a scene to the next step."""
        return self.clock.step - scene.step + 1

    def _position(self, target: int, forecast: Estimate) -> Floats:
        return planar(forecast.mean[list(self.setup.filter_motion(target).position)])

    def nearest(self, candidates: Sequence[int], point: Floats) -> int:
        """The candidate assumed nearest to a point (2,); of equally near ones the first."""
        away = ((self.nodes.assumed.positions[np.array(candidates)] - point) ** 2).sum(axis=1)
        return candidates[int(np.argmin(away))]

    def outlook(self, target: int, head: int, members: Sequence[int], belief: Any, scene: Scene) -> Outlook:
        """What a head foresees that holds a belief of the time of `scene`, for policies that see the geometry."""
        setup, ahead = self.setup, self._ahead(scene)
        succession = forecast = setup.tracker.forecast(belief, scene, ahead)
        if isinstance(setup.tracker, ForecastsSuccession):
            succession = setup.successor_forecast(belief, scene, ahead)
        return self._outlook(target, head, members, forecast, succession)

    def first_outlook(self, target: int, head: int, estimate: Estimate) -> Outlook:
        """What a head foresees that knows the first estimate of a track, of this step."""
        clock, motion = self.clock, self.setup.filter_motion(target)
        forecast = one_step_on(estimate, motion, clock.dt, clock.step * clock.dt)
        return self._outlook(target, head, [head], forecast, forecast)

    def _outlook(
        self, target: int, head: int, members: Sequence[int], forecast: Estimate, succession: Estimate
    ) -> Outlook:
        return Outlook(
            head=head,
            place=self.nodes.assumed.positions[head],
            members=np.array(members, dtype=np.int64),
            time=self.clock.next_step,
            dt=self.clock.dt,
            forecast=forecast,
            succession=succession,
            motion=self.setup.filter_motion(target),
            sensor=self.setup.filter_sensor,
            reach=self.nodes.reach,
            nodes_near=self.nodes_near,
        )


class TargetSearch:
    """What awake nodes detect at the `setup.polls` instants of a step at which they search.

        search.first_detection(target, poll) -> (node, {node: reading}) or None

    At a step's own instant (poll 0) the readings are those of the step; between steps they have noise of their own.
    All nodes search at the same instants; of several that detect the target, a random one reports first (our choice).
    """

    def __init__(
        self, network: NetworkView, available: Sequence[Readings], paths: Sequence[Floats],
        imperfections: Imperfections, key: int,
    ) -> None:  # fmt: skip
        """`available` and `paths`: per target, its readings at steps, and its trajectory at every poll."""
        self._network = network
        self._available = available
        self._polls = network.setup.polls
        self._key = key
        setup, nodes = network.setup, network.nodes
        between = replace(imperfections, dt=setup.dt / setup.polls)
        self._between = make_readings(setup, paths, nodes, between, key) if self._polls > 1 else []

    def first_detection(self, target: int, poll: int) -> tuple[int, dict[int, Reading]] | None:
        """The node that detects a target first at an instant, and the readings of all awake nodes; None: no node."""
        network, step = self._network, self._network.clock.step
        if poll:
            readings = self._between[target].readings(step * self._polls + poll)
        else:
            readings = self._available[target].readings(step)
        awake = {node: value for node, value in readings.items() if network.nodes.is_awake(node)}
        able = np.array([node for node in awake if network.can_lead(node)], dtype=np.int64)
        if not able.size:
            return None
        chances = uniforms(derive_all(derive(self._key, target, step, poll), able), 0)
        return int(able[np.argmin(chances)]), awake


def one_step_on(estimate: Estimate, motion: MotionModel, dt: float, time: float) -> Estimate:
    """An estimate of `time` s, predicted for the step after it."""
    point = np.ascontiguousarray(estimate.mean[:, None])
    transitions, noise = motion.matrices(point, dt, time)
    cov = transitions[0] @ estimate.cov @ transitions[0].T + noise
    return Estimate(motion.advance(point, dt, time)[:, 0], 0.5 * (cov + cov.T))


class WakeIntervals:
    """The wake intervals of nodes: a short one for those that were told of a target, a long one for all others.

        intervals.shorten(nodes, until)      intervals.shorten_for_next_step(nodes)

    Who is told decides: nodes that heard an announcement, a wake-up message or a call of the wake-up radio, or a parcel
    of their head, and the head itself. Where the target is plays no part. There are two intervals where `mac.near`
    exists and is set; elsewhere radios listen always, or at one interval.
    """

    def __init__(self, setup: NetworkSetup, clock: StepClock, nodes: Nodes, mechanism: MacMechanism) -> None:
        """`mechanism`: that of the MAC."""
        two = getattr(setup.mac, "near", None) is not None and isinstance(mechanism, UsesShortInterval)
        self._mechanism = cast(UsesShortInterval, mechanism) if two else None
        self._clock = clock
        self._after = max(setup.wakeup.wait, clock.dt)
        self._nodes = nodes
        self._until: dict[int, float] = {}
        self._seconds = 0.0

    def shorten(self, nodes: Iterable[int], until: float) -> None:
        """Have nodes wake up at the short interval until a time in s at least.

        The MAC is told about those nodes that are up, and that have not been told for as long.
        """
        if self._mechanism is None:
            return
        now, alive = self._clock.now, self._nodes.alive
        known = {node: self._until.get(node, now) for node in nodes if alive[node]}
        longer = [node for node, before in known.items() if until > max(before, now)]
        if not longer:
            return
        self._seconds += sum([until - max(known[node], now) for node in longer])
        self._until.update(dict.fromkeys(longer, until))
        self._mechanism.use_short_interval(np.array(longer, dtype=np.int64), until)

    def shorten_for_next_step(self, nodes: Iterable[int]) -> None:
        """The same until the next step, and for as long after it as woken nodes wait, but for a step at least."""
        if self._mechanism is not None:
            self.shorten(nodes, self._clock.next_step + self._after)

    def forget(self, node: int) -> None:
        """A node went down: it restarts at the long interval. The time that it had left is taken back."""
        self._seconds -= max(self._until.pop(node, 0.0) - self._clock.now, 0.0)

    def share(self) -> float:
        """Share of the nodes' time so far that was at the short interval; NaN where there is one interval."""
        if self._mechanism is None:
            return float("nan")
        now = self._clock.now
        left = sum([max(until - now, 0.0) for until in self._until.values()])
        return (self._seconds - left) / (self._nodes.size * now) if now else 0.0
