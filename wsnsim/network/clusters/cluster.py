"""A cluster while it lives: its members with their memories, and the scene that its head sees at each step."""

from __future__ import annotations

import numpy as np

from wsnsim.base.ports import Scene
from wsnsim.base.requests import Member
from wsnsim.base.rng import HEAD_KEY, derive, derive_all, derive_each
from wsnsim.network.run_context import RunContext

KEYS_AHEAD = 64
"""Steps for which keys are derived at once."""


class Cluster:
    """Members, the head first. Fixed at formation; or, where the policy is open, whoever senses belongs."""

    def __init__(
        self, stage: RunContext, target: int, head: int, joined: list[int], is_open: bool, keys_ahead: int = KEYS_AHEAD
    ) -> None:
        self._stage = stage
        self._target = target
        self._open = is_open
        self._forgotten = 0
        self._ahead = keys_ahead
        self._track_key = derive(stage.tracker_key, target)
        self._keys: list[list[int]] = []
        self._keyed: tuple[tuple[int, ...], int] = ((), 0)
        self._ids: tuple[int, ...] = ()
        self._traits = stage.fleet.traits[:0]
        self._positions = stage.fleet.positions[:0]
        self.head = head
        self.members: dict[int, Member] = {}
        for node in [head, *joined]:
            self._admit(node)

    def _admit(self, node: int) -> None:
        fleet = self._stage.fleet
        self.members[node] = Member(node, fleet.positions[node], fleet.traits[node])

    def roster(self) -> tuple[int, ...]:
        """Living members, sensing or not."""
        alive, sensing = self._stage.fleet.alive, self._stage.sensing[self._target]
        if self._open:
            return tuple([node for node in self.members if alive[node] and (node in sensing or node == self.head)])
        return tuple([node for node in self.members if alive[node]])

    @property
    def size(self) -> int:
        """N_cluster: how many belong, those included that are no longer up."""
        return len(self.members) + self._forgotten

    def forget(self, node: int) -> None:
        """A member has crashed. What it remembered is gone: should it come back, it belongs only if it joins anew."""
        if self.members.pop(node, None) is None:
            return
        self._forgotten += not self._open
        if node in self._ids:
            kept = [i for i, member in enumerate(self._ids) if member != node]
            self._ids = tuple([self._ids[i] for i in kept])
            self._positions, self._traits = self._positions[kept], self._traits[kept]

    def active(self) -> int:
        """N_act: how many living members sense now."""
        sensing = self._stage.sensing[self._target]
        return sum([node in sensing for node in self.members])

    def scene(self, steps: int) -> Scene:
        """What the head knows at the stage's step; gives each member its reading and its key."""
        stage, parts = self._stage, self._stage.parts
        readings = stage.sensing[self._target]
        if self._open:
            for node in readings:
                if node not in self.members:
                    self._admit(node)
        roster = self.roster()
        for node, key in zip(roster, self._keys_of(roster), strict=True):
            member = self.members[node]
            member.reading, member.key = readings.get(node), key
        joined, left = self._look_around(tuple([node for node in roster if node in readings]))
        return Scene(
            time=stage.step * parts.dt,
            step=stage.step,
            steps=steps,
            dt=parts.dt,
            target=self._target,
            head=self.head,
            ids=self._ids,
            positions=self._positions,
            traits=self._traits,
            roster=roster,
            joined=joined,
            left=left,
            field=stage.field,
            motion=parts.filter_motions[self._target],
            sensor=parts.filter_sensor,
            key=derive(self._track_key, stage.step, HEAD_KEY),
        )

    def _look_around(self, ids: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Who began and who ceased to sense, since the last look."""
        before, fleet = self._ids, self._stage.fleet
        if ids == before:
            return (), ()
        index = np.array(ids, dtype=np.int64)
        self._ids, self._positions, self._traits = ids, fleet.positions[index], fleet.traits[index]
        gone = [node for node in before if node not in ids]
        for node in gone:
            self.members[node].reading = None
        return tuple([node for node in ids if node not in before]), tuple([node for node in gone if fleet.alive[node]])

    def _keys_of(self, roster: tuple[int, ...]) -> list[int]:
        """The members' keys of this step: derive(tracker key, target, step, node)."""
        keyed, first = self._keyed
        step = self._stage.step
        if keyed != roster or not first <= step < first + self._ahead:
            bases = derive_all(self._track_key, np.arange(step, step + self._ahead))
            nodes = np.array(roster, dtype=np.int64).astype(np.uint64)
            self._keys = derive_each(bases[:, None], nodes[None, :]).tolist()
            self._keyed, first = (roster, step), step
        return self._keys[step - first]
