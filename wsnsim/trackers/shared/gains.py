"""Gains of sensors that a filter estimates beside the state: a Gaussian joint with it, kept in the cluster head.

A reading is z = h(x) + g + v with the constant gain g of its node, or its bias, which the filter takes as normal before
the first reading (`gain_prior` of the sensor model, its variance). Gains of nodes that were not heard yet are left out:
they are independent of everything, but for a part that all may have in common (`common_prior`).

A Kalman filter updates state and gains as one augmented state. Filters of particles marginalise the gains: given a
particle, they are linear in the readings and Gaussian, so that a Kalman filter per particle has them, with the same
covariance for all particles (Schön, Gustafsson, Nordlund (2005): a marginalised particle filter). Between steps we keep
the joint moments of state and gains instead of a mean of each gain per particle, as the Gaussian particle filter does
for the state (our choice): what particles remember of constants degenerates with resampling.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Flow, Send
from wsnsim.base.sensing import BIAS, GAIN_DB
from wsnsim.trackers.shared.moments import symmetric
from wsnsim.trackers.shared.readings import Evidence, number_packets, parcel

SMALLEST = 1e-10
"""Of the greatest eigenvalue of the state's covariance: smaller ones count as zero in its inverse (our choice)."""
LOG_TWO_PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, slots=True)
class Gains:
    """What a filter believes of the gains of the nodes that it has heard.

    Attributes:
        nodes: n node numbers.
        mean: (n,) in dB, or in m of biases.
        cov: (n, n) covariance in the square of that.
        cross: (D, n) covariance of the state with the gains.
        name: `gain_db` or `bias`.
    """

    nodes: tuple[int, ...]
    mean: Floats
    cov: Floats
    cross: Floats
    name: str = GAIN_DB

    def rows(self, ids: Iterable[int]) -> list[int]:
        """The places of some nodes."""
        places = {node: place for place, node in enumerate(self.nodes)}
        return [places[node] for node in ids]

    def with_nodes(self, ids: Iterable[int], prior: float, common: float = 0.0) -> Gains:
        """These gains and those of further nodes: with the mean 0, the variance `prior` and the covariance `common`.

        Before any reading. By now, that of a new node is known by its regression on those of nodes that were heard.
        """
        new = [node for node in ids if node not in self.nodes]
        if not new:
            return self
        known, count = len(self.nodes), len(self.nodes) + len(new)
        cov = (prior - common) * np.eye(count) + common
        between = cov[known:, :known]
        slope = between @ np.linalg.pinv(cov[:known, :known], rcond=SMALLEST, hermitian=True)
        cov[known:, known:] += slope @ (self.cov @ slope.T - between.T)
        cov[:known, :known] = self.cov
        cov[known:, :known] = slope @ self.cov
        cov[:known, known:] = cov[known:, :known].T
        mean, cross = np.append(self.mean, slope @ self.mean), np.hstack([self.cross, self.cross @ slope.T])
        return replace(self, nodes=(*self.nodes, *new), mean=mean, cov=cov, cross=cross)

    def only(self, ids: Iterable[int]) -> Gains:
        """The gains of those of the nodes that are among `ids`."""
        kept = self.rows(sorted(set(ids).intersection(self.nodes), key=self.nodes.index))
        nodes = tuple(self.nodes[row] for row in kept)
        cov = self.cov[np.ix_(kept, kept)]
        return replace(self, nodes=nodes, mean=self.mean[kept], cov=cov, cross=self.cross[:, kept])


