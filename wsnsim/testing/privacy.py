"""Checks that a Local reads and changes its own member alone, and that a tracker predicts by `scene.steps` model steps.

The work is repeated with other values at the other members, and everything is restored. If the work reads another
member indirectly (a member kept from an earlier call, a shared dictionary), its result changes.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Estimate, Floats
from wsnsim.base.ports import MotionModel, SensorModel, Tracker
from wsnsim.base.requests import Local, Member, Request
from wsnsim.base.rng import derive
from wsnsim.testing.table import DT, FIRST, Play, Table, another
from wsnsim.trackers.shared.moments import stepped


def examine(request: Request, members: dict[int, Member]) -> None:
    """Check the work of a Local; other requests are ignored.

    Raises:
        AssertionError: The work depends on, or changes, another member, or `work_all` does not give the same bits as
            `work` for each member.
    """
    if not isinstance(request, Local):
        return
    who = (
        [node for node, member in members.items() if member.reading is not None] if request.who is None else request.who
    )
    addressed = [members[node] for node in who if node in members]
    kept = SavedMembers(members)
    alone = _one_by_one(request, addressed, members)
    kept.restore()
    if request.work_all is not None and addressed:
        request.work_all(addressed)
        for member in addressed:
            assert same(alone[member.id], _state(member)), f"work_all and work differ on node {member.id}"
        kept.restore()
    for member in addressed:
        _among_poisoned(request, member, addressed, members)
        assert same(alone[member.id], _state(member)), f"the work of node {member.id} depends on what others hold"
        kept.restore()


def _one_by_one(request: Local, addressed: list[Member], members: dict[int, Member]) -> dict[int, Any]:
    """The state of each member after its work, with the true values at the other members."""
    alone = {}
    for member in addressed:
        others = {node: _state(other) for node, other in members.items() if node != member.id}
        request.work(member)
        alone[member.id] = _state(member)
        for node, state in others.items():
            assert same(state, _state(members[node])), f"the work of node {member.id} changed node {node}"
    return alone


def _among_poisoned(request: Local, member: Member, addressed: list[Member], members: dict[int, Member]) -> None:
    """Do a member's work after all others have other values and have worked with them."""
    for other in members.values():
        if other is not member:
            _poison(other)
    for other in reversed(addressed):
        if other is not member:
            with suppress(Exception):
                request.work(other)
    request.work(member)


def _state(member: Member) -> Any:
    return copy.deepcopy((member.memory, len(member.inbox)))


def _poison(member: Member) -> None:
    """Change all values of a member in place, so that work which reads them indirectly sees the change."""
    if member.reading is not None:
        member.reading = another(member.reading)
    member.key = derive(member.key, 99)
    member.inbox = []
    for array in _arrays(member.memory):
        array[...] = 1.7 * array[..., ::-1] + 0.3 if array.dtype.kind == "f" else array[..., ::-1]


def _arrays(thing: Any) -> Iterator[np.ndarray]:
    """All writeable arrays with at least one dimension in nested containers."""
    if isinstance(thing, np.ndarray):
        if thing.flags.writeable and thing.ndim:
            yield thing
    elif isinstance(thing, dict):
        for value in thing.values():
            yield from _arrays(value)
    elif isinstance(thing, tuple | list):
        for value in thing:
            yield from _arrays(value)
    elif is_dataclass(thing) and not isinstance(thing, type):
        yield from _arrays(_values(thing))


def _values(thing: Any) -> list[Any]:
    """The values of a dataclass's fields."""
    return [getattr(thing, each.name) for each in fields(thing)]


class SavedMembers:
    """A copy of all members' states, which `restore` writes back into the same objects."""

    def __init__(self, members: dict[int, Member]) -> None:
        self._members = [
            (member, member.reading, member.key, list(member.inbox), dict(member.memory)) for member in members.values()
        ]
        self._contents = [(array, array.copy()) for member in members.values() for array in _arrays(member.memory)]
        self._containers = [
            (member, name, copy.deepcopy(value))
            for member in members.values()
            for name, value in member.memory.items()
            if isinstance(value, list | dict | set)
        ]

    def restore(self) -> None:
        """Restore all members."""
        for member, reading, key, inbox, memory in self._members:
            member.reading, member.key, member.inbox = reading, key, list(inbox)
            member.memory.clear()
            member.memory.update(memory)
        for array, content in self._contents:
            array[...] = content
        for member, name, value in self._containers:
            member.memory[name] = copy.deepcopy(value)


def same(first: Any, second: Any) -> bool:
    """Whether two nested values are equal bit for bit."""
    if isinstance(first, np.ndarray):
        return isinstance(second, np.ndarray) and first.shape == second.shape and first.tobytes() == second.tobytes()
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same(value, second[key]) for key, value in first.items())
    if isinstance(first, tuple | list):
        return len(first) == len(second) and all(same(a, b) for a, b in zip(first, second, strict=True))
    if is_dataclass(first) and not isinstance(first, type):
        return type(first) is type(second) and same(_values(first), _values(second))
    return bool(first == second) or (first != first and second != second)


