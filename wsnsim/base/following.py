"""Optional port of a recorder that follows a run while it computes, as a live view does.

A follower only reads. It is asked at each step whether it wants the present state, which costs nothing if not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple, Protocol, runtime_checkable

from wsnsim.base.arrays import Floats
from wsnsim.base.rows import Issued
from wsnsim.base.setups import Setup


class RunStart(NamedTuple):
    """What is known of a run before its clock starts.

    Attributes:
        setup: The scenario.
        replicate: Number of the run.
        positions: (N, 2) positions of the nodes in m.
        truths: The states (steps + 1, D) of each target.
    """

    setup: Setup
    replicate: int
    positions: Floats
    truths: Sequence[Floats]


class TrackNow(NamedTuple):
    """The estimates of a target by step, and the cluster heads by step (-1: none), so far. Both grow during the run."""

    target: int
    estimates: Mapping[int, Issued]
    heads: Sequence[int]


class RunNow(NamedTuple):
    """The state of a run at the beginning of a step.

    Attributes:
        step: Number of the step; all steps before it are over, and their events are written.
        time: Simulated time in s.
        tracks: The tracks; of a run without a network, the one that is computed.
        joules: Energy in J that the network has spent so far, by cause; empty without a network.
        residual: (N,) residual energies of the nodes in J, None without a network.
    """

    step: int
    time: float
    tracks: Sequence[TrackNow]
    joules: Sequence[float] = ()
    residual: Floats | None = None


@runtime_checkable
class FollowsRuns(Protocol):
    """A recorder that follows runs while they compute."""

    def begin(self, start: RunStart) -> None:
        """A run begins."""

    def due(self) -> bool:
        """Whether the present state is wanted."""

    def follow(self, now: RunNow) -> None:
        """Take the present state. What it refers to changes when the run goes on."""


class _Nobody:
    """Follows nothing."""

    def begin(self, start: RunStart) -> None:
        pass

    def due(self) -> bool:
        return False

    def follow(self, now: RunNow) -> None:
        pass


NOBODY: Final = _Nobody()


def follower_of(recorder: object) -> FollowsRuns:
    """The recorder, if it follows runs."""
    return recorder if isinstance(recorder, FollowsRuns) else NOBODY
