"""A network without a head: every node that senses the target, or is near its own prediction, runs the filter.

A step: nodes that begin to sense ask for a belief and get one; all participants perform the tracker's flow; the
estimate of one of them, the gateway, is recorded and reported; who is no longer near leaves, and who is near is
invited. Nothing here outlives the participants, and nothing ends with one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final, cast

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats, is_finite, planar
from wsnsim.base.errors import RunError, WsnsimError
from wsnsim.base.network_ports import HeadlessPolicy
from wsnsim.base.ports import HeadlessTracker, Scene
from wsnsim.base.requests import NOBODY, PACKET_BITS, Delivery, Exchange, Member, Parcel
from wsnsim.network.clusters.cluster import CALLS, Cluster
from wsnsim.network.clusters.driver import Driver, DriverServices
from wsnsim.network.clusters.head_services import HeadProtocol, HeadServices
from wsnsim.network.clusters.track import Handover, Track
from wsnsim.network.event_log import Acting

READING: Final = "reading"
ANNOUNCED: Final = "belief"


class Peers(Cluster):
    """The participants. `head` is the gateway: the one whose estimate was recorded last."""

    @property
    def size(self) -> int:
        """The number of participants."""
        return len(self.members)

    def living(self) -> list[Member]:
        """The living participants."""
        return [self.members[node] for node in self.roster()]


@dataclass(slots=True)
class Participation:
    """The participants of a track from its initiation until none is left.

    Attributes:
        step: the step of their beliefs.
        calls: how often a participant has invited a node that did not join: {(participant, node): times}.
    """

    track: Track
    peers: Peers
    driver: PeerDriver
    step: int
    calls: dict[tuple[int, int], int] = field(default_factory=dict)


class PeerDriver(Driver):
    """Performs flows of a network without a head: each participant computes, and broadcasts to its neighbours.

    A round ends when the last broadcast of it has, and all participants know that (our choice). A flow goes on
    whichever participants die.

    Args:
        services: what it uses.
        target: the target of the track.
        members: every participant by id, with its memory.
    """

    def __init__(self, services: DriverServices, target: int, members: dict[int, Member]) -> None:
        super().__init__(services, target, NOBODY, members)

    def _addressed(self, who: Sequence[int] | None) -> list[Member]:
        """The living participants of those that a request addresses; None: all."""
        return super()._addressed(list(self._members) if who is None else who)

    def _exchange(self, request: Exchange) -> Acting[dict[int, dict[int, Bools]]]:
        members, alive = self._members, self._alive
        parcels = {member.id: request.parcel_of(member) for member in self._addressed(request.who)}
        sent = {node: parcel for node, parcel in parcels.items() if parcel is not None}
        heard: dict[int, dict[int, Bools]] = {}
        if not sent:
            return heard
        ended, bursts = self._services.transport.broadcast(list(sent), list(sent.values()), self._target)
        yield ended
        for burst in bursts:
            parcel = burst.parcel
            for node, mask in burst.received.items():
                if node in members and alive[node]:
                    members[node].inbox.append(Delivery(parcel.what, parcel.payload, mask, burst.source))
                    heard.setdefault(node, {})[burst.source] = mask
        self._services.intervals.shorten_for_next_step({**parcels, **heard})
        return heard

    PERFORMERS: ClassVar[Mapping[type, Callable[[Any, Any], Acting[Any]]]] = {Exchange: _exchange}
    REQUESTS: ClassVar[str] = "without a head, use Local and Exchange"


class PeerProtocol(HeadProtocol):
    """Runs the filter on all participants of a track, in a process that belongs to no node."""

    def __init__(self, services: HeadServices) -> None:
        super().__init__(services)
        self._tracker = cast(HeadlessTracker, self._setup.tracker)
        self._policy = cast(HeadlessPolicy, self._setup.clusters)
        self._radius = self._setup.link.reach if self._policy.radius is None else self._policy.radius
        points = self._setup.sink_points if self._policy.gateway == "sink" else ()
        self._sink = np.array(points[0]) if points else None
        self._begun: set[int] = set()

    def fill_vacancy(self, track: Track, poll: int) -> Handover | None:
        """Begin to follow a target at its first step; nobody is named."""
        if track.target not in self._begun:
            self._begun.add(track.target)
            self._clock.env.process(self._follow(track))
        return None

    def lead(self, track: Track, handover: Handover) -> Acting[Handover | None]:
        """Refuse: nobody is ever appointed."""
        raise RunError("there is no head that could lead")

    def _follow(self, track: Track) -> Acting[None]:
        """Take the steps of a track until the end of the run."""
        part: Participation | None = None
        try:
            while True:
                if part is None:
                    part = yield from self._initiate(track)
                else:
                    yield from self._step(part)
                if part is not None and not part.peers.roster():
                    self._lose(track)
                    part = None
                yield track.tick
        except WsnsimError:
            raise
        except Exception as reason:  # SimPy rebuilds exceptions from their arguments, which not every class allows
            raise RunError(f"{type(reason).__name__}: {reason}") from reason

    def _lose(self, track: Track) -> None:
        """Log that no node holds a belief any more, and end the participation."""
        assert track.cluster is not None, "participants are the cluster of their track"
        self._log.add("lost", track.target, -1, "no_participants")
        track.clusters[-1].released = self._clock.now
        self.release(track, track.cluster)
        track.cluster = None

    def _initiate(self, track: Track) -> Acting[Participation | None]:
        """Have all nodes that sense begin: from the prior at the start, later from the readings that each has heard."""
        network, target, step = self._network, track.target, self._clock.step
        sensing = [node for node in network.readings[target] if network.nodes.alive[node]]
        if not sensing:
            return None
        peers = Peers(network, target, sensing[0], sensing[1:])
        part = Participation(track, peers, PeerDriver(self._services.driver, target, peers.members), step)
        peers.scene(0)
        self._services.processes.enlist(sensing, target)
        track.open_cluster(peers, Handover(sensing[0], step), self._clock.now)
        if step == 0 and track.known_at_start and not track.started:
            for member in peers.living():
                self._tracker.begin(member, track.prior)
        else:
            yield from part.driver.request(Exchange(_reading_of))
            for member in peers.living():
                self._begin_from_readings(track, member)
        self._drop_idle(part)
        if peers.roster():
            self._services.estimates.note_start(track, peers.head)
            self._record(part, peers.scene(0), step, len(sensing))
        return part

    def _begin_from_readings(self, track: Track, member: Member) -> None:
        """Begin at a node from its own reading and those that it has heard."""
        heard = {each.source: each.payload for each in member.take_inbox() if each.what == READING}
        known = {node: value for node, value in (heard | {member.id: member.reading}).items() if value is not None}
        if finite := {node: value for node, value in known.items() if is_finite(value)}:
            self._tracker.begin(member, self._services.estimates.initial(track, finite))

    def _step(self, part: Participation) -> Acting[None]:
        """One step of all participants."""
        clock, peers, track = self._clock, part.peers, part.track
        yield from self._welcome(part)
        if not peers.roster():
            return
        scene, step = peers.scene(clock.step - part.step), clock.step
        yield from part.driver.perform(self._tracker.step(_known_to_all(scene)))
        part.step, readings = step, part.driver.readings
        for member in peers.living():
            member.take_inbox()
        if not peers.roster():
            return
        self._record(part, scene, step, readings)
        inviter = self._nearest_to_prediction(part, scene)
        self._services.wake_ahead.wake(track, inviter.id, self._tracker.belief_of(inviter), scene, scene.time)
        yield from self._invite(part, scene, inviter)
        self._drop(part, [member.id for member in peers.living() if not self._stays(part, scene, member)])
        track.clusters[-1].members = max(track.clusters[-1].members, peers.size)

    def _record(self, part: Participation, scene: Scene, step: int, readings: int) -> None:
        """Record the estimate of the gateway and what the others think, and report the former."""
        peers, track, place = part.peers, part.track, list(scene.motion.position)
        members = peers.living()
        points = np.array([self._estimate(member).mean[place] for member in members])
        aim = planar(points) if self._sink is None else self._sink
        places = np.array([member.position for member in members])
        gateway = members[int(((places - aim) ** 2).sum(axis=1).argmin())]
        peers.head, part.driver.readings = gateway.id, readings
        belief, full = self._tracker.belief_of(gateway), replace(scene, head=gateway.id)
        self._services.estimates.issue(track, step, full, part.driver, belief)
        self._services.estimates.snapshot(track, peers, belief, step)
        if step:
            spread = float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))
            track.estimates[step].peers = points.mean(axis=0), spread

    def _estimate(self, member: Member) -> Estimate:
        return self._tracker.estimate(self._tracker.belief_of(member))

    def _predicted(self, part: Participation, scene: Scene, member: Member) -> Floats:
        """(2,) where a participant expects the target at the next step."""
        return self._network.predicted_position(part.track.target, self._tracker.belief_of(member), scene)

    def _nearest_to_prediction(self, part: Participation, scene: Scene) -> Member:
        """The participant that is nearest to where it expects the target itself; of equally near ones the first."""
        return min(
            part.peers.living(),
            key=lambda member: float(((self._predicted(part, scene, member) - member.position) ** 2).sum()),
        )

    def _stays(self, part: Participation, scene: Scene, member: Member) -> bool:
        """Whether a participant senses, or knows well enough that the target will be near it."""
        if member.id in self._network.readings[part.track.target]:
            return True
        away = self._predicted(part, scene, member) - member.position
        return float(away @ away) <= self._radius**2 and self._is_certain(scene, member)

    def _is_certain(self, scene: Scene, member: Member) -> bool:
        """Whether a participant knows to within the radius where the target is."""
        place = list(scene.motion.position)
        return float(np.trace(self._estimate(member).cov[np.ix_(place, place)])) <= self._radius**2

    def _welcome(self, part: Participation) -> Acting[None]:
        """Let nodes that sense without a belief ask for one; the nearest participant that hears each announces its own.

        A node that nobody hears asks again at the next step.
        """
        network, target, peers = self._network, part.track.target, part.peers
        living = network.nodes.alive
        new = [node for node in network.readings[target] if node not in peers.members and living[node]]
        if not new:
            return
        requests = [Parcel(None, 1, PACKET_BITS, "join")] * len(new)
        ended, bursts = self._services.messages.transport.broadcast(new, requests, target)
        yield ended
        able = set(peers.roster())
        heard = [sorted(able.intersection(burst.received)) for burst in bursts]
        place = network.nodes.assumed.positions
        asked = {
            network.nearest(nodes, place[burst.source]) for nodes, burst in zip(heard, bursts, strict=True) if nodes
        }
        yield from self._announce(part, sorted(asked), new)

    def _announce(self, part: Participation, announcers: Sequence[int], invited: Iterable[int]) -> Acting[None]:
        """Have participants broadcast their beliefs; of the invited, those that receive one whole join."""
        peers, target = part.peers, part.track.target
        if not announcers:
            return
        new = peers.admit(invited)
        yield from part.driver.request(Exchange(self._announcement, announcers))
        for member in peers.living():
            whole = [each for each in member.take_inbox() if each.what == ANNOUNCED and each.mask.all()]
            if whole and member.id in new:
                nearest = self._network.nearest([each.source for each in whole], member.position)
                self._tracker.join(member, next(each.payload for each in whole if each.source == nearest))
                self._log.add("join", target, member.id, peer=nearest)
        self._drop_idle(part)
        self._services.processes.enlist([node for node in new if node in peers.members], target)

    def _announcement(self, member: Member) -> Parcel:
        return replace(self._tracker.announcement(member), what=ANNOUNCED)

    def _invite(self, part: Participation, scene: Scene, inviter: Member) -> Acting[None]:
        """Have the inviter announce its belief, if there are nodes near its prediction that are no participants."""
        point, calls, members = self._predicted(part, scene, inviter), part.calls, part.peers.members
        near = self._network.nodes_near(point, self._radius).ids.tolist() if self._is_certain(scene, inviter) else []
        missing = [node for node in near if node not in members and calls.get((inviter.id, node), 0) < CALLS]
        if missing:
            yield from self._announce(part, [inviter.id], missing)
        for node in missing:
            calls[inviter.id, node] = 0 if node in members else calls.get((inviter.id, node), 0) + 1

    def _drop_idle(self, part: Participation) -> None:
        """Drop the nodes that hold no belief: nothing reached them."""
        members = part.peers.members.values()
        self._drop(part, [member.id for member in members if self._tracker.belief_of(member) is None])

    def _drop(self, part: Participation, nodes: Sequence[int]) -> None:
        """Let nodes cease to be participants."""
        for node in nodes:
            part.peers.forget(node)
        self._services.processes.dismiss(nodes, part.track.target)


def _reading_of(member: Member) -> Parcel:
    """What a participant broadcasts of its reading."""
    return Parcel(member.reading, 1, PACKET_BITS, READING, readings=1)


def _known_to_all(scene: Scene) -> Scene:
    """A scene that says nothing of other nodes: what each participant knows without a frame."""
    nobody: Any = {
        name: getattr(scene, name)[:0]
        for name in ("ids", "positions", "traits", "roster", "joined", "left", "roster_positions", "roster_traits")
    }
    return replace(scene, **nobody, head=-1, head_position=np.zeros(2))
