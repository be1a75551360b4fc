"""Who leads, who follows, and until when.

    elect(ids, strengths, able) -> id or None      must_hand_over(active, members) -> bool
    successor(forecast (2,), positions (N, 2), able (N,)) -> id or None

`is_open` clusters take in whoever senses, without a frame; the members of the others are fixed when they form.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import NetworkSetup
from wsnsim.models.bounds import MOST_NODES, PLACE

SAMPLED: Final = 64
"""Every how many nodes one is tried, to bound how far the nearest is."""
ROUNDING: Final = 1e-9
TIMES: Final = Quantity("s", ge=0.0, le=1e6)
WAITS: Final = Quantity("s", ge=1e-6, le=1e6)


@part
class StrongestSignal:
    """The loudest node leads, until too few of its members sense the target.

    Handover when N_act < `minimum_active`, or N_act / N_cluster < `handover_fraction`; the node nearest to the
    predicted target then leads, or calls an election (`successor_rule: elect`, the paper's other reading).

    A head must hold more than `threshold`: left out, what it takes to send a packet at reach, to receive one and to
    compute one step (our reading of the paper's energy threshold).

    Source: Jiang, Song, Lin (2013), section 2.3.
    """

    handover_fraction: Annotated[
        float, Quantity("", ge=0, le=1), "hand over below this share of members that sense"
    ] = 0.25
    minimum_active: Annotated[int, Quantity("", ge=1, le=MOST_NODES), "hand over when fewer sense, head included"] = 3
    successor_rule: Annotated[Literal["nearest", "elect"], "who leads next"] = "nearest"
    threshold: Annotated[
        float | None, Quantity("J", ge=0, lt=inf), "charge a head must exceed; left out: one step's"
    ] = None

    @property
    def protocol(self) -> str:
        """'electing' if the node nearest to the forecast calls an election instead of leading, else 'standing'."""
        return "electing" if self.successor_rule == "elect" else "standing"

    def elect(self, ids: Sequence[int], strengths: Sequence[float], able: Sequence[bool]) -> int | None:
        """The loudest of those able; of equally loud ones the lowest id. None if nobody is able."""
        return _loudest(ids, strengths, able)

    def must_hand_over(self, active: int, members: int) -> bool:
        """Whether too few of `members`, the head included, sense: fewer than the minimum, or than the fraction."""
        return active < self.minimum_active or active / members < self.handover_fraction

    def successor(self, forecast: Floats, positions: Floats, able: Bools) -> int | None:
        """The able node nearest to the predicted position (2,). None if nobody is able."""
        return _nearest(forecast, positions, able)

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """A battery that lets nobody lead."""
        yield from _too_little_charge(setup)


@part
class Central:
    """A cluster for reference: one head for good, near a fixed point, and whoever senses is a member.

    Our choice, for trackers that know every reading; no paper's protocol. Nobody is elected: `successor` appoints the
    head, at the start and when the old one has died, wherever the target is.
    """

    protocol: ClassVar[str] = "open"
    minimum_active: ClassVar[int] = 0

    x: Annotated[float, PLACE, "the head is the able node nearest to (x, y)"] = 0.0
    y: Annotated[float, PLACE, "the head is the able node nearest to (x, y)"] = 0.0
    threshold: Annotated[
        float | None, Quantity("J", ge=0, lt=inf), "charge a head must exceed; left out: one step's"
    ] = None

    def elect(self, ids: Sequence[int], strengths: Sequence[float], able: Sequence[bool]) -> int | None:
        """None: the head is appointed by its place, not elected."""
        return None

    def must_hand_over(self, active: int, members: int) -> bool:
        """Never."""
        return False

    def successor(self, forecast: Floats, positions: Floats, able: Bools) -> int | None:
        """The able node nearest to (x, y), wherever the target goes. None if nobody is able."""
        return _nearest(np.array([self.x, self.y]), positions, able)

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """A battery that lets nobody lead."""
        yield from _too_little_charge(setup)


@part
class MovingHead:
    """A main node anew at each step, and nodes that were told to track: no cluster that stands.

    `prediction`: the main node is the one nearest to the predicted position among those woken for the step;
    `detection`: the one that read the target nearest at the step before. It takes `sampling` to take a reading; the
    main node waits for readings until none has come for `quiet`, at most for `cap`. Without a reading it coasts on its
    prediction for `patience`; then the track is lost, and nodes that are awake look for the target.

    Source: Li, Jiang, Zhang, Zhang (2012), section 2.2; the times are our choice, as the paper gives none.
    """

    protocol: ClassVar[str] = "moving"
    minimum_active: ClassVar[int] = 1

    main: Annotated[Literal["prediction", "detection"], "what decides who leads at the next step"] = "prediction"
    sampling: Annotated[float, TIMES, "to take a reading"] = 2e-3
    quiet: Annotated[float, WAITS, "without a reading, after which the main node waits no longer"] = 12e-3
    cap: Annotated[float, WAITS, "for which the main node waits at most"] = 50e-3
    patience: Annotated[float, TIMES, "for which the main node coasts without a reading"] = 3.0
    threshold: Annotated[
        float | None, Quantity("J", ge=0, lt=inf), "charge a head must exceed; left out: one step's"
    ] = None

    def elect(self, ids: Sequence[int], strengths: Sequence[float], able: Sequence[bool]) -> int | None:
        """The loudest of those able; of equally loud ones the lowest id. None if nobody is able."""
        return _loudest(ids, strengths, able)

    def must_hand_over(self, active: int, members: int) -> bool:
        """Never: who leads is settled anew at each step."""
        return False

    def successor(self, forecast: Floats, positions: Floats, able: Bools) -> int | None:
        """The able node nearest to the predicted position (2,). None if nobody is able."""
        return _nearest(forecast, positions, able)

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """A battery that lets nobody lead; times that do not fit; a wake-up or a tracker that does not go with it."""
        yield from _too_little_charge(setup)
        if self.quiet > self.cap:
            yield Issue(("clusters", "quiet"), f"{self.quiet:g} s is more than cap = {self.cap:g} s")
        if self.sampling + self.cap >= setup.dt:
            longest = self.sampling + self.cap
            yield Issue(("clusters", "cap"), f"readings would come in for {longest:g} s, a step lasts {setup.dt:g} s")
        mechanism = setup.wakeup.mechanism
        if self.main == "prediction" and mechanism == "none":
            yield Issue(
                ("clusters", "main"),
                "where nobody is woken nobody can lead by a prediction: use main: detection",
            )
        if self.main == "detection" and mechanism == "region":
            yield Issue(
                ("clusters", "main"),
                "with wakeup: region the node nearest to the prediction leads: use main: prediction",
            )
        if getattr(setup.tracker, "member_cycles", 0.0) > 0:
            yield Issue(
                ("clusters", "kind"),
                "the members change at each step: the tracker must keep its belief in the head (gmtt, tsstp, cluster, "
                "ris, ekf, pf ...), and this one spreads it over the members",
            )


def _loudest(ids: Sequence[int], strengths: Sequence[float], able: Sequence[bool]) -> int | None:
    candidates = [(-strength, i) for i, strength, fit in zip(ids, strengths, able, strict=True) if fit]
    return min(candidates)[1] if candidates else None


def _nearest(point: Floats, positions: Floats, able: Bools) -> int | None:
    """The able node nearest to a point; of equally near ones the lowest id.

    Some of the able bound its distance; only who is no farther in x is then looked at.
    """
    some = positions[::SAMPLED][able[::SAMPLED]]
    limit = np.sqrt(_squared(some, point).min(initial=np.inf)) * (1.0 + ROUNDING)
    near = np.flatnonzero((np.abs(positions[:, 0] - point[0]) <= limit) & able)
    return int(near[np.argmin(_squared(positions[near], point))]) if near.size else None


def _squared(positions: Floats, point: Floats) -> Floats:
    squared: Floats = ((positions - point) ** 2).sum(axis=1)
    return squared


def _too_little_charge(setup: NetworkSetup) -> Iterator[Issue]:
    """A full battery that does not exceed the threshold, or else what a packet each way and a step take."""
    energy, least, source = setup.energy, setup.head_threshold, "clusters.threshold"
    if setup.clusters.threshold is None:
        source = f"a packet sent over {setup.link.reach:g} m, one received, and a step's computing"
    if energy.battery <= least:
        yield Issue(
            ("energy", "battery"),
            f"{energy.battery:g} J lets nobody lead: a head must hold more than {least:g} J ({source})",
        )
