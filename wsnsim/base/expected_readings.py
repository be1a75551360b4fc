"""Readings that have not been taken: which nodes would have one, and the Fisher information in it.

    detected(sensor, points (n, P), positions (S, 2)) -> (n, S)
    informations(sensor, points (P, n), positions, traits) -> (S, P, P, n)

A head uses them to choose among nodes, by its map and its prediction.
"""

from __future__ import annotations

from typing import Any

from wsnsim.base.arrays import Bools, Floats, planar


def detected(sensor: Any, points: Floats, positions: Floats) -> Bools:
    """(n, S) whether a target at each of the points (n, P) gives a reading at each of the sensors (S, 2).

    Without the port `Detects`, those in sensing range have a reading.
    """
    detects = getattr(sensor, "detects", None)  # to check a protocol takes longer than to detect
    if detects is not None:
        found: Bools = detects(points, positions)
        return found
    squared = ((planar(points)[:, None, :] - positions) ** 2).sum(axis=2)
    within: Bools = squared <= sensor.reach**2
    return within


def informations(sensor: Any, points: Floats, positions: Floats, traits: Floats) -> Floats:
    """(S, P, P, n) Fisher information about the position in a reading of each sensor, at points (P, n).

    The variance's dependence on the position is included where the sensor model states it (port `Informs`). The
    components of a reading are independent. Whether a sensor has a reading is not asked: see `detected`.
    """
    information = getattr(sensor, "information", None)
    if information is not None:
        stated: Floats = information(points, positions, traits)
        return stated
    _, gradients, variances = sensor.linearise(points, positions, traits)
    each: Floats = gradients[:, :, None] * gradients[:, None, :] / variances[:, None, None]
    if len(each) == len(positions):
        return each
    summed: Floats = each.reshape(len(positions), -1, *each.shape[1:]).sum(axis=1)
    return summed
