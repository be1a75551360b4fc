"""Residuals of a law: their correlated part, along the path and over time, and the white part.

Residuals of one node on one track are taken as a Gudmundson process along the travelled path plus white noise: their
covariance at a path of Δ m apart is shadowing² exp(-Δ/decorrelation), and at the same reading shadowing² + sd². The
means of products of pairs, in bins of Δ, are fitted by least squares weighted by their number of pairs (our choice).
Residuals lack what the gains of nodes have taken up, the mean of the process over all of a node's readings; the fitted
curve is lowered by the variance of this mean.

The white part is normal or Student's t, with `sd` as its standard deviation and more than two degrees of
freedom. The density of a residual is that of the sum of N(0, shadowing²) and of the white part, integrated by
Gauss-Hermite quadrature.

Source: Gudmundson (1991), "Correlation model for shadow fading in mobile radio systems".
"""

from __future__ import annotations

import math
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np
from scipy import special, stats

from wsnsim.base.arrays import Floats, Ints
from wsnsim.fitting.located_readings import LocatedReadings

BINS: Final = 30
LONGEST: Final = 0.25
"""Longest lag, relative to the longest track: beyond it, pairs are few and share the error of the gains."""
TRIED: Final = 60
"""Decorrelation distances that are tried."""
PATH_POINTS: Final = 80
"""Points of each track from which the variance of the process's mean is computed."""
FEW_PAIRS: Final = 0.05
"""Bins of a curve with fewer pairs than this, relative to the fullest one, are left out."""
NEAR_ONE_SECOND: Final = 0.25
"""Readings that are 1 s apart up to this (s) give the correlation at 1 s."""


class Lagged(NamedTuple):
    """Sums over pairs of residuals, by block of the earlier reading and bin of the lag.

    Attributes:
        lags: (K,) mean lag of each bin that has pairs.
        products: (B, K) sums of products.
        counts: (B, K) numbers of pairs.
    """

    lags: Floats
    products: Floats
    counts: Floats

    def means(self, weights: Floats) -> tuple[Floats, Floats]:
        """Mean products and numbers of pairs, (R, K) each, for R weightings (R, B) of the blocks."""
        counts = weights @ self.counts
        return weights @ self.products / np.maximum(counts, 1.0), counts


class Shadowing(NamedTuple):
    """The correlated part for R weightings of the blocks.

    Attributes:
        variances: (R,) of the process.
        distances: (R,) over which its correlation falls to 1/e.
        remaining: (R,) share of the variance that the gains leave in the residuals.
        limited: whether the first distance is the least or the greatest one that was tried.
    """

    variances: Floats
    distances: Floats
    remaining: Floats
    limited: bool


class Averaged(NamedTuple):
    """What gains take up of the process.

    Attributes:
        tracks: (n_t,) points of the travelled path (m) of each track.
        shares: of the readings on each track.
        nodes: nodes over which the mean is taken: 1 if each has a gain, else all.
    """

    tracks: tuple[Floats, ...]
    shares: tuple[float, ...]
    nodes: int

    def variance(self, distance: float) -> float:
        """The variance of the mean of a process of variance 1 over all readings of these nodes."""
        found = 0.0
        for path, share in zip(self.tracks, self.shares, strict=True):
            found += share**2 * float(np.exp(-np.abs(path[:, None] - path) / distance).mean())
        return found / self.nodes


def averaged(sample: LocatedReadings, gains: bool) -> Averaged:
    """The paths of a sample's tracks, at `PATH_POINTS` of their readings."""
    paths, shares = [], []
    for _, own in sample.by_file():
        path = sample.travelled[own]
        paths.append(path[np.linspace(0, len(path) - 1, PATH_POINTS).astype(np.int64)])
        shares.append(float(own.mean()))
    heard = 1 if gains else max(len(np.unique(sample.nodes)), 1)
    return Averaged(tuple(paths), tuple(shares), heard)


def lagged(sample: LocatedReadings, residuals: Floats, blocks: Ints, along: Floats) -> Lagged:
    """The products of pairs by their lag in `along` (n,): the travelled path, or the time."""
    first, second = sample.pairs
    lags = along[second] - along[first]
    lengths = [float(np.ptp(along[own])) for _, own in sample.by_file() if own.any()]
    longest = LONGEST * max(lengths, default=0.0)
    moving = lags[(lags > 0.0) & (lags <= longest)]
    if not moving.size:
        return Lagged(np.empty(0), np.empty((0, 0)), np.empty((0, 0)))
    shortest = max(float(np.quantile(moving, 0.01)), longest * 1e-4)
    edges = np.concatenate([[0.0], np.geomspace(shortest, longest, BINS)])
    near = lags <= longest
    first, second, lags = first[near], second[near], lags[near]
    bins = np.searchsorted(edges, lags, side="left")
    return _summed(bins, lags, residuals[first] * residuals[second], blocks[first], int(blocks.max()) + 1)


