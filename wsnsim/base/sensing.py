"""Sensors of nodes: gains, detection, the information in readings, and shadowing along the path of a target."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, planar
from wsnsim.base.optional_ports import IsShadowed
from wsnsim.base.ports import Detection, SensorModel
from wsnsim.base.rng import derive_all, derive_each, normals

GAIN: Final = "gain"
"""A factor of a sensor's readings, or of the signal in them."""
GAIN_DB: Final = "gain_db"
"""What is added to a sensor's readings of received power, in dB."""
BIAS: Final = "bias"
"""What is added to a sensor's readings of a distance, in m."""
HEIGHT: Final = "height"
"""The height of a node in m, which the deployment gives (`HasHeights`)."""


def gain_factors(names: tuple[str, ...], traits: Floats) -> Floats:
    """(N,) the gain of each node as a factor, from traits (N, T): 1 where sensors have none, 10^(g/10) for g in dB."""
    if GAIN in names:
        return traits[:, names.index(GAIN)]
    if GAIN_DB in names:
        return 10.0 ** (traits[:, names.index(GAIN_DB)] / 10.0)
    return np.ones(len(traits))


def recorded_traits(law: Any, nodes: int, rng: np.random.Generator) -> Floats:
    """(nodes, T) the traits of nodes whose readings were recorded: those of the law, without the gains that it samples.

    The true gains are unknown, and samples would not be theirs: they are set to 1 or 0 dB, which filters assume of
    unknown gains.
    """
    traits: Floats = law.draw_traits(nodes, rng)
    if samples_gains(law):
        column = gain_column(law.trait_names)
        traits = traits.copy()
        traits[:, column] = 1.0 if law.trait_names[column] == GAIN else 0.0
    return traits


def samples_gains(sensor: Any) -> bool:
    """Whether a sensor model samples gains that differ from node to node, instead of listing them."""
    return has_gains(sensor) and not any(getattr(sensor, key, ()) for key in ("gains", "biases"))


def has_gains(sensor: Any) -> bool:
    """Whether the nodes of a sensor model differ in gain, which a filter may not know."""
    return gain_column(sensor.trait_names) is not None and gain_variance(sensor) > 0.0


def may_have_gains(sensor: Any) -> bool:
    """Whether the nodes of a sensor model differ in gain, or would if its spread were not 0."""
    return gain_column(sensor.trait_names) is not None or hasattr(sensor, "gain_spread")


def gain_variance(sensor: Any) -> float:
    """The variance of the gains, in the square of their unit; 0 if the sensor model does not say."""
    return getattr(sensor, "gain_variance", 0.0)


def gain_column(names: tuple[str, ...]) -> int | None:
    """The column of the gain, or of what is added, among a sensor's traits; None if sensors have none."""
    return next((column for column, name in enumerate(names) if name in (GAIN, GAIN_DB, BIAS)), None)


def is_perfect(detection: Detection) -> bool:
    """Whether all readings are reported as they are taken."""
    probe = np.ones(1)  # a model without errors returns the very array that it gets
    return detection.missed == detection.false_alarm == 0 and (
        detection.distort(probe, np.zeros(1, dtype=np.uint64)) is probe
    )


def detected(sensor: Any, points: Floats, positions: Floats) -> Bools:
    """(n, S) whether a target at each of the points (n, P) gives a reading at each of the sensors (S, 2).

    Without the port `Detects`, those in sensing range have a reading.
    """
    detects = getattr(sensor, "detects", None)  # isinstance() with a protocol would take longer than the detection
    if detects is not None:
        found: Bools = detects(points, positions)
        return found
    squared = ((planar(points)[:, None, :] - positions) ** 2).sum(axis=2)
    within: Bools = squared <= sensor.reach**2
    return within


def informations(sensor: Any, points: Floats, positions: Floats, traits: Floats) -> Floats:
    """(S, P, P, n) Fisher information about the position in a reading of each sensor, at points (P, n).

    The variance's dependence on the position is included where the sensor model states it (port `Informs`). The
    components of a reading are independent. It is that of a reading, whether a sensor has one or not: see `detected`.
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


SHADOWING_COUNTER: Final = 3
"""The random number of the key of (target, step, node) that shadowing uses; noise and detection use lower ones."""


class PathShadowing:
    """What shadowing adds to the readings of one target: a Gauss-Markov process per node along the target's path.

    Its variance is σ², and the correlation of two steps exp(-d/δ), with the length d of the path between them. It does
    not change while the target rests. A target that returns to a place does not find the same shadowing there: this is
    a process, not a map. The samples of a node are a function of (key, step, node): they depend neither on other nodes
    nor on which nodes are awake. At instants between steps, it is interpolated linearly (our choice).

    Source: Gudmundson (1991), whose correlation is a power of the distance; the rest is our choice.

    Args:
        sensor: σ and δ.
        points: (T, P) position of the target at each instant; every `instants`-th is a step.
        key: `derive(streams.key("sense"), target)`.
        instants: how many instants a step has.
    """

    def __init__(self, sensor: IsShadowed, points: Floats, key: int, instants: int = 1) -> None:
        steps = points[::instants]
        moved = np.linalg.norm(np.diff(steps, axis=0), axis=1) / sensor.decorrelation
        self._correlations, self._new_shares = np.exp(-moved), np.sqrt(-np.expm1(-2.0 * moved))
        self._sd, self._instants = sensor.shadowing, instants
        self._keys = derive_all(key, np.arange(len(steps)))
        self._columns: dict[int, int] = {}
        self._values = np.empty((len(steps), 0))

    def at(self, instants: Ints, nodes: Ints) -> Floats:
        """(n,) what is added to the reading of each node at each instant, both (n,)."""
        self._extend(nodes)
        columns = np.array([self._columns[node] for node in nodes.tolist()], dtype=np.int64)
        steps, offsets = np.divmod(instants, self._instants)
        now: Floats = self._values[steps, columns]
        if self._instants == 1:
            return now
        share, later = offsets / self._instants, np.minimum(steps + 1, len(self._values) - 1)
        between: Floats = now + share * (self._values[later, columns] - now)
        return between

    def _extend(self, nodes: Ints) -> None:
        """Compute the process of nodes for which `at` was not called yet."""
        new = [node for node in np.unique(nodes).tolist() if node not in self._columns]
        if not new:
            return
        keys = derive_each(self._keys[:, None], np.array(new, dtype=np.uint64)[None, :])
        values = self._sd * normals(keys, SHADOWING_COUNTER)
        for step in range(1, len(values)):
            values[step] = self._correlations[step - 1] * values[step - 1] + self._new_shares[step - 1] * values[step]
        self._columns.update({node: len(self._columns) + place for place, node in enumerate(new)})
        self._values = np.concatenate([self._values, values], axis=1)


def path_shadowing(sensor: SensorModel, points: Floats, key: int, instants: int = 1) -> PathShadowing | None:
    """The shadowing of a target's readings; None if the sensor model has none. Arguments as of `PathShadowing`."""
    if not isinstance(sensor, IsShadowed) or not sensor.shadowing:
        return None
    return PathShadowing(sensor, points, key, instants)
