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
from wsnsim.trackers.shared.readings import Evidence, ranges_of

NEIGHBOURS: Final = 4
"""A node's detections are crossed with those of so many nearest nodes that scanned (our choice)."""
GATE: Final = 4.0
"""Standard deviations within which a detection supports a candidate (our choice)."""
ITERATIONS: Final = 5
"""Gauss-Newton steps of the position of a new track (our choice)."""
LEAST_CLUTTER: Final = 1e-9
"""False detections in a scan where none are expected, so that log-odds are finite."""
LOG_TWO_PI: Final = math.log(2.0 * math.pi)


class Start(NamedTuple):
    """A new track: position (2,), covariance (2, 2), log-odds of its target, and its row in each scan, or -1."""

    point: Floats
    cov: Floats
    odds: float
    used: list[int]


class _Candidates(NamedTuple):
    """Points (n, 2), and the two scans and rows (n, 2) that cross there: the same twice for a point of a single one."""

    points: Floats
    scans: Ints
    rows: Ints


def can_start(sensor: Any) -> bool:
    """Whether tracks can start from the readings of a sensor model."""
    return _has_bearings(sensor) or hasattr(sensor, "ranges")


def density(facts: Facts) -> float:
    """The density of false detections in the space of readings."""
    return max(facts.clutter, LEAST_CLUTTER) / facts.volume


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
        candidates = _Candidates(*(part[kept & still] for part in candidates))
    return starts


def _scored(
    candidates: _Candidates, left: list[Bools], scans: Sorted, facts: Facts, births: float
) -> tuple[Floats, Ints, Floats]:
    """Log-odds (n,), the row (n, S) of each scan that belongs to each candidate, or -1, and covariances (n, 2, 2).

    Crossing densities of its own detections integrate to 1 / |det H| over the plane, with the slopes H.
    """
    points, sensor, count = candidates.points, facts.sensor, len(candidates.points)
    means, slopes, variances = sensor.linearise(np.ascontiguousarray(points.T), scans.positions, scans.traits)
    size, each = len(components_of(sensor)), np.arange(count)
    seen = facts.probability * np.maximum(detected(sensor, points, scans.positions), LEAST_SEEN)  # (n, S)
    information = np.repeat(np.eye(2)[None] / min(sensor.reach, 1e9) ** 2, count, axis=0)
    odds = np.full(count, births)
    for k in range(2):
        counts = (k == 0) | (candidates.scans[:, 1] != candidates.scans[:, 0])
        for row in (candidates.scans[:, k] * size + p for p in range(size)):
            slope, variance = slopes[row, :, each], variances[row, each]
            information += np.where(counts, 1.0 / variance, 0.0)[:, None, None] * slope[:, :, None] * slope[:, None]
            odds -= np.where(counts, 0.5 * np.log(variance), 0.0)
        odds += np.where(counts, np.log(seen[each, candidates.scans[:, k]] / density(facts)), 0.0)
    odds -= 0.5 * np.log(np.linalg.det(information))
    covs, used = np.linalg.inv(information), np.full((count, len(scans.nodes)), -1)
    for scan, values in enumerate(scans.detections):
        rows = slice(scan * size, (scan + 1) * size)
        widths = variances[rows] + np.einsum("dpn,npq,dqn->dn", slopes[rows], covs, slopes[rows])
        gains, best = np.full(count, -np.inf), np.full(count, -1)
        if left[scan].any():
            places = np.flatnonzero(left[scan])
            off = np.stack([near(sensor, value[:, None], means[rows]) - means[rows] for value in values[places]])
            squares = (off**2 / widths).sum(axis=1)  # (M, n)
            best = np.argmin(squares, axis=0)
            square = squares[best, each]
            logs = -0.5 * (square + np.log(widths).sum(axis=0) + size * LOG_TWO_PI)
            gains = np.where(square <= GATE**2, np.log(seen[:, scan] / density(facts)) + logs, -np.inf)
            best = places[best]
        alone = np.log1p(-np.minimum(seen[:, scan], 1.0 - LEAST_CLUTTER))
        own = candidates.scans == scan
        used[:, scan] = np.where(gains > alone, best, -1)
        odds += np.where(own.any(axis=1), 0.0, np.maximum(gains, alone))
        for k in range(2):
            used[own[:, k], scan] = candidates.rows[own[:, k], k]
    return odds, used, covs