@dataclass(frozen=True, slots=True)
class GainsOfParticles:
    """The gains given each of N particles: means (n, N), and a covariance (n, n) that all have in common."""

    nodes: tuple[int, ...]
    means: Floats
    cov: Floats

    @classmethod
    def given(cls, gains: Gains, mean: Floats, cov: Floats, cloud: Floats) -> GainsOfParticles:
        """Those of particles (D, N), by the regression of the gains on a state with this mean and covariance."""
        slope = gains.cross.T @ np.linalg.pinv(cov, rcond=SMALLEST, hermitian=True)
        means = gains.mean[:, None] + slope @ (cloud - mean[:, None])
        return cls(gains.nodes, means, symmetric(gains.cov - slope @ gains.cross))

    def weighed(self, expected: Floats, variances: Floats, seen: Evidence) -> tuple[GainsOfParticles, Floats]:
        """The gains after readings with the means `expected` (S, N) without gain; (N,) log-likelihoods of particles.

        Args:
            expected: Means of the readings at each particle, without the gains.
            variances: (S, N) variances of the readings, of which those of the first particle count for all.
            seen: The readings and their nodes, all of which have a gain here.
        """
        rows = [self.nodes.index(node) for node in seen.ids]
        lifts = self.cov[:, rows]
        width = lifts[rows] + np.diag(variances[:, 0])
        factor = np.linalg.cholesky(width)
        innovations = seen.readings[:, None] - expected - self.means[rows]
        with np.errstate(invalid="ignore"):
            white = np.linalg.solve(factor, innovations)
            squares = (white**2).sum(axis=0)
            share = np.linalg.solve(factor, lifts.T).T
            means = self.means + share @ white
        logs = -0.5 * squares - np.log(np.diag(factor)).sum() - 0.5 * len(rows) * LOG_TWO_PI
        known = np.isfinite(logs)
        means = np.where(known, means, self.means)
        after = GainsOfParticles(self.nodes, means, symmetric(self.cov - share @ share.T))
        return after, np.where(known, logs, -np.inf)

    def joint(self, cloud: Floats, mean: Floats, log_weights: Floats) -> Gains:
        """The joint moments of gains and state, of particles (D, N) with this mean, weighed by log-weights (N,)."""
        weights = np.exp(log_weights)
        weighty = weights > 0.0
        shares, means = weights[weighty] / weights.sum(), self.means[:, weighty]
        centre = means @ shares
        around = np.sqrt(shares) * (means - centre[:, None])
        cross = (np.sqrt(shares) * (cloud[:, weighty] - mean[:, None])) @ around.T
        return Gains(self.nodes, centre, self.cov + around @ around.T, cross)


def gain_prior(sensor: object) -> float:
    """The variance in dB² of a gain that filters estimate, before its first reading; 0 if they estimate none."""
    return getattr(sensor, "gain_prior", 0.0)


def gains_of(belief: Any, scene: Scene, ids: Iterable[int]) -> Gains:
    """The gains of a belief, which may have none yet, and of the nodes `ids`."""
    sensor, gains = scene.sensor, belief.gains
    if not isinstance(gains, Gains):
        name = BIAS if BIAS in sensor.trait_names else GAIN_DB
        gains = Gains((), np.empty(0), np.empty((0, 0)), np.empty((belief.mean.size, 0)), name)
    return gains.with_nodes(ids, gain_prior(sensor), getattr(sensor, "common_prior", 0.0))


def gains_before(gains: Gains, scene: Scene, mean: Floats) -> Gains:
    """The gains at the time of a scene, before its readings: the state has moved on from `mean` (D,)."""
    cross = gains.cross
    for step in range(scene.steps):
        point, now = np.ascontiguousarray(mean[:, None]), scene.since + step * scene.dt
        transitions, _ = scene.motion.matrices(point, scene.dt, now)
        cross, mean = transitions[0] @ cross, scene.motion.advance(point, scene.dt, now)[:, 0]
    return replace(gains, cross=cross)


def gain_packets(count: int, columns: int) -> int:
    """Packets of `count` gains beside a state of D columns: nodes, means, covariances and those with the state."""
    numbers = count * (2 + columns) + count * (count + 1) // 2
    return number_packets(numbers)


def send_gains(gains: Gains, scene: Scene, successor: int) -> Flow[Gains | None]:
    """Send the gains of the old cluster's members to the next head; None if a packet is lost, or there are none.

    The others are forgotten: the target has left them behind (our choice). A head without gains begins again with the
    prior of each.
    """
    kept = gains.only(scene.roster)
    if not kept.nodes:
        return None
    packets = gain_packets(len(kept.nodes), len(kept.cross))
    mask = yield Send(successor, parcel(kept, packets, "gains"))
    return kept if mask.all() else None


def reported(gains: Gains | None) -> dict[str, Floats]:
    """The quantities of the gains for the table `tracker_state`: nodes, means and standard deviations."""
    if gains is None:
        return {}
    deviations: Floats = np.sqrt(np.diag(gains.cov))
    nodes = np.array(gains.nodes, dtype=np.float64)
    return {"gain_node": nodes, gains.name: gains.mean, f"{gains.name}_sd": deviations}