STEPS: Final = 5
"""Model steps since the belief's time at a head that missed all but the last of them."""
LEAST: Final = 1e-9
"""Relative difference of moments from which on they are different, and not only rounded differently."""
MOMENTS: Final = ("mean", "cov")
NEAR: Final = 0.1
"""A mean has been predicted by the model if it is nearer to the model's than this share of the way to it."""
ADVICE: Final = (
    "scene.steps is the number of model steps since the belief's time. Predict as often, from the time scene.since: "
    "for step in range(scene.steps): mean = scene.motion.advance(mean, scene.dt, scene.since + step * scene.dt), and "
    "the covariance beside it; wsnsim.plugins.predicted(mean, cov, scene) does both"
)


@dataclass(frozen=True)
class _Trial:
    """A track of a start and one step. `begin` is the number of the step at which it starts, `steps` those after it.

    Trials differ in times and in nothing else: target, readings and keys are the same.
    """

    begin: int
    steps: int
    dt: float = DT

    def played(self, tracker: Tracker[Any], table: Table, ids: tuple[int, ...]) -> tuple[Estimate, Estimate]:
        """Return the estimates after the start and after the step, at which the members `ids` have a reading."""
        play = Play(table)
        play.lead(FIRST)
        scene = replace(play.scene(0, 0, FIRST), step=self.begin, time=self.begin * DT)
        belief = play.drive(tracker.start(table.prior, scene))
        before, now = tracker.estimate(belief), self.begin + self.steps
        scene = replace(play.scene(1, self.steps, ids), step=now, time=now * DT, dt=self.dt)
        return before, tracker.estimate(play.drive(tracker.step(belief, scene)))


MISSED: Final = _Trial(0, STEPS)
ONE: Final = _Trial(STEPS - 1, 1)
LONGER: Final = _Trial(STEPS - 1, 1, 2.0 * DT)


def demand_missed_steps(tracker: Tracker[Any], motion: MotionModel, sensor: SensorModel, seed: int) -> None:
    """Check that a tracker that predicts does so over the steps that its head missed.

    Of a filter that always predicts one step, the estimate after five steps is that after one, bit for bit, since all
    random numbers are the same. Filters that predict nothing, and models whose states stay, are left alone, and so are
    covariances that a filter holds constant, as an alpha-beta filter does.

    Raises:
        AssertionError: Mean or covariance depend on the motion model, and not on `scene.steps`.
    """
    for ids in ((), FIRST):
        (before, missed), (_, one) = (
            trial.played(tracker, Table(motion, sensor, seed), ids) for trial in (MISSED, ONE)
        )
        equal = [name for name in MOMENTS if same(getattr(missed, name), getattr(one, name))]
        if not equal or (ids and len(equal) < len(MOMENTS)) or not missed.cov.any():
            continue  # readings may decide the mean alone, and a cloud of one particle has no covariance
        _, longer = LONGER.played(tracker, Table(motion, sensor, seed), ids)
        after_one, after_all = _advanced(motion, before, ONE), _advanced(motion, before, MISSED)
        moved = {
            "mean": not ids and _near(before, one, after_one),
            "cov": not ids and _differ(before.cov, one.cov),
        }
        for name in equal:
            expected, found = getattr(after_all, name), getattr(missed, name)
            depends = moved[name] or _differ(getattr(longer, name), found)
            assert not (depends and _differ(expected, getattr(after_one, name))), _message(name, ids, found, expected)


def _advanced(motion: MotionModel, estimate: Estimate, trial: _Trial) -> Estimate:
    """An estimate, predicted by the motion model over the steps of a trial."""
    return Estimate(*stepped(estimate.mean, estimate.cov, motion, DT, trial.begin * DT, trial.steps))


def _near(before: Estimate, found: Estimate, expected: Estimate) -> bool:
    """Whether a step without readings moved the mean as one step of the model does."""
    way = np.linalg.norm(expected.mean - before.mean)
    return bool(way > 0.0 and np.linalg.norm(found.mean - expected.mean) < NEAR * way)


def _differ(one: Floats, other: Floats) -> bool:
    """Whether two moments are different."""
    return not np.allclose(one, other, rtol=LEAST, atol=LEAST * float(np.abs(one).max(initial=0.0)))


def _message(name: str, ids: tuple[int, ...], found: Floats, expected: Floats) -> str:
    what, values = ("mean", [found, expected]) if name == "mean" else ("covariance", [*map(np.diag, (found, expected))])
    shown, wanted = ("diagonal " * (name != "mean") + np.array2string(each, precision=4) for each in values)
    readings = "with the readings of all members" if ids else "without a reading"
    by_model = "" if ids else f" (by the motion model {wanted})"
    return (
        f"the head missed {STEPS - 1} steps and then made one, {readings}: scene.steps was {STEPS}. The {what} was "
        f"expected to be predicted over {STEPS} steps{by_model}; it is that of scene.steps = 1, bit for bit: {shown}. "
        f"{ADVICE}"
    )
