"""Fusion of whole estimates with those of neighbours: covariance intersection, and its warning, naive fusion.

Local: predict, update  Exchange: estimate  Local: fuse ...                  the requests of a step
"""

from __future__ import annotations

from functools import partial
from typing import Annotated, Final, Literal, TypeAlias

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from wsnsim.base.arrays import Floats
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Exchange, Flow, Local, Member, Parcel
from wsnsim.trackers.shared.peers import (
    COV,
    MEAN,
    Information,
    PeerFilter,
    information_of,
    inverse,
    inversion_cycles,
    news_of,
    packed,
    received,
    store,
    unpacked,
    update,
)
from wsnsim.trackers.shared.readings import moment_packets, parcel

FUSED = "estimate"
SEARCH: Final = 12.0
"""Inversions whose operations a search for a weight takes, about: eigenvalues of two matrices, and a scalar root."""
Criterion: TypeAlias = Literal["determinant", "trace", "fast"]


@part
class EstimateFusion(PeerFilter):
    """What both filters share: each updates with its own reading, then fuses what neighbours send. See `combined`."""

    rounds: Annotated[int, Quantity("", ge=1, le=1000), "rounds of exchange and fusion in a step"] = 1

    def combined(self, estimates: list[Information]) -> Information:
        """The information of several estimates, the participant's own first."""
        raise NotImplementedError

    def fusion_cycles(self, size: int) -> float:
        """Operations to fuse one estimate of so many columns."""
        raise NotImplementedError

    def fused(self, scene: Scene) -> Flow[None]:
        """The update and the rounds."""
        size = len(scene.motion.columns)
        yield Local(partial(_update, scene=scene), 2.0 * inversion_cycles(size))
        for _ in range(self.rounds):
            yield Exchange(_estimate)
            yield Local(_hear, 1.0)
            yield Local(self._fuse, partial(self._cycles, size=size))

    def _fuse(self, member: Member) -> None:
        others = [unpacked(numbers) for numbers in member.memory[FUSED]]
        if others:
            store(member, *self.combined([information_of(member), *(_informed(*each) for each in others)]))

    def _cycles(self, member: Member, size: int) -> float:
        return len(member.memory[FUSED]) * self.fusion_cycles(size)


@part
class CovarianceIntersection(EstimateFusion):
    """Covariance intersection: a convex combination of information, consistent whatever estimates have in common.

    J = ω J₁ + (1 - ω) J₂, one neighbour after the other by its id; ω minimises the determinant or the trace of the
    covariance. `fast` fuses all at once, weighed by the inverse traces of their covariances (Niehsen 2002).

    Source: Julier, Uhlmann (1997).
    """

    criterion: Annotated[Criterion, "what the weights minimise"] = "determinant"

    def combined(self, estimates: list[Information]) -> Information:
        """The convex combination."""
        if self.criterion == "fast":
            weights = np.array([1.0 / np.trace(inverse(matrix)) for _, matrix in estimates])
            return _weighed(weights / weights.sum(), estimates)
        fused = estimates[0]
        for other in estimates[1:]:
            omega = _best(fused[1], other[1], self.criterion)
            fused = _weighed(np.array([omega, 1.0 - omega]), [fused, other])
        return fused

    def fusion_cycles(self, size: int) -> float:
        """An inversion, or those of a search."""
        return (2.0 if self.criterion == "fast" else SEARCH) * inversion_cycles(size)


@part
class NaiveFusion(EstimateFusion):
    """Naive fusion: the product of estimates as if they were independent. A warning, not a filter to use.

    What neighbours have in common (the prior, the process noise, earlier exchanges) counts once for each: the
    covariance is far too small.
    """

    def combined(self, estimates: list[Information]) -> Information:
        """The sum of information."""
        return _weighed(np.ones(len(estimates)), estimates)

    def fusion_cycles(self, size: int) -> float:
        """An inversion."""
        return 2.0 * inversion_cycles(size)


def _update(member: Member, scene: Scene) -> None:
    update(member, scene, news_of(member, scene))


def _estimate(member: Member) -> Parcel:
    mean = member.memory[MEAN]
    return parcel(packed(mean, member.memory[COV]), moment_packets(mean.size), FUSED)


def _hear(member: Member) -> None:
    member.memory[FUSED] = [numbers for _, numbers in received(member, FUSED)]


def _informed(mean: Floats, cov: Floats) -> Information:
    matrix = inverse(cov)
    return matrix @ mean, matrix


def _weighed(weights: Floats, estimates: list[Information]) -> Information:
    vectors, matrices = (np.array(each) for each in zip(*estimates, strict=True))
    return weights @ vectors, np.tensordot(weights, matrices, axes=1)


def _best(one: Floats, other: Floats, criterion: Criterion) -> float:
    """The weight ω of the first of two information matrices that minimises the criterion, which is convex in it.

    With the vectors X that diagonalise both, Xᵀ J₂ X = I and Xᵀ J₁ X = I + D, the covariance is X (I + ω D)⁻¹ Xᵀ: the
    slope of the log-determinant is -Σ dᵢ / (1 + ω dᵢ), that of the trace -Σ |xᵢ|² dᵢ / (1 + ω dᵢ)².
    """
    values, vectors = eigh(one, other)
    excess, power = values - 1.0, 1 if criterion == "determinant" else 2
    sizes = np.ones(values.size) if criterion == "determinant" else (vectors**2).sum(axis=0)

    def gain(omega: float) -> float:
        return float((sizes * excess / (1.0 + omega * excess) ** power).sum())

    if gain(0.0) <= 0.0:
        return 0.0
    return 1.0 if gain(1.0) >= 0.0 else float(brentq(gain, 0.0, 1.0, xtol=1e-6))
