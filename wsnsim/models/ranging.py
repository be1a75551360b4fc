"""Sensor models of a distance: range, time difference of arrival, range from the origin, received signal strength.

log_likelihood(points (P, N), readings (S,), positions (S, 2), traits (S, T), owners (N,) | None) -> (N,)

Sensors stand in the plane. A target whose position is one column (P = 1) moves along the x-axis. T is 0, 1 or 2: what
is added to the readings of a node where nodes differ in it, and its height in m where heights count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, near, planar
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.sensing import BIAS, GAIN_DB
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.kernels import ranging as kernels
from wsnsim.models.bounds import ACCURACY, ELEVATION, FAILURE, LENGTH, LOG_TWO_PI, PLACE
from wsnsim.models.distances import Excess, OfDistance
from wsnsim.models.node_constants import NAMES, Constants, OfNodes
from wsnsim.models.sensing import fisher

REACH: Final = Quantity("m", ge=1e-3)
"""A sensing range that may be infinite: up to 1e7 m, or .inf (see `reach_issues`)."""
SPREAD: Final = Quantity("m", ge=0, le=1e6)
"""A standard deviation of lengths that may be 0."""
FITTED_ON: Final = "digests of the files of readings that the law was fitted to, as `wsnsim fit` writes them"


GREATEST_RANGE: Final = 1e7
"""Greatest range (m) in a recording, the greatest length in a scenario: the sensing range does not bound it."""
DEVIATIONS: Final = 10.0
"""A recorded range may be below 0 by this many standard deviations (our choice): noise exceeds it in 1 of 1e23."""


@part
class Range(OfNodes):
    """The distance to a target, with noise of constant variance: z = d + b + v, v ~ N(0, R).

    Source: Liu, Wang (2012): R is 1 m² and the range 400 m. In the paper every sensor has a reading, which is the
    noise alone, z = v, if the target is out of range (`beyond: noise`). In a network such a node has none
    (`beyond: silent`). `own_cell` is our interpretation of the paper's sensors that hand a target over: a sensor
    measures in its own Voronoi cell only.

    A filter linearises the distance without regard to the range, as in the paper. The likelihood of a particle and the
    Fisher information follow the true law: beyond the range, a reading has the mean 0 and no information.

    The rest is our choice, and off by default. The bias b of a node is constant over a run: normal with the standard
    deviation `bias_spread`, or as listed in `biases`; `clock_spread` is that of a part that all nodes have in common,
    as with a target whose clock has an offset. Filters know it, or estimate it beside the state (`assumes.gains`). With
    `target_height` d is the distance in space. With the probability `blocked`, the line of sight is blocked and the
    path longer by N(`detour`, `detour_sd`²): the likelihood is that of the mixture. Gaussian filters take its mean and
    its variance.
    """

    constant: ClassVar[str] = BIAS

    sd: Annotated[float, ACCURACY, "standard deviation of a reading"] = 1.0
    reach: Annotated[float, REACH, "sensing range in the plane; .inf: unlimited"] = 400.0
    beyond: Annotated[Literal["silent", "noise"], "reading of a target out of range"] = "silent"
    own_cell: Annotated[bool, "whether only the sensor nearest to the target has a reading"] = False
    bias_spread: Annotated[float, SPREAD, "standard deviation of the biases of nodes, normal"] = 0.0
    biases: Annotated[tuple[float, ...], PLACE, "bias of each node, in the order of `nodes`; none: drawn"] = ()
    nodes: Annotated[tuple[int | str, ...], NAMES] = ()
    clock_spread: Annotated[float, SPREAD, "standard deviation of a bias that all nodes have in common"] = 0.0
    target_height: Annotated[float | None, ELEVATION, "height of the target; none: heights are ignored"] = None
    blocked: Annotated[float, FAILURE, "probability that the line of sight is blocked"] = 0.0
    detour: Annotated[float, LENGTH, "mean length of the detour where it is blocked"] = 5.0
    detour_sd: Annotated[float, SPREAD, "standard deviation of the detour, normal"] = 2.0
    fitted_on: Annotated[tuple[str, ...], FITTED_ON] = ()

    @property
    def reading_limits(self) -> tuple[float, float]:
        """Least and greatest range (m) that may be recorded: noise makes that of a small distance negative."""
        return -DEVIATIONS * math.hypot(self.sd, math.sqrt(self.gain_variance)), GREATEST_RANGE

    @property
    def reading_space(self) -> tuple[tuple[float, float], ...]:
        """The interval in which a range may be: from 0 to the sensing range."""
        return ((0.0, self.reach),)

    def detects(self, points: Floats, positions: Floats) -> Bools:
        """(n, S) whether each sensor has a reading of a target at each of the points (n, P): all if `beyond: noise`.

        With `own_cell`, the first of several equally near sensors has the reading.
        """
        if self.beyond == "noise":
            return np.ones((len(points), len(positions)), dtype=np.bool_)
        squared = ((planar(points)[:, None, :] - positions) ** 2).sum(axis=-1)
        within: Bools = squared <= self.reach * self.reach
        if self.own_cell and len(positions):
            within &= np.arange(len(positions)) == np.argmin(squared, axis=1)[:, None]
        return within

    @property
    def constants(self) -> Constants:
        """Biases in m."""
        return Constants("biases", self.biases, self.bias_spread, self.clock_spread)

    def ranges(self, readings: Floats) -> Floats:
        """(S,) the distance in m at which each reading is expected: the reading itself, at least 0."""
        return np.maximum(readings, 0.0)

    def strength(self, reading: float) -> float:
        """The strength of a reading for an election, which grows as the range shrinks."""
        return -reading

    def information(self, points: Floats, positions: Floats, traits: Floats) -> Floats:
        """(S, P, P, N) Fisher information about the position in one reading: g gᵀ / R; 0 where it is noise alone."""
        distances, gradients, variances = self.linearise(points, positions, traits)
        return fisher(gradients, np.where(distances <= self._within, self._weights(variances), 0.0))

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue for `beyond: noise` in a network or with `own_cell`, and for a range that is too long."""
        yield from super().check(setup)
        if self.beyond == "noise" and (self.trait_names or self.blocked):
            yield Issue(("sensor", "beyond"), "with biases, heights or blocked lines of sight use beyond: silent")
        if self.beyond == "noise" and isinstance(setup, NetworkSetup):
            yield Issue(
                ("sensor", "beyond"),
                "in a network, a node out of range has no reading: use beyond: silent, or network: none",
            )
        if self.beyond == "noise" and self.own_cell:
            yield Issue(("sensor", "own_cell"), "with beyond: noise every sensor has a reading: use beyond: silent")

    @property
    def _within(self) -> float:
        """The distance (m) up to which a reading depends on the distance."""
        return self.reach if self.beyond == "noise" else math.inf

    def law(self, inflation: float = 0.0) -> kernels.Law:
        """The distance itself; `inflation` is added to R."""
        return 0.0, 1.0, 0.0, float(self.sd) ** 2 + inflation, float(self._within), False

    def _means(self, squared: Floats) -> Floats:
        return np.where(squared <= self._within * self._within, np.sqrt(squared), 0.0)

    @property
    def _excess(self) -> Excess | None:
        return Excess(self.blocked, self.detour, self.detour_sd) if self.blocked else None


