"""Fisher information of readings about a target's position, which nodes have one, and recursions for the least error.

    in_range(sensor, points, positions) -> UsedReadings
    information(sensor, points, positions, traits, used) -> (T, P, P)

The information is evaluated at the ground truth with the true sensor model, and includes what a state-dependent
variance contributes (see `base.ports.Informs`). Whether a node has a reading at all also depends on the target's
position. This is not counted: the bound is for filters that use the values of readings only.

    RecordedReadings(path, setup).used(replicate, target, readings) -> UsedReadings

`active`: the readings of the active members of the cluster, as many as `estimates.active` says.
`arrived`: the readings that the head had when it computed the estimate. If more readings than these entered the
computation (`estimates.readings`), the members computed themselves, and the readings of all active members count; at a
track initiation, those of all nodes that sensed. So the tracker never used more than what counts here.

The least error covariance of a state follows step by step:

    P⁻ = Q + F P Fᵀ        P = (P⁻⁻¹ + I)⁻¹                                            along one trajectory
    P⁻ = Q + F̄ (P⁻¹ + V)⁻¹ F̄ᵀ,  V = E[(F - F̄)ᵀ Q⁻¹ (F - F̄)],  I = E[information]      over all trajectories

The second is the recursion of Tichavský, Muravchik, Nehorai (1998), eq. 21: with their D11 = E[Fᵀ Q⁻¹ F] and
D12 = -E[F]ᵀ Q⁻¹, the matrix inversion lemma takes J = D22 - D12ᵀ (J + D11)⁻¹ D12 to this form, in which neither the
process noise Q nor the information has to be inverted: both may be singular.

Shapes: R trajectories, T steps, D state columns, P of them (`place`) the position. Information is (..., P, P).
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, is_relative, planar
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.optional_ports import Detects, Informs
from wsnsim.base.ports import SensorModel
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.base.tables import KIND
from wsnsim.recording import meanings, read_table

STEPS_PER_BLOCK = 25
"""Steps computed together: a target meets nearly the same nodes within them (our choice)."""


class UsedReadings(NamedTuple):
    """The readings that count, as pairs of a step and a node.

    Attributes:
        steps: (n,) in ascending order.
        nodes: (n,) node numbers.
    """

    steps: Ints
    nodes: Ints


def in_range(sensor: SensorModel, points: Floats, positions: Floats) -> UsedReadings:
    """The readings of all nodes that detect a target.

    Args:
        sensor: the sensor model.
        points: (T, P) the target's position at each step; NaN where it is absent.
        positions: (N, 2) of the nodes.
    """
    present = np.flatnonzero(np.isfinite(points[:, 0]))
    steps, nodes = CellGrid(positions).within_each(planar(points[present]), sensor.reach)
    if isinstance(sensor, Detects):
        candidates = np.unique(nodes)
        steps, rows = np.nonzero(sensor.detects(points[present], positions[candidates]))
        nodes = candidates[rows]
    return UsedReadings(present[steps], nodes)


def information(sensor: SensorModel, points: Floats, positions: Floats, traits: Floats, used: UsedReadings) -> Floats:
    """The Fisher information about the position in all used readings of each step, (T, P, P)."""
    assert isinstance(sensor, Informs), "a bound is computed only for a sensor model that has an information matrix"
    steps, size = points.shape
    total = np.zeros((steps, size, size))
    length = 1 if is_relative(sensor) else STEPS_PER_BLOCK  # relative readings are centred over those of a step
    for first in range(0, steps, length):
        begin, end = np.searchsorted(used.steps, [first, first + length])
        nodes, rows = np.unique(used.nodes[begin:end], return_inverse=True)
        block = np.ascontiguousarray(points[first : first + length].T)
        each = sensor.information(block, positions[nodes], traits[nodes])
        counted = np.zeros((len(nodes), 1, 1, block.shape[1]), dtype=np.bool_)
        counted[rows, 0, 0, used.steps[begin:end] - first] = True
        total[first : first + length] = np.where(counted, each, 0.0).sum(axis=0).transpose(2, 0, 1)
    return total


Table = dict[str, np.ndarray]
NodesByStep = dict[int, frozenset[int]]
KEYS = ("replicate", "target")
NOBODY: frozenset[int] = frozenset()


class RecordedReadings:
    """The tables of a result file that say whose readings counted."""

    def __init__(self, path: str | Path, setup: TrackingSetup) -> None:
        self._join = isinstance(setup, NetworkSetup) and setup.members_join
        self._estimates = read_table(path, "estimates", [*KEYS, "step", "time", "issued", "head", "active", "readings"])
        self._clusters = read_table(path, "clusters", [*KEYS, "formed", "released", "head"])
        events = read_table(path, "events", [*KEYS, "time", "step", "node", "peer", "kind", "what"])
        words = meanings(path, "events", "what")
        reading = words.index("reading") if "reading" in words else -1
        self._sensed = _rows(events, events["kind"] == KIND["sense"])
        self._joined = _rows(events, events["kind"] == KIND["join"])
        self._received = _rows(events, (events["kind"] == KIND["receive"]) & (events["what"] == reading))

    def used(self, replicate: int, target: int, readings: str) -> UsedReadings:
        """The readings that count at each step: those of `active` members, or those that `arrived`."""
        estimates, clusters, sensed, joined, received = (
            _rows(table, (table["replicate"] == replicate) & (table["target"] == target))
            for table in (self._estimates, self._clusters, self._sensed, self._joined, self._received)
        )
        sensing = _by_step(sensed["step"], sensed["node"])
        active = self._active(estimates, clusters, joined, sensing)
        if readings == "active":
            return _pairs(active)
        arrived = _arrived(estimates, received, sensing)
        counts = dict(zip(estimates["step"].tolist(), estimates["readings"].tolist(), strict=True))
        used = {}
        for step, count in counts.items():
            if count:
                enough = (nodes[step] for nodes in (arrived, active) if len(nodes.get(step, NOBODY)) >= count)
                used[step] = next(enough, sensing.get(step, NOBODY))
        return _pairs(used)

    def _active(self, estimates: Table, clusters: Table, joined: Table, sensing: NodesByStep) -> NodesByStep:
        """The members of the cluster in charge that sensed at each step."""
        if not self._join:
            return sensing
        result = {}
        for step, head, begin, end in _computations(estimates):
            led = (clusters["head"] == head) & (clusters["formed"] <= end) & ~(clusters["released"] < begin)
            if led.any():
                members = _members(clusters, joined, int(np.flatnonzero(led)[-1]), end)
                result[step] = sensing.get(step, NOBODY) & members
        return result


def _arrived(estimates: Table, received: Table, sensing: NodesByStep) -> NodesByStep:
    """The nodes whose readings the head had: itself, and those received from the step's start until the estimate."""
    result = {}
    times: Floats = received["time"]
    for step, head, begin, end in _computations(estimates):
        first, last = np.searchsorted(times, begin, "left"), np.searchsorted(times, end, "right")
        to_head = received["node"][first:last] == head
        own = frozenset([head]) & sensing.get(step, NOBODY)
        result[step] = own | frozenset(received["peer"][first:last][to_head].tolist())
    return result


