"""A position from the measured distances of each step alone: a baseline without memory.

Requests of a step:

    Gather: readings  Compute

Ruan, Wang, Yang, Zhang (2020), section 1.2: each reading is a circle about its node, each pair of circles gives a
point, and the position is the weighted centroid of these points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, ClassVar, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Compute, Flow
from wsnsim.base.setups import TrackingSetup
from wsnsim.trackers.shared.dealing import PREDICT_CYCLES
from wsnsim.trackers.shared.heads import GaussianBelief, HeadFilter, only_predicted
from wsnsim.trackers.shared.readings import Evidence, gather_readings, ranges_of

PAIR_CYCLES = 40.0
"""To cross two circles (our count)."""
MISFIT_CYCLES = 10.0
"""To hold one crossing against one circle (our count)."""
FARTHEST: Final = 1e9
"""m: a longer distance is none (our choice)."""
SHORTEST: Final = 1e-6
"""m: two radii count as no less, so that no pair's weight is infinite; nodes nearer are in one place (our choice)."""
ALIKE: Final = 1e-9
"""Relative: crossings whose misfits differ by less fit equally well (our choice)."""


class Circles(NamedTuple):
    """About centres (S, 2), with radii (S,)."""

    centres: Floats
    radii: Floats


@part
class Trilateration(HeadFilter):
    """The weighted centroid of the points where circles about the nodes cross, each pair of circles giving one point.

    Two crossings: the one that fits the other circles better, by the sum of its distances from all circles; if both fit
    alike (there are only two circles, or all nodes stand in a line), the one nearer to where the motion expects the
    target. Circles that do not meet: the point between them that shares the gap in proportion to their radii, also
    where one lies in the other. A pair weighs 1/(d_i + d_j). Nodes in the same place make no pair.

    Only the position is measured: the rest of the state is the motion's prediction of the last belief, uncorrelated
    with it. The position's covariance is the weighted spread of the pairs' points, plus `floor`² on each axis. With
    fewer than two distances the whole belief is predicted. Which crossing is taken, the covariance and the prediction
    are our choice: the paper gives only the centroid.
    """

    paper: ClassVar[str] = "Ruan, Wang, Yang, Zhang (2020)"
    idea: ClassVar[str] = "the weighted centroid of the circles' crossings, without memory: a baseline"
    state: ClassVar[str] = "the last position found"
    messages: ClassVar[str] = "a reading up per member"
    variants: ClassVar[str] = ""
    needs: ClassVar[tuple[str, ...]] = ("ranges",)
    """Methods that its sensor must have in addition to the port's."""

    floor: Annotated[
        float, Quantity("m", ge=1e-6, le=1e7), "standard deviation that the position has if all pairs agree"
    ] = 0.1

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """The motion must have a position of two columns."""
        if any(len(motion.position) != 2 for motion in setup.filter_motions):
            yield Issue(
                ("tracker", "kind"),
                "trilateration finds a position of two columns; this motion has one; it can use constant_velocity or "
                "bounded_velocity",
            )

    def step(self, belief: GaussianBelief, scene: Scene) -> Flow[GaussianBelief]:
        """One step: N_act - 1 readings reach the head; all pairs of them are crossed there."""
        seen = yield from gather_readings(scene)
        count = len(seen.ids)
        pairs = count * (count - 1) // 2
        yield Compute(PREDICT_CYCLES * scene.steps + pairs * (PAIR_CYCLES + 2.0 * MISFIT_CYCLES * count))
        expected = only_predicted(belief, scene)
        place = np.array(scene.motion.position)
        found = located(_circles(seen, scene), expected.mean[place])
        if found is None:
            return expected
        mean, cov = expected.mean.copy(), expected.cov.copy()
        cov[place, :] = cov[:, place] = 0.0
        mean[place], cov[np.ix_(place, place)] = found[0], found[1] + self.floor**2 * np.eye(2)
        return replace(expected, mean=mean, cov=cov)


def located(circles: Circles, expected: Floats) -> tuple[Floats, Floats] | None:
    """The weighted centroid (2,) of the pairs' points, and their weighted spread (2, 2); None if there is no pair.

    `expected` (2,) decides between crossings that fit all circles alike.
    """
    points, weights = _pair_points(circles, expected)
    if not weights.size:
        return None
    shares = weights / weights.sum()
    mean = shares @ points
    around = np.sqrt(shares)[:, None] * (points - mean)
    return mean, around.T @ around


def _circles(seen: Evidence, scene: Scene) -> Circles:
    """A circle a reading, but for distances that are no number or beyond measure."""
    radii = ranges_of(seen.readings, scene.sensor)
    known = (radii >= 0.0) & (radii < FARTHEST)
    return Circles(seen.positions[known], radii[known])


def _pair_points(circles: Circles, expected: Floats) -> tuple[Floats, Floats]:
    """A point (pairs, 2) for each pair of circles, and its weight (pairs,)."""
    centres, radii = circles
    first, second = np.triu_indices(radii.size, 1)
    apart = np.linalg.norm(centres[second] - centres[first], axis=1)
    pairs = apart > SHORTEST
    first, second, apart = first[pairs], second[pairs], apart[pairs]
    along = (centres[second] - centres[first]) / apart[:, None]
    from_first, aside = _crossed(radii[first], radii[second], apart)
    middle = centres[first] + from_first[:, None] * along
    sideways = aside[:, None] * np.stack([-along[:, 1], along[:, 0]], axis=1)
    points = _better(np.stack([middle - sideways, middle + sideways]), circles, expected)
    return points, 1.0 / np.maximum(radii[first] + radii[second], SHORTEST)


def _crossed(first: Floats, second: Floats, apart: Floats) -> tuple[Floats, Floats]:
    """Where two circles cross: how far from the first centre towards the second, and how far aside, each (pairs,).

    Circles that do not meet cross nowhere aside, but between them.
    """
    total = np.maximum(first + second, SHORTEST)
    outside, within = apart > first + second, apart < np.abs(first - second)
    chord = 0.5 * (apart + (first - second) * (first + second) / apart)
    between = first + (apart - first - second) * first / total
    side = np.where(first > second, 1.0, -1.0)  # one in the other: beyond the second centre, or behind the first
    beside = side * first - (np.abs(first - second) - apart) * first / total
    along = np.where(outside, between, np.where(within, beside, chord))
    aside = np.sqrt(np.maximum((first - chord) * (first + chord), 0.0))
    return along, np.where(outside | within, 0.0, aside)


def _better(crossings: Floats, circles: Circles, expected: Floats) -> Floats:
    """Of two crossings (2, pairs, 2) of each pair, the one (pairs, 2) that fits all circles better."""
    centres, radii = circles
    off = np.abs(np.linalg.norm(crossings[:, :, None, :] - centres, axis=-1) - radii).sum(axis=-1)
    far = np.linalg.norm(crossings - expected, axis=-1)
    alike = np.abs(off[1] - off[0]) <= ALIKE * radii.sum()
    second = np.where(alike, far[1] < far[0], off[1] < off[0])
    chosen: Floats = np.where(second[:, None], crossings[1], crossings[0])
    return chosen
