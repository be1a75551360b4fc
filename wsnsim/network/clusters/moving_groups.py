"""Groups that move with their tracks, where readings name no target: they begin, merge, split and end.

A group begins with an election among neighbouring nodes that have detections which no group explains, and which are
near one of the step before, since clutter seldom is. Each head
broadcasts its tracks at each step: who hears them takes what they explain for explained. Groups merge where confirmed
tracks meet: the head of the higher number sends its tracks to the other one. A group whose tracks have parted hands
some of them to a head nearer to them. It ends with its last track.

The gates of two tracks overlap by the share of those nodes, in range of both, at which the gates for their readings do:
from `MEET` on they meet, below `PART` they have parted (our choices). Heads go by their map of the nodes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats, components_of, near, planar
from wsnsim.base.ports import KnownNodes
from wsnsim.base.requests import PACKET_BITS, Member, Parcel
from wsnsim.base.scans import Scan, TrackEstimate
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.driver import Driver
from wsnsim.network.clusters.election import strength_of
from wsnsim.network.clusters.groups import NUMBERS, Arrived, GroupLead, Groups, belief_sent
from wsnsim.network.clusters.head_services import HeadServices
from wsnsim.network.clusters.track import GroupEnded, Handover, Track
from wsnsim.network.clusters.track_book import outdone
from wsnsim.network.event_log import Acting, then
from wsnsim.network.radio.datagrams import Datagram

MEET: Final = 0.5
PART: Final = 0.25
GATE: Final = 4.0
"""Standard deviations of a reading about its expected value within which it is explained."""
FAR: Final = 1e9
"""A sensing range (m) that is as good as unlimited."""
FRESH: Final = 4
"""Number of steps for which a node uses the tracks that a cluster head has broadcast."""
LEAST_NODES: Final = 2
"""Neighbouring nodes with unexplained detections, from which on a group begins."""
SWIFT: Final = 3.0
"""Deviations of the speed of targets that may begin, which they reach at most (our choice)."""
STILL: Final = 0.1
"""Least share of the space of readings that a detection may move from one step to the next (our choice)."""
PATIENCE: Final = 3
"""Steps in a row without a track that end a group where radios are mostly off: joins may be under way (our choice)."""


class BroadcastTracks(NamedTuple):
    """The tracks that a cluster head broadcast at a step."""

    step: int
    head: int
    tracks: Sequence[TrackEstimate]


class MovingGroups(Groups):
    """The head protocol of groups that move with their tracks."""

    def __init__(self, services: HeadServices) -> None:
        super().__init__(services)
        self._received: dict[int, dict[int, BroadcastTracks]] = {}
        self._inbox: dict[int, list[Any]] = {}
        self._before: Mapping[int, Any] = {}
        low, high = np.array(self._space or [(0.0, np.inf)]).T
        share = SWIFT * self._tracker.management.rate_sd * self._clock.dt / self._facts.sensor.reach
        self._step_at_most = (high - low) * min(max(share, STILL), 1.0)

    def fill_vacancy(self, track: Track, poll: int) -> Handover | None:
        """None: a group without a head has ended."""
        return None

    def release(self, track: Track, cluster: Cluster) -> None:
        """Dismiss the members."""
        self._services.processes.dismiss(cluster.roster(), track.target)

    def begin(self) -> None:
        """Close groups whose head has gone, and begin new ones from detections that no group explains."""
        book, step = self._book, self._clock.step
        self._forget_old()
        book.close_groups()
        self._inbox = {group.target: self._inbox.get(group.target, []) for group in book.groups}
        for prior in self._known(step):
            self._begin_with(prior)
        free = self._unexplained() if self._tracker.management.starts else {}
        sensor, positions = self._setup.sensor, self._network.nodes.assumed.positions
        while free:
            first = max(free, key=lambda node: (strength_of(sensor, free[node]), -node))
            beside = np.hypot(*(positions[list(free)] - positions[first]).T) <= self._network.nodes.reach
            electorate = {node: free[node] for node, near in zip(list(free), beside.tolist(), strict=True) if near}
            free = {node: reading for node, reading in free.items() if node not in electorate}
            if len(electorate) >= LEAST_NODES:
                self._services.elections.fill_vacancy(book.open_group(), electorate)

    def _forget_old(self) -> None:
        """Forget the tracks that nodes received too long ago."""
        since = self._clock.step - FRESH
        kept = {
            node: {group: each for group, each in received.items() if each.step >= since}
            for node, received in self._received.items()
        }
        self._received = {node: received for node, received in kept.items() if received}

    def _begin_with(self, prior: Estimate) -> None:
        """Appoint the node nearest to a known target, with its track."""
        positions, point = self._network.nodes.assumed.positions, planar(prior.mean[list(self._facts.motion.position)])
        head = self._setup.clusters.successor(point, positions, self._network.who_can_lead())
        if head is not None:
            belief = self._first_belief(0, [prior])
            self._services.elections.appoint(self._book.open_group(), Handover(head, 0, belief, acts_now=True))

    def _unexplained(self) -> dict[int, Any]:
        """{node: strongest detection} of the nodes in no group, without what tracks explain that they heard of."""
        network, taken = self._network, set[int]()
        for group in self._book.groups:
            taken.update(group.cluster.members if group.cluster else [])
            taken.update(group.election.readings if group.election else [])
            if group.head is not None and group.cluster is None:  # it is about to form its cluster
                head = network.nodes.assumed.positions[group.head]
                taken.update(network.nodes.assumed.grid.within(head, network.nodes.reach).tolist())
        scans: Mapping[int, Any] = network.readings[0]
        free = {node: scan for node, scan in scans.items() if node not in taken and network.can_lead(node)}
        found = {}
        for node, scan in free.items():
            tracks = self._tracks_received(node)
            known = self._explained(node, scan, tracks) | ~self._lasting(scan, self._before.get(node, ()))
            left = [z for z, no in zip(scan, known.tolist(), strict=True) if not no]
            if left:
                found[node] = max(left, key=lambda reading: strength_of(self._setup.sensor, reading))
        self._before = scans
        return found

    def _lasting(self, scan: Any, before: Any) -> Bools:
        """(M,) which detections of a node are near one of its scan before; all, if none are false."""
        sensor, size = self._facts.sensor, len(components_of(self._facts.sensor))
        new, old = (np.array(each, dtype=np.float64).reshape(-1, size) for each in (scan, before))
        if not self._facts.clutter:
            return np.ones(len(new), dtype=np.bool_)
        steps = [np.abs(near(sensor, old.reshape(-1), np.tile(z, len(old))).reshape(-1, size) - z) for z in new]
        return np.array([bool((step <= self._step_at_most).all(axis=1).any()) for step in steps])

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
            if idle >= (1 if self._setup.waits.joins is None else PATIENCE):
                self._log.add("end", track.target, cluster.head)
                raise GroupEnded
            yield from self._merge(lead)
            yield from self._split(lead)
            yield from self._tell(lead)
            active = self._in_range(lead)
            small = self._setup.clusters.must_hand_over(active, lead.cluster.size)
            if enough < 0:  # a cluster that is too small from its first step on is so until fewer are in range
                enough = active if small else lead.cluster.size
            elif small and active < enough and lead.tracks:
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
        reach = min(self._facts.sensor.reach, FAR)
        near_by = set(nodes.grid.within(nodes.positions[cluster.head], reach).tolist())
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
        own = self._tracks_received(member.id, only=lead.group.target)
        left = self._mine(member.id, member.reading, own, self._tracks_received(member.id, but=lead.group.target))
        return tuple([detection for detection, kept in zip(member.reading, left.tolist(), strict=True) if kept])

    def _heard(self, lead: GroupLead, arrived: Arrived, step: int) -> list[Scan]:
        """The scans of a step, without what others' tracks alone explain, as far as the head knows."""
        head, scans = lead.cluster.head, super()._heard(lead, arrived, step)
        own = [self._predicted(track, lead.step, step) for track in lead.tracks]
        others = self._tracks_received(head, but=lead.group.target)
        return [
            replace(scan, detections=scan.detections[self._mine(scan.node, scan.detections, own, others)])
            for scan in scans
        ]

    def _mine(self, node: int, scan: Any, own: Sequence[TrackEstimate], others: Sequence[TrackEstimate]) -> Bools:
        """(M,) which detections of a node others' tracks do not explain, or own ones too."""
        return self._explained(node, scan, own) | ~self._explained(node, scan, others)

    def _tracks_received(self, node: int, but: int = -1, only: int = -1) -> list[TrackEstimate]:
        """The tracks that a node has heard of, predicted for this step: of all groups `but` one, or of one `only`."""
        received = {number: each for number, each in self._received.get(node, {}).items() if number != but}
        fresh = [received[only]] if only in received else received.values() if only < 0 else []
        fresh = [each for each in fresh if self._clock.step - each.step <= FRESH]
        return [self._predicted(track, each.step, self._clock.step) for each in fresh for track in each.tracks]

    def _explained(self, node: int, scan: Any, tracks: Sequence[TrackEstimate]) -> Bools:
        """(M,) which detections of a node lie in the gate of one of the tracks."""
        size = len(components_of(self._facts.sensor))
        detections, known = np.array(scan, dtype=np.float64).reshape(-1, size), np.zeros(len(scan), dtype=np.bool_)
        for track in tracks:
            expected, spread = self._expected(track, [node])
            apart = near(self._facts.sensor, detections.reshape(-1), np.tile(expected[0], len(detections)))
            known |= (np.abs(apart.reshape(-1, size) - expected[0]) <= GATE * spread[0]).all(axis=1)
        return known

    def _expected(self, track: TrackEstimate, ids: Sequence[int]) -> tuple[Floats, Floats]:
        """(n, d) the expected readings of a track at nodes, and their standard deviations."""
        nodes, place, index = self._network.nodes, list(self._facts.motion.position), np.array(ids, dtype=np.int64)
        law = self._facts.sensor.linearise(
            track.mean[place][:, None], nodes.assumed.positions[index], nodes.traits[index]
        )
        expected, gradients, variances = (array[..., 0] for array in law)
        spread = np.einsum("ki,ij,kj->k", gradients, track.cov[np.ix_(place, place)], gradients) + variances
        size = len(components_of(self._facts.sensor))
        return expected.reshape(-1, size), np.sqrt(spread).reshape(-1, size)

    def _overlap(self, one: TrackEstimate, other: TrackEstimate) -> float:
        """The share of the nodes on the map, in range of two tracks, whose gates for them overlap; 0 without any."""
        place, nodes = list(self._facts.motion.position), self._network.nodes.assumed
        reach = min(self._facts.sensor.reach, FAR)
        beside, others = (nodes.grid.within(planar(track.mean[place]), reach) for track in (one, other))
        ids: list[int] = np.intersect1d(beside, others).tolist()
        if not ids:
            return 0.0
        (a, sa), (b, sb) = self._expected(one, ids), self._expected(other, ids)
        apart = near(self._facts.sensor, b.reshape(-1), a.reshape(-1)).reshape(a.shape) - a
        return float((np.abs(apart) <= GATE * (sa + sb)).all(axis=1).mean())

    def _tell(self, lead: GroupLead) -> Acting[None]:
        """Broadcast the tracks, mean and covariance of each."""
        tracks = tuple(lead.tracks)
        if not tracks:
            return
        size, head, group = len(tracks[0].mean), lead.cluster.head, lead.group.target
        packets = len(tracks) * -(-(size + size * (size + 1) // 2) // NUMBERS)
        parcel = Parcel(None, packets, PACKET_BITS, "tracks")
        heard = yield from self._services.messages.broadcast(group, head, parcel)
        self._received.setdefault(head, {})[group] = BroadcastTracks(lead.step, head, tracks)  # it may lead others too
        for node, mask in heard.items():
            whole = mask.reshape(len(tracks), -1).all(axis=1).tolist()
            received = tuple([track for track, arrived in zip(tracks, whole, strict=True) if arrived])
            if received:
                self._received.setdefault(node, {})[group] = BroadcastTracks(lead.step, head, received)

    def _leave_to_others(self, lead: GroupLead) -> None:
        """End the tracks whose targets others track, as far as the head has heard."""
        others = self._tracks_received(lead.cluster.head, but=lead.group.target)
        now = [self._predicted(track, lead.step, self._clock.step) for track in lead.tracks]
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
        for number, received in sorted(self._received.get(lead.cluster.head, {}).items()):
            if number >= group or self._clock.step - received.step > FRESH or received.head == lead.cluster.head:
                continue
            theirs = [
                self._predicted(track, received.step, self._clock.step) for track in received.tracks if track.confirmed
            ]
            if any(self._overlap(one, other) >= MEET for one in own for other in theirs):
                sent = yield from self._sent(lead, lead.belief, received.head)
                leads = [each.target for each in self._book.groups if each.head == received.head]
                if sent is not None and number in leads:
                    self._inbox.setdefault(number, []).append(sent[0])
                    self._log.add("merge", group, lead.cluster.head, peer=received.head, sequence=number)
                    raise GroupEnded

    def _take_in(self, lead: GroupLead) -> Acting[None]:
        """Join the tracks that other heads have sent, and let their members join too."""
        arrived = self._inbox.pop(lead.group.target, [])
        if not arrived:
            return
        time, step = self._clock.step * self._clock.dt, self._clock.step
        nobody = KnownNodes((), np.empty((0, 2)), self._network.nodes.traits[:0])
        each = [
            self._tracker.step(belief, time, (), nobody, self._facts, self._book.next).belief
            for belief in [lead.belief, *arrived]
        ]
        lead.belief, lead.step = self._tracker.joined(each), step
        sets = [self._tracker.estimates(belief, self._facts) for belief in each]
        self._keep(lead, {
            track.number
            for i, own in enumerate(sets) for track in own
            if not outdone(track, [other for j, others in enumerate(sets) if j != i for other in others])
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
        if sent is None or not self._network.nodes.alive[successor]:
            return
        belief, driver = sent
        lead.belief = self._tracker.only(lead.belief, {track.number for track in lead.tracks} - numbers)
        lead.tracks = self._tracker.estimates(lead.belief, self._facts)
        new = self._book.open_group()
        self._received.setdefault(head, {})[new.target] = BroadcastTracks(lead.step, successor, far)
        self._log.add("split", lead.group.target, head, peer=successor, sequence=new.target)
        handover = Handover(
            successor, lead.step, belief, previous_head=head, hops=driver.hops, bits=driver.collection.bits
        )
        self._services.elections.appoint(new, handover)

    def _parted(self, tracks: Sequence[TrackEstimate]) -> list[list[TrackEstimate]]:
        """The tracks in sets between which no gates overlap by `PART` or more."""
        sets: list[list[TrackEstimate]] = []
        for track in tracks:
            near_by = [each for each in sets if any(self._overlap(track, one) >= PART for one in each)]
            sets = [each for each in sets if each not in near_by] + [
                [track, *(one for each in near_by for one in each)]
            ]
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
        sent = yield from self._sent(lead, lead.belief, successor)
        if sent is None or not self._network.nodes.alive[successor]:
            return None
        belief, driver = sent
        return Handover(
            successor, lead.step, belief, previous_head=head, hops=driver.hops, bits=driver.collection.bits
        )  # fmt: skip

    def _sent(self, lead: GroupLead, belief: Any, to: int) -> Acting[tuple[Any, Driver] | None]:
        """Send a belief to a node; what arrived, and the driver that sent it. None: it did not arrive."""
        driver = Driver(self._services.driver, lead.group.target, lead.cluster.head, lead.cluster.members)
        arrived = yield from driver.perform(belief_sent(belief, self._tracker.numbers_of(belief), to))
        return None if arrived is None else (arrived, driver)

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
