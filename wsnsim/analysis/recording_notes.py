"""Rules of `notes.RULES` on what was recorded: targets that were absent, and readings that do not follow their law.

Readings are held against the law at the trajectory, at the time of each reading. Of several explanations of what
differs, the one is noted that leaves the least loss, the mean of log(1 + (r / σ)²) over residuals r, if that is less
than half of the loss without it, and less by `CLEARLY`. The loss is that of a Cauchy distribution: few outliers do not
decide it (our choices).

    absent_movers(setup), unread_identifiers(setup), late_readings(setup), unexplained_readings(setup) -> notes
    residuals(setup) -> a sentence or none
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias, get_type_hints

import numpy as np

from wsnsim.base.arrays import Floats, Ints, components_of, first_steps, is_relative, near
from wsnsim.base.errors import RunError, counted, shortened
from wsnsim.base.initial_conditions import InitialConditions, measured_points, node_names, sample_initial_conditions
from wsnsim.base.part import Quantity
from wsnsim.base.sensing import gain_variance, samples_gains
from wsnsim.base.setups import Setup, TrackingSetup
from wsnsim.models.csvfile import identifiers
from wsnsim.models.recorded_readings import RecordedSensor
from wsnsim.models.recorded_track import RecordedTrack
from wsnsim.models.unit_checks import is_explained, losses
from wsnsim.recording.reader import read_table

LONG_GAP: Final = 5.0
"""A recorded target is absent for more than this many steps, and usual times between rows [our choice]."""
MOST_READINGS: Final = 5_000
"""Readings that are held against the law; of more, as many are sampled [our choice]."""
FEWEST: Final = 10
"""Readings for each quantity that an explanation estimates, at least [our choice]."""
FAR: Final = 4.0
"""Median of |residual| / σ above which readings do not follow the law; it should be 0.67 [our choice]."""
FINER: Final = 4
"""Instants of a trajectory in a step; between them it is interpolated."""
IMPROBABLE: Final = 0.05
"""Cells are improbable below this share of the most probable one: of small ones, 2.4 standard deviations off."""
MANY_IMPROBABLE: Final = 0.1
"""Share of readings in improbable cells above which readings do not follow the law [our choice]."""
SAME: Final = 1e-6
"""Difference by which a recorded reading may be off the value of its cell, which a file may round [our choice]."""
NEARLY, MANY, REMAIN = 0.8, 0.05, 0.2
"""Part of a step by which two readings in it are apart; parts of all readings that begin such a pair, and of these
pairs that remain with another origin of time [our choice]."""
LONGEST_LAG: Final = 100
"""Steps by which clocks are thought to be wrong, at most [our choice]."""
EXTREME: Final = 50.0
"""Standard deviations from the law beyond which a reading is an outlier [our choice]."""
FEW: Final = 0.01
"""Share of outliers above which the law is too narrow [our choice]."""
CONVERSIONS: Final = (
    ("in mm", 1e-3, 0.0), ("in cm", 1e-2, 0.0), ("in km", 1e3, 0.0), ("in feet", 0.3048, 0.0),
    ("10 times as large (cm taken for mm?)", 0.1, 0.0), ("a tenth (mm taken for cm?)", 10.0, 0.0),
    ("in degrees", math.pi / 180.0, 0.0), ("clockwise from north", -1.0, math.pi / 2.0), ("clockwise", -1.0, 0.0),
    ("from the target to the node", 1.0, math.pi),
)  # fmt: skip
"""(how readings may have been given, factor, summand) that make them those of the law."""


def absent_movers(setup: TrackingSetup) -> Iterator[str]:
    """Recorded trajectories that begin late, end early or have gaps: there the target is not known to be."""
    end = setup.steps * setup.dt
    for i, motion in enumerate(setup.motions):
        if isinstance(motion, RecordedTrack) and not setup.has_absences:
            times = np.array([0.0, *motion.track.times.clip(0.0, end), end])
            apart = np.diff(times)
            gaps = np.flatnonzero(apart > LONG_GAP * max(np.quantile(np.diff(motion.track.times), 0.25), setup.dt))
            for gap in gaps[:1].tolist():
                span = f"{counted(len(gaps), 'gap')}, the first from {times[gap]:g} s to {times[gap + 1]:g} s"
                yield f"target {i} is taken to rest, or to go straight, where its trajectory has no row: {span}"


def unread_identifiers(setup: TrackingSetup) -> Iterator[str]:
    """Columns of recorded readings that are not read and name several things at one node, such as targets."""
    if not isinstance(setup.recorded, RecordedSensor):
        return
    path, named = setup.recorded.path, setup.recorded.columns
    found = identifiers(path, (named.time, named.reading, named.target))
    nodes = found.pop(named.node, [])
    for column, cells in found.items():
        if 1 < len({*cells}) <= len(nodes) / 3 and len({*zip(nodes, cells, strict=True)}) > len({*nodes}):
            values = shortened(", ".join(dict.fromkeys(cells)))
            said = f"sensor.columns: '{column}' of {path} ({values}) is not read"
            yield f"{said}: if it names targets, number them from 0 in a column target, or give each a file"


def late_readings(setup: TrackingSetup) -> Iterator[str]:
    """Recorded readings just after a step, which share the next one with those of that step; another origin helps."""
    if not isinstance(setup.recorded, RecordedSensor):
        return
    times, nodes, _, targets = setup.recorded.rows(node_names(setup), len(setup.motions))
    order = np.lexsort((times, nodes, targets))
    apart = np.diff(times[order]) > NEARLY * setup.dt

    def first_of_two(later: float) -> Ints:
        keys = [targets[order], nodes[order], first_steps(times[order] - later, setup.dt)]
        return np.asarray(order[:-1][apart & (np.diff(keys) == 0.0).all(axis=0)], np.int64)

    if len(first := first_of_two(0.0)) > MANY * len(times):
        late = float((times - (first_steps(times, setup.dt) - 1.0) * setup.dt)[first].max())
        if len(first_of_two(late)) < REMAIN * len(first):
            yield (
                f"sensor: {len(first):,} times, two readings of a node nearly a step apart are in one step: the first "
                f"is up to {late:.3g} s after the step before: add {late:.3g} s to time_origin of sensor and motion"
            )


_Path: TypeAlias = tuple[Floats, Floats]
"""Times (n,) and positions (n, P) of a target."""


class _ReadingsWithLaw(NamedTuple):
    """Readings and what is known of them.

    Attributes:
        sensor: the law.
        names: of all nodes.
        law: (nodes (n,), seconds later) -> (n,) the mean by the law for the target at the time of each reading.
        nodes, readings: (n,) of each reading.
        sds: (n,) standard deviation of each by the law, with what it does not know of nodes, and shadowing.
        odds: (n,) of readings that name a cell, its probability over that of the most probable one, NaN for a reading
            in no cell; none for others.
        groups: (n,) of readings that are relative, those with a number in common; none for others.
    """

    sensor: Any
    names: Sequence[str]
    law: Callable[[Ints, float], Floats]
    nodes: Ints
    readings: Floats
    sds: Floats
    groups: Ints | None
    odds: Floats | None

    def off(self, later: float = 0.0, nodes: Ints | None = None) -> Floats:
        """(n,) readings minus law."""
        expected = self.law(self.nodes if nodes is None else nodes, later)
        if self.groups is not None:
            apart = self.readings - expected
            return apart - (np.bincount(self.groups, apart) / np.bincount(self.groups))[self.groups]
        return near(self.sensor, self.readings, expected) - expected

    def medians(self, off: Floats) -> dict[int, float]:
        """The median residual of each node with readings."""
        return {node: float(np.median(off[self.nodes == node])) for node in np.unique(self.nodes).tolist()}


def _trajectories(setup: TrackingSetup) -> list[_Path]:
    """The path of each target where it is present."""
    steps, dt, rng = setup.steps * FINER, setup.dt / FINER, np.random.default_rng(0)
    times: Floats = np.arange(steps + 1, dtype=np.float64) * dt
    found = [measured_points(motion, setup.sensor, motion.truth(steps, dt, rng), dt) for motion in setup.motions]
    return [_known(times, points) for points in found]


def _estimates(setup: TrackingSetup, result: str | Path) -> list[_Path]:
    """The estimated path of each target in the first run of a result."""
    motion = setup.motions[0]
    axes = [motion.columns[i] for i in motion.position]
    table = read_table(result, "estimates", ["replicate", "target", "time", *axes])
    points = np.column_stack([table[axis] for axis in axes])
    each = [(table["replicate"] == 0) & (table["target"] == target) for target in range(len(setup.motions))]
    return [_known(table["time"][rows], points[rows]) for rows in each]


def _known(times: Floats, points: Floats) -> _Path:
    there = np.isfinite(points).all(axis=1)
    return times[there], points[there]


def _readings_with_law(setup: TrackingSetup, paths: Sequence[_Path]) -> _ReadingsWithLaw | None:
    """The recorded readings of the first run; None if there are hardly any, or not of one component each."""
    if not isinstance(setup.recorded, RecordedSensor):
        return None
    sensor = setup.sensor
    try:
        conditions, names = sample_initial_conditions(setup, 0), node_names(setup)
        rows = setup.recorded.rows(names, len(setup.motions))
    except RunError:  # `notes.first_run` says so
        return None
    spans = np.array([(known[0], known[-1]) if len(known) else (np.inf, np.inf) for known, _ in paths])[rows[3]]
    within = np.flatnonzero((rows[0] >= spans[:, 0]) & (rows[0] <= spans[:, 1]))
    used, groups = np.random.default_rng(0).permutation(within)[:MOST_READINGS], None
    if is_relative(sensor):
        used, groups = _together(within, first_steps(rows[0][within], setup.dt), rows[3][within])
    if len(used) < FEWEST or len(components_of(sensor)) > 1:
        return None
    times, nodes, readings, targets = (row[used] for row in rows)

    def places_at(later: float) -> Floats:
        points = np.empty((len(nodes), paths[0][1].shape[1]))
        for target in np.unique(targets).tolist():
            known, path = paths[target]
            now = times[targets == target] + later
            points[targets == target] = np.transpose([np.interp(now, known, x) for x in path.T])
        return points

    def law(nodes: Ints, later: float) -> Floats:
        places, traits = conditions.positions[nodes], conditions.traits[nodes]
        return shift + sensor.measure(places_at(later), places, traits, np.zeros(len(nodes)))

    means, variances, odds = _moments(sensor, places_at(0.0)[:, :2], nodes, readings, conditions)
    shift = np.zeros(len(nodes))
    if groups is None:  # where the median is not the mean, as of blocked lines of sight
        shift = means - sensor.measure(
            places_at(0.0)[:, :2], conditions.positions[nodes], conditions.traits[nodes], shift
        )
    variances += gain_variance(sensor) * samples_gains(sensor) + getattr(sensor, "shadowing", 0.0) ** 2
    if groups is not None:
        variances *= 1.0 - 1.0 / np.bincount(groups)[groups]
    sds = np.sqrt(variances + 1e-200)  # of a law without noise
    return _ReadingsWithLaw(sensor, names, law, nodes, readings, sds, groups, odds)


def _moments(
    sensor: Any, points: Floats, nodes: Ints, readings: Floats, conditions: InitialConditions
) -> tuple[Floats, Floats, Floats | None]:
    """(n,) mean and variance of each reading by the law at points (n, P) in the plane, and `odds` of readings."""
    means, variances, odds = np.empty((3, len(nodes)))
    in_cells = np.size(getattr(sensor, "reading_values", ())) > 0
    for node in np.unique(nodes).tolist():
        own, one = nodes == node, slice(node, node + 1)
        there = np.ascontiguousarray(points[own].T), conditions.positions[one], conditions.traits[one]
        expected, _, spread = sensor.linearise(*there)
        means[own], variances[own] = expected[0], spread[0]
        if in_cells:
            odds[own] = _odds(sensor, readings[own], *there)
    return means, variances, odds if in_cells else None


def _odds(sensor: Any, readings: Floats, points: Floats, positions: Floats, traits: Floats) -> Floats:
    """(n,) the probability of the cell of each reading of one node at points (P, n), over that of the greatest."""
    chances, apart = sensor.cells(points, positions, traits).chances[0], sensor.reading_values[:, None] - readings
    own = np.abs(apart).argmin(axis=0), np.arange(len(readings))
    return np.where(np.abs(apart[own]) < SAME, chances[own] / chances.max(axis=0), np.nan)


def _together(rows: Ints, steps: Floats, targets: Ints) -> tuple[Ints, Ints]:
    """The rows of sampled steps, up to `MOST_READINGS`, and the number of the step and target of each; none alone."""
    _, groups, sizes = np.unique(steps + 1j * targets, return_inverse=True, return_counts=True)
    order = np.argsort(np.random.default_rng(0).permutation(len(sizes))[groups], kind="stable")
    order = order[sizes[groups[order]] > 1][:MOST_READINGS]
    kept = np.bincount(groups[order], minlength=len(sizes))[groups[order]] > 1  # the last step may be cut
    return rows[order[kept]], np.unique(groups[order[kept]], return_inverse=True)[1]


def residuals(setup: Setup, result: str | Path = "") -> Iterator[str]:
    """Yield a sentence on recorded readings minus their law at the trajectory, if there are some.

    With the result of a run, the law is that at its estimates, if no trajectory was recorded.
    """
    if not isinstance(setup, TrackingSetup) or (
        result and any(isinstance(each, RecordedTrack) for each in setup.motions)
    ):
        return
    if (compared := _readings_with_law(setup, _estimates(setup, result) if result else _trajectories(setup))) is None:
        return
    where = "estimates of run 0, which follow the readings and are no truth" if result else "trajectory"
    if compared.odds is not None:
        rare = int((compared.odds < IMPROBABLE).sum())
        yield f"{rare:,} of {len(compared.odds):,} readings are in cells that are improbable by the law at the {where}"
        return
    off = compared.off()
    middle, medians = np.median(off), compared.medians(off)
    low, high = min(medians, key=medians.__getitem__), max(medians, key=medians.__getitem__)
    count = f"{len(off):,} {'sampled ' * (len(off) == MOST_READINGS)}readings"
    said = _with_unit(compared.sensor)
    spread = f"{said(1.4826 * np.median(np.abs(off - middle)))} (law: {said(np.median(compared.sds))})"
    ends = [f"{said(medians[node])} ({compared.names[node]})" for node in (low, high)]
    nodes = f"medians of nodes from {' to '.join(ends)}"
    worst = np.abs(off).argmax()
    most = f"largest {said(off[worst])} ({compared.names[compared.nodes[worst]]})"
    yield f"{count} minus law at the {where}: median {said(middle)}, spread {spread}, {most}; {nodes}"


def _with_unit(sensor: Any) -> Callable[[float], str]:
    """What says a value in the unit of a sensor's readings, that of its `sd`."""
    about = getattr(get_type_hints(type(sensor), include_extras=True).get("sd"), "__metadata__", ())
    unit = next((f" {each.unit}" for each in about if isinstance(each, Quantity)), "")
    return lambda value: f"{value:.3g}{unit}"


