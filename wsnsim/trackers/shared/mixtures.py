"""A belief of several Gaussians: one while the motion's law is certain, more where it is not, merged when they agree.

Where the law of motion changes within a Gaussian (a target is turned back beyond a line), one linear prediction serves
one side of it only. There the Gaussian is cut in two, each moves by its own law, and the readings decide.

    filtered(kept steps, mixture, {step: readings}, scene) -> kept steps, this one the last

Readings may arrive some steps after they were taken: the head keeps the readings of as many steps as a packet may span,
and the mixture after each of them, and computes those steps and the later ones again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.ports import Scene
from wsnsim.trackers.shared.moments import mixed, stepped, symmetric
from wsnsim.trackers.shared.posteriors import updated
from wsnsim.trackers.shared.readings import Evidence, replied, together

LEAST: Final = 1e-4
"""A Gaussian with a smaller share of the probability is dropped, or not cut off."""
ALIKE: Final = 0.25
"""Two Gaussians whose means are closer than this, in squared standard deviations of both, are merged."""
MOST: Final = 8
"""Gaussians that are kept."""
PIECES: Final = 5
"""A law that changes more often within a Gaussian is smooth: it is not cut there."""
REACH: Final = 4.0
"""Standard deviations within which a change of the law is looked for."""
SLICES: Final = np.linspace(-REACH, REACH, 1601)
SHARES: Final = np.exp(-0.5 * SLICES**2) / np.exp(-0.5 * SLICES**2).sum()
TINY: Final = float(np.finfo(np.float64).tiny)
EQUAL: Final = 1e-9
"""Two laws differ if their matrices or offsets differ by more than this share of the greatest."""


class Hypothesis(NamedTuple):
    """A Gaussian (mean (D,), covariance (D, D)) and the log of its weight."""

    log_weight: float
    mean: Floats
    cov: Floats


Hypotheses: TypeAlias = tuple[Hypothesis, ...]


def moments_of(mixture: Hypotheses) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) of a mixture with normalised weights."""
    if len(mixture) == 1:
        return mixture[0].mean, mixture[0].cov
    weights = np.exp([each.log_weight for each in mixture])
    means = np.stack([each.mean for each in mixture])
    return mixed(weights, means, np.stack([each.cov for each in mixture]))


def predicted_mixture(mixture: Hypotheses, scene: Scene, since: float, steps: int) -> Hypotheses:
    """The mixture `steps` model steps after the time `since`, cut wherever the law changes on the way."""
    for step in range(steps):
        now = since + step * scene.dt
        mixture = reduced([moved for each in mixture for moved in _moved(each, scene, now)])
    return mixture


def updated_mixture(mixture: Hypotheses, seen: Evidence, scene: Scene) -> Hypotheses:
    """Each Gaussian updated by all the readings, and weighted by the density that it gave them."""
    if not seen.ids:
        return mixture
    after = []
    for each in mixture:
        mean, cov, log_evidence = updated(each.mean, each.cov, seen, scene)
        after.append(Hypothesis(each.log_weight + log_evidence, mean, cov))
    if not any(np.isfinite(each.log_weight) for each in after):
        return mixture
    return reduced(after)


def reduced(hypotheses: Sequence[Hypothesis]) -> Hypotheses:
    """The hypotheses with normalised weights: the unlikely are dropped, similar ones are merged."""
    if len(hypotheses) == 1:
        return (hypotheses[0]._replace(log_weight=0.0),)
    ranked = sorted(hypotheses, key=lambda each: -each.log_weight)
    least = ranked[0].log_weight + np.log(LEAST)
    kept: list[Hypothesis] = []
    for one in ranked:
        if not one.log_weight > least:
            continue
        for place, other in enumerate(kept):
            if _alike(one, other):
                kept[place] = _merged(other, one)
                break
        else:
            kept.append(one)
    return _normalised(kept[:MOST])


def _normalised(mixture: Sequence[Hypothesis]) -> Hypotheses:
    logs = np.array([each.log_weight for each in mixture])
    total = logs.max() + np.log(np.exp(logs - logs.max()).sum())
    return tuple(each._replace(log_weight=float(each.log_weight - total)) for each in mixture)


def _alike(one: Hypothesis, other: Hypothesis) -> bool:
    apart, spread = one.mean - other.mean, one.cov + other.cov
    scale = np.sqrt(np.maximum(np.diag(spread), TINY))
    white = apart / scale
    found = np.linalg.lstsq(spread / np.outer(scale, scale), white, rcond=1e-9)[0]
    return bool(white @ found < ALIKE)


def _merged(one: Hypothesis, other: Hypothesis) -> Hypothesis:
    """One Gaussian with the weight and the moments of both."""
    log_weight = float(np.logaddexp(one.log_weight, other.log_weight))
    pair = tuple(each._replace(log_weight=each.log_weight - log_weight) for each in (one, other))
    return Hypothesis(log_weight, *moments_of(pair))


