"""When the candidates of an election broadcast, where a broadcast takes long: the nearer the target, the earlier.

The strongest reading is then broadcast among the first, and those who hear it keep silent. Source of the idea: Chen,
Hou, Sha (2004), "Dynamic clustering for acoustic target tracking in wireless sensor networks", IEEE Trans. Mobile
Computing 3(3), doi:10.1109/TMC.2004.22, whose heads volunteer after a delay that depends on their place.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import SensorModel
from wsnsim.base.vector_readings import Reading
from wsnsim.network.clusters.election import strength_of

CLASSES: Final = 16
"""Distances with which a reading is compared."""


def waiting_share(sensor: SensorModel, columns: int, traits: Floats, reading: Reading, chance: float) -> float:
    """The share of the election's time that a candidate waits: its distance from the target over the sensing range.

    The distance is the one at which the expected reading is as strong. Candidates of one class of distances wait by
    chance, and so do all where readings say nothing about the distance.

    Args:
        sensor: the sensor model that nodes assume.
        columns: the number of columns of a position.
        traits: (T,) constants of the candidate's sensor.
        reading: what the candidate measured.
        chance: a uniform random number of the candidate, in [0, 1).
    """
    points = np.zeros((columns, CLASSES))
    points[0] = (np.arange(CLASSES) + 0.5) * (sensor.reach / CLASSES)
    means = sensor.linearise(points, np.zeros((1, 2)), traits[None])[0]
    strengths = [strength_of(sensor, tuple(each) if len(each) > 1 else each[0]) for each in means.T.tolist()]
    if min(strengths) == max(strengths):
        return chance
    own = strength_of(sensor, reading)
    nearer = sum([each > own for each in strengths])
    return (nearer + chance) / (CLASSES + 1)
