"""Trackers that keep one Gaussian per track: nearest neighbour, global nearest neighbour, PDA and JPDA.

They differ in the probabilities (T, M + 1) with which tracks made the detections of a scan, or none (column 0).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.part import part
from wsnsim.base.scans import Facts
from wsnsim.kernels.association import LEAST, associate
from wsnsim.trackers.multi_target.frames import Frame
from wsnsim.trackers.multi_target.tracker import MOST_EXACT, MultiTargetTracker, alive

LEAST_RATIO, IMPOSSIBLE = 1e-300, 1e3
"""The least ratio whose logarithm is taken, and the cost of no detection of another track, which is greater."""


@part
class SingleGaussian(MultiTargetTracker):
    """Base of trackers whose tracks are one Gaussian, or one per mode of their filter."""

    decides: ClassVar[bool] = False
    """Whether a track takes one detection or none for certain."""

    def associated(self, likelihoods: Floats, miss: Floats, clutter: Floats) -> Floats:
        """The probability (T, M + 1) that each track made each detection; arguments as of `kernels.association`."""
        raise NotImplementedError

    def _scan(self, frame: Frame, sensor: int, values: Floats, limit: float, facts: Facts) -> Floats:
        modes, whole = frame.likelihoods(sensor, values, limit)
        seen, false = frame.seen[:, sensor], facts.clutter / facts.volume
        made = frame.existence * seen if self.management.tests_existence else seen
        likelihoods = made[:, None] * whole
        shares = self.associated(likelihoods, 1.0 - made * self.gate, np.full(len(values), false))
        taken = shares[:, 1:]
        if self.management.tests_existence:
            before = frame.existence
            frame.existence, _ = alive(shares, before, seen * self.gate)
            if self.decides:  # the pair's own odds: its detection may be clutter
                own = (taken * likelihoods).sum(axis=1)
                certain = own / np.maximum(own + (1.0 - before) * false, 1e-300)
                frame.existence = np.where(own > 0.0, certain, frame.existence)
            else:
                taken = taken / np.maximum(frame.existence, 1e-300)[:, None]
        frame.condition(sensor, values, modes, whole, taken)
        frame.assigned += taken.sum(axis=1)
        explained: Floats = np.minimum(shares[:, 1:].sum(axis=0), 1.0)
        return explained


@part
class LocalNearestNeighbour(SingleGaussian):
    """Each track takes the most likely detection in its gate, whatever the others take.

    Source: Bar-Shalom, Li (1995).
    """

    decides: ClassVar[bool] = True

    def associated(self, likelihoods: Floats, miss: Floats, clutter: Floats) -> Floats:
        """1 at the most likely detection of each track, or at none if its gate is empty."""
        shares = np.zeros((len(miss), len(clutter) + 1))
        best = 1 + likelihoods.argmax(axis=1) if clutter.size else np.zeros(len(miss), np.int64)
        inside = likelihoods.max(axis=1, initial=0.0) > 0.0
        shares[np.arange(len(miss)), np.where(inside, best, 0)] = 1.0
        return shares


@part
class Gnn(SingleGaussian):
    """Global nearest neighbour: the most probable joint event decides which detection each track takes.

    Source: Blackman, Popoli (1999); the assignment is that of Crouse (2016), as SciPy has it.
    """

    decides: ClassVar[bool] = True

    def associated(self, likelihoods: Floats, miss: Floats, clutter: Floats) -> Floats:
        """1 at the detection of each track in the most probable joint event, or at none."""
        tracks, count = likelihoods.shape
        ratios = np.empty((tracks, count + 1))
        ratios[:, 0] = np.maximum(miss, LEAST)
        ratios[:, 1:] = likelihoods / np.maximum(clutter, LEAST * likelihoods.max(axis=0, initial=LEAST))
        best = ratios.argmax(axis=1)
        taken = best[best > 0]
        if len(set(taken.tolist())) < taken.size:  # two tracks have the same detection as their best
            best = assigned(ratios)
        shares = np.zeros((tracks, count + 1))
        shares[np.arange(tracks), best] = 1.0
        return shares


def assigned(ratios: Floats) -> Ints:
    """(T,) the column of each row of (T, M + 1) with the greatest product, none but the first column taken twice."""
    from scipy.optimize import linear_sum_assignment

    tracks, count = len(ratios), ratios.shape[1] - 1
    each, rows = -np.log(np.maximum(ratios, LEAST_RATIO)), np.arange(tracks)
    costs = np.full((tracks, count + tracks), IMPOSSIBLE)
    costs[:, :count], costs[rows, count + rows] = each[:, 1:], each[:, 0]
    _, columns = linear_sum_assignment(costs)
    result: Ints = np.where(columns < count, columns + 1, 0)
    return result


@part
class Pda(SingleGaussian):
    """Probabilistic data association: each track weighs all detections in its gate, as if it were the only one.

    Source: Bar-Shalom, Tse (1975); with `sprt`, integrated: Musicki, Evans, Stankovic (1994).
    """

    def associated(self, likelihoods: Floats, miss: Floats, clutter: Floats) -> Floats:
        """The probabilities of each track alone."""
        each = [
            associate(row[None], one[None], clutter, MOST_EXACT)[0] for row, one in zip(likelihoods, miss, strict=True)
        ]
        return np.array(each)


@part
class Jpda(SingleGaussian):
    """Joint probabilistic data association: the probabilities are sums over all joint events.

    They are exact unless more than ten tracks and more than ten detections hang together; then they are those of loopy
    belief propagation. Tracks of close targets coalesce: their estimates are drawn to the same detections.

    Source: Fortmann, Bar-Shalom, Scheffe (1983); Williams, Lau (2014). With `sprt`, integrated: Musicki, Evans (2004).
    """

    def associated(self, likelihoods: Floats, miss: Floats, clutter: Floats) -> Floats:
        """The marginal probabilities of joint events."""
        return associate(likelihoods, miss, clutter, MOST_EXACT)
