"""One election: candidates broadcast the strength of their readings, and the strongest becomes cluster head.

Where a broadcast takes long, the nearer a candidate is to the target, the earlier it broadcasts. The strongest reading
is then broadcast among the first, and those who hear it keep silent. Source of the idea: Chen,
Hou, Sha (2004), "Dynamic clustering for acoustic target tracking in wireless sensor networks", IEEE Trans. Mobile
Computing 3(3), doi:10.1109/TMC.2004.22, whose heads volunteer after a delay that depends on their place.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Floats, Reading
from wsnsim.base.network_ports import ClusterPolicy
from wsnsim.base.optional_ports import Ranks
from wsnsim.base.ports import SensorModel

DISTANCE_CLASSES: Final = 16
"""Number of distances within the sensing range whose expected readings a reading is compared with."""


class Election:
    """One election among the candidates of `readings`, which maps each to its reading of `step`.

    `closed` fires once every candidate has broadcast, withdrawn or gone down; its value is the winner, or None.
    An idealisation: the strongest of all candidates wins, even if it did not hear all others, and all nodes know it
    at once.
    """

    def __init__(
        self,
        closed: simpy.Event,
        step: int,
        readings: Mapping[int, Reading],
        policy: ClusterPolicy,
        sensor: SensorModel,
    ) -> None:
        self.closed = closed
        self.step = step
        self.readings = readings
        self._policy = policy
        self._sensor = sensor
        self._pending = set(readings)
        self._heard: dict[int, Mapping[int, Bools]] = {}
        self._overdue = False

    def report(self, node: int, heard: Mapping[int, Bools]) -> None:
        """Note that a candidate's broadcast has ended, and who heard it; withdrawn candidates are ignored."""
        if node not in self._pending:
            return
        self._heard[node] = heard
        self._remove_pending(node)

    def withdraw(self, node: int) -> None:
        """Remove a candidate that went down, before or after its broadcast, or that keeps silent."""
        self._heard.pop(node, None)
        self._remove_pending(node)

    def is_outbid(self, node: int) -> bool:
        """Whether a candidate has heard one whose reading is at least as strong."""
        own = strength_of(self._sensor, self.readings[node])
        return any(
            node in heard and strength_of(self._sensor, self.readings[other]) >= own
            for other, heard in self._heard.items()
        )

    def close(self) -> None:
        """End the election now, without the pending candidates; if none has broadcast yet, when the first one has."""
        self._overdue = True
        self._end_if_decided()

    def _remove_pending(self, node: int) -> None:
        self._pending.discard(node)
        self._end_if_decided()

    def _end_if_decided(self) -> None:
        decided = not self._pending or (self._overdue and self._heard)
        if decided and not self.closed.triggered:
            ids = sorted(self._heard)
            strengths = [strength_of(self._sensor, self.readings[i]) for i in ids]
            self.closed.succeed(self._policy.elect(ids, strengths, [True] * len(ids)) if ids else None)

    def readings_at(self, node: int) -> dict[int, Reading]:
        """{candidate: reading} that a candidate knows after the election."""
        return {i: self.readings[i] for i, heard in sorted(self._heard.items()) if i == node or node in heard}


def strength_of(sensor: SensorModel, reading: Reading) -> float:
    """The strength of a reading, greater for a nearer target; for most sensors it is the reading itself."""
    if isinstance(sensor, Ranks):
        return sensor.strength(reading)
    assert not isinstance(reading, tuple), "a sensor model whose readings have several components ranks them"
    return reading


def waiting_share(sensor: SensorModel, columns: int, traits: Floats, reading: Reading, chance: float) -> float:
    """The share of the election's time that a candidate waits: its distance from the target over the sensing range.

    The distance is that at which the expected reading is as strong as the candidate's, in DISTANCE_CLASSES classes.
    `chance` orders the candidates of one class, and all candidates if readings do not depend on the distance.

    Args:
        sensor: the sensor model that nodes assume.
        columns: the number of coordinates of a position.
        traits: (T,) constants of the candidate's sensor.
        reading: what the candidate measured.
        chance: a uniform random number of the candidate, in [0, 1).
    """
    points = np.zeros((columns, DISTANCE_CLASSES))
    points[0] = (np.arange(DISTANCE_CLASSES) + 0.5) * (sensor.reach / DISTANCE_CLASSES)
    means = sensor.linearise(points, np.zeros((1, 2)), traits[None])[0]
    strengths = [strength_of(sensor, tuple(each) if len(each) > 1 else each[0]) for each in means.T.tolist()]
    if min(strengths) == max(strengths):
        return chance
    own = strength_of(sensor, reading)
    nearer = sum([each > own for each in strengths])
    return (nearer + chance) / (DISTANCE_CLASSES + 1)
