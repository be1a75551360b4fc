"""Groups that move with their tracks, where readings name no target: they begin, merge, split and end.

A group begins with an election among neighbouring nodes that have detections which no group explains, and which are
near one of the step before, since clutter seldom is (`free_detections`). Each head broadcasts its tracks at each step:
nodes that hear them take what they explain for explained (`received_tracks`). Groups merge where confirmed tracks meet:
the head of the higher number sends its tracks to the other one. A group whose tracks have parted hands some of them to
a head nearer to them. It ends with its last track.

The gates of two tracks overlap by the share of those nodes, in range of both, at which the gates for their readings do:
from `MEET` on they meet, below `PART` they have parted (our choices). Heads go by their map of the nodes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats, planar
from wsnsim.base.requests import PACKET_BITS, Member, Parcel, Send
from wsnsim.base.scans import Scan, TrackEstimate
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.driver import Driver
from wsnsim.network.clusters.groups import NUMBERS, Arrived, GroupLead, Groups
from wsnsim.network.clusters.head_services import HeadServices
from wsnsim.network.clusters.received_tracks import BroadcastTracks, FreeDetections, ReceivedTracks
from wsnsim.network.clusters.track import GroupEnded, Handover, Track, outdone, predicted
from wsnsim.network.event_log import Acting, then
from wsnsim.network.radio.datagrams import Datagram

MEET: Final = 0.5
PART: Final = 0.25
PATIENCE: Final = 3
"""Steps in a row without a track that end a group where radios are mostly off: joins may be under way (our choice)."""


class MovingGroups(Groups):
    """The head protocol of groups that move with their tracks."""

    def __init__(self, services: HeadServices) -> None:
        super().__init__(services)
        self._received = ReceivedTracks(self._network, self._facts)
        self._inbox: defaultdict[int, list[Handover]] = defaultdict(list)
        low, high = np.array(self._space or [(0.0, np.inf)]).T
        self._free = FreeDetections(
            self._network, self._book, self._facts, self._received, high - low, self._tracker.management.rate_sd
        )

    def fill_vacancy(self, track: Track, poll: int) -> Handover | None:
        """None: a group without a head has ended."""
        return None

    def begin(self) -> None:
        """Close groups whose head has gone, and begin new ones from detections that no group explains."""
        book = self._book
        self._received.forget_old()
        book.close_groups()
        self._inbox = defaultdict(list, {group.target: self._inbox[group.target] for group in book.groups})
        for prior in self._known(self._clock.step):
            self._begin_with(prior)
        for electorate in self._free.electorates() if self._tracker.management.starts else ():
            self._services.elections.fill_vacancy(book.open_group(), electorate)

    def _begin_with(self, prior: Estimate) -> None:
        """Appoint the node nearest to a known target, with its track."""
        positions, point = self._network.nodes.assumed.positions, planar(prior.mean[list(self._facts.motion.position)])
        head = self._setup.clusters.successor(point, positions, self._network.who_can_lead())
        if head is not None:
            belief = self._first_belief(0, [prior])
            self._services.elections.appoint(self._book.open_group(), Handover(head, 0, belief, acts_now=True))

    def lead(self, track: Track, handover: Handover) -> Acting[Handover | None]:
        """Form a cluster, track in it step by step, and merge, split or hand over."""
        cluster = yield from self._form(track, handover)
        step, belief = handover.belief_step, handover.belief
        if track not in self._book.groups:
            self._book.groups.append(track)
        if belief is None:
            self._log.add("begin", track.target, cluster.head)
            step, belief = self._clock.step, self._first_belief(self._clock.step, ())
        lead, enough, idle = self._lead_of(track, cluster, belief, step), -1, 0
        if step == 0 and lead.tracks:  # they are known at this instant
            yield track.tick
        while True:
            yield from self._take_in(lead)
            yield from self._step(lead)
            self._leave_to_others(lead)
            idle = 0 if lead.tracks else idle + 1
            if idle >= (1 if self._setup.waits.joins is None else PATIENCE) and not self._inbox[track.target]:
                self._log.add("end", track.target, cluster.head)
                raise GroupEnded
            yield from self._merge(lead)
            yield from self._split(lead)
            yield from self._tell(lead)
            active = self._in_range(lead)
            small = self._setup.clusters.must_hand_over(active, lead.cluster.size)
            if enough < 0:  # a cluster that is too small from its first step on is so until fewer are in range
                enough = active if small else lead.cluster.size
            elif small and active < enough and lead.tracks and not self._inbox[track.target]:
                following = yield from self._hand_over(lead)
                if following is not None:
                    return following
            yield track.tick

    def _form(self, group: Track, handover: Handover) -> Acting[Cluster]:
        """Announce a cluster; nodes with detections that hear it join."""
        head = handover.successor
        cluster = Cluster(self._network, group.target, head, [])
        yield from self._recruit(group, cluster)
        group.open_cluster(cluster, handover, self._clock.now)
        return cluster

    def _recruit(self, group: Track, cluster: Cluster) -> Acting[None]:
        """Let nodes join: those with detections that are within sensing range of the head, where its tracks are."""
        nodes = self._network.nodes.assumed
        near_by = set(nodes.grid.within(nodes.positions[cluster.head], self._received.reach).tolist())
        joins = yield from self._services.messages.recruit(group.target, cluster.head, near_by)
        cluster.admit(joins.readings)
        for join, ended in joins.pending:
            then(ended, self._admit_late, group, cluster, join)
        self._services.processes.enlist(cluster.members, group.target)

    def _admit_late(self, group: Track, cluster: Cluster, join: Datagram) -> None:
        """Admit a node whose join arrived after the head stopped waiting, if the cluster still exists."""
        if join.arrived and group.cluster is cluster and (new := cluster.admit([join.source])):
            self._log.add("join", group.target, join.source, peer=cluster.head)
            self._services.processes.enlist(new, group.target)

    def _own_scan(self, lead: GroupLead, member: Member) -> Any:
        """The detections of a member, but those which, as far as it knows, other groups' tracks alone explain."""
        if member.id == lead.cluster.head:
            return member.reading
        scan: Any = member.reading
        left = self._mine(member.id, scan, *self._received.own_and_others(member.id, lead.group.target))
        return tuple([detection for detection, kept in zip(scan, left.tolist(), strict=True) if kept])

    def _heard(self, lead: GroupLead, arrived: Arrived, step: int) -> list[Scan]:
        """The scans of a step, without what others' tracks alone explain, as far as the head knows."""
        head, scans = lead.cluster.head, super()._heard(lead, arrived, step)
        own = [predicted(track, self._facts, lead.step, step) for track in lead.tracks]
        _, others = self._received.own_and_others(head, lead.group.target)
        return [
            replace(scan, detections=scan.detections[self._mine(scan.node, scan.detections, own, others)])
            for scan in scans
        ]

    def _mine(self, node: int, scan: Any, own: Sequence[TrackEstimate], others: Sequence[TrackEstimate]) -> Bools:
        """(M,) which detections of a node others' tracks do not explain, or own ones too."""
        return self._received.explained(node, scan, own) | ~self._received.explained(node, scan, others)

    def _tell(self, lead: GroupLead) -> Acting[None]:
        """Broadcast the tracks: of each its number, whether it is confirmed, mean and covariance."""
        tracks = tuple(lead.tracks)
        if not tracks:
            return
        size, head, group = len(tracks[0].mean), lead.cluster.head, lead.group.target
        packets = len(tracks) * -(-(2 + size + size * (size + 1) // 2) // NUMBERS)
        parcel = Parcel(None, packets, PACKET_BITS, "tracks")
        heard = yield from self._services.messages.broadcast(group, head, parcel)
        self._received.note(head, group, BroadcastTracks(lead.step, head, tracks))  # it may lead others too
        for node, mask in heard.items():
            whole = np.all(mask.reshape(len(tracks), -1), axis=1).tolist()
            received = tuple([track for track, arrived in zip(tracks, whole, strict=True) if arrived])
            if received:
                self._received.note(node, group, BroadcastTracks(lead.step, head, received))

    def _leave_to_others(self, lead: GroupLead) -> None:
        """End the tracks whose targets others track, as far as the head has heard."""
        _, others = self._received.own_and_others(lead.cluster.head, lead.group.target)
        now = [predicted(track, self._facts, lead.step, self._clock.step) for track in lead.tracks]
        self._keep(lead, {track.number for track in now if not outdone(track, others)})

    def _keep(self, lead: GroupLead, numbers: Collection[int]) -> None:
        """Keep some of the tracks; the others are duplicates."""
        for track in self._tracker.estimates(lead.belief, self._facts):
            if track.number not in numbers:
                self._log.add("delete", lead.group.target, lead.cluster.head, "duplicate", sequence=track.number)
        lead.belief = self._tracker.only(lead.belief, numbers)
        lead.tracks = self._tracker.estimates(lead.belief, self._facts)

    def _merge(self, lead: GroupLead) -> Acting[None]:
        """Send all tracks to the head of a group of a lower number whose tracks meet those of this one."""
        group, own = lead.group.target, [track for track in lead.tracks if track.confirmed]
        for number, received, tracks in self._received.by_group(lead.cluster.head):
            if number >= group or received.head == lead.cluster.head:
                continue
            theirs = [track for track in tracks if track.confirmed]
            if any(self._received.overlap(one, other) >= MEET for one in own for other in theirs):
                sent = yield from self._sent(lead, lead.belief, received.head)
                leads = [each.target for each in self._book.groups if each.head == received.head]
                if sent is not None and number in leads and not self._inbox[group]:  # else it takes in tracks first
                    self._inbox[number].append(sent)
                    self._log.add("merge", group, lead.cluster.head, peer=received.head, sequence=number)
                    raise GroupEnded

    def _take_in(self, lead: GroupLead) -> Acting[None]:
        """Join the tracks that other heads have sent, and let their members join too."""
        arrived = self._inbox.pop(lead.group.target, [])
        if not arrived:
            return
        beliefs = [lead.belief, *(each.belief for each in arrived)]
        steps = [lead.step, *(each.belief_step for each in arrived)]
        sets = [self._tracker.estimates(belief, self._facts) for belief in beliefs]
        now = max(steps)
        for tracks, since in zip(sets, steps, strict=True):
            self._note_passed(lead, tracks, since, now + 1)
        lead.belief, lead.step = self._tracker.joined(beliefs, now * self._clock.dt, self._facts), now
        lead.tracks = self._tracker.estimates(lead.belief, self._facts)
        own = {track.number: place for place, tracks in enumerate(sets) for track in tracks}
        self._keep(lead, {
            track.number for track in lead.tracks
            if not outdone(track, [each for each in lead.tracks if own[each.number] != own[track.number]])
        })  # fmt: skip
        yield from self._recruit(lead.group, lead.cluster)

    def _split(self, lead: GroupLead) -> Acting[None]:
        """Hand the tracks that have parted from those near the head to a node that is nearer to them."""
        sets = self._parted([track for track in lead.tracks if track.confirmed])
        if len(sets) < 2:
            return
        here = self._network.nodes.assumed.positions[lead.cluster.head]
        sets.sort(key=lambda tracks: float(np.hypot(*(self._middle(tracks) - here))))
        head, far = lead.cluster.head, sets[-1]
        successor = self._nearest(far)
        if successor is None or successor == head:
            return
        numbers = {track.number for track in far}
        sent = yield from self._sent(lead, self._tracker.only(lead.belief, numbers), successor)
        if sent is None:
            return
        lead.belief = self._tracker.only(lead.belief, {track.number for track in lead.tracks} - numbers)
        lead.tracks = self._tracker.estimates(lead.belief, self._facts)
        new = self._book.open_group()
        self._received.note(head, new.target, BroadcastTracks(lead.step, successor, far))
        self._log.add("split", lead.group.target, head, peer=successor, sequence=new.target)
        self._services.elections.appoint(new, sent)

    def _parted(self, tracks: Sequence[TrackEstimate]) -> list[list[TrackEstimate]]:
        """The tracks in sets between which no gates overlap by `PART` or more."""
        sets: list[list[TrackEstimate]] = []
        for track in tracks:
            near_by = [each for each in sets if any(self._received.overlap(track, one) >= PART for one in each)]
            sets = [each for each in sets if each not in near_by] + [sum(near_by, [track])]
        return sets

    def _in_range(self, lead: GroupLead) -> int:
        """The number of members in range of a track."""
        positions = self._network.nodes.assumed.positions[np.array(lead.cluster.roster(), dtype=np.int64)]
        place = list(self._facts.motion.position)
        near_by = [
            np.hypot(*(positions - planar(track.mean[place])).T) <= self._facts.sensor.reach for track in lead.tracks
        ]
        return int(np.any(near_by, axis=0).sum()) if near_by else 0

    def _hand_over(self, lead: GroupLead) -> Acting[Handover | None]:
        """Send the belief to the node nearest to the tracks, which leads from the next step on; it may be the head."""
        head, group = lead.cluster.head, lead.group
        successor = self._nearest(lead.tracks)
        if successor is None:
            return None
        if successor == head:
            return Handover(head, lead.step, lead.belief, previous_head=head)
        self._log.add("handover", group.target, head, peer=successor)
        group.handovers += 1
        return (yield from self._sent(lead, lead.belief, successor))

    def _sent(self, lead: GroupLead, belief: Any, to: int) -> Acting[Handover | None]:
        """Send a belief to a node; what it starts from, None if a packet is lost or the node is down."""
        driver = Driver(self._services.driver, lead.group.target, lead.cluster.head, lead.cluster.members)
        packets = -(-self._tracker.numbers_of(belief) // NUMBERS)
        mask = yield from driver.request(Send(to, Parcel(belief, packets, PACKET_BITS, "belief")))
        if not mask.all() or not self._network.nodes.alive[to]:
            return None
        hops, bits = driver.hops, driver.collection.bits
        return Handover(to, lead.step, belief, previous_head=lead.cluster.head, hops=hops, bits=bits)

    def _middle(self, tracks: Iterable[TrackEstimate]) -> Floats:
        """(2,) the mean of the positions that tracks will have at the next step."""
        motion, dt = self._facts.motion, self._clock.dt
        states = np.array([track.mean for track in tracks]).T
        middle: Floats = planar(motion.advance(states, dt, self._clock.now)[list(motion.position)].T).mean(axis=0)
        return middle

    def _nearest(self, tracks: Iterable[TrackEstimate]) -> int | None:
        """The able node nearest to where tracks will be; None if none is able."""
        positions = self._network.nodes.assumed.positions
        return self._setup.clusters.successor(self._middle(tracks), positions, self._network.who_can_lead())
