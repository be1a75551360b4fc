"""The port of cluster policies: which node leads a cluster, and until when."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.outlook import Appointment, Outlook


class ClusterPolicy(Protocol):
    """Which node leads a cluster, and until when.

    `protocol` names what heads do:
    - 'standing': a cluster keeps its head until too few members sense; then the successor leads.
    - 'electing': the same, but the successor calls an election.
    - 'open': the head that `successor` names leads; every node that senses belongs to the cluster, without a frame.
    - 'moving': the head is chosen again at each step; see `MovingPolicy`.
    - 'appointing': the head appoints members from its prediction; see `AppointingPolicy`.
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
        """The head among candidates; None if none is able.

        Args:
            ids: The candidates.
            strengths: Of the reading of each; larger for a nearer target.
            able: Whether the charge of each exceeds the threshold.
        """

    def must_hand_over(self, active: int, members: int) -> bool:
        """Whether too few of the members sense: `active` of `members`, the head included."""

    def successor(self, forecast: Floats, positions: Floats, able: Bools) -> int | None:
        """The next head; None if no node is able.

        Args:
            forecast: (2,) the predicted position in m.
            positions: (N, 2) of all nodes in m.
            able: (N,) who is up and holds enough charge to lead.
        """


class MovingPolicy(ClusterPolicy, Protocol):
    """A policy of moving heads.

    `main`: the head is the node nearest to the 'prediction' among those woken for the step, or the one that measured
    the target nearest at the step before ('detection'). Measuring takes `sampling` s. The head waits for readings until
    none has come for `quiet` s, at most for `cap` s; None: as long as the MAC needs. Without
    readings it continues its prediction for `patience` s before the track is lost.
    """

    main: str
    sampling: float
    quiet: float | None
    cap: float | None
    patience: float


@runtime_checkable
class SeesGeometry(Protocol):
    """Optional port of a cluster policy: decides on handovers from the geometry, not from counts and one point.

    Heads that stand ('standing', 'electing') then ask these methods in place of `must_hand_over` and `successor`.
    """

    def must_appoint(self, outlook: Outlook) -> bool:
        """Whether the cluster must be renewed: by another head, or by more members."""

    def next_head(self, outlook: Outlook) -> int | None:
        """The best head from now on, which may be the present one; None if no node that it considers is able."""


class AppointingPolicy(ClusterPolicy, SeesGeometry, Protocol):
    """A policy of heads that appoint their members.

    If `next_head` names no node, the one that `successor` names leads. Without readings the head continues its
    prediction for `patience` s before the track is lost.
    """

    @property
    def patience(self) -> float:
        """Seconds without a reading after which the track is lost; a single step without one never loses it."""

    def appointment(self, outlook: Outlook) -> Appointment:
        """The rule that the head announces: which nodes are members."""
