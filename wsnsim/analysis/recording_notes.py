"""Rules of `notes.RULES` on what was recorded: targets that were absent, and readings that do not follow their law.

Readings are held against the law at the trajectory, at the time of each reading. Of several explanations of what
differs, the one is noted that leaves the least loss, the mean of log(1 + (r / σ)²) over residuals r, if that is less
than without it by `CLEARLY`. The loss is that of a Cauchy distribution: few outliers do not decide it (our choice).

    absent_movers(setup), unexplained_readings(setup) -> notes          residuals(setup) -> a sentence or none
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.analysis.phrases import counted
from wsnsim.base.arrays import Floats, Ints, components_of, near
from wsnsim.base.errors import RunError, shortened
from wsnsim.base.initial_conditions import InitialConditions, measured_points, node_names, sample_initial_conditions
from wsnsim.base.sensing import gain_variance, samples_gains
from wsnsim.base.setups import Setup, TrackingSetup
from wsnsim.models.recorded_readings import RecordedSensor
from wsnsim.models.recorded_track import RecordedTrack

LONG_GAP: Final = 5.0
"""A recorded target is absent for more than this many steps, and usual times between rows [our choice]."""
MOST_READINGS: Final = 5_000
"""Readings that are held against the law; of more, as many are sampled [our choice]."""
FEWEST: Final = 10
"""Readings for each quantity that an explanation estimates, at least [our choice]."""
CLEARLY: Final = 0.5
"""Loss by which an explanation must be better than none: that of residuals which are larger by about a half."""
FAR: Final = 4.0
"""Median of |residual| / σ above which readings do not follow the law; it should be 0.67 [our choice]."""
FINER: Final = 4
"""Instants of a trajectory in a step; between them it is interpolated."""
LONGEST_LAG: Final = 100
"""Steps by which clocks are thought to be wrong, at most [our choice]."""
CONVERSIONS: Final = (
    ("in mm", 1e-3, 0.0), ("in cm", 1e-2, 0.0), ("in km", 1e3, 0.0), ("in feet", 0.3048, 0.0),
    ("in degrees", math.pi / 180.0, 0.0), ("clockwise from north", -1.0, math.pi / 2.0), ("clockwise", -1.0, 0.0),
    ("from the target to the node", 1.0, math.pi),
)  # fmt: skip
"""(how readings may have been given, factor, summand) that make them those of the law."""


def absent_movers(setup: TrackingSetup) -> Iterator[str]:
    """Recorded trajectories that begin late, end early or have gaps: there the target is not known to be."""
    end = setup.steps * setup.dt
    for i, motion in enumerate(setup.motions):
        if isinstance(motion, RecordedTrack):
            times = np.array([0.0, *motion.track.times.clip(0.0, end), end])
            apart = np.diff(times)
            gaps = np.flatnonzero(apart > LONG_GAP * max(np.quantile(np.diff(motion.track.times), 0.25), setup.dt))
            for gap in gaps[:1].tolist():
                span = f"{counted(len(gaps), 'gap')}, the first from {times[gap]:g} s to {times[gap + 1]:g} s"
                yield f"target {i} is taken to rest, or to go straight, where its trajectory has no row: {span}"


class _Held(NamedTuple):
    """Readings and what is known of them.

    Attributes:
        sensor: the law.
        names: of the nodes.
        conditions: those of the first run.
        dt: time in s between two points of a trajectory.
        paths: (K, P) points of each target.
        times, nodes, readings, targets: (n,) of each reading.
    """

    sensor: Any
    names: Sequence[str]
    conditions: InitialConditions
    dt: float
    paths: Sequence[Floats]
    times: Floats
    nodes: Ints
    readings: Floats
    targets: Ints

    def of(self, chosen: Any) -> _Held:
        """The chosen readings."""
        return self._replace(**{key: getattr(self, key)[chosen] for key in self._fields[-4:]})

    def law(self, nodes: Ints, later: float = 0.0, noise: float = 0.0) -> Floats:
        """(n,) what the law expects of these nodes at times that are `later` by so many s."""
        points = np.empty((len(nodes), self.paths[0].shape[1]))
        for target, path in enumerate(self.paths):
            own, instants = self.targets == target, np.arange(len(path)) * self.dt
            points[own] = np.transpose([np.interp(self.times[own] + later, instants, axis) for axis in path.T])
        places, traits = self.conditions.positions[nodes], self.conditions.traits[nodes]
        expected: Floats = self.sensor.measure(points, places, traits, np.full(len(nodes), noise))
        return expected

    def off(self, expected: Floats) -> Floats:
        """(n,) readings minus what is expected."""
        return near(self.sensor, self.readings, expected) - expected

    @property
    def sds(self) -> Floats:
        """(n,) standard deviation of each residual by the law, with what it does not know of nodes and shadowing."""
        known = self.law(self.nodes, noise=1.0) - self.law(self.nodes)
        gains = gain_variance(self.sensor) if samples_gains(self.sensor) else 0.0
        least = 1e-200  # of a law without noise
        result: Floats = np.sqrt(known**2 + getattr(self.sensor, "shadowing", 0.0) ** 2 + gains + least)
        return result

    def medians(self, off: Floats) -> dict[int, float]:
        """The median residual of each node with readings."""
        return {node: float(np.median(off[self.nodes == node])) for node in np.unique(self.nodes).tolist()}


def _held(setup: Setup) -> _Held | None:
    """The recorded readings of the first run; None if there are none, or not of one component."""
    if not (isinstance(setup, TrackingSetup) and isinstance(setup.recorded, RecordedSensor)):
        return None
    if len(components_of(setup.sensor)) > 1:
        return None
    steps, dt, rng = setup.steps * FINER, setup.dt / FINER, np.random.default_rng(0)
    try:
        conditions, names = sample_initial_conditions(setup, 0), node_names(setup)
        rows = setup.recorded.rows(names, len(setup.motions))
    except RunError:  # `notes.first_run` says so
        return None
    paths = [measured_points(motion, setup.sensor, motion.truth(steps, dt, rng), dt) for motion in setup.motions]
    used = rng.permutation(np.flatnonzero((rows[0] >= 0.0) & (rows[0] <= steps * dt)))[:MOST_READINGS]
    return _Held(setup.sensor, names, conditions, dt, paths, *rows).of(used) if len(used) >= FEWEST else None


def residuals(setup: Setup) -> Iterator[str]:
    """Yield a sentence on recorded readings minus their law at the trajectory, if there are some."""
    if (held := _held(setup)) is None:
        return
    off = held.off(held.law(held.nodes))
    middle, medians = np.median(off), held.medians(off)
    low, high = min(medians, key=medians.__getitem__), max(medians, key=medians.__getitem__)
    count = f"{len(off):,} {'sampled ' * (len(off) == MOST_READINGS)}readings"
    spread = f"{1.4826 * np.median(np.abs(off - middle)):.3g} (law: {np.median(held.sds):.3g})"
    nodes = f"medians of nodes from {medians[low]:.3g} ({held.names[low]}) to {medians[high]:.3g} ({held.names[high]})"
    most = f"largest {off[np.abs(off).argmax()]:.3g}"
    yield f"{count} minus law at the recorded trajectory: median {middle:.3g}, spread {spread}, {most}; {nodes}"


def unexplained_readings(setup: TrackingSetup) -> Iterator[str]:
    """Recorded readings that do not follow their law at the trajectory, and what explains it best.

    An extreme value stands for something else if 2 % of the readings have it, three times as many as have the next.
    """
    if (held := _held(setup)) is None:
        return
    values, counts = np.unique(held.readings, return_counts=True)
    for end, following, which in ((0, 1, "least"), (-1, -2, "greatest")):
        if len(values) > FEWEST and counts[end] > max(0.02 * len(held.readings), 3 * counts[following]):
            share = f"{counts[end]:,} of {len(held.readings):,} readings are {values[end]:g}, the {which}"
            yield f"sensor: {share}: a limit of the receiver, or no reading? Leave them out"
            held = held.of(held.readings != values[end])
    off, sds = held.off(held.law(held.nodes)), held.sds
    loss, said = min(_explanations(held, off, sds))
    if _losses(off, sds).mean() - loss > CLEARLY:
        yield f"sensor: {said}"
    elif np.median(np.abs(off) / sds) > FAR:
        yield "sensor: readings do not follow the law at the trajectory: units, names, times, values of the law?"


def _losses(off: Floats, sds: Floats) -> Floats:
    """(n,) losses of residuals."""
    return np.log1p((off / sds) ** 2)


def _explanations(held: _Held, off: Floats, sds: Floats) -> Iterator[tuple[float, str]]:
    """Yield the loss that an explanation of residuals leaves, and the explanation with what to write."""
    law = held.law(held.nodes)
    for said, factor, summand in CONVERSIONS:
        converted = held._replace(readings=summand + factor * held.readings)
        yield _losses(converted.off(law), sds).mean(), f"readings seem to be {said}: convert them"
    yield _lagging(held, sds)
    if len(off) < FEWEST * len(held.names):
        return
    medians = held.medians(off)
    values = np.array([*medians.values()])
    most = ", ".join(f"{held.names[node]} {medians[node]:.3g}" for node in medians)
    said = f"a constant of each node, {shortened(most)}: give the law its gains, or take it off"
    if np.ptp(values) < abs(np.median(values)):
        said = f"a constant {np.median(values):.3g} of all nodes, such as a clock offset: take it off"
    each = np.array([medians[node] for node in held.nodes.tolist()])
    yield _losses(held.off(law + each), sds).mean(), f"readings contain {said}"
    yield _swapped(held, sds)


def _lagging(held: _Held, sds: Floats) -> tuple[float, str]:
    """The loss at the clock offset that fits best."""
    from scipy.optimize import minimize_scalar

    def loss(later: float) -> float:
        return float(_losses(held.off(held.law(held.nodes, later)), sds).mean())

    dt, most = FINER * held.dt, min(LONGEST_LAG, len(held.paths[0]) // FINER // 2)
    coarse = min((dt * lag for lag in range(-most, most + 1)), key=loss)
    found = minimize_scalar(loss, method="bounded", bounds=(coarse - dt, coarse + dt))
    when = f"{abs(found.x):.3g} s {'later' if found.x > 0 else 'earlier'}"
    return float(found.fun), f"readings fit the trajectory {when}: set time_origin of sensor or motion, or the clocks"


def _swapped(held: _Held, sds: Floats) -> tuple[float, str]:
    """The loss with the nodes to which the readings of each node fit best, each once."""
    from scipy.optimize import linear_sum_assignment

    count = len(held.names)
    losses = [_losses(held.off(held.law(np.full_like(held.nodes, node))), sds) for node in range(count)]
    sums = np.array([np.bincount(held.nodes, each, count) for each in losses]).T
    rows, columns = linear_sum_assignment(sums)
    changed = np.flatnonzero((rows != columns) & sums.any(axis=1))
    pairs = ", ".join(f"{held.names[i]} of {held.names[columns[i]]}" for i in changed.tolist())
    said = f"readings seem to have the names of other nodes: those of {shortened(pairs)}: check names and positions"
    return float(sums[rows, columns].sum() / len(held.nodes)), said
