"""The port of cluster policies: which node leads a cluster, and until when."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, Protocol

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.deprecation import uses_former


class ClusterPolicy(Protocol):
    """Which node leads a cluster, and until when.

    `protocol` names what heads do:
    - 'standing': a cluster keeps its head until too few members sense; then the successor leads.
    - 'electing': the same, but the successor calls an election.
    - 'open': the head that `successor` names leads; every node that senses belongs to the cluster, without a frame.
    - 'moving': the head is chosen again at each step; see `MovingPolicy`.
    """

    @property
    def protocol(self) -> str:
        """The name of what heads do."""

    @property
    def minimum_active(self) -> int:
        """The number of sensing members, the head included, below which a new cluster holds an election."""

    @property
    def threshold(self) -> float | None:
        """The charge in J that a head must exceed; None: the paper's rule."""

    def elect(self, ids: Sequence[int], strengths: Sequence[float], able: Sequence[bool]) -> int | None:
        """The head among candidates, given each one's strength and whether its charge exceeds the threshold."""

    def must_hand_over(self, active: int, members: int) -> bool:
        """Whether too few of the members sense."""

    def successor(self, forecast: Floats, positions: Floats, able: Bools) -> int | None:
        """The next head, given the predicted position (2,), all nodes' positions (N, 2) and who is able (N,)."""


class MovingPolicy(ClusterPolicy, Protocol):
    """A policy of moving heads.

    `main`: the head is the node nearest to the 'prediction' among those woken for the step, or the one that measured
    the target nearest at the step before ('detection'). Measuring takes `sampling` s. The head waits for readings until
    none has come for `quiet` s, at most for `cap` s. Without readings it continues its prediction for `patience` s
    before the track is lost.
    """

    main: str
    sampling: float
    quiet: float
    cap: float
    patience: float


def head_protocol(policy: Any) -> str:
    """The name of a policy's head protocol.

    A policy written before `protocol` existed has the flags `is_open`, `moves` and `calls_election` instead.
    """
    flags = {"is_open": "open", "moves": "moving", "calls_election": "electing"}
    name = getattr(policy, "protocol", None)
    if name is not None and not any(uses_former(policy, flag, "protocol") for flag in flags):
        return str(name)
    warnings.warn(
        f"{type(policy).__name__}: the flags is_open, moves and calls_election of a cluster policy are replaced by "
        "`protocol`: 'standing', 'electing', 'open' or 'moving'",
        DeprecationWarning,
        stacklevel=2,
    )
    return next((name for flag, name in flags.items() if getattr(policy, flag, False)), "standing")
