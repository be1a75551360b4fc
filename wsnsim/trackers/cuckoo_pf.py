"""Particle filters whose resampling is a cuckoo search, plain (CS-PF) and improved (ICS-PF), in the head.

Wei, Guo (2022). Particles are nests, likelihoods their fitness. They move by Lévy flights about the best one and are
replaced at random; a move is accepted if it is fitter (`hunt`), or after a Metropolis-Hastings test, which is our
repair (`walk`). Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.arrays import Floats, Ints, Keys, near, rows
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels.cuckoo import (
    accept_chains,
    accept_greedy,
    fly_cuckoos,
    levy_deviation,
    relative_changes,
    replace_nests,
)
from wsnsim.trackers.shared.dealing import PREDICT_CYCLES, Pool, resampled
from wsnsim.trackers.shared.heads import (
    MOVE_CYCLES,
    WEIGH_CYCLES,
    CloudBelief,
    HeadCloud,
    Prediction,
    keys_of,
    score_of,
    summary,
)
from wsnsim.trackers.shared.moments import noise_issues
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


def searched(search: Nests, prediction: Prediction, seen: Evidence, scene: Scene) -> CloudBelief:
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


def hunt(cloud: Floats, fitness: Floats, score: Score, search: Nests, scene: Scene) -> None:
    """Let a cloud (D, N) of known fitness (N,) search, in place: each generation a flight and a replacement.

    A proposal is taken if it is fitter. The hunt ends after a generation in which the best fitness grows by less than
    `search.least_gain`, as a share of it. Δk is the change of fitness over the *previous* generation, and 1 in the
    first: the paper's, over the one to come, cannot be known. So a nest that did not improve does not fly in the next.
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
        if fitness.max() < before.max() + math.log1p(search.least_gain):
            return
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


def walk(cloud: Floats, fitness: Floats, before: Floats, score: Score, search: Nests, scene: Scene) -> None:
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


def _advance(mine: _Half, others: _Half, score: Score, search: Nests, number: int, scene: Scene) -> None:
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


def _rows(search: Nests, scene: Scene) -> Ints:
    """(Q,) the rows of a cloud that move."""
    if search.move == "position":
        return np.array(scene.motion.position, np.int64)
    return np.arange(len(scene.motion.columns), dtype=np.int64)


GAIN = (
    "termination condition of steps one and five, which the paper does not give: the search ends after a generation in "
    "which the best fitness grows by less than this share; 0: all generations, for which operations are stated"
)
PROBABILITY = Quantity("", ge=0, le=1)
LENGTH = Quantity("", ge=0, le=1e3)


@part
class Nests(HeadCloud):
    """What both searches have in common; a subclass gives the `schedule` of the generations."""

    by_change: ClassVar[bool] = False
    """Whether Δk scales a flight, eq. (10)."""

    particles: Annotated[int, Quantity("", ge=1, le=10**7), "N_p: particles, the nests"] = 100
    generations: Annotated[int, Quantity("", ge=1, le=10_000), "n: generations of the search per step"] = 5
    exponent: Annotated[float, Quantity("", ge=0.3, le=1.99), "λ: tail exponent of the Levy flights"] = 1.5
    variant: Annotated[Variant, "the search alone, after resampling, or after resampling with a Metropolis test"] = (
        "literal"
    )
    fitness: Annotated[Fitness, "fitness and weight, eq. 13: the likelihood, or its form without the square"] = (
        "gaussian"
    )
    move: Annotated[Move, "which columns of the state the search moves"] = "all"
    least_gain: Annotated[float, Quantity("", ge=0, le=1e9), GAIN] = 0.0

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Under a Metropolis test, a process noise without a density, and an end that depends on what is found.

        The test needs the density of the motion's transition; chains that end when they are fit are biased.
        """
        if self.variant == "metropolis":
            yield from noise_issues(setup, "variant: metropolis")
            if self.least_gain:
                yield Issue(("tracker", "least_gain"), "must be 0 with variant: metropolis, which ends by generations")

    @property
    def random_alpha(self) -> bool:
        """Whether α is multiplied by a standard normal, eq. (5)."""
        return False

    @property
    def schedule(self) -> tuple[Generation, ...]:
        """α and P of each generation."""
        raise NotImplementedError

    def weighed(self, prediction: Prediction, seen: Evidence, scene: Scene) -> CloudBelief:
        """The belief after the search, with the moments of its result."""
        return searched(self, prediction, seen, scene)

    @property
    def evaluations(self) -> int:
        """Likelihood evaluations per particle and step."""
        return 1 + 2 * self.generations

    @property
    def reading_cycles(self) -> float:
        """Operations per particle and reading, at all evaluations."""
        return WEIGH_CYCLES * self.evaluations

    @property
    def move_cycles(self) -> float:
        """Operations per particle: a flight and a replacement per generation, 50 each, as moves in the other trackers.

        A Metropolis test also needs a transition density: to predict, and to compare.
        """
        return 2.0 * self.generations * (MOVE_CYCLES + (PREDICT_CYCLES if self.variant == "metropolis" else 0.0))


@part
class CuckooPf(Nests):
    """CS-PF: the predicted particles search for states of high likelihood and are weighted there.

    The literal search is not a sampler: it climbs the likelihood from the prediction, and the weights use the
    likelihood a second time. `variant: metropolis` accepts the same moves as those of a Markov chain. All columns move,
    as in the paper; the velocity then diverges, since the fitness does not depend on it. Use `move: position` in
    networks.
    """

    alpha: Annotated[Literal["random", "fixed"], "whether a standard normal multiplies the step, eq. 5"] = "random"
    length: Annotated[float, LENGTH, "α: length of a flight, eq. 5"] = 0.01
    keep: Annotated[float, PROBABILITY, "p_a: probability that a nest is kept, eq. 7 as printed"] = 0.25

    @property
    def random_alpha(self) -> bool:
        """Whether α is multiplied by a standard normal, eq. (5)."""
        return self.alpha == "random"

    @property
    def schedule(self) -> tuple[Generation, ...]:
        """α and P of each generation: always the same."""
        return (Generation(self.length, self.keep),) * self.generations


@part
class ImprovedCuckooPf(Nests):
    """ICS-PF: CS-PF with flights that shorten and nests that are kept less over the generations; Δk scales each flight.

    Δk is that of the previous generation, since the printed one needs the fitness after the flight.
    """

    by_change: ClassVar[bool] = True

    p_max: Annotated[float, PROBABILITY, "P_max: by how much the probability of keeping decreases, eq. 8"] = 0.3
    p_min: Annotated[float, PROBABILITY, "P_min: probability of keeping in the last generation, eq. 8"] = 0.01
    f_max: Annotated[float, LENGTH, "length of a flight in the first generation, eq. 9"] = 0.5
    f_min: Annotated[float, LENGTH, "length of a flight in the last generation, eq. 9"] = 0.01

    @property
    def schedule(self) -> tuple[Generation, ...]:
        """α and P of each generation c = 1 ... n; a single one is the first (our choice: 0/0 in print).

        P = P_max cos(π/2 (c - 1)/(n - 1)) + P_min, printed with 1/sec; α = f_max - (c - 1)/(n - 1) (f_max - f_min).
        Eqs. (8), (9).
        """
        passed = [c / max(self.generations - 1, 1) for c in range(self.generations)]
        return tuple(
            Generation(
                alpha=self.f_max - part * (self.f_max - self.f_min),
                keep=self.p_max * math.cos(0.5 * math.pi * part) + self.p_min,
            )
            for part in passed
        )
