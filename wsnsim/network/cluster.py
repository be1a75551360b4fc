"""A cluster while it lives: its members with their memories, and the scene that its head sees at each step."""

from __future__ import annotations

import numpy as np

from wsnsim.base.asks import Member
from wsnsim.base.ports import Scene
from wsnsim.base.rng import derive, derive_all
from wsnsim.network.stage import Stage

HEAD_KEY = 0xFFFF_FFFF
"""In the place of a node's number, for the draws that a head makes for the whole track."""


class Cluster:
    """Members in the order: head, then ascending. Fixed at formation, unless the policy is open: then whoever senses belongs."""

    def __init__(self, stage: Stage, target: int, head: int, joined: list[int], is_open: bool) -> None:
        self._stage = stage
        self._target = target
        self._open = is_open
        self._before: tuple[int, ...] = ()
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
            return tuple(node for node in self.members if alive[node] and (node in sensing or node == self.head))
        return tuple(node for node in self.members if alive[node])

    def active(self) -> int:
        """N_act: how many members sense now."""
        sensing = self._stage.sensing[self._target]
        return sum(node in sensing for node in self.roster())

    def scene(self, steps: int) -> Scene:
        """What the head knows at the stage's step; gives each member its reading and its key."""
        stage, parts, fleet = self._stage, self._stage.parts, self._stage.fleet
        readings = stage.sensing[self._target]
        if self._open:
            for node in readings:
                if node not in self.members:
                    self._admit(node)
        roster = self.roster()
        ids = tuple(node for node in roster if node in readings)
        base = derive(stage.tracker_key, self._target, stage.step)
        keys = derive_all(base, np.array(roster, dtype=np.int64)).tolist()
        for node, key in zip(roster, keys, strict=True):
            member = self.members[node]
            member.reading, member.key = readings.get(node), key
        before, self._before = self._before, ids
        index = np.array(ids, dtype=np.int64)
        return Scene(
            time=stage.step * parts.dt,
            step=stage.step,
            steps=steps,
            dt=parts.dt,
            target=self._target,
            head=self.head,
            ids=ids,
            positions=fleet.positions[index],
            traits=fleet.traits[index],
            roster=roster,
            joined=tuple(node for node in ids if node not in before),
            left=tuple(node for node in before if node not in ids and fleet.alive[node]),
            field=stage.field,
            motion=parts.filter_motions[self._target],
            sensor=parts.filter_sensor,
            key=derive(base, HEAD_KEY),
        )
