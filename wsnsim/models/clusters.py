"""Cluster policies: which node leads, when it hands over, and to which node.

elect(ids, strengths, able) -> id or None      must_hand_over(active, members) -> bool
successor(forecast (2,), positions (N, 2), able (N,)) -> id or None
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from typing import Annotated, ClassVar, Final, Literal, TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.errors import Issue
from wsnsim.base.medium_access import is_duty_cycled, window_of
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import NetworkSetup
from wsnsim.models.bounds import MOST_NODES, PLACE, SECONDS

SAMPLED: Final = 64
"""Every 64th node is tried first, for a bound on the distance of the nearest."""
ROUNDING: Final = 1e-9
"""Relative error that the bound allows for."""
WAITS: Final = Quantity("s", ge=1e-6, le=1e6)
Threshold: TypeAlias = Annotated[
    float | None, Quantity("J", ge=0, lt=inf), "charge a head must exceed; left out: one step's"
]


class LeadsByPlace:
    """What policies share: the strongest is elected, the nearest succeeds, and a battery must be large enough."""

    def elect(self, ids: Sequence[int], strengths: Sequence[float], able: Sequence[bool]) -> int | None:
        """The able candidate with the strongest reading, of equal ones the lowest id; None if none is able."""
        candidates = [(-strength, i) for i, strength, fit in zip(ids, strengths, able, strict=True) if fit]
        return min(candidates)[1] if candidates else None

    def must_hand_over(self, active: int, members: int) -> bool:
        """Never: the numbers of nodes decide nothing."""
        return False

    def successor(self, forecast: Floats, positions: Floats, able: Bools) -> int | None:
        """The able node nearest to the predicted position (2,); None if none is able."""
        return nearest_able(forecast, positions, able)

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """Yield an issue if no battery is large enough for a head."""
        energy, least, source = setup.energy, setup.head_threshold, "clusters.threshold"
        if setup.clusters.threshold is None:
            source = f"a packet sent over {setup.link.reach:g} m, one received, and the computation of a step"
        if energy.battery <= least and setup.plain_batteries:
            yield Issue(
                ("energy", "battery"),
                f"{energy.battery:g} J is too little for any head: a head must hold more than {least:g} J ({source})",
            )


@part
class StrongestSignal(LeadsByPlace):
    """The node with the strongest reading leads, until too few members of its cluster sense the target.

    The head hands over when N_act < `minimum_active` or N_act / N_cluster < `handover_fraction`. The node nearest to
    the predicted position leads next, or calls an election (`successor_rule: elect`, the paper's other reading).

    A head must hold more charge than `threshold`. Left out, that is the energy to send one packet over the
    communication range, to receive one and to compute one step (our reading of the paper's energy threshold).

    Source: Jiang, Song, Lin (2013), section 2.3.
    """

    handover_fraction: Annotated[
        float, Quantity("", ge=0, le=1), "hand over below this share of members that sense"
    ] = 0.25
    minimum_active: Annotated[int, Quantity("", ge=1, le=MOST_NODES), "hand over when fewer sense, head included"] = 3
    successor_rule: Annotated[Literal["nearest", "elect"], "who leads next"] = "nearest"
    threshold: Threshold = None

    @property
    def protocol(self) -> str:
        """'electing' if the node nearest to the forecast calls an election instead of leading, else 'standing'."""
        return "electing" if self.successor_rule == "elect" else "standing"

    def must_hand_over(self, active: int, members: int) -> bool:
        """Whether fewer members sense than the minimum or the fraction; both counts include the head."""
        return active < self.minimum_active or active / members < self.handover_fraction


@part
class Central(LeadsByPlace):
    """An open cluster: one fixed head near (x, y), to which every node belongs that senses the target.

    A reference for trackers that use every reading; our choice, from no paper. There are no elections: `successor`
    appoints the head, at the start and after the death of the last one, wherever the target is.
    """

    protocol: ClassVar[str] = "open"
    minimum_active: ClassVar[int] = 0

    x: Annotated[float, PLACE, "the head is the able node nearest to (x, y)"] = 0.0
    y: Annotated[float, PLACE, "the head is the able node nearest to (x, y)"] = 0.0
    threshold: Threshold = None

    def elect(self, ids: Sequence[int], strengths: Sequence[float], able: Sequence[bool]) -> int | None:
        """None: the head is not elected."""
        return None

    def successor(self, forecast: Floats, positions: Floats, able: Bools) -> int | None:
        """The able node nearest to (x, y), wherever the target is; None if none is able."""
        return nearest_able(np.array([self.x, self.y]), positions, able)


@part
class MovingHead(LeadsByPlace):
    """A head that is chosen again at each step, and members that were woken for the step.

    With `main: prediction` the head is the node nearest to the predicted position among those woken for the step; with
    `main: detection` the node that measured the target nearest at the step before. Measuring takes `sampling`. The head
    waits for readings until none has come for `quiet`, at most for `cap`. Without a reading it continues its prediction
    for `patience`; then the track is lost, and awake nodes search for the target.

    Left out, `quiet` and `cap` are 12 ms and 50 ms on a radio that always listens. Where it is mostly off they are 1.5
    and 4 times what a hop takes at most, and not more than 0.6 of a step, if a hop fits into that.

    Source: Li, Jiang, Zhang, Zhang (2012), section 2.2, where the head is called main node. The times are our choice,
    since the paper gives none.
    """

    protocol: ClassVar[str] = "moving"
    minimum_active: ClassVar[int] = 1

    main: Annotated[Literal["prediction", "detection"], "what decides which node leads at the next step"] = "prediction"
    sampling: Annotated[float, SECONDS, "time to take a reading"] = 2e-3
    quiet: Annotated[
        float | None, WAITS, "time without a reading, after which the head waits no longer; left out: by the MAC"
    ] = None
    cap: Annotated[float | None, WAITS, "time for which the head waits at most; left out: by the MAC"] = None
    patience: Annotated[float, SECONDS, "time for which the head continues its prediction without a reading"] = 3.0
    threshold: Threshold = None

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """Yield an issue if no node could lead, if times do not fit, or if `wakeup` or `tracker` cannot be combined."""
        yield from LeadsByPlace.check(self, setup)
        yield from self._bad_waits(setup)
        mechanism = setup.wakeup.mechanism
        if self.main == "prediction" and mechanism == "none":
            yield Issue(
                ("clusters", "main"),
                "with wakeup: none no node is woken that could lead by prediction: use main: detection",
            )
        if self.main == "detection" and mechanism == "region":
            yield Issue(
                ("clusters", "main"),
                "with wakeup: region the node nearest to the prediction leads: use main: prediction",
            )
        if setup.member_cycles > 0:
            yield Issue(
                ("clusters", "kind"),
                "the members change at each step: the tracker must keep its belief in the head (gmtt, tsstp, cluster, "
                "ris, ekf, pf ...), and this one distributes it over the members",
            )

    def _bad_waits(self, setup: NetworkSetup) -> Iterator[Issue]:
        """Yield issues: waits that do not fit into each other or into a step, or that end before a reading can come."""
        quiet, cap = window_of(self.quiet, self.cap, setup.waits)
        if quiet > cap:
            yield Issue(("clusters", "quiet"), f"{quiet:g} s is more than cap = {cap:g} s")
        longest = self.sampling + cap
        if longest >= setup.dt:
            yield Issue(("clusters", "cap"), f"measuring and waiting take {longest:g} s, a step lasts {setup.dt:g} s")
        for key, given in (("quiet", self.quiet), ("cap", self.cap)):
            if given is not None and given < setup.hop.unicast and is_duty_cycled(setup.mac):
                yield Issue(
                    ("clusters", key),
                    f"{given:g} s is over before a reading can arrive: over mac: {setup.mac.mechanism} a unicast takes "
                    f"up to {setup.hop.unicast:.3g} s; give at least {setup.hop.unicast:.3g} s, or leave it out",
                )
                return


@part
class NoHead(LeadsByPlace):
    """No cluster head: every node that senses the target, or is near its own prediction, runs the filter.

    A node that begins to sense broadcasts a request; of the participants that hear it, the nearest one broadcasts its
    belief. After each step the participant that is nearest to its own prediction invites the nodes near it that are
    none yet, by its belief, each at most three times. So nodes without a reading carry the belief across a gap between
    those that sense, if `radius` is larger than the sensing range. Where nobody participates, the nodes that sense
    broadcast their readings, and each takes its first estimate from those that it heard. All that is paid.
    Idealisations, our choice: participants know which of them is the nearest, and a round of broadcasts ends for all
    when the last one has ended.

    The estimate of one participant, the gateway, is recorded, and reported if there is a sink.
    """

    protocol: ClassVar[str] = "none"
    minimum_active: ClassVar[int] = 0
    threshold: ClassVar[float] = 0.0

    radius: Annotated[
        float | None, Quantity("m", ge=0, le=1e6), "farthest from the prediction; left out: the communication range"
    ] = None
    gateway: Annotated[
        Literal["sink", "target"], "the participant nearest to it reports; without a sink, always the target"
    ] = "sink"

    def check(self, setup: NetworkSetup) -> Iterator[Issue]:
        """Yield an issue for a run that ends with a cluster."""
        if setup.until_clusters is not None:
            yield Issue(("until",), "without a head there are no clusters to end at")


def nearest_able(point: Floats, positions: Floats, able: Bools) -> int | None:
    """The able node nearest to a point; of equally near ones the lowest id.

    A sample of the able nodes bounds its distance; then only nodes within that distance in x are compared.
    """
    some = positions[::SAMPLED][able[::SAMPLED]]
    limit = np.sqrt(_squared(some, point).min(initial=np.inf)) * (1.0 + ROUNDING)
    near = np.flatnonzero((np.abs(positions[:, 0] - point[0]) <= limit) & able)
    return int(near[np.argmin(_squared(positions[near], point))]) if near.size else None


def _squared(positions: Floats, point: Floats) -> Floats:
    squared: Floats = ((positions - point) ** 2).sum(axis=1)
    return squared