def _computations(estimates: Table) -> zip[Any]:
    """(step, head, start of the step, time of the estimate) of each step; both times are equal without an estimate."""
    end = np.where(np.isfinite(estimates["issued"]), estimates["issued"], estimates["time"])
    columns = estimates["step"], estimates["head"], estimates["time"], end
    return zip(*(values.tolist() for values in columns), strict=True)


def _members(clusters: Table, joined: Table, number: int, end: float) -> frozenset[int]:
    """The members of a cluster at a time: its head, and the nodes that joined it since the cluster before it formed."""
    head, since = int(clusters["head"][number]), clusters["formed"][number - 1] if number else -np.inf
    mine = (joined["peer"] == head) & (joined["time"] > since) & (joined["time"] <= end)
    return frozenset([head, *joined["node"][mine].tolist()])


def _by_step(steps: Ints, nodes: Ints) -> NodesByStep:
    groups: dict[int, set[int]] = {}
    for step, node in zip(steps.tolist(), nodes.tolist(), strict=True):
        groups.setdefault(step, set()).add(node)
    return {step: frozenset(some) for step, some in groups.items()}


def _pairs(groups: NodesByStep) -> UsedReadings:
    pairs = sorted((step, node) for step, nodes in groups.items() for node in nodes)
    steps, nodes = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return UsedReadings(steps, nodes)


