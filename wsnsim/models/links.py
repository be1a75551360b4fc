"""Who hears whom, when a frame gets the channel, and which path a relayed message takes.

    arrivals(distance, packets, key) -> (packets,) bool

Channel access and routing are performed by the network room; their parts carry the name of the mechanism and its
parameters.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.arrays import Bools
from wsnsim.base.asks import all_arrived
from wsnsim.base.part import Quantity, part
from wsnsim.base.rng import derive_all, uniforms
from wsnsim.models.bounds import LENGTH


@part
class Disk:
    """Two nodes hear each other within a fixed reach, and not beyond.

    Source: Jiang, Song, Lin (2013), table 2 (R_c). `loss` is our addition: each packet of a burst is lost
    independently.
    """

    reach: Annotated[float, LENGTH, "R_c: nominal range of a link"] = 75.0
    loss: Annotated[float, Quantity("", ge=0, lt=1), "probability that a packet within reach does not arrive"] = 0.0

    def arrivals(self, distance: float, packets: int, key: int) -> Bools:
        """(packets,) which packets of a burst arrive over `distance` m; `key` seeds the frame's own draws."""
        if distance > self.reach:
            return np.zeros(packets, dtype=np.bool_)
        if self.perfect:
            return all_arrived(packets)
        return uniforms(derive_all(key, np.arange(packets)), 0) >= self.loss

    @property
    def perfect(self) -> bool:
        """Whether every packet within reach arrives."""
        return self.loss == 0.0


@part
class IdealMac:
    """No contention and no collisions: a frame is delivered within the instant, or after its airtime if `rate` is set.

    The world of Jiang, Song, Lin (2013), where only the payload's bits cost energy.
    """

    mechanism: ClassVar[str] = "ideal"

    rate: Annotated[float | None, Quantity("bit/s", ge=1e-3), "of the air; left out: no time passes"] = None


@part
class MinimumEnergy:
    """Relay along the path that costs the fewest joules to send and to receive (our choice: the paper names none)."""

    weight: ClassVar[str] = "energy"


@part
class MinimumHop:
    """Relay along the path with the fewest hops."""

    weight: ClassVar[str] = "hop"
