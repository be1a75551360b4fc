"""Functions for filters over a Markov chain of sensors: its sensors, their measurements, and the handover.

The sensors of the chain are the nodes that sense (`scene.ids`). In Liu and Wang (2012) all of them sense at every step.
How sensors that join or leave, and lost packets, are treated is our choice; the docstrings say how.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.ports import Scene, SensorModel
from wsnsim.base.requests import Flow
from wsnsim.trackers.shared.parcels import weight_packets
from wsnsim.trackers.shared.readings import gather_readings

Linear: TypeAlias = tuple[Floats, Floats, Floats]
"""Expected readings, their gradients and their variances, as `linearised` gives them."""
LIKELIHOOD_CYCLES = 30.0
"""CPU cycles to linearise one reading and to compute its log-likelihood."""


def chain_readings(scene: Scene) -> Flow[Floats]:
    """Readings (n,) of the sensors `scene.ids`: one packet per member, NaN for a lost one."""
    seen = yield from gather_readings(scene)
    if seen.ids == scene.ids:
        return seen.readings
    arrived = dict(zip(seen.ids, seen.readings.tolist(), strict=True))
    return np.array([arrived.get(node, np.nan) for node in scene.ids], dtype=np.float64)


def linearised(points: Floats, sensor: SensorModel, positions: Floats, traits: Floats) -> Linear:
    """The sensor model at points (P, N) for n sensors: expected (n, N), gradients (n, P, N), variances (n, N)."""
    expected, gradients, variances = sensor.linearise(points, positions, traits)
    return np.ascontiguousarray(expected), np.ascontiguousarray(gradients), np.ascontiguousarray(variances)


def carried(ids: tuple[int, ...], probabilities: Floats, now: tuple[int, ...]) -> Floats:
    """Carry the probabilities of the last step over to the sensors (n,) that sense `now`, before the Markov step.

    A sensor that joins gets probability 0. One that no longer senses is removed, and the others are renormalised, or
    made equal if they are all zero. If no sensor remains, as at the start, all probabilities are equal.
    """
    if ids == now or not now:
        return probabilities if ids == now else np.empty(0)
    before = dict(zip(ids, probabilities.tolist(), strict=True))
    result = np.array([before.get(node, 0.0) for node in now])
    total = float(result.sum())
    if total > 0.0:
        return result / total
    stayed = np.array([node in before for node in now], dtype=np.float64)
    return stayed / stayed.sum() if stayed.any() else np.full(len(now), 1.0 / len(now))


def stay_after(stay: float, sensors: int, steps: int) -> float:
    """The probability of staying after several steps: the diagonal of Mˢ, whose other entries are equal again.

    M = c I + (1 - c) 1 1ᵀ / n with c = stay - (1 - stay) / (n - 1), so that Mˢ has cˢ instead of c.
    """
    if sensors < 2:
        return 1.0
    if steps == 1:
        return stay
    kept = (stay - (1.0 - stay) / (sensors - 1)) ** steps
    return kept + (1.0 - kept) / sensors


def arrived_probabilities(probabilities: Floats, mask: Bools) -> Floats:
    """The probabilities (n,) after a transfer of four per packet: lost ones share the rest of the sum of 1 equally."""
    known = np.repeat(mask[: weight_packets(probabilities.size)], 4)[: probabilities.size]
    if known.all():
        return probabilities
    missing = max(1.0 - float(probabilities[known].sum()), 0.0)
    return np.where(known, probabilities, missing / np.count_nonzero(~known))
