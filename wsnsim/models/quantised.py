"""Sensor models of readings that take few values: a detection or none, and any scalar reading in a number of bits.

log_likelihood(points (P, N), readings (S,), positions (S, 2), traits (S, T), owners (N,) | None) -> (N,)

A reading says in which of C cells a number fell. Its likelihood is the probability of that cell. Gaussian filters take
the mean and the variance of a reading, which are exact, as those of a Gaussian, which it is not. The Fisher information
of a reading is the sum of ∇p ∇pᵀ / p over its cells.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, components_of, is_relative, near, periods_of
from wsnsim.base.errors import Issue
from wsnsim.base.optional_ports import Replays
from wsnsim.base.part import OfRole, Quantity, part
from wsnsim.base.ports import SensorModel
from wsnsim.base.sensing import detected, informations
from wsnsim.base.setups import TrackingSetup
from wsnsim.models.bounds import ACCURACY, LENGTH, READING
from wsnsim.models.distances import reach_issues, squared_distances
from wsnsim.models.ranging import REACH, Range
from wsnsim.models.sensing import OfLaw, OfPosition, of_readings

LEAST_VARIANCE: Final = 1e-12
"""Of the squared distance of the outermost values, the least variance of a reading: it is never certain (our choice).

It is that of one bit whose threshold is seven standard deviations away.
"""
WIDTH: Final = 1e-4
"""m: half the difference of points for the slope of a law's variance."""
SWEEPS: Final = 2000
"""Of Lloyd's iteration: up to 5 bits it has then converged to 1e-9, and more bits are hardly better."""
PASSED_ON: Final = frozenset({
    "components", "periods", "strength", "ranges", "ranges_in_plane", "in_plane", "reading_limits",
    "gains", "gain_spread", "gain_variance", "biases", "bias_spread", "clock_spread",
})  # fmt: skip
"""What else a law can do with a reading, or says of its nodes: the middle of a cell stands for a reading in it."""


class Cells(NamedTuple):
    """The cells of readings: what stands for each, its probability, and the slope of that by the target's position.

    Attributes:
        values: (S, C, N), or what broadcasts to it.
        chances: (S, C, N).
        slopes: (S, C, P, N).
    """

    values: Floats
    chances: Floats
    slopes: Floats


class OfCells:
    """The base of sensors whose readings take few values. A subclass gives `cells` and `log_cells`."""

    def cells(self, points: Floats, positions: Floats, traits: Floats) -> Cells:
        """The cells of one reading of each sensor at points (P, N)."""
        raise NotImplementedError

    def log_cells(self, points: Floats, readings: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, N) the log of the probability of the cell of each reading at points (P, N)."""
        raise NotImplementedError

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log P(readings | target at points (P, N)): of all S readings, or of reading owners[j] for particle j.

        Zeros without readings; -inf for points that are not finite and for readings that are NaN.
        """
        if not readings.size:
            return np.zeros(points.shape[1])
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            logs = self.log_cells(points, readings, positions, traits)
        known = np.isfinite(readings)[:, None] & np.isfinite(points).all(axis=0)
        return of_readings(np.where(known, logs, -np.inf), owners)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Mean readings (S, N) at points (P, N), their gradients (S, P, N) and variances (S, N)."""
        values, chances, slopes = self.cells(points, positions, traits)
        means = (values * chances).sum(axis=1)
        variances = (chances * (values - means[:, None]) ** 2).sum(axis=1)
        least = LEAST_VARIANCE * np.ptp(values, axis=1) ** 2
        return means, (values[:, :, None] * slopes).sum(axis=1), np.maximum(variances, least)

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher information about the position in one reading of each sensor: Σ ∇p ∇pᵀ / p."""
        _, chances, slopes = self.cells(points, positions, traits)
        each = np.divide(slopes, np.sqrt(chances)[:, :, None], out=np.zeros_like(slopes), where=chances[:, :, None] > 0)
        total: Floats = np.einsum("scpn,scqn->spqn", each, each)
        return total


