"""What a head believes of several targets: tracks, each a mixture of Gaussians."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.scans import TrackEstimate
from wsnsim.trackers.shared.gaussian_port import GaussianBank
from wsnsim.trackers.shared.moments import mixed

History = tuple[tuple[tuple[int, int], ...], ...]
"""The detections (node, row) that a hypothesis took in each of the last steps, the latest last."""


@dataclass(frozen=True, slots=True, eq=False)
class BelievedTrack:
    """What is believed of one target: a mixture of C components, each of the modes of its filter.

    Attributes:
        number: its number.
        weights: (C,) of the components, with the sum 1; for the hypotheses of `mht`, the log-odds of their truth.
        bank: the components; the first is the estimate.
        since: when it started, in s.
        confirmed: whether it counts as a target.
        existence: the probability that its target exists; 1 where the tracker does not estimate it.
        hits: of the last steps that could tell whether the target is there, whether it was detected; the latest last.
        misses: steps in a row without a detection.
        histories: of each component, for `mht`.
        near: (number of another track, steps in a row) for how long it has been where another one is.
    """

    number: int
    weights: Floats
    bank: GaussianBank
    since: float
    confirmed: bool = False
    existence: float = 1.0
    hits: tuple[bool, ...] = ()
    misses: int = 0
    histories: tuple[History, ...] = ()
    near: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """The tracks of a group at a time in s, in the order of their numbers. It is a value."""

    time: float
    tracks: tuple[BelievedTrack, ...] = ()


def moments_of(bank: GaussianBank, row: int) -> tuple[Floats, Floats]:
    """Mean (D,) and covariance (D, D) of one component over its modes."""
    if bank.chances.shape[1] == 1:
        return bank.means[row, 0], bank.covs[row, 0]
    return mixed(bank.chances[row], bank.means[row], bank.covs[row])


def picked(bank: GaussianBank, rows: Ints | slice) -> GaussianBank:
    """Some components of a bank."""
    return GaussianBank(*(part[rows] for part in bank))


def stacked(banks: Iterable[GaussianBank]) -> GaussianBank:
    """The components of several banks."""
    return GaussianBank(*(np.concatenate(parts) for parts in zip(*banks, strict=True)))


def distances(estimates: Sequence[TrackEstimate], columns: list[int]) -> Floats:
    """(T, T) the Mahalanobis distances of estimates, as if their errors were independent.

    Args:
        estimates: T estimates.
        columns: Those of the state that are compared.
    """
    if not estimates:
        return np.empty((0, 0))
    means, covs = np.array([one.mean for one in estimates])[:, columns], np.array([one.cov for one in estimates])
    covs = covs[:, np.array(columns)[:, None], columns]
    off = means[:, None] - means[None]
    solved = np.linalg.solve(covs[:, None] + covs[None], off[..., None])[..., 0]
    squares: Floats = np.maximum((off * solved).sum(axis=-1), 0.0)
    return np.sqrt(squares)
