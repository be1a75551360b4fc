"""Appointing heads: a head announces where it predicts the target, and the nodes there are its members.

No node answers an announcement, so that nothing contends with anything, and it costs one broadcast. The policy sees
the geometry around the prediction: it says when the cluster must be renewed, by whom, and who is a member. Nodes that
are woken ahead of the target hear from the wake-up message whom to report to: they are members, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

from wsnsim.base.arrays import Reading
from wsnsim.base.network_ports import AppointingPolicy, Appointment, Outlook
from wsnsim.base.optional_ports import Announces
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Delivery, GatheredReadings, GatherReadings, Parcel
from wsnsim.network.clusters.cluster import AppointedCluster
from wsnsim.network.clusters.driver import Driver
from wsnsim.network.clusters.head_services import HeadServices
from wsnsim.network.clusters.standing_cluster import StandingClusterProtocol
from wsnsim.network.clusters.track import Handover, Track, TrackLost
from wsnsim.network.event_log import Acting

ROUNDING = 1e-9
"""Times (s) that differ by less than this are equal but for rounding."""


@dataclass(slots=True)
class AppointedLead:
    """One head's lead of a track with members that it appointed.

    Attributes:
        step: the step of the belief.
        last_sensed: time in s of the last step with a reading.
        scene: the scene of the belief.
        tentative: whether the track started from too few readings to locate the target.
        promising: whether the next step may bring enough of them.
    """

    track: Track
    cluster: AppointedCluster
    driver: Driver
    belief: Any
    step: int
    last_sensed: float
    scene: Scene
    tentative: bool = False
    promising: bool = True


class AppointingProtocol(StandingClusterProtocol):
    """A head that appoints members from its prediction; an election fills a vacancy."""

    def __init__(self, services: HeadServices) -> None:
        super().__init__(services)
        self._policy = cast(AppointingPolicy, self._setup.clusters)
        tracker = self._setup.tracker
        self._payload_of = tracker.announcement if isinstance(tracker, Announces) else (lambda belief, scene: None)

    def lead(self, track: Track, handover: Handover) -> Acting[Handover | None]:
        """Start the track or take it over, and lead it until another node is the better head."""
        if handover.readings is None:
            lead = yield from self._take_over(track, handover)
        else:
            lead = yield from self._initiate(track, handover, handover.readings)
        while True:
            yield from self._step(lead)
            following = yield from self._renew(lead)
            if following is not None:
                return following
            yield track.tick

    def _initiate(self, track: Track, handover: Handover, readings: Mapping[int, Reading]) -> Acting[AppointedLead]:
        """Start a track from its prior or from readings, and have nodes woken before the first step."""
        services, head, step = self._services, handover.successor, handover.belief_step
        prior, count = yield from self._first_estimate(track, handover, readings)
        outlook = self._network.first_outlook(track.target, head, prior)
        cluster = yield from self._appointed(track, handover, outlook, None)
        driver, scene = self._driver(track, cluster), cluster.scene(0)
        belief = yield from driver.perform(self._setup.tracker.start(prior, scene))
        driver.readings = count
        services.estimates.note_start(track, head)
        services.estimates.issue(track, step, scene, driver, belief)
        services.wake_ahead.wake(track, head, belief, scene, scene.time, cluster.must_call)
        yield track.tick
        tentative = 0 < count < self._enough(track)
        return AppointedLead(track, cluster, driver, belief, step, scene.time, scene, tentative)

    def _take_over(self, track: Track, handover: Handover) -> Acting[AppointedLead]:
        """Appoint members, in the step in which the belief arrived if there is time, and wait for the next step."""
        network, head, step = self._network, handover.successor, handover.belief_step
        scene = AppointedCluster(network, track.target, head).scene(0)
        scene = replace(scene, step=step, time=step * scene.dt)
        outlook = self._network.outlook(track.target, head, [head], handover.belief, scene)
        payload = self._payload_of(handover.belief, scene)
        cluster = yield from self._appointed(track, handover, outlook, payload)
        if network.clock.step == step:
            yield track.tick
        driver = self._driver(track, cluster)
        return AppointedLead(track, cluster, driver, handover.belief, step, handover.last_sensed, scene)

    def _appointed(
        self, track: Track, handover: Handover, outlook: Outlook, payload: Parcel | None
    ) -> Acting[AppointedCluster]:
        """A cluster that the head announces, made the track's own."""
        cluster = AppointedCluster(self._network, track.target, outlook.head)
        yield from self._announce(track, cluster, self._policy.appointment(outlook), payload)
        self._open(track, cluster, handover)
        return cluster

    def _announce(
        self, track: Track, cluster: AppointedCluster, appointment: Appointment, payload: Parcel | None
    ) -> Acting[None]:
        """Broadcast an appointment; nodes that hear it, are covered and have a link to the head are members then.

        A node whose link can be used in one direction only would report over other nodes, out of turn (our choice).
        """
        network, target, head = self._network, track.target, cluster.head
        heard = yield from self._services.messages.announce(target, head, appointment, payload)
        positions, motion = network.nodes.assumed.positions, self._setup.filter_motions[target]
        ids = self._services.messages.linked(head, heard)
        covered = [node for node, near in zip(ids, appointment.covers(positions[ids], motion), strict=True) if near]
        self._services.messages.intervals.shorten_for_next_step([head, *covered])
        cluster.appoint(self._appointed_on_map(head, appointment, target))
        self._services.messages.transport.expect(head, cluster.known)
        self._admit(track, cluster, covered)
        for node, mask in heard.items():
            if payload is not None and mask.any() and node in cluster.members:
                cluster.members[node].inbox.append(Delivery(payload.what, payload.payload, mask))

    def _appointed_on_map(self, head: int, appointment: Appointment, target: int) -> list[int]:
        """The nodes within the head's range that an appointment covers."""
        near = self._network.nodes_near(self._network.nodes.assumed.positions[head], self._network.nodes.reach)
        covered = appointment.covers(near.positions, self._setup.filter_motions[target])
        return [node for node in near.ids[covered].tolist() if node != head]

    def _admit(self, track: Track, cluster: AppointedCluster, nodes: list[int]) -> None:
        """Make nodes members. Those that follow a schedule stay awake; others sense the target whenever it is near."""
        new = cluster.admit(nodes)
        for node in new:
            self._log.add("join", track.target, node, peer=cluster.head)
        if self._network.nodes.follows_schedules:
            self._services.processes.enlist(new, track.target)

    def _admit_woken(self, lead: AppointedLead) -> None:
        """Make those nodes members that were woken for this step and have a link to the head: the message names it."""
        round_ = lead.track.round
        if round_ is not None and round_.message.step == self._network.clock.step:
            linked = self._services.messages.linked(lead.cluster.head, sorted(round_.tracking))
            self._admit(lead.track, lead.cluster, linked)

    def _step(self, lead: AppointedLead) -> Acting[None]:
        """One step at the head: readings in, an estimate out, nodes woken for the next step."""
        track, cluster, driver, services = lead.track, lead.cluster, lead.driver, self._services
        self._admit_woken(lead)
        step = self._network.clock.step
        lead.scene = cluster.scene(step - lead.step)
        if lead.tentative and lead.promising:
            yield from self._start_anew(lead)
        else:
            lead.belief = yield from driver.perform(self._setup.tracker.step(lead.belief, lead.scene))
            lead.promising = driver.readings >= self._enough(track)
        lead.step = step
        cluster.note_answers(driver.answered)
        services.estimates.issue(track, step, lead.scene, driver, lead.belief)
        services.estimates.snapshot(track, cluster, lead.belief, step)
        self._watch_readings(lead)
        services.wake_ahead.wake(track, cluster.head, lead.belief, lead.scene, lead.last_sensed, cluster.must_call)

    def _watch_readings(self, lead: AppointedLead) -> None:
        """Note that the target was sensed. Raises TrackLost if it has not been for too long."""
        if lead.driver.readings or (lead.scene.ids and self._setup.uses_silence):
            lead.last_sensed = lead.scene.time
        elif lead.scene.time - lead.last_sensed > max(self._policy.patience, self._network.clock.dt) + ROUNDING:
            raise TrackLost("no_readings")

    def _start_anew(self, lead: AppointedLead) -> Acting[None]:
        """Start the track from the readings of this step, if enough arrive. Members keep what they have in memory.

        A first estimate from one or two readings is a ring or two crossings. What it is good for is to appoint and to
        wake those nodes whose readings locate the target. That is tried in the first step, and in each step
        after one with enough readings: no member sends a reading twice.
        """
        track, cluster, driver = lead.track, lead.cluster, lead.driver
        heard: GatheredReadings = yield from driver.request(GatherReadings())
        if len(heard.ids) < self._enough(track):
            yield from self._step_alone(lead, any_heard=bool(heard.ids))
            return
        readings = dict(zip(heard.ids, heard.values.tolist(), strict=True))
        estimate = self._services.estimates.initial(track, readings)
        lead.scene = cluster.scene(0)
        lead.belief = yield from driver.perform(self._setup.tracker.start(estimate, lead.scene))
        driver.readings, lead.tentative = len(readings), False

    def _step_alone(self, lead: AppointedLead, any_heard: bool) -> Acting[None]:
        """A step of the tracker with what the head itself measured: the others have sent their readings already."""
        track, cluster, driver = lead.track, lead.cluster, lead.driver
        own = {cluster.head: cluster.members[cluster.head]}
        alone = Driver(self._services.driver, track.target, cluster.head, own)
        lead.belief = yield from alone.perform(self._setup.tracker.step(lead.belief, lead.scene))
        driver.readings, lead.promising = alone.readings, False
        if any_heard:
            lead.last_sensed = lead.scene.time

    def _enough(self, track: Track) -> int:
        """Number of readings that locate the target: one more than it has coordinates."""
        return len(self._setup.filter_motions[track.target].position) + 1

    def _renew(self, lead: AppointedLead) -> Acting[Handover | None]:
        """Appoint more members or hand over, if the expected information of the members is too small."""
        track, cluster = lead.track, lead.cluster
        outlook = self._network.outlook(track.target, cluster.head, cluster.known, lead.belief, lead.scene)
        if self._may_be_unheard(lead):
            appointment = self._policy.appointment(outlook)
            yield from self._announce(track, cluster, appointment, self._payload_of(lead.belief, lead.scene))
        if lead.tentative or not self._policy.must_appoint(outlook):
            return None
        successor = self._next_head(track, cluster, lead.belief, lead.scene)
        if successor is not None and successor != cluster.head:
            return (yield from self._unless_undelivered(self._hand_on(lead, successor)))
        appointment = self._policy.appointment(outlook)
        if not set(self._appointed_on_map(cluster.head, appointment, track.target)) <= set(cluster.known):
            yield from self._announce(track, cluster, appointment, self._payload_of(lead.belief, lead.scene))
        return None

    def _may_be_unheard(self, lead: AppointedLead) -> bool:
        """Whether no member has answered, and none is about to, where radios are mostly off: frames collide there."""
        silent = not lead.driver.collection.overdue and not lead.driver.answered - {lead.cluster.head}
        return silent and self._setup.waits.retries_handover

    def _hand_on(self, lead: AppointedLead, successor: int) -> Acting[Handover]:
        """Send the belief to the successor, which acts at once."""
        track, head = lead.track, lead.cluster.head
        self._count_handover(track)
        self._log.add("handover", track.target, head, peer=successor)
        flow = self._setup.tracker.hand_over(lead.belief, lead.scene, successor)
        handover = Handover(successor, lead.step, previous_head=head, last_sensed=lead.last_sensed)
        handover = yield from self._send_belief(lead.driver, flow, handover)
        return replace(handover, acts_now=True)
