"""What a head believes of several targets, and its components while the scans of a step are processed in turn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, Ints, periods_of
from wsnsim.base.ports import KnownNodes
from wsnsim.base.scans import Facts, Scan, TrackEstimate
from wsnsim.base.sensing import detected
from wsnsim.kernels import detections as kernels
from wsnsim.trackers.shared.gaussian_port import GaussianBank, GaussianPort
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


LEAST_SEEN: Final = 1e-3
"""Least share of a predicted position that a node may sense, where a track is not in its range at all (our choice)."""


class Sorted(NamedTuple):
    """The scans of a step in the order in which they are processed: by node, and detections by their values.

    Attributes:
        nodes: (S,) ids.
        positions: (S, 2) in m.
        traits: (S, T).
        detections: of each scan (M, d).
        places: of each scan (M,) where its detections were in what was given.
        given: of each scan its place in what was given.
        heard: (S,) as in `Scan`.
    """

    nodes: list[int]
    positions: Floats
    traits: Floats
    detections: list[Floats]
    places: list[Ints]
    given: list[int]
    heard: Floats


def some(scans: Sorted, chosen: Ints) -> Sorted:
    """Some of the scans."""
    nodes, places, given = (
        [part[scan] for scan in chosen.tolist()] for part in (scans.nodes, scans.places, scans.given)
    )
    values = [scans.detections[scan] for scan in chosen.tolist()]
    return Sorted(nodes, scans.positions[chosen], scans.traits[chosen], values, places, given, scans.heard[chosen])


def in_order(scans: Sequence[Scan], nodes: KnownNodes) -> Sorted:
    """Scans by the number of their node, so that no result depends on the order in which detections are listed."""
    given = sorted(range(len(scans)), key=lambda place: scans[place].node)
    rows = {node: row for row, node in enumerate(nodes.ids)}
    chosen = [rows[scans[place].node] for place in given]
    places = [np.lexsort(scans[place].detections.T[::-1]) for place in given]
    values = [np.ascontiguousarray(scans[g].detections[order]) for g, order in zip(given, places, strict=True)]
    ids = [scans[place].node for place in given]
    heard = np.array([scans[place].heard for place in given])
    return Sorted(ids, nodes.positions[chosen], nodes.traits[chosen], values, places, given, heard)


@dataclass(slots=True, eq=False)
class Frame:
    """C components of T tracks, each of K modes, as joint moments with the readings of S sensors.

    Attributes:
        owners: (C,) the row of the track of each component.
        weights: (C,) as in `BelievedTrack`.
        chances: (C, K).
        means: (C K, A) joint moments.
        covs: (C K, A, A).
        existence: (T,).
        seen: (T, S) the probability that each sensor detects each track, if it exists.
        assigned: (T,) the expected number of its detections until now.
        histories: of each component, where hypotheses are kept.
        size: D.
        periods: (d,) of the components of a reading.
        nodes: (S,) the node of each sensor.
    """

    owners: Ints
    weights: Floats
    chances: Floats
    means: Floats
    covs: Floats
    existence: Floats
    seen: Floats
    assigned: Floats
    histories: list[History]
    size: int
    periods: Floats
    nodes: list[int]

    def likelihoods(self, sensor: int, detections: Floats, limit: float) -> tuple[Floats, Floats]:
        """Densities of detections (M, d) of a sensor in each mode (C, K, M) and component (C, M): 0 outside the gate.

        Args:
            sensor: Which of the sensors.
            detections: Its detections.
            limit: The squared distance within which the gate of a mode lies.
        """
        logs, squares = kernels.score(self.means, self.covs, self._first(sensor), detections, self.periods)
        modes = np.where(squares <= limit, np.exp(logs), 0.0).reshape(*self.chances.shape, len(detections))
        return modes, modes[:, 0] if modes.shape[1] == 1 else np.einsum("ck,ckm->cm", self.chances, modes)

    def condition(self, sensor: int, detections: Floats, modes: Floats, whole: Floats, shares: Floats) -> None:
        """Update each component with detections that are its own with probabilities `shares` (C, M).

        Args:
            sensor: Which of the sensors.
            detections: (M, d).
            modes: (C, K, M) from `likelihoods`.
            whole: (C, M) from `likelihoods`.
            shares: (C, M).
        """
        if self.chances.shape[1] > 1:
            each = np.divide(shares, whole, out=np.zeros(shares.shape), where=whole > 0.0)
            within = self.chances[:, :, None] * modes * each[:, None]
            chances = within.sum(axis=2) + self.chances * (1.0 - shares.sum(axis=1))[:, None]
            shares = np.divide(within, chances[:, :, None], out=np.zeros(within.shape), where=chances[:, :, None] > 0.0)
            self.chances = chances / chances.sum(axis=1, keepdims=True)
        flat = np.ascontiguousarray(shares.reshape(len(self.means), -1))
        kernels.condition(self.means, self.covs, self._first(sensor), detections, self.periods, flat)

    def take(self, rows: Ints) -> None:
        """Keep copies of these components only."""
        modes = self.chances.shape[1]
        flat = (rows[:, None] * modes + np.arange(modes)).reshape(-1)
        self.means, self.covs = self.means[flat], self.covs[flat]
        self.owners, self.weights, self.chances = self.owners[rows], self.weights[rows], self.chances[rows]
        self.histories = [self.histories[row] for row in rows.tolist()] if self.histories else []

    def bank(self) -> GaussianBank:
        """The states of the components."""
        shape, size = self.chances.shape, self.size
        means, covs = self.means[:, :size], self.covs[:, :size, :size]
        return GaussianBank(means.reshape(*shape, size), covs.reshape(*shape, size, size), self.chances)

    def _first(self, sensor: int) -> int:
        return self.size + sensor * self.periods.size


def frame_of(tracks: Sequence[BelievedTrack], scans: Sorted, seen: Floats, port: GaussianPort, facts: Facts) -> Frame:
    """The frame of predicted tracks before the first scan; there is one track at least.

    Args:
        tracks: T tracks.
        scans: S scans.
        seen: (T, S) from `visible`.
        port: The filter.
        facts: What the head assumes.
    """
    bank = stacked(track.bank for track in tracks)
    counts = [len(track.weights) for track in tracks]
    means, covs = port.joint(bank, facts.sensor, scans.positions, scans.traits)
    return Frame(
        np.repeat(np.arange(len(tracks)), counts), np.concatenate([track.weights for track in tracks]), bank.chances,
        means, covs, np.array([track.existence for track in tracks]), seen, np.zeros(len(tracks)),
        [history for track in tracks for history in track.histories], bank.means.shape[-1],
        np.array(periods_of(facts.sensor)), scans.nodes,
    )  # fmt: skip


def visible(tracks: Sequence[BelievedTrack], scans: Sorted, port: GaussianPort, facts: Facts) -> Floats:
    """(T, S) the probability of detection: that of a target in range, times the share of the position in range.

    The share is that of four points, √2 standard deviations to either side along two axes (our choice).
    """
    columns = np.array(port.own)[list(facts.motion.position)]
    moments = [moments_of(track.bank, 0) for track in tracks]
    means, covs = np.array([mean[columns] for mean, _ in moments]), np.array([cov for _, cov in moments])
    values, axes = np.linalg.eigh(covs[:, columns[:, None], columns])
    steps = (axes * np.sqrt(len(columns) * np.maximum(values, 0.0))[:, None]).transpose(0, 2, 1)
    points = np.concatenate([means[:, None] + steps, means[:, None] - steps], axis=1)  # (T, 2 P, P)
    within = detected(facts.sensor, points.reshape(-1, len(columns)), scans.positions)
    shares = within.reshape(len(tracks), -1, len(scans.nodes)).mean(axis=1)
    seen: Floats = facts.probability * np.maximum(shares, LEAST_SEEN) * scans.heard
    return seen
