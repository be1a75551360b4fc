"""When nodes listen: their schedules as functions of time, and when they were held awake or down.

with watched_schedules() as listening:      a run
listening.within(node, since, until)        whether the node listened at some time between
listening.throughout(node, since, until)    whether it listened all the time
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from wsnsim.base.radio import Mode
from wsnsim.network.node_states import SleepStates


class Listening:
    """What the nodes of one run were told to do, and what their schedule says."""

    def __init__(self) -> None:
        self.schedules: Any = None
        self.notes: dict[int, list[tuple[float, Mode]]] = {}

    def within(self, node: int, since: float, until: float) -> bool:
        """Whether a node listened at some time from `since` to `until`; always, if it has no schedule."""
        if self.schedules is None:
            return True
        spans = self._spans(node, since, until)
        return any(mode in (Mode.AWAKE, Mode.DORMANT) for *_, mode in spans) or any(
            mode is Mode.SCHEDULED and self._awake(node, begin, end) for begin, end, mode in spans
        )

    def throughout(self, node: int, since: float, until: float) -> bool:
        """Whether a node listened all the time from `since` to `until`; always, if it has no schedule."""
        if self.schedules is None:
            return True
        return all(
            mode in (Mode.AWAKE, Mode.DORMANT) or (mode is Mode.SCHEDULED and not self._asleep(node, begin, end))
            for begin, end, mode in self._spans(node, since, until)
        )

    def _spans(self, node: int, since: float, until: float) -> list[tuple[float, float, Mode]]:
        """(begin, end, mode) of the spans that touch [since, until]."""
        notes = [(0.0, Mode.SCHEDULED), *self.notes.get(node, []), (np.inf, Mode.DOWN)]
        spans = [(begin, end, mode) for (begin, mode), (end, _) in itertools.pairwise(notes)]
        return [(max(b, since), min(e, until), mode) for b, e, mode in spans if b <= until and e >= since]

    def _awake(self, node: int, since: float, until: float) -> bool:
        """Whether the schedule is awake at some time from `since` to `until`."""
        return any(self._states(node, since, until))

    def _asleep(self, node: int, since: float, until: float) -> bool:
        """Whether the schedule is asleep at some time from `since` to `until`."""
        return not all(self._states(node, since, until))

    def _states(self, node: int, since: float, until: float) -> Iterator[bool]:
        """Whether the schedule is awake, in each span that touches [since, until]."""
        nodes, time = np.array([node]), since
        while True:
            awake, _, ends = self.schedules.state(nodes, time)
            yield bool(awake[0])
            if ends[0] > until or ends[0] <= time:
                return
            time = float(ends[0])


@contextlib.contextmanager
def watched_schedules() -> Iterator[Listening]:
    """Note which nodes leave their schedules in the run that the block makes."""
    listening = Listening()
    begin, note = SleepStates.__init__, SleepStates.note

    def begun(self: SleepStates, rest: Mode = Mode.DORMANT, env: Any = None, schedules: Any = None) -> None:
        begin(self, rest, env, schedules)
        listening.schedules = schedules

    def noted(self: SleepStates, node: int, mode: Mode) -> None:
        if self.rest is Mode.SCHEDULED:
            listening.notes.setdefault(node, []).append((float(self._env.now), mode))
        note(self, node, mode)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SleepStates, "__init__", begun)
        patch.setattr(SleepStates, "note", noted)
        yield listening