@part
class TimeDifference(OfNodes):
    """Time differences of arrival (TDOA) of a signal of the target: z = d + b + v, v ~ N(0, R), with b unknown.

    A reading is a time of arrival times the speed of propagation, by a clock that all nodes have in common. The time
    of emission, hence b, is another one at each step and unknown, so that only the differences of readings count. The
    n - 1 differences from the reading of any node have the covariance R (I + 1 1ᵀ). Whichever node is the reference,
    their likelihood is that of the n readings with a flat prior of b, and their information GᵀG - n ḡ ḡᵀ over R, with
    the slopes G of the distances and their mean ḡ. So each node sends its own reading, the head uses those that arrive,
    and no reference has to be chosen or can fail. A single reading says nothing.

    Sampled readings have b = 0, which no result depends on. With `target_height` d is the distance in space.

    Source: Chan, Ho (1994) for the differences and their covariance.
    """

    constant: ClassVar[str] = BIAS
    relative: ClassVar[bool] = True
    constants: ClassVar[Constants] = Constants("", (), 0.0)
    gain_prior: ClassVar[float] = 0.0
    ranges: ClassVar[None] = None  # type: ignore[assignment]
    """No distance follows from a reading."""
    reading_limits: ClassVar[tuple[float, float]] = (-GREATEST_RANGE, GREATEST_RANGE)
    """Of recorded readings (m): larger numbers would not keep the digits of their differences."""

    sd: Annotated[float, ACCURACY, "standard deviation of a time of arrival, times the speed of propagation"] = 1.0
    reach: Annotated[float, REACH, "sensing range in the plane; .inf: unlimited"] = 400.0
    target_height: Annotated[float | None, ELEVATION, "height of the target; none: heights are ignored"] = None

    def strength(self, reading: float) -> float:
        """The strength of a reading for an election: the signal arrives first at the nearest node."""
        return -reading

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) log p(differences of the readings | target at points (P, N)): 0 for one reading, or with `owners`.

        -inf for points that are not finite and for readings that are NaN.
        """
        known = np.isfinite(points).all(axis=0) & bool(np.isfinite(readings).all())
        if len(readings) < 2 or owners is not None:
            return np.where(known, 0.0, -np.inf) if len(readings) else np.zeros(points.shape[1])
        expected, _, variances = self.linearise(points, positions, traits)
        off, rows = near(self, readings[:, None], expected) - expected, len(readings) - 1
        constant = rows * (LOG_TWO_PI + 2.0 * math.log(self.sd)) + math.log(len(readings))
        return np.where(known, -0.5 * ((off * off / variances).sum(axis=0) + constant), -np.inf)

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings (S, N) at points (P, N), gradients (S, P, N), less their means, and variances (S, N)."""
        expected, gradients, variances = super().linearise(points, positions, traits)
        with np.errstate(invalid="ignore"):  # of points that are not finite
            return *(array - array.sum(axis=0) / max(len(array), 1) for array in (expected, gradients)), variances

    def law(self, inflation: float = 0.0) -> kernels.Law:
        """The distance itself; `inflation` is added to R."""
        return 0.0, 1.0, 0.0, float(self.sd) ** 2 + inflation, math.inf, False

    def _means(self, squared: Floats) -> Floats:
        return np.sqrt(squared)


