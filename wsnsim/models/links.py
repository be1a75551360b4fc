"""Link models and routing: which nodes receive each other with which probability, and the path of datagrams.

    powers(distances, pairs, directions) -> dBm (n,)    reception(powers, bits, interference) -> probability (n,)
    senses(powers) -> bool (n,)                         reach, audible: m

The routing components only name what a path minimises; `network.radio.routing` finds the path. Nodes know these paths
at no cost: they are the reference for `models.workloads`, where nodes send frames to find their routes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Keys
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import Setup
from wsnsim.models.bounds import LENGTH, LEVEL, MOST_DEVIATIONS, truncated_normals
from wsnsim.models.datasheets import Modulation, bit_error, snr_at_sensitivity, snr_for, success

SHORTEST_BITS: Final = 88
"""Bits on the air of the shortest frame, an acknowledgement."""
LEAST_SUCCESS: Final = 1e-3
"""A power at which the shortest frame arrives with a lower probability is not heard at all (our choice)."""
LEAST_DISTURBANCE: Final = 0.1
"""An interferer that raises the noise by a smaller share is neglected (our choice)."""
PER_DECIBEL: Final = math.log(10.0) / 10.0
"""Natural logarithm of the factor that 1 dB stands for."""
SPREAD: Final = Quantity("dB", ge=0.0, le=30.0)


@part
class Disk:
    """Two nodes receive each other within a fixed range, and not beyond it; overlapping frames are both lost.

    Source: Jiang, Song, Lin (2013), table 2 (R_c). `loss` is our addition: each frame is lost independently at each
    receiver.
    """

    captures: ClassVar[bool] = False

    reach: Annotated[float, LENGTH, "R_c: communication range"] = 75.0
    loss: Annotated[float, Quantity("", ge=0, lt=1), "probability that a packet within range does not arrive"] = 0.0

    @property
    def audible(self) -> float:
        """The distance in m beyond which no node hears another: the range."""
        return self.reach

    @property
    def perfect(self) -> bool:
        """Whether every undisturbed packet within range arrives."""
        return self.loss == 0.0

    def powers(self, distances: Floats, pairs: Keys, directions: Keys) -> Floats:
        """(n,) -inf beyond the range, and 0 within it: this model has no powers."""
        return np.where(distances <= self.reach, 0.0, -np.inf)

    def reception(self, powers: Floats, bits: float, interference: Floats | float) -> Floats:
        """(n,) 1 - loss for a frame of any length that is heard undisturbed; else 0."""
        return np.where(np.isfinite(powers) & (np.asarray(interference) <= 0.0), 1.0 - self.loss, 0.0)

    def senses(self, powers: Floats) -> Bools:
        """(n,) whether a node senses the channel busy: it does if it hears anything."""
        return np.isfinite(powers)


@part
class LogNormal:
    """Log-normal shadowing: power falls with the logarithm of the distance, and differs from link to link.

    P = power - loss_at_1m - 10 exponent log10(d / 1 m) + N(0, shadowing²) ± N(0, asymmetry²) / 2, with one sample of
    each per link; the sign of the second differs between the two directions. Distances below 1 m count as 1 m, and both
    normal variables are truncated at three standard deviations (our choices). They are sampled once per run.

    A frame arrives if none of its bits is wrong. The bit error rate is that of the modulation at the ratio of signal to
    noise and interference. The noise follows from the receiver's `sensitivity`, as the standard defines it: 1 % of the
    frames with a PSDU of 20 bytes are lost.

    With `interference: overlap`, overlapping frames are both lost where both are heard. With `sinr`, a receiver locks
    on one frame, and others add to the noise while they overlap it. A frame that is stronger by `capture_margin` takes
    over while the synchronisation header of the first is on the air (capture).

    The channel is busy during a transmission that arrives with `carrier_sense` or more (CCA mode 1 of the standard), or
    that is recognised as a frame because it arrives with the sensitivity or more (mode 2), or in both cases (mode 3).
    Our choice is that a frame is recognised whether or not the radio has heard its beginning.

    A power is heard (otherwise it is -inf) if the shortest frame arrives once in a thousand times, or if the channel is
    sensed busy; with `sinr` also if it raises the noise by a tenth (our choices).

    Source: Zuniga, Krishnamachari (2004), "Analyzing the transitional region in low power wireless links", for path
    loss and reception; IEEE 802.15.4-2006, 6.1.7 (sensitivity), 6.9.9 (CCA modes), annex E.4.1.8 (bit error rate).
    Defaults of the path: Castalia 3's (55 dB at 1 m, 2.4, 4 dB, 1 dB), which also halves the sample of the asymmetry.
    Defaults of the assessment: TI SWRS041 (CC2420), CCA_THR = -32 in register RSSI with an offset of -45 dBm, and
    CCA_MODE = 3 in register MDMCTRL0 (reset value 0x0AE2); of the capture margin: its co-channel rejection, -3 dB.
    """

    power: Annotated[float, LEVEL, "transmit power"] = 0.0
    loss_at_1m: Annotated[float, Quantity("dB", ge=0.0, le=200.0), "path loss at 1 m"] = 55.0
    exponent: Annotated[float, Quantity("", ge=1.0, le=10.0), "path-loss exponent: 2 in free space"] = 2.4
    shadowing: Annotated[float, SPREAD, "standard deviation of the path loss from link to link"] = 4.0
    asymmetry: Annotated[float, SPREAD, "standard deviation of the difference between the two directions of a link"] = (
        1.0
    )
    sensitivity: Annotated[float, LEVEL, "received power at which 1 % of frames of 20 bytes are lost"] = -95.0
    carrier_sense: Annotated[float, LEVEL, "received power from which the channel is busy in CCA modes 1 and 3"] = -77.0
    cca_mode: Annotated[
        int, Quantity("", ge=1, le=3), "what makes the channel busy; 1: power, 2: a frame that is recognised, 3: either"
    ] = 3
    interference: Annotated[Literal["overlap", "sinr"], "effect of overlapping frames on each other"] = "overlap"
    capture_margin: Annotated[
        float, Quantity("dB", ge=0.0, le=60.0), "with `sinr`: how much stronger a later frame must be to take over"
    ] = 3.0
    modulation: Annotated[Modulation, "oqpsk: IEEE 802.15.4 at 2.4 GHz; ncfsk: non-coherent FSK"] = "oqpsk"
    fitted_on: Annotated[
        tuple[str, ...], "digests of the recorded links that the values were fitted to, as `wsnsim fit` writes them"
    ] = ()

    perfect: ClassVar[bool] = False

    @property
    def captures(self) -> bool:
        """Whether a frame may survive another that overlaps it."""
        return self.interference == "sinr"

    @property
    def reach(self) -> float:
        """The distance in m at which the mean power meets the sensitivity."""
        return self._distance(self.sensitivity)

    @property
    def audible(self) -> float:
        """The distance in m beyond which no node hears another, even over the strongest link."""
        return self._distance(self.floor - MOST_DEVIATIONS * (self.shadowing + self.asymmetry / 2.0))

    @cached_property
    def noise(self) -> float:
        """The noise of the receiver in mW, which follows from its sensitivity."""
        return float(10.0 ** (self.sensitivity / 10.0)) / snr_at_sensitivity(self.modulation)

    @cached_property
    def floor(self) -> float:
        """The power in dBm below which a frame is neither received nor sensed."""
        least = self.noise * snr_for(LEAST_SUCCESS, SHORTEST_BITS, self.modulation)
        if self.captures:
            least = min(least, self.noise * LEAST_DISTURBANCE)
        return min(10.0 * float(np.log10(least)), self._busy_from)

    def powers(self, distances: Floats, pairs: Keys, directions: Keys) -> Floats:
        """(n,) received power in dBm over links of these lengths; -inf where it is below the floor."""
        powers = self._mean(np.maximum(distances, 1.0))
        if self.shadowing:
            powers += self.shadowing * truncated_normals(pairs)
        if self.asymmetry:
            powers += self.asymmetry * _antisymmetric_halves(directions)
        return np.where(powers >= self.floor, powers, -np.inf)

    def reception(self, powers: Floats, bits: float, interference: Floats | float) -> Floats:
        """(n,) probability that a frame of this length on the air arrives; `interference` in mW."""
        disturbed = np.asarray(interference)
        ratio = np.exp(np.asarray(powers) * PER_DECIBEL) / (self.noise + disturbed)
        arrives = success(bit_error(ratio, self.modulation), bits)
        heard = ratio > 0.0 if self.captures else (ratio > 0.0) & (disturbed <= 0.0)
        return np.where(heard, arrives, 0.0)

    def senses(self, powers: Floats) -> Bools:
        """(n,) whether a node that receives these powers senses the channel busy."""
        return np.asarray(powers) >= self._busy_from

    @property
    def _busy_from(self) -> float:
        """The received power in dBm from which the channel is busy."""
        thresholds = {1: self.carrier_sense, 2: self.sensitivity}
        return thresholds.get(self.cca_mode, min(self.carrier_sense, self.sensitivity))

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if the mean power at 1 m is below the sensitivity."""
        if self.reach < 1.0:
            yield Issue(
                ("link", "power"),
                f"{self.power:g} dBm arrives with {float(self._mean(np.ones(1))[0]):g} dBm at 1 m, which is below "
                f"link.sensitivity = {self.sensitivity:g} dBm: no node receives another",
            )

    def _mean(self, distances: Floats) -> Floats:
        return self.power - self.loss_at_1m - 10.0 * self.exponent * np.log10(distances)

    def _distance(self, level: float) -> float:
        """The distance in m at which the mean power is `level` dBm."""
        return float(10.0 ** ((self.power - self.loss_at_1m - level) / (10.0 * self.exponent)))


@part
class MinimumEnergy:
    """Send along the path with the least energy for sending and receiving (our choice: the paper names none).

    A destination in range is reached over several hops if these cost less. A head and the members of its cluster that
    are in range of it always use one hop.
    """

    weight: ClassVar[str] = "energy"


@part
class MinimumHop:
    """Send along the path with the fewest hops: one to a destination in range."""

    weight: ClassVar[str] = "hop"


@part
class GreedyGeographic:
    """Relay to the neighbour nearest to the destination; a datagram is lost if none is nearer than the node itself.

    It needs no map of the network. Source: Karp, Kung (2000), "GPSR: greedy perimeter stateless routing for wireless
    networks", greedy mode. The perimeter mode, which leads around voids, is not implemented.
    """

    weight: ClassVar[str] = "greedy"


def _antisymmetric_halves(directions: Keys) -> Floats:
    """(n,) halves of standard normal numbers, with opposite signs for the two directions of a link.

    The keys of the two directions of a link are complements of each other.
    """
    others = ~directions
    halves = 0.5 * truncated_normals(np.minimum(directions, others))
    return np.where(directions < others, halves, -halves)
