"""What readings tell about a target's position, for cluster policies and trackers alike.

fisher_information(sensor, points (P, K), positions (n, 2), traits (n, T)) -> (n, P, P, K)
"""

from __future__ import annotations

from typing import Any

from wsnsim.base.arrays import Floats


def fisher_information(sensor: Any, points: Floats, positions: Floats, traits: Floats) -> Floats:
    """(n, P, P, K) Fisher information about the position in one reading of each of n nodes, at points (P, K).

    The dependence of a variance on the position is included where the sensor model says it (`Informs`). Otherwise a
    component tells g gᵀ / R, and the components of a reading are independent.
    """
    if hasattr(sensor, "information"):  # the port `Informs`: to check a protocol takes longer than to compute
        told: Floats = sensor.information(points, positions, traits)
        return told
    _, slopes, variances = sensor.linearise(points, positions, traits)
    each = slopes[:, :, None] * slopes[:, None, :] / variances[:, None, None]
    rows: Floats = each.reshape(len(positions), -1, *each.shape[1:]).sum(axis=1)
    return rows
