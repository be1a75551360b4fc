"""Particle filters whose resampling is a cuckoo search, plain (CS-PF) and improved (ICS-PF), in the head.

Wei, Guo (2022). Particles are nests. They move by Lévy flights about the best one and are replaced at random; a move is
accepted if it is fitter. Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.shared.dealing import PREDICT_CYCLES
from wsnsim.trackers.shared.heads import MOVE_CYCLES, WEIGH_CYCLES, CloudBelief, HeadCloud, Prediction
from wsnsim.trackers.shared.moments import noise_issues
from wsnsim.trackers.shared.nests import Fitness, Generation, Move, Search, Variant, searched
from wsnsim.trackers.shared.readings import Evidence

PROBABILITY = Quantity("", ge=0, le=1)
LENGTH = Quantity("", ge=0, le=1e3)


@part
class Nests:
    """The parameters of both searches."""

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

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """A process noise without a density, under a Metropolis test, which needs that of the motion's transition."""
        if self.variant == "metropolis":
            yield from noise_issues(setup, "variant: metropolis")

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
class CuckooPf(Nests, HeadCloud):
    """CS-PF: the predicted particles search for states of high likelihood and are weighted there.

    The literal search is not a sampler: it climbs the likelihood from the prediction, and the weights use the
    likelihood a second time. `variant: metropolis` accepts the same moves as those of a Markov chain. All columns move,
    as in the paper; the velocity then diverges, since the fitness does not depend on it. Use `move: position` in
    networks.
    """

    alpha: Annotated[Literal["random", "fixed"], "whether a standard normal multiplies the step, eq. 5"] = "random"
    length: Annotated[float, LENGTH, "α: length of a flight, eq. 5"] = 0.01
    keep: Annotated[float, PROBABILITY, "p_a: probability that a nest is kept, eq. 7 as printed"] = 0.25

    def weighed(self, prediction: Prediction, seen: Evidence, scene: Scene) -> CloudBelief:
        """The belief after the search, with the moments of its result."""
        schedule = (Generation(self.length, self.keep),) * self.generations
        search = Search(schedule, self.exponent, self.alpha == "random", False, self.variant, self.fitness, self.move)
        return searched(search, prediction, seen, scene)


@part
class ImprovedCuckooPf(Nests, HeadCloud):
    """ICS-PF: CS-PF with flights that shorten and nests that are kept less over the generations; Δk scales each flight.

    Δk is that of the previous generation, since the printed one needs the fitness after the flight.
    """

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

    def weighed(self, prediction: Prediction, seen: Evidence, scene: Scene) -> CloudBelief:
        """The belief after the search, with the moments of its result."""
        search = Search(self.schedule, self.exponent, False, True, self.variant, self.fitness, self.move)
        return searched(search, prediction, seen, scene)
