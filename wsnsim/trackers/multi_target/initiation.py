"""New tracks from detections that no track explains: where the loci of several nodes' detections meet.

    found(free, scans, facts, rules) -> [Start]        free: of each scan (M,), which of its detections may be used

A detection of a range is a circle, one of a bearing a ray, and one of both a point. Circles or rays of neighbouring
nodes cross in candidates. Each is scored by the log-odds that a new target is there rather than clutter, given its own
detections and the best one of every other node. The best candidate takes its detections away, and so on. Its position
is that of least squares over all of them.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, components_of, near
from wsnsim.base.scans import Facts
from wsnsim.base.sensing import detected
from wsnsim.trackers.multi_target.frames import LEAST_SEEN, Sorted
from wsnsim.trackers.multi_target.management import TrackRules
from wsnsim.trackers.shared.fixes import FARTHEST
from wsnsim.trackers.shared.readings import Evidence, ranges_of

NEIGHBOURS: Final = 4
"""A node's detections are crossed with those of so many nearest nodes that scanned (our choice)."""
GATE: Final = 4.0
"""Standard deviations within which a detection supports a candidate (our choice)."""
ITERATIONS: Final = 5
"""Gauss-Newton steps of the position of a new track (our choice)."""
LEAST_CLUTTER: Final = 1e-9
"""False detections in a scan where none are expected, so that log-odds are finite."""
LARGEST_VOLUME: Final = 1e9
"""Greatest volume of a space of readings, where it is unbounded and none of them are false (our choice)."""
LOG_TWO_PI: Final = math.log(2.0 * math.pi)


class Start(NamedTuple):
    """A new track: position (2,), covariance (2, 2), log-odds of its target, and its row in each scan, or -1."""

    point: Floats
    cov: Floats
    odds: float
    used: list[int]


class _Crossings(NamedTuple):
    """Points (n, 2), and the two scans and rows (n, 2) that cross there: the same twice for a point of a single one."""

    points: Floats
    scans: Ints
    rows: Ints


def can_start(sensor: Any) -> bool:
    """Whether tracks can start from the readings of a sensor model."""
    return _has_bearings(sensor) or hasattr(sensor, "ranges")


def density(facts: Facts) -> float:
    """The density of false detections in the space of readings, above 0 even where there are none."""
    return max(facts.clutter, LEAST_CLUTTER) / min(facts.volume, LARGEST_VOLUME)


def found(free: list[Bools], scans: Sorted, facts: Facts, rules: TrackRules) -> list[Start]:
    """The new tracks of a step, the most probable one first."""
    left, starts = [rows.copy() for rows in free], []
    candidates = _candidates(left, scans, facts)
    while len(candidates.points):
        odds, used, covs = _scored(candidates, left, scans, facts, math.log(rules.births))
        kept = (np.count_nonzero(used >= 0, axis=1) >= rules.support) & (odds >= rules.least_odds)
        if not kept.any():
            break
        best = int(np.argmax(np.where(kept, odds, -np.inf)))
        point, cov = _refined(candidates.points[best], covs[best], used[best], scans, facts)
        starts.append(Start(point, cov, float(odds[best]), used[best].tolist()))
        for scan, row in enumerate(used[best].tolist()):
            left[scan][row : row + 1] = False  # none where the row is -1
        still = [all(left[s][r] for s, r in zip(*two, strict=True)) for two in zip(*candidates[1:], strict=True)]
        candidates = _Crossings(*(part[kept & still] for part in candidates))
    return starts


