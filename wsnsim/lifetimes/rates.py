"""Mean joules of a visit by node, from a few simulated visits: posterior draws without the curse of the smallest value.

    loads = fit_loads(samples (K, N))        loads.draw(rng, 100) -> (100, N)

The first death is a minimum over nodes. The node whose mean looks largest is one whose noise is large, so a minimum
over raw means comes too early, and resampling visits repeats the error. So the loads of nodes, relative to their mean,
are taken as draws from a distribution of which the spread is unknown: nothing, a body (log-normal or uniform), and a
share of hot spots of any size (hierarchical Bayes; Efron 2011, "Tweedie's formula and selection bias"). Each draw takes
the parameters of the distribution from their posterior, then the loads from theirs: nodes are pooled where they may be
alike, and a hot spot whose difference is larger than the noise is kept. The level of all loads, which nodes have in
common, has the uncertainty of a mean of K visits.
"""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np
from scipy import special

from wsnsim.base.arrays import Floats

ATOMS: Final = 300
"""Possible loads, about 2 % apart."""
LEAST: Final = 0.05
"""The least possible load, relative to the mean."""
SPREADS: Final = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0)
"""Standard deviations of the body, relative to its mean, each equally likely."""
UNIFORM_MOST: Final = 0.55
"""Largest standard deviation of a uniform body: above it, loads would be negative."""
HOT_SHARES: Final = (0.01, 0.03, 0.1)
"""Shares of hot spots, each equally likely."""
HOT_LEAST: Final = 1.5
"""Hot spots are either all near one load above this times the body, or uniform in the logarithm from there on."""
HOT_PLACES: Final = 20
HOT_SPREAD: Final = 0.03
COLD: Final = 0.5
"""Probability, before anything is known, that there are no hot spots (our choice)."""
ALIKE: Final = 0.65
"""Probability, before anything is known, that all nodes but hot spots are equal (our choice)."""
CENSORED: Final = 0.2
"""Quantile of the noise below which only that a mean is low counts: a node may be missed by all visits."""


@dataclasses.dataclass(frozen=True)
class Loads:
    """The posterior distribution of mean loads.

    Attributes:
        level: mean load of the nodes.
        level_error: relative standard error of that.
        noise: (K, N) how visits differ: errors of nodes that a visit reaches together are alike.
        atoms: (A,) possible loads, relative to the mean load.
        likelihood: (N, A) of the sample mean of each node, up to a factor.
        priors: (H, A) probabilities of the atoms for each possible distribution of loads.
        weights: (H,) posterior probabilities of these.
    """

    level: float
    level_error: float
    noise: Floats
    atoms: Floats
    likelihood: Floats
    priors: Floats
    weights: Floats

    def draw(self, rng: np.random.Generator, draws: int) -> Floats:
        """(draws, N) loads from the posterior distribution."""
        chosen = np.empty((draws, len(self.likelihood)))
        for i, prior in enumerate(self.priors[rng.choice(len(self.weights), draws, p=self.weights)]):
            sums = np.cumsum(self.likelihood * prior, axis=1)
            ranks = special.ndtr(rng.standard_normal(len(self.noise)) @ self.noise)
            picks = (ranks[:, None] * sums[:, -1:] >= sums).sum(axis=1)
            chosen[i] = self.atoms[np.minimum(picks, len(self.atoms) - 1)]
        level = self.level * np.exp(self.level_error * rng.standard_t(max(len(self.noise) - 1, 1), (draws, 1)))
        loads: Floats = level * chosen / chosen.mean(axis=1, keepdims=True)
        return loads


def fit_loads(samples: Floats) -> Loads:
    """The posterior distribution of each node's mean load.

    Args:
        samples: (K, N) joules that each of K visits takes from each of N nodes, K at least 2.
    """
    count, nodes = samples.shape
    totals = samples.mean(axis=1)
    level = float(totals.mean())
    if not level > 0.0:
        one = np.ones((1, 1))
        return Loads(0.0, 0.0, np.zeros((count, nodes)), one[0], np.ones((nodes, 1)), one, one[0])
    relative = samples.mean(axis=0) / level
    atoms = np.geomspace(LEAST, max(3.0, 2.0 * float(relative.max())), ATOMS)
    likelihood = _likelihood(relative, atoms, _shape(samples / level))
    priors, logs = _priors(atoms)
    noise = _noise(samples / level)
    logs += np.log(likelihood @ priors.T + 1e-300).sum(axis=0) * _independent(noise)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    error = float(totals.std(ddof=1) / level / np.sqrt(count))
    return Loads(level, error, noise, atoms, likelihood, priors, weights)


