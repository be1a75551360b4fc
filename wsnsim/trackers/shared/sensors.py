"""Functions for filters over a Markov chain of sensors: its sensors, their measurements, and the handover.

The sensors of the chain are those who sense (`scene.ids`). Liu and Wang (2012) have all of them at every step; what
happens where they come and go, and where packets are lost, is our choice, and is said here.
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Flow
from wsnsim.trackers.shared.parcels import weight_packets
from wsnsim.trackers.shared.readings import gather_readings

LIKELIHOOD_CYCLES = 30.0
"""To linearise one reading and to take the log of its likelihood."""


def chain_readings(scene: Scene) -> Flow[Floats]:
    """Readings (n,) of the sensors `scene.ids`: one packet a member, NaN for a lost one."""
    seen = yield from gather_readings(scene)
    if seen.ids == scene.ids:
        return seen.readings
    arrived = dict(zip(seen.ids, seen.readings.tolist(), strict=True))
    return np.array([arrived.get(node, np.nan) for node in scene.ids], dtype=np.float64)


def linearised(points: Floats, scene: Scene) -> tuple[Floats, Floats, Floats]:
    """The sensors `scene.ids` at points (P, N): expected (n, N), gradients (n, P, N), variances (n, N), contiguous."""
    expected, gradients, variances = scene.sensor.linearise(points, scene.positions, scene.traits)
    return np.ascontiguousarray(expected), np.ascontiguousarray(gradients), np.ascontiguousarray(variances)


def relayed(ids: tuple[int, ...], probabilities: Floats, now: tuple[int, ...]) -> Floats:
    """The probabilities (n,) of the sensors that sense `now`, before the Markov step, from those of the last step.

    One that joins enters with probability 0. One that no longer senses drops out and the rest are renormalised: to
    equal ones if all of theirs are zero. Where nobody stays, as at the start, all are equal.
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


def stay_over(stay: float, sensors: int, steps: int) -> float:
    """The diagonal of the Markov matrix of several steps, whose other entries are again all the same.

    M = c I + (1 - c) 1 1ᵀ / n with c = stay - (1 - stay) / (n - 1), so that Mˢ has cˢ in the place of c.
    """
    if sensors < 2:
        return 1.0
    if steps == 1:
        return stay
    kept = (stay - (1.0 - stay) / (sensors - 1)) ** steps
    return kept + (1.0 - kept) / sensors


def arrived_probabilities(probabilities: Floats, mask: Bools) -> Floats:
    """Probabilities (n,) of which four are in a packet: the lost ones share equally what is missing to one."""
    known = np.repeat(mask[: weight_packets(probabilities.size)], 4)[: probabilities.size]
    if known.all():
        return probabilities
    missing = max(1.0 - float(probabilities[known].sum()), 0.0)
    return np.where(known, probabilities, missing / np.count_nonzero(~known))