def _scored(
    candidates: _Crossings, left: list[Bools], scans: Sorted, facts: Facts, births: float
) -> tuple[Floats, Ints, Floats]:
    """Log-odds (n,), the row (n, S) of each scan that belongs to each candidate, or -1, and covariances (n, 2, 2).

    Crossing densities of its own detections integrate to 1 / |det H| over the plane, with the slopes H.
    """
    points, sensor, count = candidates.points, facts.sensor, len(candidates.points)
    means, slopes, variances = sensor.linearise(np.ascontiguousarray(points.T), scans.positions, scans.traits)
    size, each = len(components_of(sensor)), np.arange(count)
    seen = facts.probability * np.maximum(detected(sensor, points, scans.positions), LEAST_SEEN) * scans.heard  # (n, S)
    information = np.repeat(_least_information(sensor)[None], count, axis=0)
    odds: Floats = np.full(count, births)
    for k in range(2):
        counts = (k == 0) | (candidates.scans[:, 1] != candidates.scans[:, 0])
        for row in (candidates.scans[:, k] * size + p for p in range(size)):
            slope, variance = slopes[row, :, each], variances[row, each]
            information += np.where(counts, 1.0 / variance, 0.0)[:, None, None] * slope[:, :, None] * slope[:, None]
            odds -= np.where(counts, 0.5 * np.log(variance), 0.0)
        odds += np.where(counts, np.log(seen[each, candidates.scans[:, k]] / density(facts)), 0.0)
    odds -= 0.5 * np.log(np.linalg.det(information))
    covs = np.asarray(np.linalg.inv(information), dtype=np.float64)
    used: Ints = np.full((count, len(scans.nodes)), -1, dtype=np.int64)
    alone = np.log1p(-np.minimum(seen, 1.0 - LEAST_CLUTTER))  # (n, S)
    alone[each[:, None], candidates.scans] = 0.0
    odds += alone.sum(axis=1)
    for scan in np.flatnonzero([free.any() for free in left]).tolist():
        rows, places = slice(scan * size, (scan + 1) * size), np.flatnonzero(left[scan])
        widths = variances[rows] + np.einsum("dpn,npq,dqn->dn", slopes[rows], covs, slopes[rows])
        values = scans.detections[scan][places]
        off = np.stack([near(sensor, value[:, None], means[rows]) - means[rows] for value in values])
        squares = (off**2 / widths).sum(axis=1)  # (M, n)
        best = np.argmin(squares, axis=0)
        square = squares[best, each]
        logs = -0.5 * (square + np.log(widths).sum(axis=0) + size * LOG_TWO_PI)
        gains = np.log(seen[:, scan] / density(facts)) + logs - alone[:, scan]
        taken = (square <= GATE**2) & (gains > 0.0) & (candidates.scans != scan).all(axis=1)
        used[taken, scan] = places[best[taken]]
        odds += np.where(taken, gains, 0.0)
    used[each[:, None], candidates.scans] = candidates.rows
    return odds, used, covs


def _refined(point: Floats, cov: Floats, used: Ints, scans: Sorted, facts: Facts) -> tuple[Floats, Floats]:
    """The least-squares position (2,) of some detections and its covariance, by Gauss-Newton steps from a candidate."""
    chosen, sensor = np.flatnonzero(used >= 0), facts.sensor
    measured = np.concatenate([scans.detections[scan][used[scan]] for scan in chosen.tolist()])
    place, spread, least, known = point, cov, np.inf, _least_information(sensor)
    for _ in range(ITERATIONS):
        linear = sensor.linearise(place[:, None], scans.positions[chosen], scans.traits[chosen])
        off, slopes, variances = near(sensor, measured, linear[0][:, 0]) - linear[0][:, 0], linear[1][..., 0], linear[2]
        cost = float((off**2 / variances[:, 0]).sum())
        if not cost < least:
            break
        least, point, weighted = cost, place, slopes / variances
        spread = np.asarray(np.linalg.inv(weighted.T @ slopes + known), dtype=np.float64)
        place = point + spread @ (weighted.T @ off)
    return point, spread


def _least_information(sensor: Any) -> Floats:
    """(2, 2) what is known of a target before any detection: that it is not much farther than a sensing range."""
    known: Floats = np.eye(2) / min(sensor.reach, FARTHEST) ** 2
    return known