@part
class RangeFromOrigin(OfDistance):
    """The target's distance from the origin, wherever the node stands: z = sqrt(x² + y²) + v, v ~ N(0, R).

    The angle about the origin is not observable.

    Source: Wei, Guo (2022), the tracking experiment; R is 1 m².
    """

    reach: ClassVar[float] = math.inf

    sd: Annotated[float, ACCURACY, "standard deviation of a reading"] = 1.0

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings in m of targets at points (n, P), with standard normal noise."""
        result: Floats = np.sqrt((points**2).sum(axis=1)) + self.sd * noise
        return result

    def _places(self, positions: Floats, traits: Floats) -> Floats:
        return np.zeros((len(positions), 2))

    @cached_property
    def _law(self) -> kernels.Law:
        return 0.0, 1.0, 0.0, float(self.sd) ** 2, math.inf, False


LARGEST_EXPONENT: Final = 600.0
"""e to this power times any d0 is finite."""
DECIBEL: Final = Quantity("dB", ge=0, le=1e6)
"""A standard deviation that may be 0."""
GAIN_OF_NODE: Final = Quantity("dB", ge=-1e6, le=1e6)


@part
class Rssi(OfNodes):
    """Received signal strength, which falls with the logarithm of the distance: z = z0 - 10 η log10(d/d0) + g + v.

    The gain g of a node is constant over a run: 0, normal with the standard deviation `gain_spread`, or as listed in
    `gains`. With `target_height` d is the distance in space: d² = dx² + dy² + (h_node - h_target)², with the heights of
    the nodes from the deployment. Without it, d is the distance in the plane. v has the standard deviation `sd`,
    whether it is normal or Student's t. `shadowing` is added to readings that are sampled: Gaussian, correlated along
    the target's path, independent between nodes and targets (Gudmundson (1991), see `base.sensing`).

    Source: Ruan, Wang, Yang, Zhang (2020), eq. 4, without gains, heights and shadowing; R is 1/4 dB². z0, from the
    paper's indoor fit, and the least d are our choice.
    """

    constant: ClassVar[str] = GAIN_DB
    reading_limits: ClassVar[tuple[float, float]] = (-200.0, 0.0)
    """Least and greatest strength (dBm) that a receiver of low power can report; recorded readings are within them."""

    z0: Annotated[float, Quantity("dBm", ge=-1e6, le=1e6), "strength at the distance d0"] = -37.8
    eta: Annotated[float, Quantity("", ge=1e-3, le=100), "η: exponent of the loss with distance"] = 2.3
    d0: Annotated[float, LENGTH, "distance at which the strength is z0"] = 1.0
    sd: Annotated[float, Quantity("dB", ge=1e-6, le=1e6), "standard deviation of a reading"] = 0.5
    floor: Annotated[float, ACCURACY, "least distance: shorter ones are taken as this"] = 0.05
    reach: Annotated[float, REACH, "sensing range in the plane; .inf: unlimited"] = math.inf
    noise: Annotated[Literal["normal", "student_t"], "distribution of the noise of a reading"] = "normal"
    dof: Annotated[float, Quantity("", gt=2, le=1e6), "ν: degrees of freedom of noise: student_t"] = 5.0
    gain_spread: Annotated[float, DECIBEL, "standard deviation of the gains of nodes, normal"] = 0.0
    gains: Annotated[tuple[float, ...], GAIN_OF_NODE, "gain of each node, in the order of `nodes`; none: drawn"] = ()
    nodes: Annotated[tuple[int | str, ...], NAMES] = ()
    target_height: Annotated[float | None, ELEVATION, "height of the target; none: heights are ignored"] = None
    shadowing: Annotated[float, DECIBEL, "standard deviation of shadowing, correlated along the target's path"] = 0.0
    decorrelation: Annotated[float, LENGTH, "δ: length of path after which its correlation is 1/e"] = 2.0
    fitted_on: Annotated[tuple[str, ...], FITTED_ON] = ()

    @property
    def constants(self) -> Constants:
        """Gains in dB."""
        return Constants("gains", self.gains, self.gain_spread)

    def ranges(self, readings: Floats) -> Floats:
        """(S,) the distance in m at which each reading is expected, at least `floor`: d0 10^((z0 - z)/(10 η))."""
        exponents = np.minimum(math.log(10.0) * (self.z0 - readings) / (10.0 * self.eta), LARGEST_EXPONENT)
        return np.maximum(self.d0 * np.exp(exponents), self.floor)

    def law(self, inflation: float = 0.0) -> kernels.Law:
        """z = a + b log d with b = -10 η / log 10 and a = z0 - b log d0 (eq. 4); `inflation` is added to R."""
        slope = -10.0 * self.eta / math.log(10.0)
        offset = self.z0 - slope * math.log(self.d0)
        return offset, slope, float(self.floor), float(self.sd) ** 2 + inflation, math.inf, True

    def _means(self, squared: Floats) -> Floats:
        distances = np.maximum(np.sqrt(squared), self.floor)
        return self.z0 - 10.0 * self.eta * np.log10(distances / self.d0)

    @property
    def _dof(self) -> float:
        """Degrees of freedom ν of the noise; infinite: it is normal."""
        return self.dof if self.noise == "student_t" else math.inf
