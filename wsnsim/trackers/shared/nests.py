"""The cuckoo search of a particle filter in the head (Wei, Guo 2022): particles are nests, likelihoods their fitness.

    searched(search, prediction, seen, scene) -> belief

`hunt` accepts what is fitter, as the paper does; `walk` applies a Metropolis-Hastings test, which is our repair.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys
from wsnsim.base.ports import Scene
from wsnsim.base.vector_readings import near, rows
from wsnsim.kernels.cuckoo import (
    accept_chains,
    accept_greedy,
    fly_cuckoos,
    levy_deviation,
    relative_changes,
    replace_nests,
)
from wsnsim.trackers.shared.dealing import Pool, resampled
from wsnsim.trackers.shared.heads import CloudBelief, Prediction, keys_of, score_of, summary
from wsnsim.trackers.shared.readings import Evidence
from wsnsim.trackers.shared.stacks import Score, place_of

FLIGHT, NEST = 3, 4
"""Tags of the particle keys that a head's key of a step gives to flights and to replacements."""

Variant: TypeAlias = Literal["literal", "resample_first", "metropolis"]
Fitness: TypeAlias = Literal["gaussian", "absolute"]
Move: TypeAlias = Literal["all", "position"]


class Generation(NamedTuple):
    """α, the length of a flight, and P, the probability that a nest is kept."""

    alpha: float
    keep: float


@dataclass(frozen=True, slots=True)
class Search:
    """What happens in place of a resampling, generation after generation.

    `random_alpha`: α is multiplied by a standard normal, eq. (5); `by_change`: flights by Δk, eq. (10).
    """

    schedule: tuple[Generation, ...]
    exponent: float
    random_alpha: bool
    by_change: bool
    variant: Variant
    fitness: Fitness
    move: Move


def searched(search: Search, prediction: Prediction, seen: Evidence, scene: Scene) -> CloudBelief:
    """The belief after at least one reading, its particles equally weighted.

    literal: the predicted particles hunt, and are weighed where they end; mean and covariance are weighted.
    resample_first: they are weighed, resampled, and hunt then. metropolis: the same, but they walk. The likelihood
    being used up by the resampling, both give the plain mean of where the particles end (our reading).
    """
    score = absolute_score(seen, scene) if search.fitness == "absolute" else score_of(seen, scene)
    cloud, log_weights = prediction.cloud.copy(), prediction.log_weights
    fitness = score(cloud)
    if search.variant == "literal":
        hunt(cloud, fitness, score, search, scene)
        return _summed_up(cloud, log_weights + fitness, scene)
    columns = resampled(log_weights + fitness, fitness.size, scene.key)
    cloud, fitness = np.take(cloud, columns, axis=1), fitness[columns]
    if search.variant == "resample_first":
        hunt(cloud, fitness, score, search, scene)
    else:
        walk(cloud, fitness, np.take(prediction.before, columns, axis=1), score, search, scene)
    return _summed_up(cloud, np.zeros(fitness.size), scene)


def _summed_up(cloud: Floats, log_weights: Floats, scene: Scene) -> CloudBelief:
    """Weighted moments of a cloud that goes on with equal weights."""
    mean, cov, effective = summary(cloud, log_weights)
    return CloudBelief(mean, cov, scene.head, effective, Pool(cloud, np.zeros(log_weights.size)))


def hunt(cloud: Floats, fitness: Floats, score: Score, search: Search, scene: Scene) -> None:
    """Let a cloud (D, N) of known fitness (N,) search, in place: each generation a flight and a replacement.

    A proposal is taken if it is fitter. Δk is the change of fitness over the *previous* generation, and 1 in the first:
    the paper's, over the one to come, cannot be known. So a nest that did not improve does not fly in the next one.
    """
    rows, deviation = _rows(search, scene), levy_deviation(search.exponent)
    flights, nests = keys_of(scene, fitness.size, FLIGHT), keys_of(scene, fitness.size, NEST)
    factor = np.ones(fitness.size)
    for number, (alpha, keep) in enumerate(search.schedule):
        before, best = fitness.copy(), cloud[:, np.argmax(fitness)].copy()
        proposal, _ = fly_cuckoos(
            cloud, best, rows, flights, 4 * rows.size * number, alpha, search.random_alpha, deviation, search.exponent,
            factor,
        )  # fmt: skip
        accept_greedy(cloud, fitness, proposal, score(proposal))
        proposal = replace_nests(cloud, cloud, rows, nests, 3 * number, keep)
        accept_greedy(cloud, fitness, proposal, score(proposal))
        if search.by_change:
            factor = relative_changes(fitness, before)


