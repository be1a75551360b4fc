"""A cluster while it exists, by joins or by appointment: its members' memories, and the scene that its head sees."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np

from wsnsim.base.arrays import Reading
from wsnsim.base.ports import KnownNodes, Scene
from wsnsim.base.requests import Member
from wsnsim.base.rng import HEAD_KEY, derive, derive_all, derive_each
from wsnsim.network.clusters.network_view import NetworkView

KEYS_AHEAD: Final = 64
"""Steps whose keys are derived at once."""
CALLS: Final = 3
"""A node that was called so often and never answered is not called any more: it is down, or has nothing to say."""


class Cluster:
    """A cluster, with the members that joined when it formed, the head included, and those that are admitted later.

    `reported`: {node: reading} that came with the joins; `awaited`: the number of joins that are still under way;
    `forming`: whether the cluster is not yet that of the track.
    """

    def __init__(
        self, network: NetworkView, target: int, head: int, joined: list[int], keys_ahead: int = KEYS_AHEAD
    ) -> None:
        self._network = network
        self._target = target
        self._crashed = 0
        self._keys_ahead = keys_ahead
        self._track_key = derive(network.tracker_key, target)
        self._keys: list[list[int]] = []
        self._keyed: tuple[tuple[int, ...], int] = ((), 0)
        self._ids: tuple[int, ...] = ()
        self._traits = network.nodes.traits[:0]
        self._positions = network.nodes.assumed.positions[:0]
        self._roster: tuple[int, ...] = ()
        self._roster_traits, self._roster_positions = self._traits, self._positions
        self.head = head
        self.members: dict[int, Member] = {}
        self.reported: Mapping[int, Reading] = {}
        self.awaited = 0
        self.forming = False
        for node in [head, *joined]:
            self._admit(node)

    def admit(self, nodes: Iterable[int]) -> list[int]:
        """Add living nodes that know that they belong; return those that are new."""
        alive, members = self._network.nodes.alive, self.members
        new = [node for node in nodes if node not in members and alive[node]]
        for node in new:
            self._admit(node)
        return new

    def _admit(self, node: int) -> None:
        nodes = self._network.nodes
        self.members[node] = Member(node, nodes.assumed.positions[node], nodes.traits[node])

    def roster(self) -> tuple[int, ...]:
        """The living members, whether they sense or not."""
        alive = self._network.nodes.alive
        return tuple([node for node in self.members if alive[node]])

    @property
    def size(self) -> int:
        """N_cluster: the number of members, those that crashed included."""
        return len(self.members) + self._crashed

    @property
    def expected(self) -> int:
        """Number of nodes that the head takes for members, itself included."""
        return len(self.members)

    def _appointed_members(self) -> KnownNodes | None:
        """The nodes with whose readings the head reckons, if these are not the roster."""
        return None

    def forget(self, node: int) -> None:
        """Remove a member that crashed, with its memory. If it restarts, it belongs only once it joins again."""
        if self.members.pop(node, None) is None:
            return
        self._crashed += 1
        if node in self._ids:
            kept = [i for i, member in enumerate(self._ids) if member != node]
            self._ids = tuple([self._ids[i] for i in kept])
            self._positions, self._traits = self._positions[kept], self._traits[kept]

    def active(self) -> int:
        """N_act: the number of living members that sense now."""
        readings = self._network.readings[self._target]
        return sum([node in readings for node in self.members])

    def scene(self, steps: int) -> Scene:
        """What the head knows at the present step; each member gets its reading and its key.

        Args:
            steps: the number of steps since the head's belief.
        """
        network, setup = self._network, self._network.setup
        step, readings = network.clock.step, network.readings[self._target]
        roster = self.roster()
        *keys, head_key = self._keys_of(roster)
        for node, key in zip(roster, keys, strict=True):
            member = self.members[node]
            member.reading, member.key = readings.get(node), key
        self._update_roster(roster)
        joined, left = self._update_active(tuple([node for node in roster if node in readings]))
        return Scene(
            time=step * setup.dt,
            step=step,
            steps=steps,
            dt=setup.dt,
            target=self._target,
            head=self.head,
            ids=self._ids,
            positions=self._positions,
            traits=self._traits,
            roster=self._roster,
            joined=joined,
            left=left,
            field=setup.deploy.field,
            motion=setup.filter_motion(self._target),
            sensor=setup.filter_sensor,
            key=head_key,
            head_position=network.nodes.assumed.positions[self.head],
            roster_positions=self._roster_positions,
            roster_traits=self._roster_traits,
            packet_joules=setup.packet_joules,
            hop_seconds=setup.gathering(self.expected - 1),
            appointed=self._appointed_members(),
        )

    def _update_roster(self, roster: tuple[int, ...]) -> None:
        """Replace the living members, if they are others than at the last step."""
        if roster != self._roster:
            nodes, index = self._network.nodes, np.array(roster, dtype=np.int64)
            self._roster = roster
            self._roster_positions, self._roster_traits = nodes.assumed.positions[index], nodes.traits[index]

    def _update_active(self, ids: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Replace the active members; return those that began to sense and those that ceased."""
        before, nodes = self._ids, self._network.nodes
        if ids == before:
            return (), ()
        index = np.array(ids, dtype=np.int64)
        self._ids, self._positions, self._traits = ids, nodes.assumed.positions[index], nodes.traits[index]
        gone = [node for node in before if node not in ids]
        for node in gone:
            self.members[node].reading = None
        return tuple([node for node in ids if node not in before]), tuple([node for node in gone if nodes.alive[node]])

    def _keys_of(self, roster: tuple[int, ...]) -> list[int]:
        """The members' keys of this step, derive(tracker key, target, step, node), and then the head's."""
        keyed, first = self._keyed
        step = self._network.clock.step
        if keyed != roster or not first <= step < first + self._keys_ahead:
            bases = derive_all(self._track_key, np.arange(step, step + self._keys_ahead))
            nodes = np.array([*roster, HEAD_KEY], dtype=np.int64).astype(np.uint64)
            self._keys = derive_each(bases[:, None], nodes[None, :]).tolist()
            self._keyed, first = (roster, step), step
        return self._keys[step - first]


class OpenCluster(Cluster):
    """A cluster to which every node belongs that senses the target, beside the head."""

    def roster(self) -> tuple[int, ...]:
        """The living members that sense, and the head."""
        alive, readings = self._network.nodes.alive, self._network.readings[self._target]
        return tuple([node for node in self.members if alive[node] and (node in readings or node == self.head)])

    @property
    def size(self) -> int:
        """N_cluster: the number of nodes that have been members."""
        return len(self.members)

    def scene(self, steps: int) -> Scene:
        """What the head knows at the present step; see `Cluster`."""
        for node in self._network.readings[self._target]:
            if node not in self.members:
                self._admit(node)
        return super().scene(steps)


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
