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

CLASSES: Final = 16
"""Distances with which a reading is compared."""


class Election:
    """One election. `closed` fires with the winner or None once every candidate has broadcast, withdrew or is down.

    An idealisation: the strongest of all candidates wins, even if it did not hear all others, and all nodes know it
    at once.
    `strengths` are the candidates' readings of `step`.
    """

    def __init__(
        self,
        closed: simpy.Event,
        step: int,
        strengths: Mapping[int, Reading],
        policy: ClusterPolicy,
        sensor: SensorModel,
    ) -> None:
        self.closed = closed
        self.step = step
        self.strengths = strengths
        self._policy = policy
        self._sensor = sensor
        self._pending = set(strengths)
        self._heard: dict[int, Mapping[int, Bools]] = {}
        self._overdue = False

    def report(self, node: int, heard: Mapping[int, Bools]) -> None:
        """Note that a candidate's broadcast has ended, and who heard it; withdrawn candidates are ignored."""
        if node not in self._pending:
            return
        self._heard[node] = heard
        self._end(node)

    def withdraw(self, node: int) -> None:
        """Remove a candidate that went down, before or after its broadcast, or that keeps silent."""
        self._heard.pop(node, None)
        self._end(node)

    def is_outbid(self, node: int) -> bool:
        """Whether a candidate has heard one whose reading is at least as strong."""
        own = strength_of(self._sensor, self.strengths[node])
        return any(
            node in heard and strength_of(self._sensor, self.strengths[other]) >= own
            for other, heard in self._heard.items()
        )

    def close(self) -> None:
        """Wait for no further broadcast, unless none has ended yet: then the first one decides."""
        self._overdue = True
        self._close_if_decided()

    def _end(self, node: int) -> None:
        self._pending.discard(node)
        self._close_if_decided()

    def _close_if_decided(self) -> None:
        if not (self._pending and not (self._overdue and self._heard)) and not self.closed.triggered:
            ids = sorted(self._heard)
            strengths = [strength_of(self._sensor, self.strengths[i]) for i in ids]
            self.closed.succeed(self._policy.elect(ids, strengths, [True] * len(ids)) if ids else None)

    def readings_at(self, node: int) -> dict[int, Reading]:
        """{candidate: reading} that a candidate knows after the election."""
        return {i: self.strengths[i] for i, heard in sorted(self._heard.items()) if i == node or node in heard}


def strength_of(sensor: SensorModel, reading: Reading) -> float:
    """How near a reading says the target is; most sensors read more where it is nearer."""
    if isinstance(sensor, Ranks):
        return sensor.strength(reading)
    assert not isinstance(reading, tuple), "a sensor model whose readings have several components ranks them"
    return reading


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