@dataclass(slots=True)
class _Half:
    """Every other particle with its ancestor, log-likelihood, log-density of its transition, and keys."""

    cloud: Floats
    before: Floats
    fitness: Floats
    prior: Floats
    flights: Keys
    nests: Keys


def walk(cloud: Floats, fitness: Floats, before: Floats, score: Score, search: Search, scene: Scene) -> None:
    """Make a cloud (D, N) the state of Markov chains that leave Π_i p(z | x_i) p(x_i | before_i) as it is, in place.

    The moves of `hunt`, tested by Metropolis and Hastings. Even and odd columns move in turn, each half with the best
    nest, x_d and x_e of the other, which therefore do not depend on who moves; Δk, which would, is 1. Our repair.
    """
    prior = scene.motion.log_transition(cloud, before, scene.dt, scene.previous)
    flights, nests = keys_of(scene, fitness.size, FLIGHT), keys_of(scene, fitness.size, NEST)
    parts: tuple[Any, ...] = (cloud, before, fitness, prior, flights, nests)
    even, odd = (_Half(*[np.ascontiguousarray(part[..., first::2]) for part in parts]) for first in (0, 1))
    if not odd.fitness.size:
        return
    for number in range(len(search.schedule)):
        for mine, others in ((even, odd), (odd, even)):
            _advance(mine, others, score, search, number, scene)
    cloud[:, 0::2], cloud[:, 1::2] = even.cloud, odd.cloud
    fitness[0::2], fitness[1::2] = even.fitness, odd.fitness


def _advance(mine: _Half, others: _Half, score: Score, search: Search, number: int, scene: Scene) -> None:
    """One generation of one half, given the other: a flight and a replacement, each accepted or not."""
    rows, (alpha, keep) = _rows(search, scene), search.schedule[number]
    best, draw = others.cloud[:, np.argmax(others.fitness)].copy(), (4 * rows.size + 2) * number
    proposal, log_ratio = fly_cuckoos(
        mine.cloud, best, rows, mine.flights, draw, alpha, search.random_alpha, levy_deviation(search.exponent),
        search.exponent, np.ones(mine.fitness.size),
    )  # fmt: skip
    _test(mine, proposal, log_ratio, score, mine.flights, draw + 4 * rows.size, scene)
    proposal = replace_nests(mine.cloud, others.cloud, rows, mine.nests, 4 * number, keep)
    _test(mine, proposal, np.zeros(mine.fitness.size), score, mine.nests, 4 * number + 3, scene)


def _test(mine: _Half, proposal: Floats, log_ratio: Floats, score: Score, keys: Keys, draw: int, scene: Scene) -> None:
    """Accept proposals by Metropolis and Hastings."""
    prior = scene.motion.log_transition(proposal, mine.before, scene.dt, scene.previous)
    accept_chains(mine.cloud, mine.fitness, mine.prior, proposal, score(proposal), prior, log_ratio, keys, draw)


def absolute_score(seen: Evidence, scene: Scene) -> Score:
    """(D, N) particles → (N,) -Σ |z - ẑ| / (2R): eq. (13) as printed, without the square. NaN is no fitness."""
    place, sensor = place_of(scene), scene.sensor

    def score(cloud: Floats) -> Floats:
        expected, _, variances = sensor.linearise(cloud[place], seen.positions, seen.traits)
        measured = near(sensor, rows(sensor, seen.readings)[:, None], expected)
        fitness = -(np.abs(measured - expected) / (2.0 * variances)).sum(axis=0)
        return np.where(np.isnan(fitness), -np.inf, fitness)

    return score


def _rows(search: Search, scene: Scene) -> Ints:
    """(Q,) the rows of a cloud that move."""
    if search.move == "position":
        return np.array(scene.motion.position, np.int64)
    return np.arange(len(scene.motion.columns), dtype=np.int64)