def _moved(one: Hypothesis, scene: Scene, now: float) -> list[Hypothesis]:
    """A Gaussian one step later: its parts, each by its own law, if the law changes within it."""
    motion, place = scene.motion, list(scene.motion.position)
    ends = REACH * one.cov[:, place] / np.sqrt(np.maximum(one.cov[place, place], TINY))
    points = np.concatenate([one.mean[:, None], one.mean[:, None] - ends, one.mean[:, None] + ends], axis=1)
    laws, noise = motion.matrices(points, scene.dt, now)
    moved = motion.advance(points, scene.dt, now)
    if _changes(laws, moved, points).any():
        parts = [one]
        for axis in place:
            parts = [part for each in parts for part in _cut(each, axis, scene, now)]
        if len(parts) > 1:
            return [Hypothesis(part.log_weight, *stepped(part.mean, part.cov, motion, scene.dt, now)) for part in parts]
    return [Hypothesis(one.log_weight, moved[:, 0], symmetric(laws[0] @ one.cov @ laws[0].T + noise))]


def _cut(one: Hypothesis, axis: int, scene: Scene, now: float) -> list[Hypothesis]:
    """The parts of a Gaussian along an axis within which the law stays the same; the other columns go along."""
    if not one.cov[axis, axis] > 0.0:
        return [one]
    along = one.cov[:, axis] / np.sqrt(one.cov[axis, axis])
    points = np.ascontiguousarray(one.mean[:, None] + along[:, None] * SLICES)
    laws, _ = scene.motion.matrices(points, scene.dt, now)
    edges = np.flatnonzero(_changes(laws, scene.motion.advance(points, scene.dt, now), points)) + 1
    if not 0 < edges.size < PIECES:
        return [one]
    return [
        _slice(one, along, rows, float(SHARES[rows].sum()))
        for rows in np.split(np.arange(SLICES.size), edges)
        if SHARES[rows].sum() > LEAST
    ]


def _changes(laws: Floats, moved: Floats, points: Floats) -> Bools:
    """(n - 1,) whether the law x⁺ = F x + b differs between one of the points (D, n) and the next."""
    offsets = moved - (laws @ points.T[:, :, None])[:, :, 0].T
    matrices = np.abs(laws[1:] - laws[:-1]).max(axis=(1, 2)) > EQUAL * np.abs(laws).max()
    size = max(float(np.abs(points).max()), 1.0)
    differs: Bools = matrices | (np.abs(offsets[:, 1:] - offsets[:, :-1]).max(axis=0) > EQUAL * size)
    return differs


def _slice(one: Hypothesis, along: Floats, rows: np.ndarray, share: float) -> Hypothesis:
    """The part of a Gaussian between two cuts, with the moments that it has there."""
    middle = float(SHARES[rows] @ SLICES[rows]) / share
    width = SLICES[1] - SLICES[0]
    variance = float(SHARES[rows] @ (SLICES[rows] - middle) ** 2) / share + width**2 / 12.0
    cov = symmetric(one.cov - (1.0 - min(variance, 1.0)) * np.outer(along, along))
    return Hypothesis(one.log_weight + float(np.log(share)), one.mean + along * middle, cov)


PREDICTION_CYCLES: Final = 300.0
"""Operations by which a Gaussian is predicted over one step (our estimate, as those below)."""
READING_CYCLES: Final = 1100.0
"""Operations by which a Gaussian is updated with one reading."""


class Kept(NamedTuple):
    """A step that may have to be computed once more: its readings, and the mixture after them."""

    step: int
    seen: Evidence
    mixture: Hypotheses


def by_step(reply: Mapping[int, tuple[Any, Bools]], scene: Scene) -> dict[int, Evidence]:
    """The readings that arrived, by the step in which they were taken."""
    found: dict[int, dict[int, tuple[Any, Bools]]] = {}
    for node in scene.ids:
        if node in reply and reply[node][1].all():
            for ago, value in reply[node][0]:
                found.setdefault(scene.step - ago, {})[node] = value, reply[node][1]
    return {step: replied(taken, scene) for step, taken in found.items()}


def filtered(
    kept: tuple[Kept, ...], mixture: Hypotheses, arrived: dict[int, Evidence], scene: Scene
) -> tuple[Kept, ...]:
    """The kept steps and this one. Where readings of earlier steps arrived, these are computed once more."""
    now, nothing = scene.step, replied({}, scene)
    first = min(arrived, default=now)
    before = tuple(each for each in kept if each.step < first)
    if first >= now or not before:
        seen = arrived.get(now, nothing)
        return (*kept, Kept(now, seen, updated_mixture(mixture, seen, scene)))
    again = {each.step: each.seen for each in kept if each.step >= first}
    for step in sorted({*again, *arrived, now}):
        both = [each for each in (again.get(step), arrived.get(step)) if each and each.ids]
        seen = reduce(together, both or [nothing])
        last = before[-1]
        mixture = predicted_mixture(last.mixture, scene, last.step * scene.dt, step - last.step)
        before = (*before, Kept(step, seen, updated_mixture(mixture, seen, scene)))
    return before


def filter_cycles(kept: tuple[Kept, ...], arrived: Mapping[int, Evidence], scene: Scene) -> float:
    """Operations of the predictions and updates of this step, repeated ones included."""
    first = min(arrived, default=scene.step)
    cycles = 0.0 if first >= scene.step else PREDICTION_CYCLES * len(kept[-1].mixture)  # the plan was judged by another
    for each in kept:
        if each.step >= first:
            cycles += len(each.mixture) * (PREDICTION_CYCLES + READING_CYCLES * len(each.seen.ids))
    return cycles