def _noise(samples: Floats) -> Floats:
    """(K, N) visits without what they have in common and without the means of nodes; columns have the norm 1."""
    relative = samples.mean(axis=0)
    rest = samples - samples.mean(axis=1, keepdims=True) * relative
    rest -= rest.mean(axis=0)
    noise: Floats = rest / np.maximum(np.linalg.norm(rest, axis=0), 1e-300)
    return noise


def _independent(noise: Floats) -> float:
    """The share of nodes that would tell as much if their noise was independent: one visit heats up neighbours."""
    count, nodes = noise.shape
    squares = float(((noise @ noise.T) ** 2).sum()) - nodes  # of the correlations of all pairs
    chance = nodes * (nodes - 1) / max(count - 1, 1)
    return float(nodes / (nodes + max(squares - chance, 0.0)))


def _shape(samples: Floats) -> float:
    """The shape of the gamma distribution of means of visits (K, N) around their expectation, alike for all nodes."""
    count, nodes = samples.shape
    relative = samples.mean(axis=0)
    # a visit that takes more from all nodes says nothing about the share of one
    noise = float((samples - samples.mean(axis=1, keepdims=True) * relative).var(axis=0, ddof=1).sum())
    squares = max(float((relative**2).sum()) - noise / count, float(nodes))
    return float(min(count * squares / max(noise, 1e-12), 1e8))


def _likelihood(values: Floats, atoms: Floats, shape: float) -> Floats:
    """(N, A) likelihood of sample means (N,), relative to their level, if the atoms (A,) are the expectations."""
    censor = special.gammaincinv(shape, CENSORED) / shape
    ratio = np.maximum(values, censor)[:, None] / atoms
    logs = (shape - 1.0) * np.log(ratio) - shape * ratio - np.log(atoms)
    low = np.log(special.gammainc(shape, shape * ratio) + 1e-300)
    logs = np.where((values <= censor)[:, None], low, logs)
    likelihood: Floats = np.exp(logs - logs.max(axis=1, keepdims=True))
    return likelihood


def _priors(atoms: Floats) -> tuple[Floats, Floats]:
    """(H, A) distributions of loads whose mean is 1, and the logarithms (H,) of their probabilities."""
    step = np.log(atoms[1] / atoms[0])
    bodies = [(np.abs(np.log(atoms)) <= 0.5 * step, ALIKE)]
    normal = [np.exp(-0.5 * (np.log(atoms) / s) ** 2) for s in SPREADS]
    uniform = [atoms * (np.abs(atoms - 1.0) <= np.sqrt(3.0) * s) for s in SPREADS if s <= UNIFORM_MOST]
    bodies += [(body, 0.5 * (1.0 - ALIKE) / len(kind)) for kind in (normal, uniform) for body in kind]
    above = np.maximum(atoms >= HOT_LEAST, atoms == atoms[-1]).astype(float)
    places = np.geomspace(HOT_LEAST, atoms[-1] / 1.3, HOT_PLACES)
    spots = [above, *(np.exp(-0.5 * (np.log(atoms / place) / HOT_SPREAD) ** 2) for place in places)]
    odds = [0.1, *np.full(HOT_PLACES, 0.9 / HOT_PLACES)]
    hot = [
        (spot, share, (1.0 - COLD) / len(HOT_SHARES) * p)
        for spot, p in zip(spots, odds, strict=True)
        for share in HOT_SHARES
    ]
    priors, logs = [], []
    for body, probability in bodies:
        for spot, share, chance in [(above, 0.0, COLD), *hot]:
            mixed = (1.0 - share) * body / body.sum() + share * spot / spot.sum()
            shift = round(float(np.log(mixed @ atoms) / step))
            priors.append(np.roll(mixed, -shift))
            logs.append(np.log(probability * chance))
    return np.array(priors), np.array(logs)
