"""Which members send their readings: a plan that the head broadcasts, and by which each member decides for itself.

A reading is worth the decrease of the expected mean square error of the position, tr(P J P) = tr(P² J) for a small
Fisher information J of the reading beside the covariance P, per joule of the packet that carries it to the head. Those
whose worth reaches a threshold are the best set for their energy (the optimality condition of A-optimal selection, its
choices relaxed to shares: Joshi, Boyd 2009). The head chooses the threshold from what its map and its prediction say.
A member extrapolates the expected state by the motion model, which every node knows: it needs no reading of others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Reading, components_of, is_finite
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Member, NodeId, Parcel
from wsnsim.base.sensing import detected, informations
from wsnsim.trackers.shared.readings import number_packets, parcel

PLAN: Final = "plan"
EXPECTED: Final = "expected"
UNSENT: Final = "unsent"
OUTGOING: Final = "outgoing"
READING: Final = "reading"
FEWEST: Final = 3
"""Readings that a plan asks for at least; all, if there are fewer."""
PROMPT: Final = 8.0
"""Readings that are worth this many times what is asked for do not wait for others of the same member."""
STEPS: Final = 2**14
"""A plan is replaced at this age in steps at the latest: its packet carries 14 bits of its step."""
EXTRAPOLATION_CYCLES: Final = 40.0
"""Operations by which an expected state is extrapolated by one step (our estimate)."""
WORTH_CYCLES: Final = 60.0
"""Operations by which the worth of a reading is computed and compared with that of the plan (our estimate)."""
DECISION_CYCLES: Final = EXTRAPOLATION_CYCLES + WORTH_CYCLES
"""Operations of a member that extrapolates the plan and computes the worth of its reading."""


class SelectionPlan(NamedTuple):
    """What members need to decide: D + 4 numbers of 16 bits for a plane, D + 2 for a line; two packets for D = 4.

    The step (modulo `STEPS`, 14 bits) and `every` (2 bits) share one number. Each of the others takes one, with a scale
    that all nodes know; `least` is sent as its logarithm. Values are passed on unrounded, as in other parcels.

    Attributes:
        state: (D,) the expected state at the step `step`.
        weights: the weights of the errors along x and y: none for one column; else (A_xx - A_yy, 2 A_xy) of A, the
            square of the position's covariance, scaled to the trace 1.
        least: the least worth of a reading that is sent, in 1/(m² J).
        every: a member sends what it measured in as many steps in one packet, unless it is worth `PROMPT` times as
            much as `least`: then it sends at each step.
    """

    state: Floats
    weights: tuple[float, ...]
    step: int
    least: float
    every: int

    def is_due(self, step: int) -> bool:
        """Whether members send at a step what they have kept."""
        return (step - self.step) % self.every == 0

    def in_parcel(self) -> Parcel:
        """The plan as it is broadcast."""
        return parcel(self, number_packets(self.state.size + len(self.weights) + 2), PLAN)


class Expected(NamedTuple):
    """The state (D, 1) that the plan makes all who have it expect at a step."""

    step: int
    state: Floats


class Candidates(NamedTuple):
    """The members, the head apart, as the head judges them from its map and its prediction.

    Attributes:
        rows: (n,) their places among the nodes that the scene calls known.
        information: (n, P, P) the Fisher information in a reading of each.
        joules: (n,) the energy of its packet.
        own: (P, P) the information of the head's own reading.
    """

    rows: np.ndarray
    information: Floats
    joules: Floats
    own: Floats


def candidates(point: Floats, scene: Scene) -> Candidates:
    """The nodes taken for members that would have a reading of a target at `point` (P,) with information about it."""
    ids, positions, traits = scene.known
    head = np.array([node == scene.head for node in ids], dtype=np.bool_)
    information = _informations_at(point, positions, traits, scene)
    traces = np.trace(information, axis1=1, axis2=2)
    useful = detected(scene.sensor, point[None], positions)[0] & np.isfinite(traces) & (traces > 0.0)
    rows = np.flatnonzero(useful & ~head)
    joules = packet_joules(positions[rows], scene)
    return Candidates(rows, information[rows], joules, information[useful & head].sum(axis=0))


def _informations_at(point: Floats, positions: Floats, traits: Floats, scene: Scene) -> Floats:
    """(n, P, P) Fisher information in a reading of each node, if the target is at `point` (P,)."""
    return informations(scene.sensor, np.ascontiguousarray(point[:, None]), positions, traits)[..., 0]


def packet_joules(positions: Floats, scene: Scene) -> Floats:
    """(n,) J of a packet from each place to the head; ones where packets cost nothing, so that all cost the same."""
    away = positions - scene.head_position
    joules = scene.packet_joules(np.sqrt((away * away).sum(axis=1)))
    return np.where(joules > 0.0, joules, 1.0)


def weights_of(spread: Floats) -> tuple[float, ...]:
    """The weights of a plan, of the covariance (P, P) of the position."""
    if len(spread) == 1:
        return ()
    square = spread @ spread
    total = square[0, 0] + square[1, 1]
    return float((square[0, 0] - square[1, 1]) / total), float(2.0 * square[0, 1] / total)


def weighed(information: Floats, weights: Sequence[float]) -> Floats:
    """(n,) the weighted informations tr(A J) of informations (n, P, P), in 1/m²."""
    if not weights:
        return information[:, 0, 0]
    along, across = weights
    xx, yy, twice_xy = information[:, 0, 0], information[:, 1, 1], information[:, 0, 1] + information[:, 1, 0]
    return 0.5 * ((1.0 + along) * xx + (1.0 - along) * yy + across * twice_xy)


def planned(mean: Floats, spread: Floats, those: Candidates, keep: float, every: int, step: int) -> SelectionPlan:
    """The plan that asks for the share `keep` of the weighted information of all readings, at the least energy."""
    weights = weights_of(spread)
    weighted = weighed(those.information, weights)
    worth = weighted / those.joules
    order = np.argsort(-worth, kind="stable")
    count = _needed(weighted[order], float(weighed(those.own[None], weights)[0]), keep)
    ranked = worth[order]
    if count == 0:
        least = float(ranked[0]) * 2.0 if ranked.size else 0.0
    elif count == ranked.size:
        least = float(ranked[-1]) * 0.5
    else:
        least = float(np.sqrt(ranked[count - 1] * ranked[count]))
    return SelectionPlan(frozen(mean.copy()), weights, step, least, every)


def _needed(weighted: Floats, own: float, keep: float) -> int:
    """How many of the readings, in this order, hold the share `keep` of the information of all and the head's own."""
    sums = own + np.cumsum(weighted)
    if not sums.size:
        return 0
    enough = int(np.searchsorted(sums, keep * sums[-1] * (1.0 - 1e-12))) + 1
    enough = 0 if own >= keep * sums[-1] else enough
    return min(max(enough, FEWEST), weighted.size)