@part
class Binary(OfCells, OfPosition):
    """Whether a node detects a target: 1 or 0, with P(1) = ε + (1 - 2ε) Φ((radius - d) / edge) at the distance d.

    Every node within `reach` has a reading, and a 0 says that the target is probably not near. The edge is that of a
    threshold on a reading of the distance with normal noise. ε, the probability of a wrong reading far from the edge,
    is our choice.

    Source: Djurić, Vemula, Bugallo (2008), whose nodes compare a received power with a threshold.
    """

    reading_bits: ClassVar[int] = 1

    radius: Annotated[float, LENGTH, "distance at which a detection is as probable as none"] = 30.0
    edge: Annotated[float, ACCURACY, "standard deviation of the distance at which a target is just detected"] = 3.0
    error: Annotated[float, Quantity("", ge=1e-6, le=0.4), "ε: probability of a wrong reading far from the edge"] = 0.01
    reach: Annotated[float, REACH, "sensing range: farther nodes have no reading; .inf: unlimited"] = 60.0

    @property
    def reading_values(self) -> Floats:
        """(2,) what a reading can be."""
        return np.array([0.0, 1.0])

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings, 0 or 1, of targets at points (n, P), with standard normal noise."""
        from scipy.special import ndtr

        chances = self._chances((self.radius - np.sqrt(squared_distances(points, positions))) / self.edge)
        readings: Floats = (ndtr(noise) < chances).astype(np.float64)
        return readings

    def log_cells(self, points: Floats, readings: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, N) log P(1) of readings above 1/2, log P(0) of others."""
        chances, _ = self._detections(points, positions)
        result: Floats = np.log(np.where(readings[:, None] > 0.5, chances, 1.0 - chances))
        return result

    def cells(self, points: Floats, positions: Floats, traits: Floats) -> Cells:
        """No detection and a detection."""
        chances, slopes = self._detections(points, positions)
        both = np.stack([1.0 - chances, chances], axis=1)
        return Cells(self.reading_values[None, :, None], both, np.stack([-slopes, slopes], axis=1))

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue for a sensing range that is too long, or shorter than the radius."""
        yield from reach_issues(self.reach)
        if self.reach < self.radius:
            message = f"must be at least the radius of {self.radius:g} m, is {self.reach:g}: no node would see an edge"
            yield Issue(("sensor", "reach"), message)

    def _detections(self, points: Floats, positions: Floats) -> tuple[Floats, Floats]:
        """P(1) (S, N) at points (P, N), and its slopes (S, P, N)."""
        nothing = np.empty((len(positions), 0))
        distances, gradients, _ = Range(sd=self.edge).linearise(points, positions, nothing)
        inside = (self.radius - distances) / self.edge
        slopes = (2.0 * self.error - 1.0) / self.edge * density(inside)
        return self._chances(inside), slopes[:, None] * gradients

    def _chances(self, inside: Floats) -> Floats:
        """P(1) this many times the edge inside the radius."""
        from scipy.special import ndtr

        chances: Floats = self.error + (1.0 - 2.0 * self.error) * ndtr(inside)
        return chances


@part
class Quantised(OfCells, OfLaw):
    """A scalar reading of another sensor model in a few bits: it says in which of 2^bits cells the number fell.

    `thresholds: uniform` are equally far apart between `low` and `high`; the outermost cells have no end, but those of
    an angle share the turn. `lloyd_max`: the head broadcasts the predicted position and its covariance (the packets of
    a mean and a covariance), and each member takes the thresholds of Max (1960) for a Gaussian about its predicted
    reading. A member that did not receive them sends nothing; without a prediction, as in the initiation of a track, a
    reading is sent in full. A packet with a reading is 32 bits of header and `bits`.

    Readings are in the unit of the law, whose noise must be Gaussian: a reading is the middle of its cell, or with
    `lloyd_max` its mean. The information with `lloyd_max` is the largest that any thresholds give, those about the
    true reading.

    Source: Msechu, Roumeliotis, Ribeiro, Giannakis (2008) for thresholds about the prediction; Ribeiro, Giannakis,
    Roumeliotis (2006) for one bit; Niu, Varshney (2006) for the likelihood and the information of cells with fixed
    thresholds.
    """

    law: Annotated[SensorModel, OfRole("sensor"), "the sensor model whose readings are quantised"]
    bits: Annotated[int, Quantity("", ge=1, le=8, label="bit"), "bits of a reading"] = 1
    thresholds: Annotated[Literal["uniform", "lloyd_max"], "the thresholds between cells"] = "uniform"
    low: Annotated[float, READING, "lower end of the uniform cells, in the unit of the law"] = 0.0
    high: Annotated[float, READING, "upper end of the uniform cells, in the unit of the law"] = 60.0

    def __post_init__(self) -> None:
        """Raises ValueError for a law that cannot be quantised, or limits in the wrong order."""
        constant = False if is_relative(self.law) else getattr(self.law, "constant_gaussian", None)
        about = self.thresholds == "lloyd_max"
        if isinstance(self.law, (Replays, OfCells)) or len(components_of(self.law)) > 1:
            raise ValueError("law: must be a sensor model of scalar readings that are computed and not yet quantised")
        if constant is False or getattr(self.law, "shadowing", None) or getattr(self.law, "beyond", None) == "noise":
            raise ValueError(
                "law: the noise must be Gaussian about the mean, without shadowing, blocking, beyond: noise or an "
                "unknown part that readings have in common"
            )
        if about and (not constant or any(periods_of(self.law))):
            raise ValueError("thresholds: lloyd_max needs noise of constant variance, and no angle; use uniform")
        if not about and not any(periods_of(self.law)) and not self.low < self.high:
            raise ValueError(f"high: must be above low ({self.low:g}), is {self.high:g}")

    @property
    def adapts(self) -> bool:
        """Whether thresholds follow a prediction."""
        return self.thresholds == "lloyd_max"

    @property
    def reading_bits(self) -> int:
        """The bits of a reading."""
        return self.bits

    @property
    def reading_values(self) -> Floats:
        """(C,) what a reading can be; nothing where thresholds adapt."""
        return np.empty(0) if self.adapts else self._uniform[1]

    def detects(self, points: Floats, positions: Floats) -> Bools:
        """(n, S) as the law."""
        return detected(self.law, points, positions)

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) the readings of the law by their cells; as they are where thresholds adapt and none are known."""
        readings = self.law.measure(points, positions, self._of_law(traits), noise)
        return readings if self._kind(traits) is OfLaw else self.quantised(readings, traits)

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """As `OfCells.log_likelihood`; that of the law for readings in full."""
        return self._kind(traits).log_likelihood(self, points, readings, positions, traits, owners)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """As `OfCells.linearise`; that of the law for readings in full."""
        return self._kind(traits).linearise(self, points, positions, traits)

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) that of the cells; with thresholds still to come, the most that they can leave of the law's."""
        if self._kind(traits) is OfCells:
            return super().information(points, positions, traits)
        edges, values = lloyd_max(self.bits)
        kept = float(np.exp(log_between(edges[:-1], edges[1:])) @ values**2)
        return kept * informations(self.law, points, positions, traits)

    def assumed(self, gains: str, inflate: bool) -> Quantised:
        """The model that a filter assumes: the law's, quantised."""
        return replace(self, law=self.law.assumed(gains, inflate))

    def with_thresholds(self, point: Floats, spread: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, T + 2) traits with each expected reading and its deviation, by a prediction (P,) of covariance (P, P)."""
        means, gradients, variances = self.law.linearise(np.ascontiguousarray(point[:, None]), positions, traits)
        slopes = gradients[:, :, 0]
        deviations = np.sqrt(((slopes @ spread) * slopes).sum(axis=1) + variances[:, 0])
        return np.column_stack([traits, means[:, 0], deviations])

    def quantised(self, readings: Floats, traits: Floats) -> Floats:
        """(n,) what stands for the cell of each reading (n,)."""
        edges, values = self._levels(traits)
        if period := periods_of(self.law)[0]:
            readings = edges[0, 0] + (readings - edges[0, 0]) % period
        cells = (readings[:, None] >= edges[:, 1:-1]).sum(axis=1)
        chosen: Floats = np.broadcast_to(values, (len(readings), values.shape[1]))[np.arange(len(readings)), cells]
        return chosen

    def log_cells(self, points: Floats, readings: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, N) the log of the probability of the cell of each reading."""
        means, _, variances = self.law.linearise(points, positions, self._of_law(traits))
        edges, values = self._levels(traits)
        apart = near(self.law, readings[:, None] - values, np.zeros(1))
        cells, rows = np.argmin(np.abs(apart), axis=1), np.arange(len(readings)) % len(edges)
        ends = [edges[rows, cells + side, None] for side in (0, 1)]
        each = [log_between(*((end + turn - means) / np.sqrt(variances) for end in ends)) for turn in self._turns]
        result: Floats = np.logaddexp.reduce(each)
        return result

    def cells(self, points: Floats, positions: Floats, traits: Floats) -> Cells:
        """The cells of the law's readings; the values of an angle are those nearest to the expected one."""
        own = self._of_law(traits)
        means, gradients, variances = self.law.linearise(points, positions, own)
        edges, values = self._levels(traits)
        deviations = np.sqrt(variances)
        chances, by_mean, by_deviation = np.zeros((3, len(means), values.shape[1], means.shape[1]))
        with np.errstate(invalid="ignore", divide="ignore"):
            for turn in self._turns:
                ends = (edges[:, :, None] + turn - means[:, None]) / deviations[:, None]
                heights = density(ends)
                chances += np.exp(log_between(ends[:, :-1], ends[:, 1:]))
                by_mean -= np.diff(heights, axis=1)
                by_deviation -= np.diff(np.where(np.isfinite(ends), ends, 0.0) * heights, axis=1)
        slopes = by_mean[:, :, None] * (gradients / deviations[:, None])[:, None]
        slopes += by_deviation[:, :, None] * self._widening(points, positions, own)[:, None]
        return Cells(near(self.law, values[:, :, None], means[:, None]), chances, slopes)

    def __getattr__(self, name: str) -> Any:
        """What a law can do with the middle of a cell, such as `ranges`."""
        if name not in PASSED_ON:
            raise AttributeError(name)
        return getattr(self.law, name)

    def _kind(self, traits: Floats) -> type[OfCells | OfLaw]:
        """Whether readings are in cells, or in full: where thresholds adapt, and these traits do not have them."""
        return OfLaw if self.adapts and traits.shape[1] == len(self.trait_names) else OfCells

    def _of_law(self, traits: Floats) -> Floats:
        return traits[:, : len(self.trait_names)]

    def _levels(self, traits: Floats) -> tuple[Floats, Floats]:
        """(S, C + 1) the ends of the cells and (S, C) what stands for each; one row where all sensors have the same."""
        if not self.adapts:
            return self._uniform[0][None], self._uniform[1][None]
        edges, values = lloyd_max(self.bits)
        centres, scales = traits[:, -2:-1], traits[:, -1:]
        return centres + scales * edges, centres + scales * values

    def _widening(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, N) the slope of the log of a reading's standard deviation."""
        if getattr(self.law, "constant_gaussian", False):
            return np.zeros((len(positions), *points.shape))
        moves = WIDTH * np.eye(len(points))[:, :, None]
        near_by = [self.law.linearise(points + move, positions, traits)[2] for move in (*moves, *-moves)]
        above, below = np.split(np.log(np.stack(near_by, axis=1)), 2, axis=1)
        slopes: Floats = (above - below) / (4.0 * WIDTH)
        return slopes

    @cached_property
    def _uniform(self) -> tuple[Floats, Floats]:
        """(C + 1,) the ends of the uniform cells and (C,) their middles."""
        period = periods_of(self.law)[0]
        low, high = (-period / 2.0, period / 2.0) if period else (self.low, self.high)
        edges = np.linspace(low, high, 2**self.bits + 1)
        middles = 0.5 * (edges[1:] + edges[:-1])
        if not period:
            edges[[0, -1]] = -math.inf, math.inf
        return edges, middles

    @cached_property
    def _turns(self) -> tuple[float, ...]:
        """By how much the cells of an angle are repeated."""
        period = periods_of(self.law)[0]
        return (-period, 0.0, period) if period else (0.0,)