def _candidates(left: list[Bools], scans: Sorted, facts: Facts) -> _Crossings:
    """The points where free detections of neighbouring nodes cross."""
    sensor, rows = facts.sensor, [np.flatnonzero(free).tolist() for free in left]
    loci = [_loci(scan, left[scan], scans, sensor) for scan in range(len(left))]
    if len(components_of(sensor)) > 1:
        single = np.array([(scan, row) for scan, mine in enumerate(rows) for row in mine]).reshape(-1, 2)
        points = np.concatenate([np.empty((0, 2)), *loci])
        return _Crossings(points, single[:, [0, 0]], single[:, [1, 1]])
    crossed = [
        (one, other, i, j)
        for one, other in _neighbours([scan for scan, mine in enumerate(rows) if mine], scans.positions, sensor.reach)
        for i in range(len(rows[one]))
        for j in range(len(rows[other]))
    ]
    pairs = np.array(crossed, dtype=np.int64).reshape(-1, 4)
    radii = np.array([(loci[one][i], loci[other][j]) for one, other, i, j in crossed]).reshape(-1, 2)
    cross = _rays if _has_bearings(sensor) else _circles
    points, which = cross(scans.positions[pairs[:, 0]], scans.positions[pairs[:, 1]], *radii.T)
    chosen = [(rows[one][i], rows[other][j]) for one, other, i, j in pairs[which].tolist()]
    return _Crossings(points, pairs[which, :2], np.array(chosen, dtype=np.int64).reshape(-1, 2))


def _neighbours(active: list[int], positions: Floats, reach: float) -> list[tuple[int, int]]:
    """Pairs of scans with free detections, of nodes that may sense the same target: of each the nearest ones."""
    places = positions[active]
    away = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    away[away == 0.0] = np.inf
    nearest = np.argsort(away, axis=1, kind="stable")[:, :NEIGHBOURS]
    return sorted({
        (min(active[one], active[other]), max(active[one], active[other]))
        for one in range(len(active)) for other in nearest[one].tolist() if away[one, other] < 2.0 * reach
    })  # fmt: skip


def _loci(scan: int, free: Bools, scans: Sorted, sensor: Any) -> Floats:
    """Of each free detection of a scan, the radius (M,) of its circle, the angle (M,) of its ray, or its point (M, 2).

    Angles are from the x-axis.
    """
    values, count = scans.detections[scan][free], int(free.sum())
    traits = np.repeat(scans.traits[scan : scan + 1], count, axis=0)
    if not _has_bearings(sensor):
        positions = np.repeat(scans.positions[scan : scan + 1], count, axis=0)
        return ranges_of(Evidence((), values[:, 0], positions, traits), sensor)
    names = tuple(sensor.trait_names)
    angles: Floats = values[:, -1] + (traits[:, names.index("heading")] if "heading" in names else 0.0)
    if values.shape[1] == 1:
        return angles
    points: Floats = scans.positions[scan] + values[:, :1] * np.column_stack([np.cos(angles), np.sin(angles)])
    return points


def _has_bearings(sensor: Any) -> bool:
    return components_of(sensor) in (("bearing",), ("range", "bearing"))


def _circles(one: Floats, other: Floats, a: Floats, b: Floats) -> tuple[Floats, Ints]:
    """The crossings (m, 2) of n pairs of circles, and their pairs (m,); a point between those that do not meet.

    Args:
        one: (n, 2) the centre of the first circle of each pair.
        other: (n, 2) that of the second, elsewhere.
        a: (n,) the radius of the first.
        b: (n,) that of the second.
    """
    apart = np.hypot(*(other - one).T)
    along = (apart**2 + a**2 - b**2) / (2.0 * apart)
    aside = np.sqrt(np.maximum(a**2 - along**2, 0.0))[:, None]
    unit = (other - one) / apart[:, None]
    middle, across = one + along[:, None] * unit, np.column_stack([-unit[:, 1], unit[:, 0]])
    return np.concatenate([middle + aside * across, middle - aside * across]), np.tile(np.arange(len(a)), 2)


def _rays(one: Floats, other: Floats, a: Floats, b: Floats) -> tuple[Floats, Ints]:
    """The crossings (m, 2) of those of n pairs of rays that meet, and their pairs (m,); angles as `_circles`' radii."""
    (dx, dy), turn = (other - one).T, np.sin(b - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        along, across = (dx * np.sin(b) - dy * np.cos(b)) / turn, (dx * np.sin(a) - dy * np.cos(a)) / turn
    meets = np.flatnonzero((along > 0.0) & (across > 0.0) & np.isfinite(along) & np.isfinite(across))
    return one[meets] + along[meets, None] * np.column_stack([np.cos(a[meets]), np.sin(a[meets])]), meets
