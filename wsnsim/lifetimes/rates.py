"""Mean joules of a visit by node, from a few simulated visits: posterior draws without the curse of the smallest value.

    loads = fit_loads(samples (K, N))        loads.draw(rng, 100) -> (100, N)

The first death is a minimum over nodes. The node whose mean looks largest is one whose noise is large, so a minimum
over raw means comes too early, and resampling visits repeats the error. So the loads of nodes, relative to their mean,
are taken as draws from a distribution that is estimated by nonparametric maximum likelihood (Kiefer and Wolfowitz 1956;
Jiang and Zhang 2009, "General maximum likelihood empirical Bayes estimation of normal means"): it pools nodes where
they are alike, and keeps a hot spot whose difference is larger than the noise. The level of all loads, which nodes have
in common, has the uncertainty of a mean of K visits.
"""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats

PENALTY: Final = 0.5
ATOMS: Final = 100
"""Support points of the estimated distribution: spacings are far below the noise of 12 visits or more."""
ITERATIONS: Final = 200
"""Steps of the EM algorithm; further steps change no first death by 0.1 %."""
PRIOR_DEGREES: Final = 8.0
"""Degrees of freedom with which the variance of a node's visits is drawn to what its load suggests (our choice)."""


@dataclasses.dataclass(frozen=True)
class Loads:
    """The posterior distribution of mean loads.

    Attributes:
        mean: (N,) posterior means, in the unit of the samples.
        raw: (N,) sample means.
        atoms: (A,) support points, relative to the mean load.
        posterior: (N, A) probabilities of the atoms for each node.
        level: mean load of the nodes.
        level_error: relative standard error of that.
        samples: number of visits.
    """

    mean: Floats
    raw: Floats
    atoms: Floats
    posterior: Floats
    level: float
    level_error: float
    samples: int
    shape: float
    alike: float

    def draw(self, rng: np.random.Generator, draws: int) -> Floats:
        """(draws, N) loads from the posterior distribution."""
        chosen = np.empty((draws, len(self.raw)))
        relative = self.raw / self.level if self.level else self.raw
        for i in range(draws):
            if rng.random() < self.alike:
                chosen[i] = 1.0
                continue
            theta = _picked(self.atoms, self.posterior, rng)
            again = theta * rng.gamma(self.shape, 1.0 / self.shape, theta.size) if self.shape < 1e8 else theta
            weights = _weights(_likelihood(again, self.atoms, self.shape))
            posterior = _likelihood(relative, self.atoms, self.shape) * weights
            chosen[i] = _picked(self.atoms, posterior / posterior.sum(axis=1, keepdims=True), rng)
        level = self.level * np.exp(self.level_error * rng.standard_t(max(self.samples - 1, 1), (draws, 1)))
        return level * chosen


def fit_loads(samples: Floats) -> Loads:
    """The posterior distribution of each node's mean load.

    Args:
        samples: (K, N) joules that each of K visits takes from each of N nodes, K at least 2.
    """
    count, nodes = samples.shape
    raw, totals = samples.mean(axis=0), samples.mean(axis=1)
    level = float(totals.mean())
    if not level > 0.0:
        return Loads(np.maximum(raw, 0.0) * 0.0, raw, np.zeros(1), np.ones((nodes, 1)), 0.0, 0.0, count, 1e8, 1.0)
    relative = raw / level
    # a visit that takes more from all nodes says nothing about the share of one
    variances = ((samples - totals[:, None] * relative) / level).var(axis=0, ddof=1)
    squares = max(float((relative**2).sum() - variances.sum() / count), float(nodes))
    shape = count * squares / max(float(variances.sum()), 1e-12)
    shape = min(shape, 1e8)
    atoms, posterior, gain = _deconvolved(relative, shape)
    alike = 1.0 / (1.0 + np.exp(min(gain - PENALTY * np.log(nodes), 50.0)))
    mean = level * posterior @ atoms
    return Loads(mean, raw, atoms, posterior, level, float(totals.std(ddof=1) / level / np.sqrt(count)), count, shape, alike)


def _picked(atoms, posterior, rng):
    picks = rng.random((len(posterior), 1))
    return atoms[np.minimum((picks > np.cumsum(posterior, axis=1)).sum(axis=1), len(atoms) - 1)]


def _likelihood(values: Floats, atoms: Floats, shape: float) -> Floats:
    ratio = np.maximum(values, 1e-9)[:, None] / atoms
    logs = (shape - 1.0) * np.log(ratio) - shape * ratio - np.log(atoms)
    return np.exp(logs - logs.max(axis=1, keepdims=True))


def _weights(likelihood: Floats) -> Floats:
    weights = np.full(likelihood.shape[1], 1.0 / likelihood.shape[1])
    for _ in range(ITERATIONS):
        weights *= (1.0 / (likelihood @ weights)) @ likelihood / len(likelihood)
    return weights


def _deconvolved(values: Floats, shape: float) -> tuple[Floats, Floats, float]:
    """The means (A,) of the distribution from which values (N,) come, and posteriors (N, A).

    A value is a gamma variate of the shape `shape` around its mean.
    """
    low, high = max(float(values.min()), 0.02), max(float(values.max()), 0.02)
    if high - low < 1e-9 * high:
        return np.array([low]), np.ones((len(values), 1)), 0.0
    atoms = np.append(np.geomspace(low, high, ATOMS), 1.0)
    likelihood = _likelihood(values, atoms, shape)
    weights = _weights(likelihood)
    gain = float(np.log(likelihood @ weights).sum() - np.log(likelihood[:, -1]).sum())
    posterior = likelihood * weights
    return atoms, posterior / posterior.sum(axis=1, keepdims=True), gain
