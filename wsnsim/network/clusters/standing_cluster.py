"""Standing clusters: a head forms its cluster, tracks step by step, and hands over when too few members sense.

Jiang (2013), section 2.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from wsnsim.base.arrays import Estimate, Reading
from wsnsim.base.network_ports import SeesGeometry
from wsnsim.base.ports import Scene
from wsnsim.base.requests import PACKET_BITS, Flow, Parcel
from wsnsim.network.clusters.cluster import Cluster, OpenCluster
from wsnsim.network.clusters.driver import Driver, HeadDied
from wsnsim.network.clusters.head_services import HeadProtocol, HeadServices
from wsnsim.network.clusters.track import Handover, NotDelivered, Track, TrackLost
from wsnsim.network.event_log import Acting, then
from wsnsim.network.radio.datagrams import Datagram


class StandingClusterProtocol(HeadProtocol):
    """The node nearest to the predicted position is the successor; an election finds a head for a track without one."""

    def __init__(self, services: HeadServices) -> None:
        super().__init__(services)
        policy = self._setup.clusters
        self._geometry = policy if isinstance(policy, SeesGeometry) else None

    def fill_vacancy(self, track: Track, poll: int) -> Handover | None:
        """Hold an election among the nodes that sense the target; its winner becomes head without a handover."""
        self._services.elections.fill_vacancy(track)
        return None

    def lead(self, track: Track, handover: Handover) -> Acting[Handover | None]:
        """Form a cluster, track step by step, and hand over when too few members sense."""
        formed = yield from self._form(track, handover)
        if isinstance(formed, Handover):
            return formed
        cluster, driver = formed, self._driver(track, formed)
        services, tracker, clock = self._services, self._setup.tracker, self._network.clock
        belief, last = handover.belief, handover.belief_step
        if handover.readings is not None:
            scene = cluster.scene(0)
            late = self._setup.waits.election is not None
            known = {**cluster.reported, **handover.readings} if late else handover.readings
            prior, readings = yield from self._first_estimate(track, handover, known)
            belief = yield from driver.perform(tracker.start(prior, scene))
            driver.readings = readings
            services.estimates.note_start(track, cluster.head)
            services.estimates.issue(track, last, scene, driver, belief)
            yield track.tick
        waits_for = self._waits_for(track, cluster)
        while True:
            scene = cluster.scene(clock.step - last)
            last = clock.step
            belief = yield from driver.perform(tracker.step(belief, scene))
            services.estimates.issue(track, last, scene, driver, belief)
            services.estimates.snapshot(track, cluster, belief, last)
            services.wake_ahead.wake(track, cluster.head, belief, scene, scene.time)
            if waits_for is not None and waits_for != set(self._network.readings[track.target]):
                waits_for = None
            if waits_for is None and not cluster.awaited and self._must_hand_over(track, cluster, belief, scene):
                following = yield from self._unless_undelivered(self._hand_over(track, cluster, belief, scene))
                if following is not None:
                    return following
            yield track.tick

    def _form(self, track: Track, handover: Handover) -> Acting[Cluster | Handover]:
        """Announce a cluster and let sensing nodes join; return it, or a handover if an election chose another head."""
        target, head, network = track.target, handover.successor, self._network
        joins = yield from self._services.messages.recruit(target, head)
        if not joins.readings and not joins.pending and self._setup.waits.retries_handover:
            joins = yield from self._services.messages.recruit(target, head)
        cluster = Cluster(network, target, head, list(joins.readings))
        cluster.reported = joins.readings if joins.step == handover.belief_step else {}
        cluster.awaited, cluster.forming = len(joins.pending), True
        for join, ended in joins.pending:
            then(ended, self._end_join, track, cluster, join)
        too_few = cluster.active() + cluster.awaited < self._setup.clusters.minimum_active
        if too_few and not handover.elected and handover.readings is None:
            winner = yield from self._services.elections.vote(track)
            if winner is not None and winner != head:
                chosen = replace(handover, successor=winner, elected=True)
                following = yield from self._unless_undelivered(self._pass_on(track, cluster, chosen))
                if following is not None:
                    cluster.forming = False
                    return following
        cluster.forming = False
        self._open(track, cluster, handover)
        self._expect_members(cluster)
        self._services.processes.enlist(cluster.members, target)
        return cluster

    def _end_join(self, track: Track, cluster: Cluster, join: Datagram) -> None:
        """Admit a node whose join arrived after the head stopped waiting for joins, if the cluster still exists."""
        cluster.awaited -= 1
        node = join.source
        if join.arrived and (cluster.forming or track.cluster is cluster) and cluster.admit([node]):
            self._log.add("join", track.target, node, peer=cluster.head)
            if not cluster.forming:
                self._expect_members(cluster)
                self._services.processes.enlist([node], track.target)

    def _expect_members(self, cluster: Cluster) -> None:
        """Tell a MAC that keeps idle slots whom the head takes for members."""
        if self._services.messages.transport.keeps_idle_slots:
            self._services.messages.transport.expect(cluster.head, list(cluster.members))

    def _open(self, track: Track, cluster: Cluster, handover: Handover) -> None:
        """Make a cluster that of the track, without members that died while it formed."""
        alive = self._network.nodes.alive
        for node in [node for node in cluster.members if not alive[node]]:
            cluster.forget(node)
        track.open_cluster(cluster, handover, self._network.clock.now)

    def _first_estimate(
        self, track: Track, handover: Handover, readings: Mapping[int, Reading]
    ) -> Acting[tuple[Estimate, int]]:
        """The initial estimate and the number of readings in it: at step 0 the prior, later one from readings.

        Of a target that is absent at step 0, it is always one from readings: nobody is told when it comes (our choice).
        """
        if not track.started and handover.belief_step == 0 and track.known_at_start:
            return track.prior, 0
        readings = yield from self._known_readings(track, handover.successor, readings)
        if not self._network.nodes.alive[handover.successor]:
            raise HeadDied
        if not readings:
            raise TrackLost("no_readings")
        return self._services.estimates.initial(track, readings), len(readings)

    def _known_readings(
        self, track: Track, head: int, readings: Mapping[int, Reading]
    ) -> Acting[Mapping[int, Reading]]:
        """The readings that a new head knows: those of the candidates that it heard."""
        yield from ()  # makes this a generator: other protocols take simulated time here
        return readings

    def _pass_on(self, track: Track, cluster: Cluster, handover: Handover) -> Acting[Handover]:
        """Send the belief, not yet distributed to members, to the winner of an election, which leads in this step."""
        scene = cluster.scene(self._network.clock.step - handover.belief_step)
        flow = self._setup.tracker.hand_over(handover.belief, scene, handover.successor)
        return (yield from self._send_belief(self._driver(track, cluster), flow, handover))

    def _hand_over(self, track: Track, cluster: Cluster, belief: Any, scene: Scene) -> Acting[Handover]:
        """Choose the successor and send it the belief; it leads from the next tick on."""
        self._count_handover(track)
        nearest = self._next_head(track, cluster, belief, scene)
        successor, elected = yield from self._successor(track, cluster.head, nearest)
        if successor is None:
            raise TrackLost("no_successor")
        self._log.add("handover", track.target, cluster.head, peer=successor)
        flow = self._setup.tracker.hand_over(belief, scene, successor)
        handover = Handover(successor, scene.step, previous_head=cluster.head, elected=elected)
        return (yield from self._send_belief(self._driver(track, cluster), flow, handover))

    def _must_hand_over(self, track: Track, cluster: Cluster, belief: Any, scene: Scene) -> bool:
        """Whether another node must lead: by the geometry if the policy sees it, otherwise by counts."""
        if self._geometry is None:
            return self._setup.clusters.must_hand_over(cluster.active(), cluster.size)
        outlook = self._network.outlook(track.target, cluster.head, cluster.roster(), belief, scene)
        return self._geometry.must_appoint(outlook) and self._geometry.next_head(outlook) != cluster.head

    def _next_head(self, track: Track, cluster: Cluster, belief: Any, scene: Scene) -> int | None:
        """The next head by the policy: by the geometry if the policy sees it, otherwise by the predicted position."""
        network, node = self._network, None
        if self._geometry is not None:
            outlook = self._network.outlook(track.target, cluster.head, cluster.roster(), belief, scene)
            node = self._geometry.next_head(outlook)
        if node is not None:
            return node
        point = network.successor_position(track.target, belief, scene)
        return self._setup.clusters.successor(point, network.nodes.assumed.positions, network.who_can_lead())

    def _successor(self, track: Track, head: int, nearest: int | None) -> Acting[tuple[int | None, bool]]:
        """The next head, and whether an election chose it: the node nearest to the forecast."""
        yield from ()  # makes this a generator: other protocols take simulated time here
        return nearest, False

    def _send_belief(self, driver: Driver, flow: Flow[Any], handover: Handover) -> Acting[Handover]:
        """Send a belief to the successor; return the handover with the belief as it arrived."""
        belief = yield from driver.perform(flow)
        if belief is None:
            raise NotDelivered
        if not self._network.nodes.alive[handover.successor]:
            raise TrackLost("handover_lost")
        return replace(
            handover,
            belief=belief,
            acts_now=handover.elected,
            hops=handover.hops + driver.hops,
            bits=handover.bits + driver.collection.bits,
        )

    def _unless_undelivered(self, handing_over: Acting[Handover]) -> Acting[Handover | None]:
        """The handover; None if the belief did not arrive and the head keeps leading (see `HeadWaits`)."""
        try:
            return (yield from handing_over)
        except NotDelivered:
            if self._setup.waits.retries_handover:
                return None
            raise

    def _waits_for(self, track: Track, cluster: Cluster) -> set[int] | None:
        """The nodes that sense now if the cluster is too small, otherwise None.

        Its head hands over only after they have changed: otherwise it would hand over at every step.
        Our choice, and an idealisation: the head knows of nodes that are not its members.
        """
        if cluster.active() >= self._setup.clusters.minimum_active:
            return None
        return set(self._network.readings[track.target])

    def _driver(self, track: Track, cluster: Cluster) -> Driver:
        return Driver(self._services.driver, track.target, cluster.head, cluster.members)


class ElectingClusterProtocol(StandingClusterProtocol):
    """As `StandingClusterProtocol`, but the node nearest to the predicted position calls an election."""

    def _successor(self, track: Track, head: int, nearest: int | None) -> Acting[tuple[int | None, bool]]:
        """Wake the node nearest to the forecast, which calls an election at the next tick; the head waits for its end.

        The paper leaves open how the head learns of the winner: here it does, without a frame (our choice).
        """
        if nearest is None:
            return None, False
        wake = Datagram(head, nearest, Parcel(None, 1, PACKET_BITS, "wake"))
        yield self._services.messages.transport.carry([wake], track.target)
        if not wake.arrived and self._setup.waits.retries_handover:
            raise NotDelivered
        if not wake.arrived:
            return None, True
        yield track.tick
        winner = yield from self._services.elections.vote(track)
        if winner is None and self._network.nodes.alive[nearest]:
            winner = nearest
        return winner, True


class OpenClusterProtocol(StandingClusterProtocol):
    """Clusters without joins, elections and frames; the policy names a head at the start and after a head's death."""

    def fill_vacancy(self, track: Track, poll: int) -> Handover | None:
        """Appoint the head that the policy names, once some node senses the target."""
        network, step = self._network, self._network.clock.step
        head = self._setup.clusters.successor(np.zeros(2), network.nodes.assumed.positions, network.who_can_lead())
        if head is None or not (network.readings[track.target] or (step == 0 and track.known_at_start)):
            return None
        return Handover(head, step, readings={}, elected=True, acts_now=True)

    def release(self, track: Track, cluster: Cluster) -> None:
        """Do nothing: members have no role."""

    def _form(self, track: Track, handover: Handover) -> Acting[Cluster | Handover]:
        """Return a cluster without sending a frame."""
        yield from ()  # makes this a generator: other protocols take simulated time here
        cluster = OpenCluster(self._network, track.target, handover.successor, [])
        self._open(track, cluster, handover)
        return cluster

    def _known_readings(
        self, track: Track, head: int, readings: Mapping[int, Reading]
    ) -> Acting[Mapping[int, Reading]]:
        """The readings of all nodes that sense, sent to the head."""
        sensed = self._network.readings[track.target]
        datagrams = [Datagram(node, head, Parcel(value, 1, PACKET_BITS, "reading")) for node, value in sensed.items()]
        if datagrams:
            yield self._services.messages.transport.carry(datagrams, track.target)
        arrived = [datagram.source for datagram in datagrams if datagram.arrived]
        # a node may have stopped sensing meanwhile
        return {node: sensed[node] for node in arrived if node in sensed}

    def _driver(self, track: Track, cluster: Cluster) -> Driver:
        """Members may be anywhere: routing decides every path."""
        return Driver(self._services.driver, track.target, cluster.head, cluster.members, one_hop=False)

    def _waits_for(self, track: Track, cluster: Cluster) -> set[int] | None:
        """None: an open cluster is never too small."""
        return None
