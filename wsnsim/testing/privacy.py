"""Check that the work of a Local reads and changes its own member alone.

The work is repeated with other values at the other members, and everything is restored. If the work reads another
member indirectly (a member kept from an earlier call, a shared dictionary), its result changes.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from wsnsim.base.requests import Local, Member, Request
from wsnsim.base.rng import derive
from wsnsim.testing.table import another


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
    return bool(first == second) or (first != first and second != second)
