"""Readings at known places of a target, as arrays: what laws are fitted to; their regression; rows that files share.

shared_with(rows, files) -> (path, share) of the file that shares too many of these rows, or None

Least squares give the coefficients of a law and the gains of its nodes, with intervals for correlated readings. The
intervals are a sandwich over blocks of time: the scores of a block's readings, of all nodes, are summed before they
are squared, so that any correlation within a block counts. Source: Liang, Zeger (1986), "Longitudinal data analysis
using generalized linear models"; the factor B/(B - 1) and Student's t with B - 1 degrees of freedom for B blocks are
the usual corrections for few blocks (Cameron, Miller 2015, "A practitioner's guide to cluster-robust inference").

A law must not be judged on rows that it was fitted to, whatever a file is called.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Set
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from scipy import linalg, stats

from wsnsim.base.arrays import Bools, Floats, Ints

MOST_APART: Final = 60
"""Pairs of one node's readings are at most this many readings apart."""
MOST_PAIRS: Final = 5_000_000
"""Of more pairs than this, only those are used whose readings are some numbers apart, evenly from 1 to `MOST_APART`."""

ReadingKeys: TypeAlias = frozenset[tuple[float, int, float, float, float]]


@dataclass(frozen=True)
class DataFile:
    """One file of readings.

    Attributes:
        path: the file as it was named.
        digest: 'sha256:' and the digest of its content, decompressed.
        readings: number of readings that are used.
        bad_rows: what is wrong with each row that was skipped, with file and line.
    """

    path: str
    digest: str
    readings: int
    bad_rows: tuple[str, ...] = ()


class NodeTable(NamedTuple):
    """The nodes in the order of the deployment: names, and places (S, 3) in m with NaN for an unknown z."""

    ids: tuple[str, ...]
    places: Floats