def _summed(bins: Ints, lags: Floats, products: Floats, blocks: Ints, count: int) -> Lagged:
    """Sums by block and bin, without bins that have no pairs."""
    width = int(bins.max()) + 1
    cell = blocks * width + bins
    numbers = np.bincount(cell, minlength=count * width).reshape(count, width)
    sums = np.bincount(cell, products, count * width).reshape(count, width)
    total = numbers.sum(axis=0)
    used = total > 0
    means = np.bincount(bins, lags, width)[used] / total[used]
    return Lagged(means.astype(np.float64), sums[:, used].astype(np.float64), numbers[:, used].astype(np.float64))


def shadowing(found: Lagged, mean: Averaged, weights: Floats) -> Shadowing:
    """Variance and distance of the curve that fits the mean products best, for weightings (R, B) of blocks.

    The variance is 0 where the mean products are not positive.
    """
    if not found.lags.size:
        return Shadowing(np.zeros(len(weights)), np.full(len(weights), np.nan), np.ones(len(weights)), False)
    means, counts = found.means(weights)
    longest = float(found.lags.max())
    tried = np.geomspace(max(float(found.lags[found.lags > 0.0].min()), longest * 1e-3), longest, TRIED)
    taken = np.array([mean.variance(distance) for distance in tried.tolist()])
    shapes = np.exp(-found.lags / tried[:, None]) - taken[:, None]
    across = (counts * means) @ shapes.T
    norms = counts @ (shapes**2).T
    variances = np.maximum(across / norms, 0.0)
    best = np.argmax(variances * across, axis=1)
    chosen = variances[np.arange(len(weights)), best]
    distances = np.where(chosen > 0.0, tried[best], np.nan)
    return Shadowing(chosen, distances, 1.0 - taken[best], int(best[0]) in (0, TRIED - 1))


def correlation_at(sample: LocatedReadings, residuals: Floats, seconds: float) -> float:
    """The correlation of residuals of one node that are this many seconds apart; NaN without such pairs."""
    first, second = sample.pairs
    near = np.abs(sample.times[second] - sample.times[first] - seconds) <= NEAR_ONE_SECOND
    variance = float(residuals.var())
    if not near.any() or variance <= 0.0:
        return float("nan")
    centred = residuals - residuals.mean()
    return float((centred[first[near]] * centred[second[near]]).mean()) / variance


def curve(sample: LocatedReadings, residuals: Floats, longest: float, width: float) -> tuple[Floats, Floats]:
    """Lags (K,) in s and the correlations (K,) of residuals over time, in bins of this width that have many pairs."""
    first, second = sample.pairs
    lags = sample.times[second] - sample.times[first]
    near = lags <= longest
    bins = np.floor(lags[near] / width).astype(np.int64)
    products = (residuals[first] * residuals[second])[near]
    numbers = np.bincount(bins)
    used = numbers > FEW_PAIRS * numbers.max(initial=0)
    means = np.bincount(bins, products)[used] / numbers[used]
    centres: Floats = (np.flatnonzero(used).astype(np.float64) + 0.5) * width
    return centres, means / max(float((residuals**2).mean()), 1e-300)


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
            return np.asarray(stats.norm.logpdf(residuals, scale=self.total))
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
    return float(found.counts.sum(axis=0) @ stats.norm.logpdf(found.centres, scale=sd))


def _log_sum(residuals: Floats, sd: float, dofs: Floats, shadowing: float) -> Floats:
    """(D, n) log density of the sum of N(0, shadowing²) and Student's t of standard deviation sd."""
    student = stats.t(dofs[:, None], scale=sd * np.sqrt(1.0 - 2.0 / dofs[:, None]))
    if shadowing <= 0.0:
        return np.asarray(student.logpdf(residuals))
    # the expectation over a standard normal variable
    places, weights = np.polynomial.hermite_e.hermegauss(NODES)
    parts = np.stack([student.logpdf(residuals - shadowing * place) for place in places])
    return np.asarray(special.logsumexp(parts, axis=0, b=weights[:, None, None] / weights.sum()))