def fits(
    plan: SelectionPlan, expected: Floats, spread: Floats, those: Candidates, scene: Scene, limits: tuple[float, float]
) -> bool:
    """Whether a plan still asks for enough information, and not at a needless cost."""
    if scene.step - plan.step >= STEPS:
        return False
    share, excess = limits
    weights = weights_of(spread)
    weighted = weighed(those.information, weights)
    _, positions, traits = scene.known
    asked = asks(plan, expected, positions[those.rows], traits[those.rows], those.joules, scene)
    own = float(weighed(those.own[None], weights)[0])
    if weighted[asked].sum() + own < share * (weighted.sum() + own):
        return False
    order = np.argsort(-weighted / those.joules, kind="stable")
    needed = those.joules[order][: _needed(weighted[order], own, share)].sum()
    return bool(those.joules[asked].sum() <= excess * needed + those.joules.mean() if asked.any() else True)


def asks(
    plan: SelectionPlan,
    expected: Floats,
    positions: Floats,
    traits: Floats,
    joules: Floats,
    scene: Scene,
    due: bool = True,
) -> Bools:
    """(n,) whether the plan asks nodes at `positions` (n, 2) for their readings, the expected state being (D, 1).

    `due`: whether it is a step in which all that are asked send; in others, those do whose readings are worth most.
    """
    point = expected[list(scene.motion.position), 0]
    weighted = weighed(_informations_at(point, positions, traits, scene), plan.weights)
    return weighted >= plan.least * joules * (1.0 if due else PROMPT)


