"""The detections from which groups begin: those that no group explains, and that last from one step to the next."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, components_of, near
from wsnsim.base.scans import Facts
from wsnsim.network.clusters.election import strength_of
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.clusters.received_tracks import ReceivedTracks
from wsnsim.network.clusters.track_book import TrackBook

LEAST_NODES: Final = 2
"""Neighbouring nodes with unexplained detections, from which on a group begins."""
SWIFT: Final = 3.0
"""Deviations of the speed of targets that may begin, which they reach at most (our choice)."""
STILL: Final = 0.1
"""Least share of the space of readings that a detection may move from one step to the next (our choice)."""


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