def unexplained_readings(setup: TrackingSetup) -> Iterator[str]:
    """Recorded readings that do not follow their law at the trajectory, and what explains it best.

    An extreme value stands for something else if 2 % of the readings have it, three times as many as have the next.
    """
    if (compared := _readings_with_law(setup, _trajectories(setup))) is None:
        return
    if compared.odds is not None:
        strange, rare = int(np.isnan(compared.odds).sum()), int((compared.odds < IMPROBABLE).sum())
        allowed = shortened(", ".join(f"{value:g}" for value in compared.sensor.reading_values))
        of = f"of {len(compared.odds):,} readings are"
        if strange:
            yield f"sensor: {strange:,} {of} none of the values of cells, {allowed}: in full? Give the law of those"
        elif rare > MANY_IMPROBABLE * len(compared.odds):
            yield f"sensor: {rare:,} {of} in cells that are improbable by the law: names, targets, times, its values?"
        return
    values, counts = np.unique(compared.readings, return_counts=True)
    for end, following, which in ((0, 1, "least"), (-1, -2, "greatest")):
        if (
            compared.groups is None
            and len(values) > FEWEST
            and counts[end] > max(0.02 * len(compared.readings), 3 * counts[following])
        ):
            share = f"{counts[end]:,} of {len(compared.readings):,} readings are {values[end]:g}, the {which}"
            yield f"sensor: {share}: a limit of the receiver, or no reading? Leave them out"
            compared = compared._replace(sds=np.where(compared.readings == values[end], np.inf, compared.sds))
    off = compared.off()
    (loss, said), unexplained = min(_explanations(compared, off, setup)), losses(off, compared.sds).mean()
    if is_explained(loss, unexplained):
        yield f"sensor: {said}"
    elif np.median(np.abs(off) / compared.sds) > FAR:
        yield "sensor: readings do not follow the law: units, names, targets, times, values of the law?"
    elif 0 < (count := int((np.abs(off) > EXTREME * compared.sds).sum())) <= FEW * len(off):
        worst = (np.abs(off) / compared.sds).argmax()
        which = f"{_with_unit(compared.sensor)(compared.readings[worst])} of {compared.names[compared.nodes[worst]]}"
        apart = f"{abs(off[worst]) / compared.sds[worst]:.3g} standard deviations from the law"
        yield f"sensor: {counted(count, 'outlier')}, such as {which}, {apart}: leave out what is no reading (--missing)"