def senders(plan: SelectionPlan, expected: Expected, steps: int, scene: Scene) -> tuple[NodeId, ...]:
    """The nodes taken for members that a plan asks at one of the steps from now on, whether they sense or not."""
    ids, positions, traits = scene.known
    joules, any_step = packet_joules(positions, scene), np.zeros(len(ids), dtype=np.bool_)
    for step in range(scene.step, scene.step + steps):
        state = extrapolated(expected, scene, step).state
        any_step |= asks(plan, state, positions, traits, joules, scene, plan.is_due(step))
    return tuple(node for node, asked in zip(ids, any_step.tolist(), strict=True) if asked and node != scene.head)


def extrapolated(expected: Expected, scene: Scene, until: int | None = None) -> Expected:
    """What is expected at the step of the scene, or at the step `until`."""
    last = scene.step if until is None else until
    if expected.step >= last:
        return expected
    state = expected.state.copy()
    for step in range(expected.step, last):
        state = scene.motion.advance(state, scene.dt, step * scene.dt)
    return Expected(last, frozen(state))


def first_expected(plan: SelectionPlan) -> Expected:
    """What is expected at the step of the plan."""
    return Expected(plan.step, frozen(plan.state[:, None].copy()))


def frozen(values: Floats) -> Floats:
    """The array itself, which nobody can change any more: members may hold one and the same."""
    values.flags.writeable = False
    return values


def prepare(members: Sequence[Member], scene: Scene, keeps: int) -> None:
    """Each member reads its inbox, keeps its reading, and decides what to send, with what it holds alone.

    Those that have the same plan are computed at once.

    Args:
        members: The members that sense.
        scene: What every node knows: the models, the step, the place of the head, the price of a packet.
        keeps: Steps for which a reading that was not sent is kept.
    """
    undecided: dict[tuple[int, int, bool], list[Member]] = {}
    for member in members:
        _read_inbox(member)
        memory, plan = member.memory, member.memory.get(PLAN)
        unsent = [each for each in memory.get(UNSENT, ()) if each[0] > scene.step - keeps]
        if member.reading is not None and is_finite(member.reading):
            unsent.append((scene.step, member.reading))
        memory[UNSENT] = unsent
        if plan is None or member.id == scene.head:
            _send(member, scene)
        else:
            due = plan.is_due(scene.step)  # also for one that heard an older plan with its appointment
            undecided.setdefault((id(plan), memory[EXPECTED].step, due), []).append(member)
    for (_, _, due), alike in undecided.items():
        _decide(alike, scene, due)


def _read_inbox(member: Member) -> None:
    """Take a new plan to memory."""
    for delivery in member.take_inbox():
        if delivery.what == PLAN and delivery.mask.all():
            member.memory[PLAN], member.memory[EXPECTED] = delivery.payload, first_expected(delivery.payload)


def _decide(members: Sequence[Member], scene: Scene, due: bool) -> None:
    """Members with one and the same plan, extrapolated to the same step, send if it asks for their readings."""
    plan, expected = members[0].memory[PLAN], extrapolated(members[0].memory[EXPECTED], scene)
    positions, traits = (np.stack([getattr(each, name) for each in members]) for name in ("position", "traits"))
    asked = asks(plan, expected.state, positions, traits, packet_joules(positions, scene), scene, due)
    for member, sends in zip(members, asked.tolist(), strict=True):
        member.memory[EXPECTED] = expected
        if sends:
            _send(member, scene)
        elif due:
            member.memory[UNSENT] = []


def _send(member: Member, scene: Scene) -> None:
    """Make a parcel of what was not sent."""
    if unsent := member.memory[UNSENT]:
        member.memory[OUTGOING] = readings_parcel(unsent, scene)
        member.memory[UNSENT] = []


def outgoing(member: Member) -> Parcel | None:
    """What a member decided to send."""
    sent: Parcel | None = member.memory.pop(OUTGOING, None)
    return sent


def readings_parcel(unsent: Sequence[tuple[int, Reading]], scene: Scene) -> Parcel:
    """Readings of some steps, oldest first: the number of steps since each, and its value; four numbers a packet.

    The steps take three bits each, in the header of the packet (our choice).
    """
    payload = tuple((scene.step - step, value) for step, value in unsent)
    numbers = len(unsent) * len(components_of(scene.sensor))
    return Parcel(payload, number_packets(numbers), 96, READING, readings=len(unsent))
