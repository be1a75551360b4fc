"""Who is the head of which track, by the head protocol of the scenario's cluster policy.

coordination.fill_vacancy(track, poll)      coordination.withdraw(node), coordination.forget(node)
"""

from __future__ import annotations

from importlib import import_module
from typing import Final

import simpy

from wsnsim.base.errors import RunError, WsnsimError
from wsnsim.network.clusters.driver import DriverServices, HeadDied
from wsnsim.network.clusters.elections import Elections
from wsnsim.network.clusters.head_services import Estimates, HeadMessages, HeadProtocol, HeadServices
from wsnsim.network.clusters.network_view import TargetSearch
from wsnsim.network.clusters.track import GroupEnded, Handover, LastClusterDone, Track, TrackBook, TrackLost
from wsnsim.network.clusters.wake_ahead import WakeAhead
from wsnsim.network.event_log import Acting
from wsnsim.network.node_process import NodeProcesses

PROTOCOLS: Final = {
    "standing": "standing_cluster:StandingClusterProtocol",
    "electing": "standing_cluster:ElectingClusterProtocol",
    "open": "standing_cluster:OpenClusterProtocol",
    "moving": "moving_head:MovingHeadProtocol",
    "appointing": "appointing:AppointingProtocol",
    "none": "peers:PeerProtocol",
    "open_groups": "groups:CentralGroup",
    "standing_groups": "moving_groups:MovingGroups",
}
"""The head protocols by the names that cluster policies give: a run imports its own only."""


class ClusterCoordination:
    """Owns the assignment of heads to tracks. A head leads a track in an activity of its own process.

    `ended` fires when the run ends with a cluster.

    Args:
        tracks: The tracks, one per target; or the groups, which begin and end.
        driver: What performs the requests of trackers.
        processes: The processes of the nodes.
        estimates: What tracks report.
        wake_ahead: Has nodes woken for the next step.
        search: What awake nodes detect of a target without a track.
    """

    def __init__(
        self, tracks: list[Track], driver: DriverServices, processes: NodeProcesses, estimates: Estimates,
        wake_ahead: WakeAhead, search: TargetSearch, book: TrackBook | None = None,
    ) -> None:  # fmt: skip
        network, transport = driver.network, driver.transport
        self._clock, self._log, self._headless = network.clock, network.log, network.setup.headless
        self._processes, self._tracks = processes, tracks
        self.ended = network.clock.env.event()
        elections = Elections(network, transport, processes, self.appoint)
        messages = HeadMessages(network, transport, driver.intervals)
        self._protocol = make_head_protocol(
            HeadServices(network, messages, driver, elections, estimates, wake_ahead, processes, search, book)
        )

    def begin_groups(self) -> None:
        """Let groups begin, where readings name no target."""
        self._protocol.begin()

    def fill_vacancy(self, track: Track, poll: int) -> None:
        """Look for a head, if the track has none and no election is under way."""
        if track.head is None and track.election is None:
            handover = self._protocol.fill_vacancy(track, poll)
            if handover is not None:
                self.appoint(track, handover)

    def appoint(self, track: Track, handover: Handover) -> None:
        """Make the handover's successor the head of the track."""
        track.head = handover.successor
        process = self._processes.of(handover.successor)
        process.serve(track.target)
        process.begin(self._lead(track, handover))

    def head_of(self, target: int) -> int | None:
        """The head of a target's track, or the node that reports where there are no heads; None if there is neither."""
        track = next((track for track in self._tracks if track.target == target), None)
        if track is None or not self._headless:
            return None if track is None else track.head
        return None if track.cluster is None else track.cluster.head

    def withdraw(self, node: int) -> None:
        """Withdraw a node that is no longer up from elections."""
        for track in self._tracks:
            if track.election is not None and node in track.election.readings:
                track.election.withdraw(node)

    def forget(self, node: int) -> None:
        """Remove a node that crashed, with its memory, from its clusters."""
        for track in self._tracks:
            if track.cluster is not None:
                track.cluster.forget(node)

    def _lead(self, track: Track, handover: Handover) -> Acting[None]:
        """Lead one track as its head, from taking over until handing over."""
        head = handover.successor
        try:
            if not handover.acts_now:
                yield track.tick
            following = yield from self._protocol.lead(track, handover)
            if following is not None:
                self._dissolve(track)
                self.appoint(track, following)
        except (HeadDied, simpy.Interrupt):
            if track.head == head:  # otherwise another head leads already
                self._lose(track, "head_died")
        except TrackLost as lost:
            self._lose(track, str(lost))
        except GroupEnded:
            self._dissolve(track)
            track.head = None
        except LastClusterDone:
            if not self.ended.triggered:
                self.ended.succeed()
        except WsnsimError:
            raise
        except Exception as reason:  # SimPy rebuilds exceptions from their arguments, which not every class allows
            raise RunError(f"{type(reason).__name__}: {reason}") from reason
        if track.head != head:
            self._processes.of(head).dismiss(track.target)

    def _dissolve(self, track: Track) -> None:
        """Dismiss the members of the track's cluster; their memories are lost."""
        if track.cluster is not None:
            track.clusters[-1].released = self._clock.now
            self._protocol.release(track, track.cluster)
            track.cluster = None

    def _lose(self, track: Track, why: str) -> None:
        """Log the loss of the belief, and leave the track without a head."""
        self._log.add("lost", track.target, -1 if track.head is None else track.head, why)
        self._dissolve(track)
        track.head = None


def make_head_protocol(services: HeadServices) -> HeadProtocol:
    """The head protocol of a scenario's cluster policy.

    Raises:
        RunError: there is none of that name.
    """
    setup = services.network.setup
    name = setup.head_protocol + ("_groups" if setup.unlabelled else "")
    if name not in PROTOCOLS:
        raise RunError(f"clusters: no head protocol '{name}' in this network; known: {', '.join(PROTOCOLS)}")
    module, kind = PROTOCOLS[name].split(":")
    protocol: HeadProtocol = getattr(import_module(f"wsnsim.network.clusters.{module}"), kind)(services)
    return protocol
