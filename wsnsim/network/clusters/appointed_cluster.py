"""A cluster whose head appointed its members: who belongs to it, and what the head knows of that."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from wsnsim.base.ports import KnownNodes
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.network_view import NetworkView

CALLS: Final = 3
"""A node that was called so often and never answered is not called any more: it is down, or has nothing to say."""


class AppointedCluster(Cluster):
    """A cluster that grows while it exists.

    Its members are the nodes that heard that they are appointed. The head does not know who heard it: it goes by its
    map, on which all nodes near its prediction are appointed, and by who has answered since. `Scene.known` has
    these, and those members of which it does not know yet, so that their readings find their places; the roster of its
    scenes leaves out those that are down.
    """

    def __init__(self, network: NetworkView, target: int, head: int, appointed: Sequence[int] = ()) -> None:
        super().__init__(network, target, head, [])
        self._appointed = set(appointed)
        self._answered: set[int] = set()
        self._calls: dict[int, int] = {}
        self._on_map = KnownNodes((), self._positions, self._traits)

    @property
    def listed(self) -> tuple[int, ...]:
        """The living nodes on the roster, the head first."""
        alive, members = self._network.nodes.alive, self.members
        others = [node for node in sorted(self._appointed) if node not in members and alive[node]]
        return (*self.roster(), *others)

    @property
    def known(self) -> tuple[int, ...]:
        """The nodes that the head takes for members, itself first: those appointed on its map, and who answered.

        It does not know which of them heard it, nor which of them are down.
        """
        return (self.head, *sorted((self._appointed | self._answered) - {self.head}))

    @property
    def expected(self) -> int:
        """Number of nodes that the head takes for members, itself included."""
        return len(self._appointed | self._answered | {self.head})

    def _appointed_members(self) -> KnownNodes:
        """The nodes in `known`, whether they are up or not, and those members that the head did not expect."""
        known = (*self.members, *sorted((self._appointed | self._answered) - self.members.keys()))
        if self._on_map.ids != known:
            nodes, index = self._network.nodes, np.array(known, dtype=np.int64)
            self._on_map = KnownNodes(known, nodes.assumed.positions[index], nodes.traits[index])
        return self._on_map

    def appoint(self, nodes: Iterable[int]) -> None:
        """Add nodes that the head's map says are appointed."""
        self._appointed.update(nodes)

    def note_answers(self, nodes: Iterable[int]) -> None:
        """Note that packets of members have arrived at the head: these are awake, and know whom to report to."""
        self._answered.update(nodes)

    def must_call(self, nodes: Sequence[int]) -> bool:
        """Whether a message must be sent to wake nodes: some have neither answered nor been called `CALLS` times.

        If so, those that have not answered are taken for called and, since the message names the head, for appointed.
        """
        silent = [node for node in nodes if node not in self._answered]
        if all(self._calls.get(node, 0) >= CALLS for node in silent):
            return False
        self._calls |= {node: self._calls.get(node, 0) + 1 for node in silent}
        self.appoint(silent)
        return True

    def _update_roster(self, roster: tuple[int, ...]) -> None:
        super()._update_roster(self.listed)