def _explanations(compared: _ReadingsWithLaw, off: Floats, setup: TrackingSetup) -> Iterator[tuple[float, str]]:
    """Yield the loss that an explanation of residuals leaves, and the explanation with what to write."""
    for said, factor, summand in CONVERSIONS:
        converted = compared._replace(readings=summand + factor * compared.readings)
        yield losses(converted.off(), compared.sds).mean(), f"readings seem to be {said}: convert them"
    yield _lagging(compared, setup)
    if len(off) < FEWEST * len(compared.names):
        return
    medians = compared.medians(off)
    values, shown = np.array([*medians.values()]), _with_unit(compared.sensor)
    most = ", ".join(f"{compared.names[node]} {shown(medians[node])}" for node in medians)
    said = f"a constant of each node, {shortened(most)}: give the law its gains, or take it off"
    if np.ptp(values) < abs(np.median(values)):
        said = f"a constant {shown(np.median(values))} of all nodes, such as a clock offset: take it off"
    without = compared._replace(readings=compared.readings - [medians[node] for node in compared.nodes.tolist()])
    yield losses(without.off(), compared.sds).mean(), f"readings contain {said}"
    if compared.groups is None:
        yield _swapped(compared)


def _lagging(compared: _ReadingsWithLaw, setup: TrackingSetup) -> tuple[float, str]:
    """The loss at the clock offset that fits best."""
    from scipy.optimize import minimize_scalar

    def loss(later: float) -> float:
        return float(losses(compared.off(later), compared.sds).mean())

    most = min(LONGEST_LAG, setup.steps // 2)
    coarse = min((setup.dt * lag for lag in range(-most, most + 1)), key=loss)
    found = minimize_scalar(loss, method="bounded", bounds=(coarse - setup.dt, coarse + setup.dt))
    when = f"{abs(found.x):.3g} s {'later' if found.x > 0 else 'earlier'}"
    return float(found.fun), f"readings fit the trajectory {when}: set time_origin of sensor or motion, or the clocks"


def _swapped(compared: _ReadingsWithLaw) -> tuple[float, str]:
    """The loss with the nodes to which the readings of each node fit best, each once."""
    from scipy.optimize import linear_sum_assignment

    count = len(compared.names)
    off = (compared.off(nodes=np.full_like(compared.nodes, node)) for node in range(count))
    sums = np.array([np.bincount(compared.nodes, losses(each, compared.sds), count) for each in off]).T
    rows, columns = linear_sum_assignment(sums)
    changed = np.flatnonzero((rows != columns) & sums.any(axis=1))
    pairs = ", ".join(f"{compared.names[i]} of {compared.names[columns[i]]}" for i in changed.tolist())
    said = f"readings seem to have the names of other nodes: those of {shortened(pairs)}: check names and positions"
    return float(sums[rows, columns].sum() / len(compared.nodes)), said
