"""A filter in the head at the bound, and members that send only what is worth its energy.

Requests of a step:

    Broadcast: plan                      only when the last plan no longer fits
    Local        each member that senses extrapolates the plan, and decides
    Gather: reading  Compute
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, ClassVar, Final, TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Estimate, Floats
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Broadcast, Compute, Flow, Gather, Local, NodeId, Parcel, Send
from wsnsim.trackers.shared.heads import GaussianBelief, HeadFilter
from wsnsim.trackers.shared.mixtures import (
    PREDICTION_CYCLES,
    Hypotheses,
    Hypothesis,
    Kept,
    by_step,
    filter_cycles,
    filtered,
    moments_of,
    predicted_mixture,
    reduced,
)
from wsnsim.trackers.shared.readings import arrived_groups, number_packets, parcel
from wsnsim.trackers.shared.selection import (
    DECISION_CYCLES,
    EXTRAPOLATION_CYCLES,
    WORTH_CYCLES,
    Candidates,
    Expected,
    SelectionPlan,
    asks,
    candidates,
    extrapolated,
    first_expected,
    fits,
    outgoing,
    packet_joules,
    planned,
    prepare,
    senders,
)

SETTLED: Final = 0.01
"""A track is settled if its standard deviation is below this share of the distance to the members."""
SLACK: Final = 3.0
"""A plan is kept while it asks for the share `keep` to this power of the information."""
EXCESS: Final = 4.0
"""A plan is kept while the packets that it asks for cost less than this many times the least that share needs."""
HASTE: Final = 1.2
LATENESS: Final = 1.4
"""Readings wait for their packet while the mean square error grows by less than `HASTE` in each step that
they wait; a plan that makes them wait is kept until it grows by more than `LATENESS`."""
DEADLINE: Final = 0.6
LATEST: Final = 0.9
"""Shares of a step after which the head goes on, and after which it does so at the latest if a hop takes longer."""
TRIES: Final = 3
"""How often a head sends to its successor what has not arrived there."""
MISSED: Final = 3
"""A plan is replaced if this number of members reply that it did not ask: they have not received it."""
REVIEW: Final = 4
"""Steps from one review of a plan to the next."""
CANDIDATE_CYCLES: Final = 60.0
"""Operations by which the information in a member's reading, and the price of its packet, are computed."""


@dataclass(frozen=True, slots=True)
class PlannedBelief(GaussianBelief):
    """The mixture, its moments, the plan that the members have, and the last steps."""

    mixture: Hypotheses = ()
    plan: SelectionPlan | None = None
    expected: Expected | None = None
    kept: tuple[Kept, ...] = ()


Planned: TypeAlias = tuple[SelectionPlan | None, Expected | None, Callable[[], tuple[NodeId, ...]] | None]
"""The plan, what it makes its members expect, and who is expected to send; None: as announced before."""


