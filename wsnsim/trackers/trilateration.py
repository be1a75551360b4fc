"""A position from the measured distances of each step alone: a baseline without memory.

Requests of a step:

    Gather: readings  Compute

Ruan, Wang, Yang, Zhang (2020), section 1.2: each reading is a circle about its node, each pair of circles gives a
point, and the position is the weighted centroid of these points.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow
from wsnsim.trackers.shared.dealing import PREDICT_CYCLES
from wsnsim.trackers.shared.fixes import OfRanges, usable
from wsnsim.trackers.shared.heads import GaussianBelief, only_predicted
from wsnsim.trackers.shared.readings import gather_readings

PAIR_CYCLES = 40.0
"""CPU cycles to intersect two circles (our count)."""
MISFIT_CYCLES = 10.0
"""CPU cycles to compare one intersection with one circle (our count)."""
SHORTEST: Final = 1e-6
"""Least sum of two radii (m), so that weights are finite; nodes closer than this form no pair (our choice)."""
EQUAL_FIT: Final = 1e-9
"""Two points fit equally well if their misfits differ by less than this share of the sum of all radii (our choice)."""


@part
class Trilateration(OfRanges):
    """The weighted centroid of the points where circles about the nodes intersect; each pair of circles gives one.

    Of two intersections it is the one with the smaller misfit, the sum of its distances from all circles. If both fit
    equally well (there are only two circles, or all nodes stand in a line), it is the one nearer to the predicted
    position. Circles that do not meet give the point that divides the gap between them in proportion to their radii,
    also if one lies in the other. A pair has the weight 1/(d_i + d_j). Nodes in the same place form no pair.

    Only the position is measured: the rest of the state is the motion's prediction of the last belief, uncorrelated
    with it. The position's covariance is the weighted spread of the pairs' points, plus `floor`² on each axis. With
    fewer than two distances the whole belief is predicted. How an intersection is chosen, the covariance
    and the prediction are our choice: the paper gives only the centroid.
    """

    floor: Annotated[
        float, Quantity("m", ge=1e-6, le=1e7), "standard deviation that the position has if all pairs agree"
    ] = 0.1

    def step(self, belief: GaussianBelief, scene: Scene) -> Flow[GaussianBelief]:
        """One step: N_act - 1 readings reach the head; it intersects the circles of each pair."""
        seen = yield from gather_readings(scene)
        count = len(seen.ids)
        pairs = count * (count - 1) // 2
        yield Compute(PREDICT_CYCLES * scene.steps + pairs * (PAIR_CYCLES + 2.0 * MISFIT_CYCLES * count))
        expected = only_predicted(belief, scene)
        columns = np.array(scene.motion.position)
        ranged = usable(seen, scene)
        found = weighted_centroid(ranged.seen.positions, ranged.ranges, expected.mean[columns])
        if found is None:
            return expected
        mean, cov = expected.mean.copy(), expected.cov.copy()
        cov[columns, :] = cov[:, columns] = 0.0
        mean[columns], cov[np.ix_(columns, columns)] = found[0], found[1] + self.floor**2 * np.eye(2)
        return replace(expected, mean=mean, cov=cov)


def weighted_centroid(centres: Floats, radii: Floats, expected: Floats) -> tuple[Floats, Floats] | None:
    """The weighted centroid (2,) of the pairs' points, and their weighted spread (2, 2); None if there is no pair.

    `expected` (2,) decides between intersections that fit all circles equally well.
    """
    points, weights = _pair_points(centres, radii, expected)
    if not weights.size:
        return None
    shares = weights / weights.sum()
    mean = shares @ points
    deviations = np.sqrt(shares)[:, None] * (points - mean)
    return mean, deviations.T @ deviations


def _pair_points(centres: Floats, radii: Floats, expected: Floats) -> tuple[Floats, Floats]:
    """A point (pairs, 2) for each pair of circles, and its weight (pairs,)."""
    first, second = np.triu_indices(radii.size, 1)
    distances = np.linalg.norm(centres[second] - centres[first], axis=1)
    pairs = distances > SHORTEST
    first, second, distances = first[pairs], second[pairs], distances[pairs]
    along = (centres[second] - centres[first]) / distances[:, None]
    from_first, offset = _intersections(radii[first], radii[second], distances)
    middle = centres[first] + from_first[:, None] * along
    sideways = offset[:, None] * np.stack([-along[:, 1], along[:, 0]], axis=1)
    points = _better_fit(np.stack([middle - sideways, middle + sideways]), centres, radii, expected)
    return points, 1.0 / np.maximum(radii[first] + radii[second], SHORTEST)


def _intersections(first: Floats, second: Floats, distances: Floats) -> tuple[Floats, Floats]:
    """Return where circles intersect: distance from the first centre towards the second, and offset from that line.

    Circles with radii `first` and `second` (pairs,) that do not meet get the point between them, with offset 0.
    """
    total = np.maximum(first + second, SHORTEST)
    outside, within = distances > first + second, distances < np.abs(first - second)
    chord = 0.5 * (distances + (first - second) * (first + second) / distances)
    between = first + (distances - first - second) * first / total
    side = np.where(first > second, 1.0, -1.0)  # one lies in the other: beyond the second centre, or behind the first
    nested = side * first - (np.abs(first - second) - distances) * first / total
    along = np.where(outside, between, np.where(within, nested, chord))
    offset = np.sqrt(np.maximum((first - chord) * (first + chord), 0.0))
    return along, np.where(outside | within, 0.0, offset)


def _better_fit(intersections: Floats, centres: Floats, radii: Floats, expected: Floats) -> Floats:
    """Return which of the two intersections (2, pairs, 2) fits all circles better, (pairs, 2)."""
    misfits = np.abs(np.linalg.norm(intersections[:, :, None, :] - centres, axis=-1) - radii).sum(axis=-1)
    errors = np.linalg.norm(intersections - expected, axis=-1)
    equal = np.abs(misfits[1] - misfits[0]) <= EQUAL_FIT * radii.sum()
    second = np.where(equal, errors[1] < errors[0], misfits[1] < misfits[0])
    chosen: Floats = np.where(second[:, None], intersections[1], intersections[0])
    return chosen
