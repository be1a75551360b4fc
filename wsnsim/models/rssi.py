"""The sensor model of received signal strength, and what filters assume of it.

log_likelihood(points (P, N), readings (S,), positions (S, 2), traits (S, T), owners (N,) | None) -> (N,)

T is 0, 1 or 2: the gain of a node in dB where there are gains, and its height in m where heights count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.sensing import GAIN_DB, HEIGHT
from wsnsim.base.setups import TrackingSetup
from wsnsim.kernels import ranging as kernels
from wsnsim.models.bounds import ACCURACY, LENGTH, number_of_nodes
from wsnsim.models.ranging import FITTED_ON, REACH, OfDistance, reach_issues, squared_distances, unit_noise

LARGEST_EXPONENT: Final = 600.0
"""e to this power times any d0 is finite."""
DECIBEL: Final = Quantity("dB", ge=0, le=1e6)
"""A standard deviation that may be 0."""
GAIN_OF_NODE: Final = Quantity("dB", ge=-1e6, le=1e6)
HowGains = Literal["known", "unknown", "estimated"]
ELEVATION: Final = Quantity("m", ge=-1e6, le=1e6)


@part
class Rssi(OfDistance):
    """Received signal strength, which falls with the logarithm of the distance: z = z0 - 10 η log10(d/d0) + g + v.

    The gain g of a node is constant over a run: 0, normal with the standard deviation `gain_spread`, or as listed in
    `gains`. With `target_height` d is the distance in space: d² = dx² + dy² + (h_node - h_target)², with the heights of
    the nodes from the deployment. Without it, d is the distance in the plane. v has the standard deviation `sd`,
    whether it is normal or Student's t. `shadowing` is added to readings that are sampled: Gaussian, correlated along
    the target's path, independent between nodes and targets (Gudmundson (1991), see `base.sensing`).

    Source: Ruan, Wang, Yang, Zhang (2020), eq. 4, without gains, heights and shadowing; R is 1/4 dB². z0, from the
    paper's indoor fit, and the least d are our choice.
    """

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
    gains: Annotated[tuple[float, ...], GAIN_OF_NODE, "gain of each node, in their order; none: drawn"] = ()
    target_height: Annotated[float | None, ELEVATION, "height of the target; none: heights are ignored"] = None
    shadowing: Annotated[float, DECIBEL, "standard deviation of shadowing, correlated along the target's path"] = 0.0
    decorrelation: Annotated[float, LENGTH, "δ: length of path after which its correlation is 1/e"] = 2.0
    fitted_on: Annotated[tuple[str, ...], FITTED_ON] = ()

    @property
    def trait_names(self) -> tuple[str, ...]:
        """The names of a node's traits: its gain if there are gains, and its height if heights count."""
        if self.target_height is not None:
            return (GAIN_DB, HEIGHT)
        return (GAIN_DB,) if self.gain_variance else ()

    @property
    def gain_variance(self) -> float:
        """The variance of the gains in dB², as filters know it: that of the listed gains without `gain_spread`."""
        if self.gain_spread or not self.gains:
            return self.gain_spread**2
        return math.fsum(gain**2 for gain in self.gains) / len(self.gains)

    @property
    def gain_prior(self) -> float:
        """The variance of a gain that the filter estimates: 0, it knows the gains."""
        return 0.0

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, T) gain in dB of each node, and its height: 0 until the deployment gives it.

        Raises:
            RunError: the gains listed are not as many as the nodes.
        """
        if not self.trait_names:
            return np.empty((nodes, 0))
        if self.gains and len(self.gains) != nodes:
            raise RunError(_wrong_count(len(self.gains), nodes))
        drawn = self.gain_spread * rng.standard_normal(nodes)
        return np.column_stack([self.gains or drawn, np.zeros(nodes)])[:, : len(self.trait_names)]

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings in dBm of targets at points (n, P) by sensors at positions (n, 2), with standard normal noise.

        Points with three columns have the target's height, which counts instead of `target_height`.
        """
        squared = squared_distances(points[:, :2], positions)
        if self.target_height is not None:
            squared = squared + (traits[:, 1] - (points[:, 2] if points.shape[1] > 2 else self.target_height)) ** 2
        distances = np.maximum(np.sqrt(squared), self.floor)
        means = self.z0 - 10.0 * self.eta * np.log10(distances / self.d0)
        readings: Floats = means + self.sd * unit_noise(noise, self._dof)
        return readings + traits[:, 0] if self.trait_names else readings

    def ranges(self, readings: Floats) -> Floats:
        """(S,) the distance in m at which each reading is expected, at least `floor`: d0 10^((z0 - z)/(10 η))."""
        exponents = np.minimum(math.log(10.0) * (self.z0 - readings) / (10.0 * self.eta), LARGEST_EXPONENT)
        return np.maximum(self.d0 * np.exp(exponents), self.floor)

    def ranges_in_plane(self, readings: Floats, traits: Floats) -> Floats:
        """(S,) as `ranges`, without the gains of the nodes, in the plane: sqrt(max(d² - (h_node - h_target)², 0))."""
        return self.in_plane(self.ranges(readings - traits[:, 0] if self.trait_names else readings), traits)

    def in_plane(self, ranges: Floats, traits: Floats) -> Floats:
        """(S,) the distances in the plane of distances in space, both in m."""
        if self.target_height is None:
            return ranges
        return np.sqrt(np.maximum(ranges**2 - (traits[:, 1] - self.target_height) ** 2, 0.0))

    def assumed(self, gains: str, inflate: bool) -> Rssi | AssumedRssi:
        """The model that a filter assumes: gains are 'known', 'unknown' (taken as 0 dB) or 'estimated'.

        With `inflate`, the variances of unknown gains and of shadowing are added to that of a reading.
        """
        how: HowGains = gains if gains in ("unknown", "estimated") and self.gain_variance else "known"  # type: ignore[assignment]
        if how == "known" and not (inflate and self.shadowing):
            return self
        return AssumedRssi(sensor=self, gains=how, inflate=inflate)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the range is finite and too long, and if other than one gain a node is listed."""
        yield from reach_issues(self.reach)
        nodes = number_of_nodes(setup.deploy) if self.gains else None
        if nodes is not None and nodes != len(self.gains):
            yield Issue(("sensor", "gains"), _wrong_count(len(self.gains), nodes))

    def law(self, inflation: float = 0.0) -> kernels.Law:
        """z = a + b log d with b = -10 η / log 10 and a = z0 - b log d0 (eq. 4); `inflation` is added to R."""
        slope = -10.0 * self.eta / math.log(10.0)
        offset = self.z0 - slope * math.log(self.d0)
        return offset, slope, float(self.floor), float(self.sd) ** 2 + inflation, math.inf, True

    def _places(self, positions: Floats, traits: Floats) -> Floats:
        """(S, 2) the positions, or (S, 3) with the squared difference in height."""
        if self.target_height is None:
            return np.ascontiguousarray(positions)
        return np.column_stack([positions, (traits[:, 1] - self.target_height) ** 2])

    def _gains(self, traits: Floats) -> Floats | None:
        return np.ascontiguousarray(traits[:, 0]) if self.trait_names else None

    @cached_property
    def _law(self) -> kernels.Law:
        return self.law()

    @property
    def _dof(self) -> float:
        """Degrees of freedom ν of the noise; infinite: it is normal."""
        return self.dof if self.noise == "student_t" else math.inf


@part
class AssumedRssi(OfDistance):
    """The model that a filter assumes of an `Rssi` of which it does not know all: gains that are not known are 0 dB.

    With `inflate`, the variances of unknown gains and of shadowing are added to that of a reading, as if both were
    independent from step to step: R' = R + σ_g² + σ² (our choice). A filter that estimates the gains beside the state
    (`estimated`) takes them off the readings itself: `gain_prior` is the variance with which it begins.
    """

    sensor: Rssi
    gains: HowGains
    inflate: bool

    @property
    def gain_prior(self) -> float:
        """The variance in dB² of a gain that the filter estimates, at first; 0 if it estimates none."""
        return self.sensor.gain_variance if self.gains == "estimated" else 0.0

    @property
    def reach(self) -> float:
        """The sensing range of the true sensor, in m."""
        return self.sensor.reach

    @property
    def trait_names(self) -> tuple[str, ...]:
        """The names of a node's traits, as of `Rssi`."""
        return self.sensor.trait_names

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, T) the traits of each node that the filter knows: gains are 0 if it does not."""
        return self._known(self.sensor.draw_traits(nodes, rng))

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) readings as the filter assumes them: without gains that it does not know, with its variance."""
        expected = self.sensor.measure(points, positions, self._known(traits), np.zeros(len(noise)))
        return expected + math.sqrt(self._law[3]) * unit_noise(noise, self._dof)

    def ranges(self, readings: Floats) -> Floats:
        """(S,) the distance in m at which each reading is expected, as from `Rssi`."""
        return self.sensor.ranges(readings)

    def ranges_in_plane(self, readings: Floats, traits: Floats) -> Floats:
        """(S,) as `ranges`, in the plane."""
        return self.sensor.ranges_in_plane(readings, self._known(traits))

    def assumed(self, gains: str, inflate: bool) -> Rssi | AssumedRssi:
        """The model that another filter assumes of the same sensor."""
        return self.sensor.assumed(gains, inflate)

    def _places(self, positions: Floats, traits: Floats) -> Floats:
        return self.sensor._places(positions, traits)

    def _gains(self, traits: Floats) -> Floats | None:
        return np.ascontiguousarray(traits[:, 0]) if self.gains == "known" and self.trait_names else None

    def _known(self, traits: Floats) -> Floats:
        """The traits (n, T) with gains that are not known as 0 dB."""
        return traits if self.gains == "known" else traits * (0.0, 1.0)[: traits.shape[1]]

    @cached_property
    def _law(self) -> kernels.Law:
        unknown = self.sensor.gain_variance if self.gains == "unknown" else 0.0
        return self.sensor.law(unknown + self.sensor.shadowing**2 if self.inflate else 0.0)

    @property
    def _dof(self) -> float:
        return self.sensor._dof


def _wrong_count(gains: int, nodes: int) -> str:
    return f"{gains} gains for {nodes} nodes: list one for each node, in the order of the nodes"