def density(z: Floats) -> Floats:
    """The standard normal density."""
    return np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)


def log_between(low: Floats, high: Floats) -> Floats:
    """log(Φ(high) - Φ(low)), computed in the tail where it keeps its digits."""
    from scipy.special import log_ndtr

    right = low > 0.0
    low, high = np.where(right, -high, low), np.where(right, -low, high)
    most = log_ndtr(high)
    with np.errstate(invalid="ignore", divide="ignore"):
        result: Floats = most + np.log1p(-np.exp(log_ndtr(low) - most))
    return result


@lru_cache
def lloyd_max(bits: int) -> tuple[Floats, Floats]:
    """The ends (C + 1,) and means (C,) of the 2^bits cells of a standard normal with the least mean squared error.

    Each end is midway between two means: the iteration of Lloyd (1982), from the thresholds of equal probability of
    N(0, 3), which are the limit for many cells. Max (1960), table 1.
    """
    from scipy.special import ndtri

    edges = math.sqrt(3.0) * ndtri(np.linspace(0.0, 1.0, 2**bits + 1))
    for _ in range(SWEEPS):
        values = -np.diff(density(edges)) / np.exp(log_between(edges[:-1], edges[1:]))
        edges[1:-1] = 0.5 * (values[1:] + values[:-1])
    return edges, values