def _refined(point: Floats, cov: Floats, used: Ints, scans: Sorted, facts: Facts) -> tuple[Floats, Floats]:
    """The least-squares position (2,) of some detections and its covariance, by Gauss-Newton steps from a candidate."""
    chosen, sensor = np.flatnonzero(used >= 0), facts.sensor
    measured = np.concatenate([scans.detections[scan][used[scan]] for scan in chosen.tolist()])
    place, spread, least = point, cov, np.inf
    for _ in range(ITERATIONS):
        linear = sensor.linearise(place[:, None], scans.positions[chosen], scans.traits[chosen])
        off, slopes, variances = near(sensor, measured, linear[0][:, 0]) - linear[0][:, 0], linear[1][..., 0], linear[2]
        cost = float((off**2 / variances[:, 0]).sum())
        if not cost < least:
            break
        least, point, weighted = cost, place, slopes / variances
        cov = np.linalg.pinv(weighted.T @ slopes, hermitian=True)
        spread, place = cov, point + cov @ (weighted.T @ off)
    return point, spread


def _candidates(left: list[Bools], scans: Sorted, facts: Facts) -> _Candidates:
    """The points where free detections of neighbouring nodes cross."""
    sensor, loci = facts.sensor, [_loci(scan, left[scan], scans, facts.sensor) for scan in range(len(left))]
    points, pairs, rows = [np.empty((0, 2))], [np.empty((0, 2), np.int64)], [np.empty((0, 2), np.int64)]
    places = [np.flatnonzero(free) for free in left]
    for one in range(len(left)):
        if len(components_of(sensor)) > 1:
            points.append(loci[one])
            pairs.append(np.full((len(loci[one]), 2), one))
            rows.append(np.column_stack([places[one], places[one]]))
            continue
        away = np.hypot(*(scans.positions - scans.positions[one]).T)
        for other in np.argsort(away, kind="stable")[: NEIGHBOURS + 1].tolist():
            if away[other] > 0.0 and (other > one or one not in _nearest(scans.positions, other)):
                cross = _rays if _has_bearings(sensor) else _circles
                grid = np.array(np.meshgrid(np.arange(len(loci[one])), np.arange(len(loci[other])), indexing="ij"))
                at, which = cross(scans.positions[one], loci[one], scans.positions[other], loci[other], grid)
                points.append(at)
                pairs.append(np.tile([one, other], (len(at), 1)))
                rows.append(np.column_stack([places[one][which[0]], places[other][which[1]]]))
    return _Candidates(np.concatenate(points), np.concatenate(pairs), np.concatenate(rows))


def _nearest(positions: Floats, node: int) -> list[int]:
    """The nodes whose detections are crossed with those of a node, itself included."""
    away = np.hypot(*(positions - positions[node]).T)
    nearest: list[int] = np.argsort(away, kind="stable")[: NEIGHBOURS + 1].tolist()
    return nearest


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
    angles = values[:, -1] + (traits[:, names.index("heading")] if "heading" in names else 0.0)
    if values.shape[1] == 1:
        return angles
    return scans.positions[scan] + values[:, :1] * np.column_stack([np.cos(angles), np.sin(angles)])


def _has_bearings(sensor: Any) -> bool:
    return components_of(sensor) in (("bearing",), ("range", "bearing"))


def _circles(one: Floats, radii: Floats, other: Floats, others: Floats, grid: Ints) -> tuple[Floats, Ints]:
    """The crossings (n, 2) of each pair of circles, a point between those that do not meet, and the pairs (2, n)."""
    a, b, apart = radii[grid[0]].reshape(-1), others[grid[1]].reshape(-1), math.hypot(*(other - one))
    along = (apart**2 + a**2 - b**2) / (2.0 * apart)
    aside = np.sqrt(np.maximum(a**2 - along**2, 0.0))
    ex, ey = (other - one) / apart
    middle = one + along[:, None] * np.array([ex, ey])
    points = np.concatenate([middle + sign * aside[:, None] * np.array([-ey, ex]) for sign in (1.0, -1.0)])
    return points, np.tile(grid.reshape(2, -1), 2)


def _rays(one: Floats, angles: Floats, other: Floats, others: Floats, grid: Ints) -> tuple[Floats, Ints]:
    """The crossings (n, 2) of each pair of rays that meet, and these pairs (2, n)."""
    pairs = grid.reshape(2, -1)
    a, b, (dx, dy) = angles[pairs[0]], others[pairs[1]], other - one
    turn = np.sin(b - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        along, across = (dx * np.sin(b) - dy * np.cos(b)) / turn, (dx * np.sin(a) - dy * np.cos(a)) / turn
    meets = (along > 0.0) & (across > 0.0) & np.isfinite(along) & np.isfinite(across)
    points = one + along[meets, None] * np.column_stack([np.cos(a[meets]), np.sin(a[meets])])
    return points, pairs[:, meets]
