"""Trackers that keep several Gaussians per track: the labelled multi-Bernoulli filter, and multiple hypotheses."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, ClassVar, Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.part import Quantity, part
from wsnsim.base.scans import Facts
from wsnsim.kernels.association import associate
from wsnsim.trackers.multi_target.frames import Belief, BelievedTrack, Frame, picked
from wsnsim.trackers.multi_target.initiation import LEAST_CLUTTER, Start, density
from wsnsim.trackers.multi_target.management import with_hit
from wsnsim.trackers.multi_target.single_gaussian import assigned
from wsnsim.trackers.multi_target.tracker import MOST_EXACT, MultiTargetTracker, alive
from wsnsim.trackers.shared.gaussian_port import GaussianPort


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
        rows, columns = np.nonzero(heaviest(weights, frame.owners, self.components, self.prune))
        frame.take(rows)
        frame.weights = weights[rows, columns]
        frame.weights /= np.bincount(frame.owners, frame.weights)[frame.owners]
        taken = (columns[:, None] == np.arange(1, count + 1)).astype(np.float64)
        frame.condition(sensor, values, modes[rows], whole[rows], taken)
        explained: Floats = np.minimum(shares[:, 1:].sum(axis=0), 1.0)
        return explained


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


CERTAIN: Final = 20.0
"""Greatest log-odds of a track, so that it can end in reasonable time (our choice)."""
WORSE: Final = 15.0
"""A hypothesis whose log-odds are lower than the best of its track by more than this is left out (our choice)."""
BONUS: Final = 1e3
"""What the best global hypothesis gains by a further track: it has as many as possible."""


@part
class Mht(MultiTargetTracker):
    """Track-oriented multiple hypothesis tracking with N-scan pruning.

    Each track is a tree of hypotheses: which detection, or none, it took in each scan. Their scores are log-odds. The
    best global hypothesis has one hypothesis of as many tracks as possible, none with a detection in common, and the
    greatest sum of scores. Of each track, hypotheses are left out that differ from the one in it more than `depth`
    steps ago. New tracks are those of the management, from detections that the best global hypothesis does not use,
    whereas in the paper each detection starts one. A hypothesis of each track is always kept: that of the best global
    one of the step before, continued by the best assignment in each scan. So all tracks have some that go together.

    Source: Blackman (2004); the global hypothesis as an integer programme: Morefield (1977).
    """

    estimates_existence: ClassVar[bool] = True

    depth: Annotated[int, Quantity("", ge=0, le=20), "steps for which decisions are deferred: N"] = 2
    hypotheses: Annotated[int, Quantity("", ge=1, le=1000), "most hypotheses of a track"] = 20

    def _begun(self, port: GaussianPort, mean: Floats, cov: Floats, number: int, time: float) -> BelievedTrack:
        return BelievedTrack(number, np.full(1, CERTAIN), port.begun(mean, cov), time, histories=((),))

    def _started(self, port: GaussianPort, start: Start, number: int, time: float, facts: Facts) -> BelievedTrack:
        return replace(super()._started(port, start, number, time, facts), weights=np.array([min(start.odds, CERTAIN)]))

    def _predicted(self, belief: Belief, time: float, port: GaussianPort, facts: Facts) -> list[BelievedTrack]:
        tracks = super()._predicted(belief, time, port, facts)
        survival, result = self.management.survival ** round((time - belief.time) / facts.dt), []
        for track in tracks:
            loss = np.log1p(np.exp(track.weights[0]) * (1.0 - survival)) - math.log(survival)
            histories = tuple((*each, ()) if time > belief.time or not each else each for each in track.histories)
            result.append(replace(track, weights=track.weights - loss, histories=histories))
        return result

    def _scan(self, frame: Frame, sensor: int, values: Floats, limit: float, facts: Facts) -> Floats:
        modes, whole = frame.likelihoods(sensor, values, limit)
        seen = frame.seen[frame.owners, sensor]
        with np.errstate(divide="ignore"):
            gains = np.log(seen[:, None] * whole / density(facts))
        alone = np.log(np.maximum(1.0 - seen * self.gate, LEAST_CLUTTER))
        scores = frame.weights[:, None] + np.column_stack([alone, gains])
        best = np.full(len(frame.existence), -np.inf)
        np.maximum.at(best, frame.owners, scores.max(axis=1))
        firsts = np.searchsorted(frame.owners, np.arange(len(best)))
        own, ranks = scores[firsts], scores - best[frame.owners, None]
        ranks[firsts, assigned(np.exp(own - own.max(axis=1, keepdims=True)))] = 1.0  # before all others
        rows, columns = np.nonzero(heaviest(ranks, frame.owners, self.hypotheses, -WORSE))
        order = np.lexsort((ranks[rows, columns] < 1.0, frame.owners[rows]))
        rows, columns = rows[order], columns[order]
        frame.take(rows)
        frame.weights = scores[rows, columns]
        for place, column in enumerate(columns.tolist()):
            if column:
                *before, last = frame.histories[place]
                frame.histories[place] = (*before, (*last, (frame.nodes[sensor], column - 1)))
        taken = (columns[:, None] == np.arange(1, len(values) + 1)).astype(np.float64)
        frame.condition(sensor, values, modes[rows], whole[rows], taken)
        return np.zeros(len(values))

    def _closed(self, tracks: list[BelievedTrack], frame: Frame, explained: list[Floats]) -> list[BelievedTrack]:
        """The tracks after the best global hypothesis and the pruning: its hypothesis of each track first."""
        bank, expected, result = frame.bank(), frame.seen.sum(axis=1), []
        places = {node: sensor for sensor, node in enumerate(frame.nodes)}
        for row, (track, best) in enumerate(zip(tracks, best_global(frame), strict=True)):
            mine = np.flatnonzero(frame.owners == row)
            leaf = best if best >= 0 else int(mine[frame.weights[mine].argmax()])
            history = frame.histories[leaf]
            old = max(len(history) - self.depth, 0)
            mine = np.array([each for each in mine.tolist() if frame.histories[each][:old] == history[:old]])
            mine = np.concatenate([[leaf], mine[mine != leaf]])
            weights = frame.weights[mine]
            weights = weights - max(weights[0] - CERTAIN, 0.0)
            existence = 1.0 / (1.0 + math.exp(-max(weights[0], -700.0))) if best >= 0 else 0.0
            histories = tuple(frame.histories[each][old:] for each in mine.tolist())
            used = history[-1] if best >= 0 else ()
            for node, taken in used:
                explained[places[node]][taken] = 1.0
            result.append(with_hit(
                track, len(used), expected[row], self.management.window, weights=weights, bank=picked(bank, mine),
                existence=existence, histories=histories,
            ))  # fmt: skip
        return result


def best_global(frame: Frame) -> list[int]:
    """Of each track, the place of its hypothesis in the best global one, or -1 if it has none there."""
    leaders = []
    for row in range(len(frame.existence)):
        mine = np.flatnonzero(frame.owners == row)
        leaders.append(int(mine[frame.weights[mine].argmax()]))
    taken = [key for leaf in leaders for key in _keys(frame, leaf)]
    if len(taken) == len(set(taken)):
        return leaders
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csr_array

    count = len(frame.owners)
    rules: dict[int | tuple[int, int, int], list[int]] = {}
    for leaf in range(count):
        rules.setdefault(int(frame.owners[leaf]), []).append(leaf)
        for key in _keys(frame, leaf):
            rules.setdefault(key, []).append(leaf)
    pairs = [(row, leaf) for row, leaves in enumerate(rules.values()) for leaf in leaves]
    matrix = csr_array((np.ones(len(pairs)), tuple(zip(*pairs, strict=True))), shape=(len(rules), count))
    found = milp(
        -(frame.weights + BONUS), integrality=np.ones(count), bounds=Bounds(0.0, 1.0),
        constraints=LinearConstraint(matrix, ub=1.0), options={"mip_rel_gap": 0.0},
    )  # fmt: skip
    chosen = np.flatnonzero(found.x > 0.5)
    places = dict(zip(frame.owners[chosen].tolist(), chosen.tolist(), strict=True))
    return [places.get(row, -1) for row in range(len(frame.existence))]


def _keys(frame: Frame, leaf: int) -> list[tuple[int, int, int]]:
    """The detections of a hypothesis: how many steps ago, which node and which row."""
    steps = reversed(frame.histories[leaf])
    return [(ago, node, row) for ago, step in enumerate(steps) for node, row in step]
