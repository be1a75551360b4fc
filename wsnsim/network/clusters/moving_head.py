"""Moving heads: the head is chosen again at each step among the nodes that were woken for it.

At the step's instant the woken nodes measure and send their readings to the head. The head waits until none has come
for a while, estimates, reports, and has nodes woken for the next step; the policy's `main` says which node leads then.
A target whose track was lost is searched for by the nodes that happen to be awake; the first to detect it becomes head.

Li, Jiang, Zhang, Zhang (2012), section 2.2, and our reconstructions of its two rivals. Idealisations, all our choice:
the woken nodes know which of them is nearest to the prediction, and awake nodes know whether a target is tracked.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, cast

import numpy as np

from wsnsim.base.arrays import Reading
from wsnsim.base.medium_access import window_of
from wsnsim.base.network_ports import MovingPolicy
from wsnsim.base.optional_ports import Portable
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Parcel
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.driver import Driver
from wsnsim.network.clusters.election import strength_of
from wsnsim.network.clusters.head_services import HeadProtocol, HeadServices
from wsnsim.network.clusters.track import Handover, Track, TrackLost
from wsnsim.network.event_log import Acting
from wsnsim.network.radio.datagrams import Datagram

ROUNDING: Final = 1e-9
"""Times (s) that differ by less than this are equal but for rounding."""


@dataclass(slots=True)
class Lead:
    """One head's lead of a track.

    Attributes:
        belief_step: the step of the belief; `belief_time`: the time in s of the belief.
        last_sensed: time in s of the last measurement.
        scene: the scene of the last step; unset before the first.
        heard: {node: reading} of the last step.
    """

    track: Track
    head: int
    belief: Any
    belief_step: int
    belief_time: float
    last_sensed: float
    scene: Scene = field(init=False)
    heard: Mapping[int, Reading] = field(default_factory=dict)


class MovingHeadProtocol(HeadProtocol):
    """A head that leads until another node takes over, at most from one step to the next."""

    def __init__(self, services: HeadServices) -> None:
        super().__init__(services)
        self._policy = cast(MovingPolicy, self._setup.clusters)
        self._window = window_of(self._policy.quiet, self._policy.cap, self._setup.waits)
        self._by_detection = self._policy.main == "detection"
        self._message_carries_belief = self._setup.wakeup.carries_belief and isinstance(self._setup.tracker, Portable)

    def fill_vacancy(self, track: Track, poll: int) -> Handover | None:
        """Name the awake node that detects the target first."""
        found = self._services.search.first_detection(track.target, poll)
        if found is None:
            return None
        head, detected = found
        return Handover(head, self._clock.step, acts_now=True, detected=detected)

    def release(self, track: Track, cluster: Cluster) -> None:
        """Do nothing: members have no role."""

    def lead(self, track: Track, handover: Handover) -> Acting[Handover | None]:
        """Initiate the track or take it over, and lead it step by step until another node is head."""
        lead = self._take_over(track, handover)
        if handover.detected is not None:
            yield from self._initiate(lead, handover.detected)
        elif handover.wakes_nodes:
            scene = self._cluster(track, lead.head, []).scene(0)
            lead.scene = replace(scene, time=lead.belief_time, dt=self._clock.next_step - lead.belief_time)
            self._wake_nodes(lead)
            yield track.tick
            following = yield from self._give_way(lead)
            if following is not None:
                return following
            yield from self._step(lead)
        else:
            yield from self._step(lead)
        while (following := (yield from self._move_on(lead))) is None:
            yield from self._step(lead)
        return following

    def _take_over(self, track: Track, handover: Handover) -> Lead:
        clock, belief_time = self._clock, handover.belief_time
        since = handover.belief_step * clock.dt if belief_time is None else belief_time
        track.open_cluster(self._cluster(track, handover.successor, []), handover, clock.now)
        return Lead(track, handover.successor, handover.belief, handover.belief_step, since, handover.last_sensed)

    def _cluster(self, track: Track, head: int, joined: list[int]) -> Cluster:
        return Cluster(self._network, track.target, head, joined, keys_ahead=1)

    def _initiate(self, lead: Lead, detected: Mapping[int, Reading]) -> Acting[None]:
        """Tell the neighbours of a target without a track; those that sense it answer. The track starts from that.

        `detected`: {node: reading} of all nodes that are awake and sense the target at this instant.
        """
        clock, track, head, estimates = self._clock, lead.track, lead.head, self._services.estimates
        began, step, acquire = clock.now, clock.step, self._setup.acquire
        self._log_sensing(track, detected, detected)
        yield clock.env.timeout(self._policy.sampling)
        listeners = yield from self._ask(lead, "detection")
        answers = [Datagram(node, head, Parcel(detected[node], 1, acquire.answer_bits, "reading"))
                   for node in listeners if node in detected]  # fmt: skip
        self._services.messages.intervals.shorten_for_next_step([head, *(answer.source for answer in answers)])
        cluster = self._cluster(track, head, [answer.source for answer in answers])
        driver = self._driver(track, cluster)
        yield from driver.collection.collect(answers)
        readings = {
            head: detected[head],
            **{answer.source: detected[answer.source] for answer in answers if answer.arrived},
        }
        prior = estimates.initial(track, readings)
        lead.scene = replace(cluster.scene(0), time=began, dt=(step + 1) * clock.dt - began)
        lead.belief = yield from driver.perform(self._setup.tracker.start(prior, lead.scene))
        driver.readings = len(readings)
        lead.heard, lead.last_sensed, lead.belief_step, lead.belief_time = readings, began, step, began
        if not track.started:
            self._log.add("acquire", track.target, head)
        estimates.note_start(track, head)
        if abs(began - step * clock.dt) < ROUNDING:
            estimates.issue(track, step, lead.scene, driver, lead.belief)

    def _step(self, lead: Lead) -> Acting[None]:
        """One step at the head: readings in, an estimate out."""
        clock, track, estimates = self._clock, lead.track, self._services.estimates
        began, asked = clock.now, clock.step
        members = yield from self._measuring(lead)
        if clock.step != asked:  # the request took longer than a step: members answer with what they measure now
            self._log_sensing(track, [lead.head, *members], self._network.readings[track.target])
        cluster = track.cluster = self._cluster(track, lead.head, members)
        track.clusters[-1].members = max(track.clusters[-1].members, cluster.size)
        driver = self._driver(track, cluster)
        step = clock.step
        scene = cluster.scene(step - lead.belief_step)
        dt = (scene.time - lead.belief_time) / scene.steps if scene.steps else scene.dt
        lead.belief = yield from driver.perform(self._setup.tracker.step(lead.belief, replace(scene, dt=dt)))
        lead.belief_step, lead.belief_time, lead.heard, lead.scene = step, scene.time, driver.heard, scene
        if driver.readings or (scene.ids and self._setup.uses_silence):
            lead.last_sensed = began
            estimates.issue(track, step, scene, driver, lead.belief)
            estimates.snapshot(track, cluster, lead.belief, step)
        elif began - lead.last_sensed > self._policy.patience + ROUNDING:
            raise TrackLost("no_readings")

    def _measuring(self, lead: Lead) -> Acting[list[int]]:
        """Let nodes measure: those that were woken; without a wake-up protocol, those that hear the head's request.

        Measuring takes `sampling` s, and no energy of its own: awake nodes sense all the time.
        """
        track, readings = lead.track, self._network.readings
        if self._services.wake_ahead.wakes_nodes:
            woken = self._woken(lead)
            self._log_sensing(track, [lead.head, *woken], readings[track.target])
            yield self._clock.env.timeout(self._policy.sampling)
            return woken
        self._log_sensing(track, list(readings[track.target]), readings[track.target])
        yield self._clock.env.timeout(self._policy.sampling)
        listeners = yield from self._ask(lead, "request")
        sensing = [node for node in listeners if node in readings[track.target]]
        self._services.messages.intervals.shorten_for_next_step(sensing)
        return sensing

    def _log_sensing(self, track: Track, nodes: Iterable[int], readings: Mapping[int, Reading]) -> None:
        for node in nodes:
            if node in readings:
                self._log.add("sense", track.target, node)

    def _woken(self, lead: Lead) -> list[int]:
        """The living nodes that were woken for this step, without the head."""
        round_ = lead.track.round
        if round_ is None or round_.message.step != self._clock.step:
            return []
        alive = self._network.nodes.alive
        return [node for node in sorted(round_.tracking) if node != lead.head and alive[node]]

    def _ask(self, lead: Lead, what: str) -> Acting[list[int]]:
        """Broadcast a question about the target; return the nodes that heard it."""
        bits = self._setup.acquire.detection_bits
        return (yield from self._services.messages.ask(lead.track.target, lead.head, what, bits))

    def _driver(self, track: Track, cluster: Cluster) -> Driver:
        return Driver(self._services.driver, track.target, cluster.head, cluster.members, self._window)

    def _wake_nodes(self, lead: Lead) -> None:
        self._services.wake_ahead.wake(lead.track, lead.head, lead.belief, lead.scene, lead.last_sensed)

    def _move_on(self, lead: Lead) -> Acting[Handover | None]:
        """Have nodes woken for the next step and wait for it; the handover, if another node leads from now on."""
        waker = self._waker(lead)
        if waker != lead.head:
            following = yield from self._hand_over(lead, waker, wakes_nodes=True)
            if following is not None:
                return following
        self._wake_nodes(lead)
        yield lead.track.tick
        return (yield from self._give_way(lead))

    def _waker(self, lead: Lead) -> int:
        """The node that wakes others for the next step: it gets the belief at once, if it is not the head.

        By detection, the node with the strongest reading; of equal ones the lowest id. By prediction, the head, or
        where the wake-up is announced by region the able node nearest to the prediction, within sensing range of it.
        """
        network = self._network
        if self._by_detection:
            able = [node for node in lead.heard if network.can_lead(node)]
            sensor = self._setup.sensor
            return min(able, key=lambda node: (-strength_of(sensor, lead.heard[node]), node), default=lead.head)
        if self._setup.wakeup.mechanism != "region":
            return lead.head
        point = network.successor_position(lead.track.target, lead.belief, lead.scene)
        near = network.nodes.assumed.grid.within(point, self._setup.sensor.reach)
        able = [node for node in near.tolist() if network.can_lead(node)]
        if not able:
            raise TrackLost("empty_region")
        return network.nearest(able, point)

    def _head_at_step(self, lead: Lead) -> int:
        """The head at the step's instant, once nodes have been woken for it.

        By detection, the head: it took over after the last step. By prediction, the able node nearest to the predicted
        position; the head if no node was woken for this step.
        """
        round_ = lead.track.round
        if self._by_detection or round_ is None or round_.message.step != self._clock.step:
            return lead.head
        able = [node for node in sorted(round_.tracking) if self._network.can_lead(node)]
        if not able:
            raise TrackLost("expired" if round_.expired else "nobody_woken")
        return self._network.nearest(able, np.array(round_.message.centre))

    def _give_way(self, lead: Lead) -> Acting[Handover | None]:
        """The handover at a step's instant, if another of the woken nodes is head now."""
        successor = self._head_at_step(lead)
        if successor == lead.head:
            return None
        if not self._message_carries_belief:
            return (yield from self._hand_over(lead, successor, wakes_nodes=False))
        assert lead.track.round is not None, "only a node that was woken takes over at the step"
        self._log.add("handover", lead.track.target, lead.head, "message", peer=successor)
        return self._next(lead, Handover(successor, lead.belief_step, lead.track.round.tracking[successor].belief))

    def _hand_over(self, lead: Lead, successor: int, wakes_nodes: bool) -> Acting[Handover | None]:
        """Send the belief to the next head. If it does not arrive, the track is lost, or the head goes on: None."""
        track = lead.track
        driver = self._driver(track, self._cluster(track, lead.head, []))
        self._log.add("handover", track.target, lead.head, peer=successor)
        flow = self._setup.tracker.hand_over(lead.belief, lead.scene, successor)
        belief = yield from driver.perform(flow)
        if belief is None and self._setup.waits.retries_handover:
            return None
        if belief is None or not self._network.nodes.alive[successor]:
            raise TrackLost("handover_lost")
        handover = Handover(
            successor, lead.belief_step, belief, hops=driver.hops, bits=driver.collection.bits, wakes_nodes=wakes_nodes
        )
        return self._next(lead, handover)

    def _next(self, lead: Lead, handover: Handover) -> Handover:
        """A handover, completed by what the next head must know of this lead."""
        self._count_handover(lead.track)
        return replace(
            handover, acts_now=True, previous_head=lead.head, last_sensed=lead.last_sensed, belief_time=lead.belief_time
        )
