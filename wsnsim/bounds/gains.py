"""The bound for filters that do not know the nodes' gains, which are drawn once a run and do not change.

    has_gains(sensor) -> bool      along_trajectory(...) -> (T, D, D)

Each gain is an unknown besides the state: a covariance of both is carried from step to step, so that what readings tell
of a gain is not forgotten, and is shared with the state as well as can be. The block of the state is the inverse of the
Schur complement of the gains in the information.

A gain's prior is a Gaussian with the variance γ²/3 of the uniform law that it is drawn from: a law with edges has no
Fisher information (our choice). A node's gain is forgotten once the node will not be heard again.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.ports import SensorModel
from wsnsim.bounds.information import STEPS_AT_ONCE, Heard
from wsnsim.bounds.recursion import Law, predicted

PROBE = 1e-3
"""Difference of gains over which a slope is taken: readings are linear in them."""


class Told(NamedTuple):
    """One a reading: the mean's slope in the position (n, P) and in the gain (n,), and the information w about the mean
    (n,), its variance's included."""

    slopes: Floats
    gain_slopes: Floats
    weights: Floats


def has_gains(sensor: Any) -> bool:
    """Whether there is a gain that a filter might not know."""
    return "gain" in sensor.trait_names and getattr(sensor, "gain_spread", 0.0) > 0.0


def along_trajectory(
    laws: Iterable[Law], prior: Floats, told: Told, heard: Heard, place: list[int], spread: float
) -> Floats:
    """(T, D, D) covariances along one truth, of gains with the prior variance `spread`²/3.

    `laws`: of each step in turn, F being (1, D, D). Step 1 is row 0 of the result; what is heard before does not count.
    """
    size, later = len(prior), heard.steps > 0
    heard, told = Heard(*(values[later] for values in heard)), Told(*(values[later] for values in told))
    seats, count = seated(heard)
    whole = np.zeros((size + count, size + count))
    whole[:size, :size] = prior
    cuts = np.searchsorted(heard.steps, np.arange(1, heard.steps.max(initial=0) + 2))
    result = []
    first = np.zeros(len(heard.steps), dtype=np.bool_)
    first[np.unique(heard.nodes, return_index=True)[1]] = True
    for step, ((slope,), noise) in enumerate(laws):
        whole[:size, :size] = predicted(whole[:size, :size], slope, noise)
        whole[:size, size:] = slope @ whole[:size, size:]
        whole[size:, :size] = whole[:size, size:].T
        if step + 1 < len(cuts):
            now = slice(cuts[step], cuts[step + 1])
            _welcome(whole, size + seats[now][first[now]], spread**2 / 3.0)
            whole = _updated(whole, Told(*(values[now] for values in told)), place, size + seats[now])
        result.append(whole[:size, :size].copy())
    return np.array(result)


def told_by(sensor: SensorModel, points: Floats, positions: Floats, traits: Floats, heard: Heard) -> Told:
    """What each reading tells, of a target at points (T, P). Each reading is a number whose law depends on its mean."""
    column = sensor.trait_names.index("gain")
    pairs = Told(np.empty((len(heard.steps), points.shape[1])), *np.empty((2, len(heard.steps))))
    for first in range(0, len(points), STEPS_AT_ONCE):
        begin, end = np.searchsorted(heard.steps, [first, first + STEPS_AT_ONCE])
        nodes, rows = np.unique(heard.nodes[begin:end], return_inverse=True)
        steps, some = heard.steps[begin:end] - first, np.ascontiguousarray(points[first : first + STEPS_AT_ONCE].T)
        where, own = positions[nodes], traits[nodes]
        more, less = own.copy(), own.copy()
        more[:, column] += PROBE
        less[:, column] -= PROBE
        _, gradients, _ = sensor.linearise(some, where, own)
        each = sensor.information(some, where, own)  # type: ignore[attr-defined]
        higher, lower = (sensor.linearise(some, where, traits)[0] for traits in (more, less))
        pairs.slopes[begin:end] = gradients[rows, :, steps]
        squared = (pairs.slopes[begin:end] ** 2).sum(axis=1)
        traces = np.trace(each, axis1=1, axis2=2)[rows, steps]
        pairs.weights[begin:end] = np.divide(traces, squared, out=np.zeros_like(traces), where=squared > 0.0)
        pairs.gain_slopes[begin:end] = (higher - lower)[rows, steps] / (2.0 * PROBE)
    return pairs


def seated(heard: Heard) -> tuple[Ints, int]:
    """A seat for each reading's node, and how many there are: a node keeps its own from its first reading to its last.

    Whoever comes next takes the seat of a node that will not be heard again.
    """
    last = dict(zip(heard.nodes.tolist(), heard.steps.tolist(), strict=True))
    taken: dict[int, int] = {}
    free: list[int] = []
    seats, count = np.empty(len(heard.nodes), dtype=np.int64), 0
    leaving: list[tuple[int, int]] = sorted(((step, node) for node, step in last.items()), reverse=True)
    for row, (step, node) in enumerate(zip(heard.steps.tolist(), heard.nodes.tolist(), strict=True)):
        while leaving and leaving[-1][0] < step:
            free.append(taken[leaving.pop()[1]])
        if node not in taken:
            taken[node] = free.pop() if free else count
            count += taken[node] == count
        seats[row] = taken[node]
    return seats, count


def _welcome(whole: Floats, rows: Ints, variance: float) -> None:
    """Nodes that are heard for the first time: nothing is known of their gains but the prior."""
    whole[rows, :] = 0.0
    whole[:, rows] = 0.0
    whole[rows, rows] = variance


def _updated(whole: Floats, told: Told, place: list[int], seats: Ints) -> Floats:
    """After readings z = h · (position) + k · (gain) + v with v of variance 1/w; those of w = 0 tell nothing."""
    used = told.weights > 0.0
    slopes, gain_slopes, weights = (values[used] for values in told)
    seats = seats[used]
    columns = whole[:, place] @ slopes.T + whole[:, seats] * gain_slopes
    innovation = slopes @ columns[place] + gain_slopes[:, None] * columns[seats] + np.diag(1.0 / weights)
    smaller = whole - columns @ np.linalg.solve(innovation, columns.T)
    result: Floats = 0.5 * (smaller + smaller.T)
    return result
