"""Packets of 12 bytes: the number that a payload needs, and the part of it that arrived (Jiang 2013, section 5).

A packet is 4 bytes of header and 8 of payload: four int16 of a state or of weights, or eight replication counts, or one
reading. What is quantised is counted in bits; the values themselves are passed on unrounded.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.requests import PACKET_BITS, Parcel, all_arrived

PARTICLES: Final = "particles"
MOMENTS: Final = "moments"
UNKNOWN: Final = float("nan")
"""The log-weight of a particle that arrived without its weight."""


def parcel(payload: Any, packets: int, what: str) -> Parcel:
    """A parcel of 12-byte packets.

    Args:
        payload: What it carries.
        packets: The number of packets.
        what: Its name in the event log.
    """
    return Parcel(payload, packets, PACKET_BITS, what)


def state_packets(columns: int) -> int:
    """The number of packets of one state: four numbers each.

    Args:
        columns: D, the number of state columns.
    """
    return -(-columns // 4)


def weight_packets(count: int) -> int:
    """Packets of `count` weights: four each."""
    return -(-count // 4)


def count_packets(count: int) -> int:
    """Packets of `count` replication counts: eight each."""
    return -(-count // 8)


def covariance_packets(columns: int) -> int:
    """Packets of a symmetric matrix: its lower triangle, four numbers each."""
    return -(-columns * (columns + 1) // 8)


def moment_packets(columns: int) -> int:
    """The number of packets of a mean and its covariance: four numbers each, of the covariance the lower triangle.

    Args:
        columns: D, the number of state columns.
    """
    return state_packets(columns) + covariance_packets(columns)


def particles_parcel(cloud: Floats, log_weights: Floats | float) -> Parcel:
    """Particles (D, n), then their weights (n,): n state packets and ceil(n / 4).

    One common weight rides in the header of the first packet (our choice): n state packets alone.
    """
    columns, count = cloud.shape
    packets = count * state_packets(columns) + (weight_packets(count) if isinstance(log_weights, np.ndarray) else 0)
    return parcel((cloud, log_weights), packets, PARTICLES)


def arrived_particles(sent: tuple[Floats, Floats | float], mask: Bools) -> tuple[Floats, Floats]:
    """Of the payload of a `particles_parcel`: the particles (D, m) whose packets arrived, and their log-weights (m,).

    `mask` begins with the parcel's packets. A weight whose packet is lost is UNKNOWN.
    """
    cloud, log_weights = sent
    columns, count = cloud.shape
    if is_whole(mask):
        return cloud, log_weights if isinstance(log_weights, np.ndarray) else np.full(count, log_weights)
    whole = arrived_groups(mask, count, state_packets(columns))
    if not isinstance(log_weights, np.ndarray):
        log_weights = np.full(count, log_weights)
    else:
        at = count * state_packets(columns)
        known = np.repeat(mask[at : at + weight_packets(count)], 4)[:count]
        log_weights = np.where(known, log_weights, UNKNOWN)
    return np.ascontiguousarray(cloud[:, whole]), log_weights[whole]


def is_whole(mask: Bools) -> bool:
    """Whether all packets arrived. Complete deliveries share their masks, which makes this case fast."""
    return mask is all_arrived(mask.size) or bool(mask.all())


def arrived_groups(mask: Bools, count: int, packets: int) -> Bools:
    """(count,) which of the first `count` things in a burst arrived, each of them in `packets` packets."""
    whole: Bools = np.all(mask[: count * packets].reshape(count, packets), axis=1)
    return whole


def guessed(log_weights: Floats) -> Floats:
    """The log-weights with each UNKNOWN one replaced by the mean of the others, or by weight one if none is known."""
    lost = np.isnan(log_weights)
    if not lost.any():
        return log_weights
    return np.where(lost, log_mean(log_weights[~lost]), log_weights)


def log_mean(log_weights: Floats) -> float:
    """The log of the mean weight; 0 where there is none, or nothing has weight."""
    top = log_weights.max() if log_weights.size else -np.inf
    if not np.isfinite(top):
        return 0.0
    return float(top + np.log(np.mean(np.exp(log_weights - top))))
