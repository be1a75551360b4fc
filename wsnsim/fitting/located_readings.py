"""Readings at known places of a target, as arrays: what laws are fitted to; their regression; rows that files share.

shared_with(rows, files) -> (path, share) of the file that shares too many of these rows, or None

Least squares give the coefficients of a law and the gains of its nodes, with intervals for correlated readings. The
intervals are a sandwich over blocks of time and path: the scores of a block's readings, of all nodes, are summed
before they are squared, so that any correlation within a block counts. Source: Liang, Zeger (1986), "Longitudinal data
analysis using generalized linear models". For few blocks, residuals are corrected for leverage (CR2), and the degrees
of freedom of Student's t are Satterthwaite's for independent readings: Bell, McCaffrey (2002), "Bias reduction in
standard errors for linear regression with multi-stage samples", as Cameron, Miller (2015), "A practitioner's guide to
cluster-robust inference", recommend.

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
from wsnsim.base.errors import UsageError

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
    """The nodes of a file: names, and places (S, 3) in m with NaN for an unknown z."""

    ids: tuple[str, ...]
    places: Floats
    path: str = ""


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

    @property
    def whole_path(self) -> float:
        """The path (m) of all tracks together."""
        return sum(float(np.ptp(self.travelled[own])) for _, own in self.by_file() if own.any())

    def blocks(self, seconds: float, path: float = 0.0) -> Ints:
        """(n,) number of the block of each reading.

        A block ends when it has lasted for this time and the target has travelled this path (m) in it, and then not
        before the target moves: a stay is never cut. Blocks without a move that are at one place are one block.
        """
        starts = [0]
        for end in (np.flatnonzero(np.diff(self.tracks, append=-1)) + 1).tolist():
            while starts[-1] < end:
                times, along = self.times[starts[-1] : end], self.travelled[starts[-1] : end]
                cut = max(1, np.searchsorted(times, times[0] + seconds), np.searchsorted(along, along[0] + path))
                starts.append(starts[-1] + int(np.searchsorted(along, along[cut - 1], side="right")))
        first, last = np.array(starts[:-1]), np.array(starts[1:]) - 1
        moved = self.travelled[last] > self.travelled[first]
        places = np.where(moved[:, None], 0.0, np.nan_to_num(self.points[first]))
        keys = np.column_stack([np.where(moved, first, -1), places])
        _, found = np.unique(keys, axis=0, return_inverse=True)
        return np.repeat(found.ravel(), np.diff(starts)).astype(np.int64)

    def stays(self, blocks: Ints) -> int:
        """The number of blocks in which the target stands still."""
        moving = (np.diff(self.travelled) > 0.0) & (np.diff(blocks) == 0)
        return int(blocks.max()) + 1 - len(np.unique(blocks[1:][moving]))

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
ALONE: Final = 1e-9
"""A block whose leverage is this near to 1 determines a combination of coefficients alone."""


class Coefficients(NamedTuple):
    """Estimates with their standard errors.

    Attributes:
        values: (C,) coefficients of the law.
        gains: (S,) of the nodes, with sum 0 over the nodes with readings; empty if none are fitted.
        reaches: (C + S,) from the estimates to the ends of their intervals, if blocks are independent; NaN without
            readings, or where one block alone gives the estimate.
    """

    values: Floats
    gains: Floats
    reaches: Floats


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
    basis, triangle = np.linalg.qr(np.column_stack([design, contrasts[nodes]]) if count else design)
    fitted = basis.T @ response
    solution = linalg.solve_triangular(triangle, fitted)
    wanted = linalg.solve_triangular(triangle, linalg.block_diag(np.eye(columns), contrasts).T, trans="T").T
    reaches = _sandwich(basis, response - basis @ fitted, wanted, blocks)
    return Coefficients(solution[:columns], contrasts @ solution[columns:], reaches)


def _sandwich(basis: Floats, residuals: Floats, wanted: Floats, blocks: Ints) -> Floats:
    """(K,) from the estimates to the ends of their intervals, NaN where unknown; there must be at least two blocks.

    Args:
        basis: (n, P) orthonormal columns Q of the design; leverages are Q Q'.
        residuals: (n,) of the regression.
        wanted: (K, P) the estimates as combinations of Q' response.
        blocks: (n,) number of the block of each reading.
    """
    order = np.argsort(blocks, kind="stable")
    starts = np.searchsorted(blocks[order], np.arange(int(blocks.max()) + 1))
    basis = basis[order]
    scores = np.add.reduceat(basis * residuals[order, None], starts)
    leverages = np.stack([part.T @ part for part in np.split(basis, starts[1:])])
    shares, axes = np.linalg.eigh(leverages)
    alone = shares > 1.0 - ALONE
    roots = np.where(alone, 0.0, 1.0 / np.sqrt(np.where(alone, 1.0, 1.0 - shares)))
    turned = np.einsum("kp,gpq->gkq", wanted, axes)
    # (I - Q_g Q_g')^(-1/2) Q_g = Q_g (I - Q_g' Q_g)^(-1/2)
    raised = np.einsum("gkq,gq,gpq->gkp", turned, roots, axes)
    errors = np.sqrt((np.einsum("gkp,gp->gk", raised, scores) ** 2).sum(axis=0))
    errors[(turned**2 * alone[:, None]).sum(axis=(0, 2)) >= ALONE * (wanted**2).sum(axis=1)] = np.nan
    across = np.einsum("gkp,gpq->gkq", raised, leverages)
    own = (raised * across).sum(axis=2)
    shared = (across**2).sum(axis=2)
    squares = (own**2 - 2.0 * own * shared).sum(axis=0)
    squares += (np.einsum("gkp,gkq->kpq", across, across) ** 2).sum(axis=(1, 2))
    dofs = np.divide((own - shared).sum(axis=0) ** 2, squares, out=np.ones_like(squares), where=squares > 0.0)
    return np.asarray(stats.t.ppf(0.5 + CONFIDENCE / 2.0, dofs) * errors)


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


def is_shared(path: str, found: tuple[str, float] | None, in_sample: bool) -> bool:
    """Whether a file shares rows with a fitted one (`shared_with`). Raises UsageError for that unless `in_sample`."""
    if found and not in_sample:
        raise UsageError(
            f"{path} and {found[0]} share {found[1]:.1%} of their readings: a fit must not be judged on what it was "
            "fitted to; give another file with --test, or say --in-sample"
        )
    return found is not None
