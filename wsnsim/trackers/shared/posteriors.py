"""The posterior of a Gaussian after readings of its position: mode by Fisher scoring, moments by quadrature about it.

    updated(mean (D,), cov (D, D), seen, scene) -> Posterior: mean, cov, log_evidence

The position is x = m + L u with P = L Lᵀ, its prior covariance, so that u is standard normal before the readings. The
mode of p(u) p(readings | x) is found by Fisher scoring with a line search (Osborne 1992), its moments and its integral
by Gauss-Hermite quadrature about the mode, as wide as the Fisher information there says (Naylor, Smith 1982). A reading
depends on the position alone, so that the other columns follow by their regression on it, which is exact.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import Scene
from wsnsim.base.sensing import informations
from wsnsim.trackers.shared.moments import symmetric
from wsnsim.trackers.shared.readings import Evidence
from wsnsim.trackers.shared.stacks import Score

ITERATIONS: Final = 20
"""At most, of Fisher scoring."""
NEAR: Final = 0.7
"""A step of fewer posterior standard deviations is the last: what it leaves is far less than what quadrature allows."""
STEP: Final = 1e-3
"""Posterior standard deviations of the differences that stand for a slope."""
HALVINGS: Final = 8
"""Of a step that does not gain."""
SHIFT: Final = 0.25
"""The quadrature is repeated about its own mean and covariance while these are more than this from where it was."""
REPEATS: Final = 6
"""At most, of the quadrature."""
NARROWING: Final = 0.02
"""Least variance, of that of its Gaussian, about which a quadrature is repeated: one point may hold all the weight."""
LEAST_SPREAD: Final = 1e-9
"""Least variance of a result, of that of the quadrature's Gaussian."""
LEAST_SHARE: Final = 1e-12
"""Of the prior's variance along any axis, below which a difference from it keeps too few digits of the posterior's."""
ORDER: Final = 5
ORDER_WIDE: Final = 9
"""Points of the quadrature along an axis; under a wide prior, the posterior may be far from a Gaussian."""
WIDE: Final = 0.03
"""A prior is wide if its standard deviation is more than this share of the distance to the sensors."""
SIDE: Final = 13
"""Points along an axis, out to three standard deviations, at which a search starts under a wide prior."""
JITTER: Final = 1e-12
LEAST_SQUARE: Final = 1e-24
_ORIGIN: Final = np.zeros((2, 1))
_UNIT: Final = {columns: np.eye(columns) for columns in (1, 2)}


class Posterior(NamedTuple):
    """Mean (D,) and covariance (D, D), and the log of the readings' probability density under the prior."""

    mean: Floats
    cov: Floats
    log_evidence: float


class Moments(NamedTuple):
    """Mean (P,), a root (P, P) of the covariance, and the log of the integral, of a density of u."""

    mean: Floats
    root: Floats
    log_integral: float


def updated(mean: Floats, cov: Floats, seen: Evidence, scene: Scene) -> Posterior:
    """The posterior of a Gaussian with at least one reading; the prior itself where no point explains them."""
    place, sensor = list(scene.motion.position), scene.sensor
    at, unit = mean[place], _UNIT[len(place)]
    spread = cov[place][:, place]
    root, inverse = _factors(spread)

    def score(u: Floats) -> Floats:
        logs = sensor.log_likelihood(at[:, None] + root @ u, seen.readings, seen.positions, seen.traits)
        density: Floats = logs - 0.5 * (u * u).sum(axis=0)
        return density

    def information(u: Floats) -> Floats:
        point = np.ascontiguousarray((at + root @ u)[:, None])
        total = informations(sensor, point, seen.positions, seen.traits)[..., 0].sum(axis=0)
        precision: Floats = root.T @ total @ root + unit
        return precision

    start, order = np.zeros(len(place)), ORDER
    if is_wide(spread, at, seen.positions):
        lattice = _lattice(len(place))
        start, order = lattice[:, np.argmax(score(lattice))], ORDER_WIDE
    found = _integrated(score, _mode(score, information, start), order)
    if found is None:
        return Posterior(mean, cov, -np.inf)
    gain = cov[:, place] @ inverse  # P_xp L⁻ᵀ
    less = unit - found.root @ found.root.T
    later, own = symmetric(cov - gain @ less @ gain.T), root @ found.root
    if np.linalg.det(found.root) ** 2 < LEAST_SHARE * (found.root * found.root).sum():
        later[np.ix_(place, place)] = own @ own.T
    return Posterior(mean + gain @ found.mean, later, found.log_integral)


