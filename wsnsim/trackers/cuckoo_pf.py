"""Particle filters whose resampling is a cuckoo search, plain (CS-PF) and improved (ICS-PF), in the head.

Wei, Guo (2022). Particles are nests: they fly by Levy flights about the best one, are replaced, and what is fitter
stays.
Requests of a step:

    Gather: readings  Compute
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

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
    """What the two searches have in common, beside a particle filter in the head."""

    particles: Annotated[int, Quantity("", ge=1, le=10**7), "N_p: particles, the nests"] = 100
    generations: Annotated[int, Quantity("", ge=1, le=10_000), "n: generations of the search per step"] = 5
    exponent: Annotated[float, Quantity("", ge=0.3, le=1.99), "λ: tail exponent of the Levy flights"] = 1.5
    variant: Annotated[Variant, "search alone, after a resampling, or after it under a Metropolis test"] = "literal"
    fitness: Annotated[Fitness, "what is sought and weighed with, eq. 13: the likelihood, or without square"] = (
        "gaussian"
    )
    move: Annotated[Move, "which columns of the state the search moves"] = "all"

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """A process noise without a density, under a Metropolis test, which needs that of the motion's transition."""
        if self.variant == "metropolis":
            yield from noise_issues(setup, "variant: metropolis")

    @property
    def evaluations(self) -> int:
        """Likelihoods a particle and step."""
        return 1 + 2 * self.generations

    @property
    def reading_cycles(self) -> float:
        """Operations a particle and reading: to weigh, at every evaluation."""
        return WEIGH_CYCLES * self.evaluations

    @property
    def move_cycles(self) -> float:
        """Operations a particle: a flight and a replacement a generation, 50 each, as moves in the other trackers.

        A Metropolis test also needs a transition density: to predict, and to compare.
        """
        return 2.0 * self.generations * (MOVE_CYCLES + (PREDICT_CYCLES if self.variant == "metropolis" else 0.0))


@part
class CuckooPf(Nests, HeadCloud):
    """CS-PF: the predicted particles search for likely places, are weighed there, and go on with equal weights.

    The literal search is no sampler: it climbs the likelihood from the prediction, and weighs with the likelihood once
    more. `variant: metropolis` is what the same moves give if they are accepted as a Markov chain's. All columns move,
    as in the paper; the velocity, which no fitness holds, then runs away: networks want `move: position`.
    """

    paper: ClassVar[str] = "Wei, Guo (2022)"
    idea: ClassVar[str] = "particle filter with a cuckoo search for resampling: Lévy flights and replaced nests"
    state: ClassVar[str] = "particles in the head"
    messages: ClassVar[str] = "a reading up per member"
    variants: ClassVar[str] = (
        "variant literal|resample_first|metropolis, alpha random|fixed, fitness gaussian|absolute, move all|position, "
        "handover particles|gaussian"
    )

    alpha: Annotated[Literal["random", "fixed"], "whether a standard normal multiplies the step, eq. 5"] = "random"
    length: Annotated[float, LENGTH, "α: length of a flight, eq. 5"] = 0.01
    keep: Annotated[float, PROBABILITY, "p_a: probability that a nest is kept, eq. 7 as printed"] = 0.25

    def weighed(self, prediction: Prediction, seen: Evidence, scene: Scene) -> CloudBelief:
        """The search, and the moments of what it found."""
        schedule = (Generation(self.length, self.keep),) * self.generations
        search = Search(schedule, self.exponent, self.alpha == "random", False, self.variant, self.fitness, self.move)
        return searched(search, prediction, seen, scene)


@part
class ImprovedCuckooPf(Nests, HeadCloud):
    """ICS-PF: as CS-PF, but flights shorten, fewer nests are kept in the later generations, and Δk scales each flight.

    Δk is taken from the previous generation, since the printed one needs the fitness that the flight is still to find.
    """

    paper: ClassVar[str] = "Wei, Guo (2022)"
    idea: ClassVar[str] = "cuckoo search particle filter; step length and replacement shrink over the generations"
    state: ClassVar[str] = "particles in the head"
    messages: ClassVar[str] = "a reading up per member"
    variants: ClassVar[str] = (
        "variant literal|resample_first|metropolis, fitness gaussian|absolute, move all|position, "
        "handover particles|gaussian"
    )

    p_max: Annotated[float, PROBABILITY, "P_max: by how much the probability of keeping falls, eq. 8"] = 0.3
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
        """The search, and the moments of what it found."""
        search = Search(self.schedule, self.exponent, False, True, self.variant, self.fitness, self.move)
        return searched(search, prediction, seen, scene)
