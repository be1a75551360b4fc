"""Readings that reach a head after it has gone on: the head uses them at the step at which they were measured.

    Gather: readings  GatherLate  Compute                           the requests of a step

The head keeps its last steps in its belief: what it believed before each, what it knew and what it used. `refilter`
goes back to the first step of which readings are late, and makes it and all later ones again, with their random
numbers: the belief is then that of a filter to which the late readings had come in time. `retrodict` corrects the
present Gaussian at once, by the l-step algorithm of Bar-Shalom, Chen, Mallick (2004).

A handover carries the belief with all that has arrived until then, but no past steps: the next head starts without any.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.arrays import near, rows
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow, GatheredReadings, GatherLate, GatherReadings
from wsnsim.trackers.shared.moments import symmetric
from wsnsim.trackers.shared.readings import Evidence, evidence_of, packet_bits


class PastStep(NamedTuple):
    """A step that a head has made.

    Attributes:
        scene: What it knew.
        before: Its belief before the step, without past steps.
        reply: The readings that it used.
    """

    scene: Scene
    before: Any
    reply: GatheredReadings


Late: TypeAlias = Literal["ignore", "refilter", "retrodict"]


OneStep: TypeAlias = Callable[[Any, Scene], Flow[Any]]
"""One step of a filter with the readings that arrive in time; see `heads.LateFilter`."""


def step_with_late(one_step: OneStep, use: Late, window: float, belief: Any, scene: Scene) -> Flow[Any]:
    """One step with the readings that arrive in time, after what has arrived late is used."""
    reply: GatheredReadings = yield GatherReadings(packet_bits(scene.sensor))
    belief = yield from with_late(one_step, use, window, belief, scene)
    made = PastStep(scene, replace(belief, past=()), reply)
    after = yield from _answered(one_step(made.before, scene), reply)
    return replace(after, past=(*belief.past, made))


def with_late(one_step: OneStep, use: Late, window: float, belief: Any, scene: Scene) -> Flow[Any]:
    """The belief after what has arrived late of its past steps; those that are too old are dropped."""
    past = tuple([each for each in belief.past if scene.time - each.scene.time <= window])
    if not past:
        return replace(belief, past=())
    arrived: Mapping[int, GatheredReadings] = yield GatherLate(past[0].scene.step, past[-1].scene.step)
    late = {i: new for i, each in enumerate(past) if (new := _new(each, arrived.get(each.scene.step))).ids}
    if not late:
        return replace(belief, past=past)
    if use == "refilter":
        return (yield from _refiltered(one_step, past, late))
    return (yield from _retrodicted(belief, past, late))


def _refiltered(one_step: OneStep, past: tuple[PastStep, ...], late: Mapping[int, GatheredReadings]) -> Flow[Any]:
    """The belief after its past steps from the first one with late readings on are made again."""
    first = min(late)
    again, belief = list(past[:first]), past[first].before
    for i, each in enumerate(past[first:], first):
        reply = _joined(each.reply, late[i]) if i in late else each.reply
        again.append(PastStep(each.scene, belief, reply))
        belief = yield from _answered(one_step(belief, each.scene), reply)
    return replace(belief, past=tuple(again))


def _answered(flow: Flow[Any], reply: GatheredReadings) -> Flow[Any]:
    """The belief of a flow whose readings were gathered before; all else is requested."""
    answer: Any = None
    while True:
        try:
            request = flow.send(answer)
        except StopIteration as end:
            return end.value
        answer = reply if isinstance(request, GatherReadings) else (yield request)


def _new(each: PastStep, arrived: GatheredReadings | None) -> GatheredReadings:
    """Of the late readings of a step, those that it has not used."""
    if arrived is None:
        return GatheredReadings((), np.empty(0))
    rows = [row for row, node in enumerate(arrived.ids) if node not in each.reply.ids]
    return GatheredReadings(tuple([arrived.ids[row] for row in rows]), arrived.values[rows])


def _joined(one: GatheredReadings, other: GatheredReadings) -> GatheredReadings:
    values = np.concatenate([one.values, other.values]) if one.ids else other.values
    return GatheredReadings(one.ids + other.ids, values)


def _retrodicted(belief: Any, past: tuple[PastStep, ...], late: Mapping[int, GatheredReadings]) -> Flow[Any]:
    """A Gaussian belief corrected by late readings, of the latest step first: what is later counts as one measurement.

    The moments of the step itself are corrected, too; those of the steps between are left (our choice).
    """
    kept = list(past)
    for i, new in sorted(late.items(), reverse=True):
        seen, later = evidence_of(new, past[i].scene), [each.scene for each in past[i + 1 :]]
        yield Compute(_cycles(belief.mean.size, sum([scene.steps for scene in later]), seen.readings.size))
        then = kept[i + 1].before if later else belief
        belief = _corrected(belief, then, later, seen, past[i].scene)
        if later:
            kept[i + 1] = kept[i + 1]._replace(before=_corrected(then, then, [], seen, past[i].scene))
        kept[i] = kept[i]._replace(reply=_joined(kept[i].reply, new))
    return replace(belief, past=tuple(kept))


def _corrected(now: Any, then: Any, later: list[Scene], seen: Evidence, scene: Scene) -> Any:
    """The belief `now` corrected by readings of an earlier time, of whose belief `then` it is the outcome.

    Algorithm Al1: all measurements between count as one of the present state. If the late reading is of the time of an
    earlier update, its retrodicted state x(κ|k) and covariances P(κ|k) and P(k, κ|k) are, with F and Q from κ to k,

        C = P(κ|κ) Fᵀ P(k|κ)⁻¹    x(κ|k) = x(κ|κ) + C (x(k|k) - x(k|κ))    P(κ|k) = P(κ|κ) + C (P(k|k) - P(k|κ)) Cᵀ
        P(k, κ|k) = P(k|k) Cᵀ

    since F P(κ|κ) Fᵀ = P(k|κ) - Q: this form needs no inverse of F. It is exact after one update at most.
    """
    mean, cov, moves = then.mean, then.cov, np.eye(then.mean.size)
    for each in later:
        for step in range(each.steps):
            point, time = np.ascontiguousarray(mean[:, None]), each.since + step * each.dt
            transitions, noise = each.motion.matrices(point, each.dt, time)
            mean, moves = each.motion.advance(point, each.dt, time)[:, 0], transitions[0] @ moves
            cov = symmetric(transitions[0] @ cov @ transitions[0].T + noise)
    back = then.cov @ moves.T @ np.linalg.pinv(cov, hermitian=True) if later else moves
    earlier = then.mean + back @ (now.mean - mean)
    spread = symmetric(then.cov + back @ (now.cov - cov) @ back.T)
    place, cross = list(scene.motion.position), now.cov @ back.T
    expected, gradients, variances = scene.sensor.linearise(
        np.ascontiguousarray(earlier[place, None]), seen.positions, seen.traits
    )
    slopes, heard = gradients[:, :, 0], near(scene.sensor, rows(scene.sensor, seen.readings), expected[:, 0])
    known = np.isfinite(heard - expected[:, 0]) & (variances[:, 0] > 0.0) & np.isfinite(variances[:, 0])
    slopes, innovation = slopes[known], (heard - expected[:, 0])[known]
    gain = np.linalg.solve(
        slopes @ spread[np.ix_(place, place)] @ slopes.T + np.diag(variances[known, 0]), slopes @ cross[:, place].T
    ).T
    return replace(now, mean=now.mean + gain @ innovation, cov=symmetric(now.cov - gain @ slopes @ cross[:, place].T))


def _cycles(size: int, steps: int, readings: int) -> float:
    """Operations: predictions and F over the steps, C and the covariances, and twice the update by each reading."""
    return 6.0 * steps * size**3 + 12.0 * size**3 + 2.0 * readings * (20.0 + 8.0 * size**2)