def is_wide(spread: Floats, at: Floats, positions: Floats) -> bool:
    """Whether a position's covariance (P, P) is wide: a law of the distance may be far from a line under it."""
    squares = ((positions[:, : at.size] - at) ** 2).sum(axis=1)
    return bool(np.trace(spread) > at.size * WIDE**2 * squares.mean())


def _mode(score: Score, information: Score, start: Floats) -> Moments:
    """A point near the mode, and the root of the inverse information there or a last short step before."""
    point, size = start, start.size
    for _ in range(ITERATIONS):
        _, root = _factors(information(point))
        around = score(point[:, None] + STEP * np.concatenate([root, -root, _ORIGIN[:size]], axis=1))
        if not np.isfinite(around).all():
            break
        slopes = (around[:size] - around[size:-1]) / (2.0 * STEP)
        move = root @ slopes
        if slopes @ slopes < NEAR**2:
            point = point + move
            break
        for _ in range(HALVINGS):
            trial = point + move
            if score(trial[:, None])[0] > around[-1]:
                break
            move = 0.5 * move
        else:
            break
        point = trial
    return Moments(point, root, 0.0)


def _factors(square: Floats) -> tuple[Floats, Floats]:
    """The Cholesky factor L (P, P) of a positive matrix, and L⁻ᵀ, a root of the matrix's inverse."""
    first = math.sqrt(max(square[0, 0], LEAST_SQUARE))
    if len(square) == 1:
        return np.array([[first]]), np.array([[1.0 / first]])
    below = square[1, 0] / first
    second = math.sqrt(max(square[1, 1] - below * below, JITTER * square[1, 1], LEAST_SQUARE))
    lower = np.array([[first, 0.0], [below, second]])
    return lower, np.array([[1.0 / first, -below / (first * second)], [0.0, 1.0 / second]])


def _integrated(score: Score, about: Moments, order: int) -> Moments | None:
    """The moments of exp(score) by quadrature about a Gaussian, repeated about its result until that stays."""
    nodes, log_weights = _quadrature(about.mean.size, order)
    unit, result = _UNIT[about.mean.size], None
    mean, root, log_volume = about.mean, about.root, _log_volume(about.root)
    for _ in range(REPEATS):
        logs = score(mean[:, None] + root @ nodes) + log_weights
        top = logs.max()
        if not math.isfinite(top):
            return None
        weights = np.exp(logs - top)
        total = weights.sum()
        middle = nodes @ weights / total
        cov = (nodes * weights) @ nodes.T / total - middle[:, None] * middle
        mean = mean + root @ middle
        result = Moments(mean, root @ _factors(cov + LEAST_SPREAD * unit)[0], float(top) + math.log(total) + log_volume)
        if np.abs(middle).max() < SHIFT and np.abs(cov - unit).max() < SHIFT:
            break
        within, _ = _factors(cov + NARROWING * unit)
        root, log_volume = root @ within, log_volume + _log_volume(within)
    return result


def _log_volume(triangular: Floats) -> float:
    """The log of the determinant of a triangular matrix with a positive diagonal."""
    return sum(map(math.log, triangular.diagonal().tolist()))


@lru_cache
def _quadrature(columns: int, order: int) -> tuple[Floats, Floats]:
    """Points (P, n) of Gauss-Hermite quadrature, and for each the log of its weight over the density's exp(-u²/2)."""
    axis, weights = np.polynomial.hermite_e.hermegauss(order)
    nodes = np.stack([each.ravel() for each in np.meshgrid(*[axis] * columns, indexing="ij")])
    products = np.stack([each.ravel() for each in np.meshgrid(*[weights / weights.sum()] * columns, indexing="ij")])
    return nodes, np.log(products).sum(axis=0) + 0.5 * (nodes * nodes).sum(axis=0)


@lru_cache
def _lattice(columns: int) -> Floats:
    """Points (P, n) out to three standard deviations."""
    axis = np.linspace(-3.0, 3.0, SIDE)
    return np.stack([each.ravel() for each in np.meshgrid(*[axis] * columns, indexing="ij")])
