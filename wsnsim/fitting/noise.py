"""The white part of residuals: normal or Student's t, beside a correlated part that is normal.

The density of a residual is that of the sum of N(0, shadowing²) and of the white part, integrated by Gauss-Hermite
quadrature. Student's t has `sd` as its standard deviation and more than two degrees of freedom.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np
from scipy import special

from wsnsim.base.arrays import Floats, Ints

Family: TypeAlias = Literal["normal", "student_t"]
NODES: Final = 64
"""Nodes of the quadrature over the correlated part."""
LEAST_WHITE_SHARE: Final = 0.3
"""Below this ratio of the white to the correlated part, the family of the white part cannot be told."""
GRID: Final = 2.0 + np.geomspace(0.1, 200.0, 60)
"""Degrees of freedom that are tried."""
PER_SD: Final = 20
"""Bins of the histogram of residuals in one standard deviation: fine enough that binning does not move the fit."""
FARTHEST: Final = 30.0
"""Residuals beyond this many standard deviations count as there."""
LOG_2PI: Final = math.log(2.0 * math.pi)


class Noise(NamedTuple):
    """The noise of a reading.

    Attributes:
        family: of the white part.
        sd: standard deviation of the white part.
        dof: its degrees of freedom; infinite if it is normal.
        shadowing: standard deviation of the correlated part.
    """

    family: Family
    sd: float
    dof: float
    shadowing: float

    @property
    def total(self) -> float:
        """The standard deviation of both parts together."""
        return math.hypot(self.sd, self.shadowing)

    def log_density(self, residuals: Floats) -> Floats:
        """(n,) log density of residuals, each by itself."""
        if not math.isfinite(self.dof):
            return _log_normal(residuals, self.total)
        densities: Floats = _log_sum(residuals, self.sd, np.array([self.dof]), self.shadowing)[0]
        return densities


class Histogram(NamedTuple):
    """Residuals by block and bin: centres (K,) and counts (B, K)."""

    centres: Floats
    counts: Floats


def histogram(residuals: Floats, blocks: Ints, sd: float) -> Histogram:
    """The counts of residuals by block, in narrow bins."""
    width = sd / PER_SD
    bins = np.rint(np.clip(residuals, -FARTHEST * sd, FARTHEST * sd) / width).astype(np.int64)
    found, index = np.unique(bins, return_inverse=True)
    count = int(blocks.max()) + 1
    counts = np.bincount(blocks * len(found) + index.ravel(), minlength=count * len(found))
    return Histogram((found * width).astype(np.float64), counts.reshape(count, len(found)).astype(np.float64))


def student_t(found: Histogram, sd: float, shadowing: float, weights: Floats) -> tuple[Floats, Floats]:
    """Degrees of freedom with the greatest likelihood, and its logarithm, (R,) each, for weightings (R, B)."""
    table = _log_sum(found.centres, sd, GRID, shadowing)
    likelihoods = weights @ found.counts @ table.T
    best = np.argmax(likelihoods, axis=1)
    return GRID[best], likelihoods[np.arange(len(weights)), best]


def normal_log_likelihood(found: Histogram, sd: float) -> float:
    """The log-likelihood of all residuals as normal ones of this standard deviation."""
    return float(found.counts.sum(axis=0) @ _log_normal(found.centres, sd))


def _log_normal(residuals: Floats, sd: float) -> Floats:
    result: Floats = -0.5 * ((residuals / sd) ** 2 + LOG_2PI) - math.log(sd)
    return result


def _log_sum(residuals: Floats, sd: float, dofs: Floats, shadowing: float) -> Floats:
    """(D, n) log density of the sum of N(0, shadowing²) and Student's t of standard deviation sd."""
    if shadowing <= 0.0:
        return _log_student(residuals, sd, dofs)
    places, weights = _quadrature()
    parts = [
        math.log(weight) + _log_student(residuals - shadowing * place, sd, dofs)
        for place, weight in zip(places.tolist(), weights.tolist(), strict=True)
    ]
    result: Floats = special.logsumexp(np.stack(parts), axis=0)
    return result


def _log_student(residuals: Floats, sd: float, dofs: Floats) -> Floats:
    """(D, n) log density of Student's t scaled to the standard deviation sd."""
    nu = dofs[:, None]
    scale = sd * np.sqrt((nu - 2.0) / nu)
    constant = (
        special.gammaln((nu + 1.0) / 2.0) - special.gammaln(nu / 2.0) - 0.5 * np.log(nu * math.pi) - np.log(scale)
    )
    result: Floats = constant - (nu + 1.0) / 2.0 * np.log1p((residuals / scale) ** 2 / nu)
    return result


@cache
def _quadrature() -> tuple[Floats, Floats]:
    """Nodes and weights of the expectation over a standard normal variable."""
    places, weights = np.polynomial.hermite_e.hermegauss(NODES)
    return places, weights / weights.sum()
