"""A cluster whose head appointed its members: who belongs to it, and whom the head takes for a member."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.network_view import NetworkView


class AppointedCluster(Cluster):
    """A cluster that grows while it exists.

    Its members are the nodes that heard that they are appointed. The head does not know who heard it: the roster of its
    scenes has all nodes that its map says are appointed. A node on the roster that is no member never answers.
    """

    def __init__(self, network: NetworkView, target: int, head: int, appointed: Sequence[int] = ()) -> None:
        super().__init__(network, target, head, [])
        self._appointed = set(appointed)

    @property
    def listed(self) -> tuple[int, ...]:
        """The living nodes that the head takes for members, itself first."""
        alive, members = self._network.nodes.alive, self.members
        others = [node for node in sorted(self._appointed) if node not in members and alive[node]]
        return (*self.roster(), *others)

    def appoint(self, nodes: Iterable[int]) -> None:
        """Add nodes that the head's map says are appointed."""
        self._appointed.update(nodes)

    def admit(self, nodes: Iterable[int]) -> list[int]:
        """Add living nodes that know that they are appointed; return those that are new."""
        alive, members = self._network.nodes.alive, self.members
        new = [node for node in nodes if node not in members and alive[node]]
        for node in new:
            self._admit(node)
        return new

    def restart(self) -> None:
        """Empty the memories of all members: the head starts the track anew."""
        for node in self.members:
            self._admit(node)

    def _update_roster(self, roster: tuple[int, ...]) -> None:
        super()._update_roster(self.listed)