def _rows(table: Table, chosen: Bools) -> Table:
    return {name: values[chosen] for name, values in table.items()}


LinearisedMotion: TypeAlias = tuple[Floats, Floats]
"""The motion model at one step: the Jacobian F (R, D, D) at each truth, and the covariance Q (D, D) of its noise."""

NO_NOISE = 1e-9
"""Eigenvalues of the scaled process noise below this share of the largest count as zero."""


def along_trajectories(
    motions: Iterable[LinearisedMotion], prior: Floats, information: Floats, place: list[int]
) -> Floats:
    """The covariances of R recursions, each along its own trajectory, (T, R, D, D).

    Args:
        motions: the linearised motion model of each step.
        prior: (R, D, D) covariances at step 0.
        information: (T, R, P, P) Fisher information of the readings.
        place: the state columns of the position.
    """
    cov, result = prior, np.empty((len(information), *prior.shape))
    for step, (jacobian, noise) in enumerate(motions):
        result[step] = cov = updated(predicted(cov, jacobian, noise), information[step], place)
    return result


def over_trajectories(
    motions: Iterable[LinearisedMotion], prior: Floats, information: Floats, place: list[int]
) -> Floats:
    """The covariances of one recursion whose expectations are means over R trajectories, (T, D, D).

    Args: as `along_trajectories`.

    Raises:
        ValueError: the process noise is zero in a direction in which the Jacobians differ.
    """
    cov, result = prior.mean(axis=0), np.empty((len(information), *prior.shape[1:]))
    for step, (jacobian, noise) in enumerate(motions):
        known = updated(cov, _information_of_spread(jacobian, noise), list(range(len(cov))))
        result[step] = cov = updated(
            predicted(known, jacobian.mean(axis=0), noise), information[step].mean(axis=0), place
        )
    return result


def _information_of_spread(jacobian: Floats, noise: Floats) -> Floats:
    """V (D, D): the information about the state that Jacobians (R, D, D) carry because they differ between states."""
    deviation = jacobian - jacobian.mean(axis=0)
    if not deviation.any():
        return np.zeros_like(noise)
    inverse, null_space = inverse_noise(noise)
    if np.abs(null_space @ deviation).max() > NO_NOISE * np.abs(jacobian).max():
        raise ValueError("the process noise is singular in a direction in which the motion depends on the state")
    spread: Floats = (deviation.swapaxes(-1, -2) @ inverse @ deviation).mean(axis=0)
    return spread


def predicted(cov: Floats, jacobian: Floats, noise: Floats) -> Floats:
    """P⁻ = F P Fᵀ + Q, (..., D, D)."""
    return jacobian @ cov @ jacobian.swapaxes(-1, -2) + noise


def updated(cov: Floats, information: Floats, place: list[int]) -> Floats:
    """(P⁻¹ + I)⁻¹, (..., D, D), of a P that may be singular and information I (..., p, p) on the columns `place`.

    Computed as P - P_x (1 + I P_xx)⁻¹ I P_xᵀ with P_xx the block of these columns and P_x those columns. The
    eigenvalues of I P_xx, a product of two covariances, are not negative, so the inverted matrix is never singular.
    """
    columns = cov[..., :, place]
    inner = np.eye(len(place)) + information @ columns[..., place, :]
    smaller = cov - columns @ np.linalg.solve(inner, information @ columns.swapaxes(-1, -2))
    return 0.5 * (smaller + smaller.swapaxes(-1, -2))


def inverse_noise(noise: Floats) -> tuple[Floats, Floats]:
    """A generalised inverse of Q (D, D), and the projection on its null space with the columns scaled to one."""
    scale = np.sqrt(np.where(np.diag(noise) > 0.0, np.diag(noise), 1.0))
    values, vectors = np.linalg.eigh(noise / np.outer(scale, scale))
    positive = values > NO_NOISE * max(float(values.max()), 0.0)
    range_, null_space = vectors[:, positive], vectors[:, ~positive]
    inverse = (range_ / values[positive]) @ range_.T / np.outer(scale, scale)
    return inverse, null_space @ null_space.T / scale
