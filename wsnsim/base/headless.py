"""The port of trackers in a network without a head: every participant runs the filter on what it holds and receives.

A flow of such a tracker requests `Local` and `Exchange` alone. In both, `who=None` addresses all participants.
"""

from __future__ import annotations

from typing import Any, Protocol

from wsnsim.base.arrays import Estimate
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Flow, Member, Parcel


class HeadlessTracker(Protocol):
    """A tracking strategy without a head. Each participant holds a belief of its own, in its memory.

    A class of this port says `headless: ClassVar[bool] = True`. It says `has_covariance: ClassVar[bool] = False` if the
    covariance of its estimates is none: then no standard deviation and no NEES are recorded.
    """

    def begin(self, member: Member, prior: Estimate) -> None:
        """Begin at a participant, from what it knows of the target: the prior, or a first estimate from readings."""

    def step(self, scene: Scene) -> Flow[None]:
        """One step of all participants.

        Args:
            scene: What every node knows, such as the time and the models; it names no node.
        """

    def belief_of(self, member: Member) -> Any:
        """What a participant believes; None if it has not begun."""

    def announcement(self, member: Member) -> Parcel:
        """What a participant broadcasts to nodes that are to join: its belief."""

    def join(self, member: Member, payload: Any) -> None:
        """Begin at a node from an announcement that arrived whole."""

    def estimate(self, belief: Any) -> Estimate:
        """The estimate of one participant's belief."""

    def forecast(self, belief: Any, scene: Scene, ahead: int) -> Estimate:
        """The estimate predicted for `ahead` steps later, by one participant."""


def port_of(tracker: Any) -> str:
    """The name of the port of a component or a class, if it is a tracker of another port than `Tracker`; else ''."""
    if getattr(tracker, "multi_target", False):
        return "MultiTracker"
    return "HeadlessTracker" if getattr(tracker, "headless", False) else ""
