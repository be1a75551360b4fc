"""What nodes know of the tracks of groups: those that cluster heads broadcast lately, and what these explain.

Groups begin from the detections that no group explains, and that last from one step to the next.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, components_of, near, planar
from wsnsim.base.scans import Facts, TrackEstimate
from wsnsim.network.clusters.election import strength_of
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.clusters.track import TrackBook, predicted

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


class BroadcastTracks(NamedTuple):
    """The tracks that a cluster head broadcast at a step."""

    step: int
    head: int
    tracks: Sequence[TrackEstimate]


class ReceivedTracks:
    """The last tracks of each group that each node has received, and the gates for their readings."""

    def __init__(self, network: NetworkView, facts: Facts) -> None:
        self._network, self._facts = network, facts
        self._place, self.reach = list(facts.motion.position), min(facts.sensor.reach, FAR)
        self._of_nodes: dict[int, dict[int, BroadcastTracks]] = {}

    def note(self, node: int, group: int, received: BroadcastTracks) -> None:
        """Note that a node has received tracks of a group."""
        self._of_nodes.setdefault(node, {})[group] = received

    def forget_old(self) -> None:
        """Forget the tracks that nodes received too long ago."""
        since = self._network.clock.step - FRESH
        for received in self._of_nodes.values():
            for group in [group for group, each in received.items() if each.step < since]:
                del received[group]

    def by_group(self, node: int) -> Iterator[tuple[int, BroadcastTracks, list[TrackEstimate]]]:
        """Yield the number of each group, ascending, what a node has received of it, and that predicted for now."""
        now = self._network.clock.step
        for group, each in sorted(self._of_nodes.get(node, {}).items()):
            yield group, each, [predicted(track, self._facts, each.step, now) for track in each.tracks]

    def own_and_others(self, node: int, group: int = -1) -> tuple[list[TrackEstimate], list[TrackEstimate]]:
        """The tracks of a group that a node has received, predicted for now, and those of all others."""
        own: list[TrackEstimate] = []
        others: list[TrackEstimate] = []
        for number, _, tracks in self.by_group(node):
            (own if number == group else others).extend(tracks)
        return own, others

    def explained(self, node: int, scan: Any, tracks: Sequence[TrackEstimate]) -> Bools:
        """(M,) which detections of a node lie in the gate of one of the tracks."""
        size = len(components_of(self._facts.sensor))
        detections, known = np.array(scan, dtype=np.float64).reshape(-1, size), np.zeros(len(scan), dtype=np.bool_)
        for track in tracks:
            expected, spread = self._expected(track, [node])
            apart = near(self._facts.sensor, detections.reshape(-1), np.tile(expected[0], len(detections)))
            known |= (np.abs(apart.reshape(-1, size) - expected[0]) <= GATE * spread[0]).all(axis=1)
        return known

    def overlap(self, one: TrackEstimate, other: TrackEstimate) -> float:
        """The share of the nodes on the map, in range of two tracks, whose gates for them overlap; 0 without any."""
        grid, place = self._network.nodes.assumed.grid, self._place
        beside, others = (grid.within(planar(track.mean[place]), self.reach) for track in (one, other))
        ids: list[int] = np.intersect1d(beside, others).tolist()
        if not ids:
            return 0.0
        (a, sa), (b, sb) = self._expected(one, ids), self._expected(other, ids)
        apart = near(self._facts.sensor, b.reshape(-1), a.reshape(-1)).reshape(a.shape) - a
        return float((np.abs(apart) <= GATE * (sa + sb)).all(axis=1).mean())

    def _expected(self, track: TrackEstimate, ids: Sequence[int]) -> tuple[Floats, Floats]:
        """(n, d) the expected readings of a track at nodes, and their standard deviations."""
        nodes, place, index = self._network.nodes, self._place, np.array(ids, dtype=np.int64)
        law = self._facts.sensor.linearise(
            track.mean[place][:, None], nodes.assumed.positions[index], nodes.traits[index]
        )
        expected, gradients, variances = (array[..., 0] for array in law)
        spread = np.einsum("ki,ij,kj->k", gradients, track.cov[np.ix_(place, place)], gradients) + variances
        size = len(components_of(self._facts.sensor))
        return expected.reshape(-1, size), np.sqrt(spread).reshape(-1, size)


class FreeDetections:
    """Finds the candidates of the elections with which groups begin.

    Args:
        network: The network.
        book: The groups that there are.
        facts: What heads assume.
        received: What nodes know of the tracks of groups.
        extents: (d,) the size of the space of readings in each component; infinite where it has no bounds.
        rate_sd: The deviation of the speed of targets that may begin, in m/s.
    """

    def __init__(
        self, network: NetworkView, book: TrackBook, facts: Facts, received: ReceivedTracks, extents: Floats,
        rate_sd: float,
    ) -> None:  # fmt: skip
        self._network, self._book, self._facts, self._received = network, book, facts, received
        self._before: Mapping[int, Any] = {}
        share = SWIFT * rate_sd * facts.dt / facts.sensor.reach
        self._step_at_most = extents * min(max(share, STILL), 1.0)

    def electorates(self) -> Iterator[dict[int, Any]]:
        """Yield {node: its strongest free detection} of neighbouring nodes, enough of them for a group."""
        free, nodes, sensor = self._strongest(), self._network.nodes, self._network.setup.sensor
        positions = nodes.assumed.positions
        while free:
            first = max(free, key=lambda node: (strength_of(sensor, free[node]), -node))
            away = np.hypot(*(positions[list(free)] - positions[first]).T)
            beside = [node for node, far in zip(free, (away > nodes.reach).tolist(), strict=True) if not far]
            electorate = {node: free.pop(node) for node in beside}
            if len(electorate) >= LEAST_NODES:
                yield electorate

    def _strongest(self) -> dict[int, Any]:
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
            _, tracks = self._received.own_and_others(node)
            known = self._received.explained(node, scan, tracks) | ~self._lasting(scan, self._before.get(node, ()))
            left = [z for z, no in zip(scan, known.tolist(), strict=True) if not no]
            if left:
                found[node] = max(left, key=lambda reading: strength_of(network.setup.sensor, reading))
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
