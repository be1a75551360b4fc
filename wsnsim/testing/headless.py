"""The check of trackers without a head: on a line of nodes, each of which hears those beside it."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Bools, Estimate
from wsnsim.base.ports import HeadlessTracker, MotionModel, SensorModel, Tracker
from wsnsim.base.requests import Exchange, Local, Member, Parcel, Request
from wsnsim.offline.loopback import Lose, answer_to, perform, silent
from wsnsim.testing.isolation import demand_enough_bits
from wsnsim.testing.privacy import examine, same
from wsnsim.testing.table import FIRST, Table, another, demand, demand_sound, examined

NODES: Final = tuple(sorted(FIRST))
STEPS: Final = ((1, NODES), (1, NODES[2:]), (3, NODES[:1]), (1, ()), (1, NODES))
"""(steps since the last one, ids with a measurement)."""


def beside(source: int, to: int, parcel: Parcel) -> Bools:
    """Which packets arrive on the line: all of those of a neighbour."""
    return np.full(parcel.packets, abs(NODES.index(source) - NODES.index(to)) == 1)


class _PeersInARow:
    """Nodes that run a tracker; `rounds`: the number of exchanges in each step; `sent`: bits."""

    def __init__(self, tracker: HeadlessTracker, table: Table, lose: Lose = beside) -> None:
        self.tracker, self.table, self.lose = tracker, table, lose
        self.members = table.members(NODES)
        self.rounds, self.sent = 0, 0

    def run(self, steps: int = len(STEPS)) -> Iterator[list[Estimate]]:
        """The estimates of all nodes, after each step."""
        tracker, now = self.tracker, 0
        last = self.members[NODES[-1]]
        for member in [each for each in self.members.values() if each is not last]:
            tracker.begin(member, self.table.prior)
        tracker.join(last, copy.deepcopy(self._checked(tracker.announcement, self.members[NODES[0]]).payload))
        for passed, ids in STEPS[:steps]:
            now, self.rounds = now + passed, 0
            scene = self.table.scene(now, passed, self.members, NODES[0], ids)
            empty: Any = {name: getattr(scene, name)[:0] for name in ("ids", "positions", "traits", "roster")}
            perform(tracker.step(replace(scene, **empty, head=-1)), self.members, -1, self.lose, None, self._answer)
            beliefs = [tracker.belief_of(member) for member in self.members.values()]
            estimates = [tracker.estimate(belief) for belief in beliefs]
            demand_sound([*estimates, tracker.forecast(beliefs[0], scene, 2)])
            yield estimates

    def _answer(self, request: Request, members: dict[int, Member], head: int, lose: Lose) -> Any:
        assert isinstance(request, Local | Exchange), (
            f"{type(request).__name__}: without a head, use Local and Exchange"
        )
        request = replace(request, who=tuple(members) if request.who is None else request.who)
        if isinstance(request, Exchange):
            self.rounds += 1
            request = replace(request, parcel_of=partial(self._checked, request.parcel_of))
        else:
            examine(request, members)
        return copy.deepcopy(answer_to(request, members, head, lose))

    def _checked(self, parcel_of: Any, member: Member) -> Any:
        """A parcel with a payload of its own, once its bits are enough."""
        parcel = parcel_of(member)
        if parcel is not None:
            demand_enough_bits(parcel, self.table.known)
            self.sent += parcel.packets * parcel.packet_bits
            parcel = replace(parcel, payload=copy.deepcopy(parcel.payload))
        return parcel


def check_headless(tracker: HeadlessTracker, motion: MotionModel, sensor: SensorModel, seed: int) -> None:
    """Check a tracker that runs on every participant; see `check_tracker` for the rules.

    Raises:
        AssertionError: The tracker breaks a rule, which the message names.
    """
    tracker = examined(tracker, Tracker, len(motion.columns))
    plain = Table(motion, sensor, seed)
    with demand("sound"):
        line = _PeersInARow(tracker, plain)
        first = list(line.run())
        assert line.sent > 0, "nothing ever crosses the air"
    with demand("repeatable"):
        again = list(_PeersInARow(tracker, Table(motion, sensor, seed)).run())
        assert _equal(first, again).all(), "the same seed gives two different tracks"
    altered = partial(Table, motion, sensor, seed, lambda node, value: another(value) if node == NODES[0] else value)
    for name, lose in (("locality", beside), ("silence", silent)):
        with demand(name):
            line = _PeersInARow(tracker, Table(motion, sensor, seed), lose)
            other = _PeersInARow(tracker, altered(), lose)
            kept = _equal(list(line.run(1)), list(other.run(1)))[0]
            reach = line.rounds if lose is beside else 0
            assert kept[reach + 1 :].all(), f"a reading arrives farther away than over {reach} hops"
    with demand("loss"):
        for share in (0.3, 0.9):
            list(_PeersInARow(tracker, Table(motion, sensor, seed), _lossy(share, seed)).run())


def _lossy(share: float, seed: int) -> Lose:
    rng = np.random.default_rng(seed)
    return lambda source, to, parcel: beside(source, to, parcel) & (rng.random(parcel.packets) > share)


def _equal(one: list[list[Estimate]], other: list[list[Estimate]]) -> Bools:
    """(steps, nodes) whether estimates are the same bit for bit."""
    pairs = [zip(a, b, strict=True) for a, b in zip(one, other, strict=True)]
    return np.array([[same((a.mean, a.cov), (b.mean, b.cov)) for a, b in pair] for pair in pairs])
