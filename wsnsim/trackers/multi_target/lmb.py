"""The labelled multi-Bernoulli filter: each track exists with a probability, and is a mixture of Gaussians."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.part import Quantity, part
from wsnsim.base.scans import Facts
from wsnsim.kernels.association import associate
from wsnsim.trackers.multi_target.frames import Frame
from wsnsim.trackers.multi_target.tracker import MOST_EXACT, MultiTargetTracker, alive


@part
class Lmb(MultiTargetTracker):
    """Labelled multi-Bernoulli filter; a label is the number of a track.

    After a scan, the existence of a track and the weights of its components are the marginals of the posterior over
    all joint events, in which a track may not exist. They are summed exactly, as by enumeration, up to ten tracks and
    ten detections that hang together, and by loopy belief propagation beyond; so no ranked assignments are needed, and
    the paper's grouping is that of the sums. Components of less weight than `prune` are left out, and beyond the
    heaviest `components`. The estimate is the heaviest component. New tracks are those of the management.

    Source: Reuter, Vo, Vo, Dietmayer (2014); Kropfreiter, Meyer, Hlawatsch (2020) for belief propagation.
    """

    estimates_existence: ClassVar[bool] = True

    components: Annotated[int, Quantity("", ge=0, le=10_000), "most components of a track; 0: any number"] = 20
    prune: Annotated[float, Quantity("", ge=0, lt=1), "components of less weight are left out; 0: none"] = 1e-3

    def _scan(self, frame: Frame, sensor: int, values: Floats, limit: float, facts: Facts) -> Floats:
        modes, whole = frame.likelihoods(sensor, values, limit)
        seen, count = frame.seen[:, sensor], len(values)
        weighted, mixture = frame.weights[:, None] * whole, np.zeros((len(seen), count))
        np.add.at(mixture, frame.owners, weighted)
        likelihoods, clutter = (frame.existence * seen)[:, None] * mixture, np.full(count, facts.clutter / facts.volume)
        shares = associate(likelihoods, 1.0 - frame.existence * seen * self.gate, clutter, MOST_EXACT)
        after, silent = alive(shares, frame.existence, seen * self.gate)
        frame.existence, some = after, np.maximum(after, 1e-300)
        frame.assigned += shares[:, 1:].sum(axis=1) / some
        each = np.divide(shares[:, 1:], mixture, out=np.zeros(mixture.shape), where=mixture > 0.0) / some[:, None]
        weights = np.column_stack([frame.weights * (silent / some)[frame.owners], weighted * each[frame.owners]])
        rows, columns = np.nonzero(self._kept(weights, frame.owners))
        frame.take(rows)
        frame.weights = weights[rows, columns]
        frame.weights /= np.bincount(frame.owners, frame.weights)[frame.owners]
        taken = (columns[:, None] == np.arange(1, count + 1)).astype(np.float64)
        frame.condition(sensor, values, modes[rows], whole[rows], taken)
        explained: Floats = np.minimum(shares[:, 1:].sum(axis=0), 1.0)
        return explained

    def _kept(self, weights: Floats, owners: Ints) -> Bools:
        """Which components (C, M + 1) are kept: of each track, at least the heaviest."""
        return heaviest(weights, owners, self.components, self.prune)


def heaviest(weights: Floats, owners: Ints, most: int, least: float) -> Bools:
    """Which entries of weights (C, n) are among the `most` heaviest of their owner, and greater than `least`.

    Args:
        weights: (C, n).
        owners: (C,) the owner of each row.
        most: 0 for any number. The heaviest of each owner is always among them.
        least: Compared with the weights.
    """
    kept = weights > least
    for owner in np.unique(owners):
        mine = np.flatnonzero(owners == owner)
        flat = weights[mine].reshape(-1)
        order = np.argsort(-flat, kind="stable")
        mask = kept[mine].reshape(-1)
        mask[order[0]] = True
        if most:
            mask[order[most:]] = False
        kept[mine] = mask.reshape(len(mine), -1)
    return kept