@part
class InformationDriven(HeadFilter):
    """A near-exact filter in the head, and members that send only readings that are worth their energy.

    The filter: the posterior of the position is a Gaussian whose moments are integrated about its mode (see
    `shared.posteriors`), or several where the law of motion changes under it, as at the walls of `bounded_velocity`
    (`shared.mixtures`). The other columns follow by their regression.

    The readings: once the track is settled, the head broadcasts a plan, in two packets for a state of four columns (see
    `shared.selection`). It holds the expected state and the least worth of a reading that is sent: the decrease of the
    expected mean square error of the position, per joule of its packet. The threshold is that at which the readings
    hold the share `keep` of the information of all members that the head's map says are in range of its prediction,
    whoever really senses. Members extrapolate the plan and decide for themselves; a reading that is worth much is sent
    at once, others wait until `every` of them fill a packet, and the head computes the steps between once more. Before
    a plan, and without having received one, members send every reading. The head reviews the plan now and then, and
    sends another where it asks for too little, or for far more than it needs, or where the error grows too fast for
    readings to wait. Members that are appointed later receive it with their announcement. If several members
    reply as if they had none, it is replaced.

    On a radio that takes time the head goes on when the share `deadline` of a step is over; left out, that is 0.6, or
    more, 0.9 at most, if a hop of the MAC or a round of slots takes longer. A handover carries each Gaussian with its
    weight. The gains of sensors are not estimated.

    Sources: the selection follows Zhao, Shin, Reich (2002), "Information-driven dynamic sensor collaboration", IEEE
    Signal Processing Magazine 19(2), doi:10.1109/79.985685, and Joshi, Boyd (2009), "Sensor selection via convex
    optimization", IEEE Trans. Signal Processing 57(2), doi:10.1109/TSP.2008.2007095; thresholds that members apply
    themselves, packed readings and the way they are joined with the filter are our choice.
    """

    relative_readings: ClassVar[bool] = False

    keep: Annotated[
        float,
        Quantity("", gt=0, le=1),
        "share of the members' information that is asked for; 1: all at each step, without a plan",
    ] = 0.95
    deadline: Annotated[
        float | None,
        Quantity("", gt=0, le=1),
        "share of a step after which the head goes on with the readings that arrived; left out: 0.6, or what a hop of "
        "the MAC needs",
    ] = None
    every: Annotated[int, Quantity("", ge=1, le=4), "readings that a member sends in one packet, once settled"] = 2

    def start(self, prior: Estimate, scene: Scene) -> Flow[PlannedBelief]:
        """The prior itself."""
        return _belief((Hypothesis(0.0, prior.mean, prior.cov),), scene.head)
        yield  # a flow without requests

    def step(self, belief: PlannedBelief, scene: Scene) -> Flow[PlannedBelief]:
        """One step: a new plan if needed; the readings that members send; prediction and update."""
        mixture = predicted_mixture(_mixture_of(belief), scene, scene.since, scene.steps)
        plan, expected, expected_senders = yield from self._plan(belief, mixture, scene)
        yield Local(
            lambda member: prepare([member], scene, self.every),
            DECISION_CYCLES,
            lambda members: prepare(members, scene, self.every),
            uses_readings=False,
        )
        reply = yield Gather(
            outgoing,
            deadline=self._seconds(scene),
            expected=expected_senders,
            expected_cycles=REVIEW * (EXTRAPOLATION_CYCLES + WORTH_CYCLES * len(scene.known.ids)),
        )
        if plan is not None and expected is not None:
            yield Compute(EXTRAPOLATION_CYCLES * (scene.step - expected.step) + WORTH_CYCLES * len(reply))
            expected = extrapolated(expected, scene)
            if _missed(plan, expected, reply, scene) >= MISSED:
                plan = expected = None
        arrived = by_step(reply, scene)
        kept = filtered(belief.kept, mixture, arrived, scene)
        yield Compute(filter_cycles(kept, arrived, scene))
        after = _belief(kept[-1].mixture, scene.head)
        return replace(after, plan=plan, expected=expected, kept=kept[-self.every :] if self.every > 1 else ())

    def _seconds(self, scene: Scene) -> float:
        """The deadline of readings in s. Left out, it leaves time for one hop, and for the estimate after it."""
        if self.deadline is not None:
            return self.deadline * scene.dt
        return max(DEADLINE * scene.dt, min(scene.hop_seconds, LATEST * scene.dt))

    def hand_over(self, belief: PlannedBelief, scene: Scene, successor: int) -> Flow[PlannedBelief | None]:
        """Each Gaussian with its weight: 4 packets for a state of four. Those that do not arrive whole are sent again.

        The plan is not handed over: the best threshold depends on where the next head and its members are. What members
        have not sent yet of earlier steps is not asked for: the question would cost more than it brings.
        """
        missing, size, arrived = _mixture_of(belief), belief.mean.size, []
        each = number_packets(1 + size + size * (size + 1) // 2)
        for _ in range(TRIES):
            sent = parcel(tuple(map(tuple, missing)), each * len(missing), "handover")
            mask: Bools = yield Send(successor, sent)
            whole = arrived_groups(mask, len(missing), each)
            arrived += [one for one, came in zip(missing, whole, strict=True) if came]
            missing = tuple(one for one, came in zip(missing, whole, strict=True) if not came)
            if not missing:
                break
        return _belief(reduced(arrived), successor) if arrived else None

    def announcement(self, belief: PlannedBelief, scene: Scene) -> Parcel | None:
        """The plan that the other members have, for those that are appointed later."""
        return None if belief.plan is None else belief.plan.in_parcel()

    def _plan(self, belief: PlannedBelief, mixture: Hypotheses, scene: Scene) -> Flow[Planned]:
        """The plan that the members have, broadcast where the last one does not fit; at a review, who will send."""
        plan, expected = belief.plan, belief.expected
        if self.keep >= 1.0:
            return None, None, None
        if plan is not None and expected is not None:
            if (scene.step - plan.step) % REVIEW:
                return plan, expected, None
            yield Compute(EXTRAPOLATION_CYCLES * (scene.step - expected.step))
            expected = extrapolated(expected, scene)
        mean, cov = moments_of(mixture)
        place = list(scene.motion.position)
        spread, point = cov[place][:, place], mean[place]
        those = candidates(point, scene)
        yield Compute(CANDIDATE_CYCLES * len(scene.known.ids))
        if not those.rows.size or not self._settled(spread, point, those, scene):
            return plan, expected, None
        ahead = PREDICTION_CYCLES * len(mixture) * (self.every - 1)
        yield Compute(ahead + WORTH_CYCLES * those.rows.size)
        limits = self.keep**SLACK, EXCESS
        growth = _growth(mixture, scene, self.every)
        every = _most_steps(growth, HASTE)
        paced = plan is not None and every <= plan.every <= _most_steps(growth, LATENESS)
        if not (paced and plan and expected and fits(plan, expected.state, spread, those, scene, limits)):
            plan = planned(mean, spread, those, self.keep, every, scene.step)
            expected = first_expected(plan)
            yield Broadcast(plan.in_parcel())
        return plan, expected, partial(senders, plan, expected, REVIEW, scene)

    def _settled(self, spread: Floats, point: Floats, those: Candidates, scene: Scene) -> bool:
        places = scene.known.positions[those.rows][:, : point.size]
        return bool(np.diag(spread).max() < SETTLED**2 * ((places - point) ** 2).sum(axis=1).mean())


def _growth(mixture: Hypotheses, scene: Scene, every: int) -> list[float]:
    """The mean square error of the position after 0, 1, ... every - 1 steps without a reading, over that of now."""
    place, errors = list(scene.motion.position), []
    for step in range(every):
        if step:
            mixture = predicted_mixture(mixture, scene, scene.time + (step - 1) * scene.dt, 1)
        errors.append(float(moments_of(mixture)[1][place, place].sum()))
    return [each / max(errors[0], np.finfo(np.float64).tiny) for each in errors]


def _most_steps(growth: list[float], limit: float) -> int:
    """The number of steps whose readings may share a packet."""
    return max(steps + 1 for steps, each in enumerate(growth) if each <= limit**steps)


def _belief(mixture: Hypotheses, head: int) -> PlannedBelief:
    return PlannedBelief(*moments_of(mixture), head, mixture=mixture)


def _mixture_of(belief: PlannedBelief) -> Hypotheses:
    return belief.mixture or (Hypothesis(0.0, belief.mean, belief.cov),)


def _missed(plan: SelectionPlan, expected: Expected, reply: Mapping[int, Any], scene: Scene) -> int:
    """How many members answered as if they had no plan: they were not asked, or not at this step."""
    rows = [row for row, node in enumerate(scene.ids) if node in reply and node != scene.head]
    if len(rows) < MISSED:
        return 0
    positions, due = scene.positions[rows], plan.is_due(scene.step)
    asked = asks(plan, expected.state, positions, scene.traits[rows], packet_joules(positions, scene), scene, due)
    return len(rows) - int(asked.sum())
