"""Groups, where readings name no target: one head, one cluster, and the tracks whose gates overlap.

A head gathers the scans of its members, in which a detection takes a packet, and has its tracker associate them with
tracks, begin new ones, confirm and delete them. `CentralGroup` leads one group for the field.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np

from wsnsim.base.arrays import Estimate, components_of, planar
from wsnsim.base.detections import MultiTracker, ReportsScans, space_of, volume_of
from wsnsim.base.medium_access import hop_latency
from wsnsim.base.ports import KnownNodes
from wsnsim.base.radio import Mode
from wsnsim.base.requests import PACKET_BITS, Compute, Gather, Member, Parcel
from wsnsim.base.rows import Issued
from wsnsim.base.scans import Facts, Scan, TrackEstimate
from wsnsim.network.clusters.cluster import Cluster, OpenCluster
from wsnsim.network.clusters.driver import Driver
from wsnsim.network.clusters.head_services import HeadProtocol, HeadServices
from wsnsim.network.clusters.track import Handover, Track, TrackRow, predicted
from wsnsim.network.event_log import Acting

NUMBERS: Final = 4
"""Numbers in a packet."""
HOPS: Final = 3.0
"""Hops that each scan may take where radios are mostly off, retries counted, before a head goes on (our choice)."""
MEMORY: Final = 0.8
"""What scans of the step before count for, where those of a step count for 1: of how many arrived (our choice)."""
Arrived = Mapping[int, tuple[Any, Any]]


@dataclass(slots=True)
class GroupLead:
    """One head's lead of a group.

    Attributes:
        step: that of the belief.
        tracks: what the head holds since then.
        sent: how many scans others sent lately, and `came`: how many of them arrived. Heads go by sequence numbers,
            and know it at once (an idealisation).
    """

    group: Track
    cluster: Cluster
    driver: Driver
    belief: Any
    step: int
    tracks: Sequence[TrackEstimate] = ()
    sent: float = 0.0
    came: float = 0.0

    def note(self, sent: int, came: int) -> None:
        """Note how many scans of a step were sent, and arrived."""
        self.sent, self.came = MEMORY * self.sent + sent, MEMORY * self.came + came

    def heard(self, clutter: float) -> float:
        """`Scan.heard` of a node from which nothing came: its scan may have been lost, with false detections too."""
        share = self.came / self.sent if self.sent else 1.0
        silent = share * math.exp(-clutter)
        return silent / (1.0 - share + silent) if share else 0.0


class Groups(HeadProtocol):
    """What heads of groups do at each step, however groups begin and end."""

    one_hop = True
    """Whether members are one hop away from their head."""

    def __init__(self, services: HeadServices) -> None:
        assert services.book is not None, "readings that name no target have a book of tracks"
        super().__init__(services)
        self._book, setup = services.book, self._setup
        self._tracker = cast(MultiTracker, setup.tracker)
        detection = setup.detection
        assert isinstance(detection, ReportsScans), "groups are for scans"
        self._space = space_of(setup.sensor, detection.window)
        self._facts = Facts(
            setup.filter_motion(0), setup.filter_sensor, setup.dt, detection.probability, detection.clutter,
            volume_of(setup.sensor, detection.window),
        )  # fmt: skip
        self._surely_scan = setup.sleep.rest is not Mode.SCHEDULED

    def _known(self, step: int) -> Sequence[Estimate]:
        """The priors of targets that are known at a step."""
        return self._book.priors if step == 0 and self._tracker.management.known_start else ()

    def _first_belief(self, step: int, priors: Sequence[Estimate]) -> Any:
        """A belief with a track for each prior."""
        belief = self._tracker.begin(priors, step * self._clock.dt, self._facts, self._book.next)
        self._book.next += len(priors)
        return belief

    def _lead_of(self, group: Track, cluster: Cluster, belief: Any, step: int) -> GroupLead:
        driver = Driver(self._services.driver, group.target, cluster.head, cluster.members, one_hop=self.one_hop)
        return GroupLead(group, cluster, driver, belief, step, self._tracker.estimates(belief, self._facts))

    def _step(self, lead: GroupLead) -> Acting[None]:
        """One step at the head: scans in, tracks out."""
        scene, step = lead.cluster.scene(self._clock.step - lead.step), self._clock.step
        parcels = {member.id: self._scan_parcel(lead, member) for member in lead.cluster.members.values()}
        sending = [node for node, parcel in parcels.items() if parcel is not None and node != lead.cluster.head]
        gather = Gather(lambda member: parcels[member.id], deadline=self._deadline(len(sending)))
        arrived: Arrived = yield from lead.driver.request(gather)
        lead.note(len(sending), len(arrived.keys() & set(sending)))
        scans = self._heard(lead, arrived, step)
        nodes = self._network.nodes
        ids = np.array([scan.node for scan in scans], dtype=np.int64)
        known = KnownNodes(tuple(ids.tolist()), nodes.assumed.positions[ids], nodes.traits[ids])
        time, readings = step * self._clock.dt, lead.driver.readings
        self._note_passed(lead, lead.tracks, lead.step, step)
        outcome = self._tracker.step(lead.belief, time, scans, known, self._facts, self._book.next)
        self._book.note(lead.group.target, lead.cluster.head, outcome)
        lead.belief, lead.step, lead.tracks = outcome.belief, step, self._tracker.estimates(outcome.belief, self._facts)
        yield from lead.driver.request(Compute(outcome.cycles))
        self._issue(lead, step, readings, len(scene.ids), len(scene.roster))

    def _note_passed(self, lead: GroupLead, tracks: Sequence[TrackEstimate], since: int, until: int) -> None:
        """Record tracks of a step, predicted for the steps that passed before another one began."""
        for between in range(since + 1, until):
            self._note(lead, [predicted(track, self._facts, since, between) for track in tracks], between)

    def _deadline(self, senders: int) -> float | None:
        """For how many seconds a head waits for scans at most, where radios are mostly off: they share the air."""
        wait, hop = self._setup.waits.gather, hop_latency(self._setup.mac, PACKET_BITS).unicast
        return None if wait is None else max(wait, HOPS * senders * hop)

    def _issue(self, lead: GroupLead, step: int, readings: int, active: int, members: int) -> None:
        """Record what the head holds of each track, and report it to the sink."""
        head, group = lead.cluster.head, lead.group.target
        if step == 0 or not lead.tracks:
            return
        self._log.add("estimate", group, head)
        self._note(lead, lead.tracks, step, readings, active, members)
        self._services.estimates.report(head, step, group, sum(track.confirmed for track in lead.tracks))

    def _note(
        self, lead: GroupLead, tracks: Iterable[TrackEstimate], step: int, readings: int = 0, active: int = 0,
        members: int = 0,
    ) -> None:  # fmt: skip
        """Record tracks of a step. Without readings they are predictions."""
        for track in tracks:
            estimate = Estimate(track.mean, track.cov)
            issued = Issued(step, self._clock.now, estimate, lead.cluster.head, active, members, readings)
            self._book.rows.append(TrackRow(track, issued, lead.group.target))

    def _heard(self, lead: GroupLead, arrived: Arrived, step: int) -> list[Scan]:
        """The scans of a step, by node: those that arrived, and empty ones of nodes that surely found nothing."""
        time, size = step * self._clock.dt, len(components_of(self._facts.sensor))
        found = {}
        for node, (scan, mask) in arrived.items():
            rows = [detection for detection, here in zip(scan, mask.tolist(), strict=True) if here]
            detections = np.array(rows, dtype=np.float64).reshape(len(rows), size)
            found[node] = Scan(node, time, detections, len(scan) * PACKET_BITS, len(rows) / len(scan))
        heard = lead.heard(self._facts.clutter)
        for node in self._silent(lead, step):
            found.setdefault(node, Scan(node, time, np.empty((0, size)), heard=heard))
        return [found[node] for node in sorted(found)]

    def _scan_parcel(self, lead: GroupLead, member: Member) -> Parcel | None:
        """A packet for each detection of a member."""
        scan = self._own_scan(lead, member) if member.reading is not None else None
        return Parcel(scan, len(scan), PACKET_BITS, "scan", readings=len(scan)) if scan else None

    def _own_scan(self, lead: GroupLead, member: Member) -> Any:
        """The detections that a member sends."""
        return member.reading

    def _silent(self, lead: GroupLead, step: int) -> Iterable[int]:
        """The nodes within range of where the head expects a track: if they send nothing, they found nothing.

        Over a sleep schedule the head does not know who was awake.
        """
        if not self._surely_scan or not lead.tracks:
            return []
        nodes, motion = self._network.nodes, self._facts.motion
        states = np.array([track.mean for track in lead.tracks]).T
        for ahead in range(lead.step, step):
            states = motion.advance(states, self._clock.dt, ahead * self._clock.dt)
        points = planar(states[list(motion.position)].T)
        candidates = np.array(self._scanning(lead.cluster), dtype=np.int64)
        apart = ((nodes.assumed.positions[candidates][:, None] - points) ** 2).sum(axis=2)
        near: list[int] = candidates[(apart <= self._facts.sensor.reach**2).any(axis=1)].tolist()
        return near

    def _scanning(self, cluster: Cluster) -> Sequence[int]:
        """The nodes that send their scans to this head if they find something."""
        return cluster.roster()


class CentralGroup(Groups):
    """One group for the field; its head is the node that the policy names, and every node may send it its scan."""

    one_hop = False

    def fill_vacancy(self, track: Track, poll: int) -> Handover | None:
        """Appoint the head that the policy names."""
        network, step = self._network, self._clock.step
        head = self._setup.clusters.successor(np.zeros(2), network.nodes.assumed.positions, network.who_can_lead())
        return None if head is None else Handover(head, step, readings={}, elected=True, acts_now=True)

    def lead(self, track: Track, handover: Handover) -> Acting[Handover | None]:
        """Lead the group until the end. What a head knew that went down is lost."""
        cluster, step = OpenCluster(self._network, track.target, handover.successor, []), handover.belief_step
        track.open_cluster(cluster, handover, self._clock.now)
        lead = self._lead_of(track, cluster, self._first_belief(step, self._known(step)), step)
        if lead.tracks:  # they are known at this instant
            yield track.tick
        while True:
            yield from self._step(lead)
            yield track.tick

    def release(self, track: Track, cluster: Cluster) -> None:
        """Do nothing: members have no role."""

    def begin(self) -> None:
        """Open the one group at the start."""
        if not self._book.groups:
            self._book.open_group()

    def _scanning(self, cluster: Cluster) -> Sequence[int]:
        return list(np.flatnonzero(self._network.nodes.living))
