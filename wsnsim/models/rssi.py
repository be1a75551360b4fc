"""The sensor model of received signal strength.

log_likelihood(points (P, N), readings (S,), positions (S, 2), traits (S, T), owners (N,) | None) -> (N,)

T is 0, 1 or 2: the gain of a node in dB where there are gains, and its height in m where heights count.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.part import Quantity, part
from wsnsim.base.sensing import GAIN_DB
from wsnsim.kernels import ranging as kernels
from wsnsim.models.bounds import ACCURACY, ELEVATION, LENGTH
from wsnsim.models.node_constants import NAMES, Constants, OfNodes
from wsnsim.models.ranging import FITTED_ON, REACH

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