@dataclass(frozen=True)
class LocatedReadings:
    """Readings in the order of track and time.

    Attributes:
        times: (n,) in s.
        nodes: (n,) index of the node of each reading.
        readings: (n,) in the unit of the law.
        points: (n, 3) place of the target, in m; z is NaN where it is unknown.
        tracks: (n,) index of the file of each reading.
        deployment: the nodes.
        files: the files.
    """

    times: Floats
    nodes: Ints
    readings: Floats
    points: Floats
    tracks: Ints
    deployment: NodeTable
    files: tuple[DataFile, ...]

    def of(self, tracks: Iterable[int]) -> LocatedReadings:
        """The readings of these files."""
        chosen = list(tracks)
        kept = np.isin(self.tracks, chosen)
        files = tuple(self.files[index] for index in chosen)
        numbers = np.searchsorted(chosen, self.tracks[kept])
        kept_rows = (self.times[kept], self.nodes[kept], self.readings[kept], self.points[kept])
        return LocatedReadings(*kept_rows, numbers, self.deployment, files)

    @property
    def has_heights(self) -> bool:
        """Whether the heights of all nodes and of the target are known."""
        return bool(np.isfinite(self.deployment.places[:, 2]).all() and np.isfinite(self.points[:, 2]).all())

    def distances(self, heights: bool) -> Floats:
        """(n,) distance in m between target and node: in space if `heights`, else in the plane."""
        apart = self.points - self.deployment.places[self.nodes]
        result: Floats = np.sqrt((apart[:, : 3 if heights else 2] ** 2).sum(axis=1))
        return result

    @cached_property
    def travelled(self) -> Floats:
        """(n,) path in the plane (m) that the target has travelled since the first reading of its track."""
        steps = np.hypot(*np.diff(self.points[:, :2], axis=0).T)
        steps[np.diff(self.tracks) != 0] = 0.0
        total = np.concatenate([[0.0], np.cumsum(steps)])
        starts = np.searchsorted(self.tracks, self.tracks)
        result: Floats = total - total[starts]
        return result

    def blocks(self, seconds: float) -> Ints:
        """(n,) number of the block of each reading: a track is cut into blocks of this length."""
        parts = np.floor(self.times / seconds).astype(np.int64)
        _, found = np.unique(np.column_stack([self.tracks, parts]), axis=0, return_inverse=True)
        return found.ravel().astype(np.int64)

    @cached_property
    def pairs(self) -> tuple[Ints, Ints]:
        """(P,), (P,) indices of pairs of readings of one node on one track, the earlier one first.

        Long recordings use fewer distances between readings, so that there are at most `MOST_PAIRS` pairs, or one a
        reading.
        """
        order = np.lexsort((self.times, self.nodes, self.tracks))
        series = np.column_stack([self.tracks, self.nodes])[order]
        first, second = [], []
        most = min(MOST_APART, len(order) - 1)
        numbers = min(most, max(MOST_PAIRS // max(len(order), 1), 1))
        for apart in np.linspace(1, most, numbers).astype(np.int64).tolist():
            same: Bools = (series[apart:] == series[:-apart]).all(axis=1)
            if not same.any():
                break
            first.append(order[:-apart][same])
            second.append(order[apart:][same])
        if not first:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        return np.concatenate(first), np.concatenate(second)

    def keys(self, track: int) -> ReadingKeys:
        """Time, node, value and place (x, y) of each reading of a file.

        Places tell walks apart whose times lie on one grid and whose readings are whole numbers.
        """
        own = self.tracks == track
        columns = (self.times, self.nodes, self.readings, self.points[:, 0], self.points[:, 1])
        return frozenset(zip(*(column[own].tolist() for column in columns), strict=True))

    def by_file(self) -> Iterator[tuple[DataFile, Bools]]:
        """Each file, and which readings are its own."""
        for index, file in enumerate(self.files):
            yield file, self.tracks == index


CONFIDENCE: Final = 0.95


class Coefficients(NamedTuple):
    """Estimates with their standard errors.

    Attributes:
        values: (C,) coefficients of the law.
        errors: (C,) their standard errors.
        gains: (S,) of the nodes, with sum 0 over the nodes with readings; empty if none are fitted.
        gain_errors: (S,) their standard errors.
        quantile: standard errors from an estimate to the end of its interval.
    """

    values: Floats
    errors: Floats
    gains: Floats
    gain_errors: Floats
    quantile: float


def least_squares(design: Floats, response: Floats, nodes: Ints, count: int, blocks: Ints) -> Coefficients:
    """The coefficients that minimise the squares of the residuals.

    Args:
        design: (n, C) columns of the coefficients.
        response: (n,) readings without what has no coefficient.
        nodes: (n,) index of the node of each reading.
        count: number of nodes with a gain; 0 to fit none.
        blocks: (n,) number of the block of each reading.
    """
    columns = design.shape[1]
    heard = np.flatnonzero(np.bincount(nodes, minlength=count)[:count])
    contrasts = np.zeros((count, max(len(heard) - 1, 0)))
    if len(heard) > 1:
        contrasts[heard] = linalg.helmert(len(heard)).T
    matrix = np.column_stack([design, contrasts[nodes]]) if count else design
    inverse = np.linalg.inv(matrix.T @ matrix)
    solution = inverse @ (matrix.T @ response)
    residuals = response - matrix @ solution
    spread, quantile = _sandwich(inverse, matrix * residuals[:, None], blocks)
    gain_errors = np.full(count, np.nan)
    gain_errors[heard] = np.sqrt(np.einsum("ij,jk,ik->i", contrasts, spread[columns:, columns:], contrasts))[heard]
    errors = np.sqrt(np.diag(spread)[:columns])
    return Coefficients(solution[:columns], errors, contrasts @ solution[columns:], gain_errors, quantile)


def _sandwich(inverse: Floats, scores: Floats, blocks: Ints) -> tuple[Floats, float]:
    """Covariance (C, C) of the estimates, and the quantile of Student's t. There must be at least two blocks."""
    count = int(blocks.max()) + 1
    sums = np.zeros((count, scores.shape[1]))
    np.add.at(sums, blocks, scores)
    readings, parameters = scores.shape
    root = sums @ inverse
    factor = count / (count - 1) * (readings - 1) / max(readings - parameters, 1)
    return root.T @ root * factor, float(stats.t.ppf(0.5 + CONFIDENCE / 2.0, count - 1))


SAME_SHARE: Final = 0.01
"""Files that share this part of their rows are not independent (our choice: far more than coincidence gives)."""


def share(first: Set[Hashable], second: Set[Hashable]) -> float:
    """The number of shared rows, relative to the smaller file, so that neither may be a part of the other."""
    return len(first & second) / max(min(len(first), len(second)), 1)


def shared_with(rows: Set[Hashable], files: Mapping[str, Set[Hashable]]) -> tuple[str, float] | None:
    """The file that shares most with these rows, and how much, if that or the share with all files is too large."""
    if not files:
        return None
    path = max(files, key=lambda name: share(rows, files[name]))
    largest = max(share(rows, files[path]), share(rows, frozenset().union(*files.values())))
    return (path, largest) if largest >= SAME_SHARE else None
