"""Track initiation: from a prior around the true start, and from readings alone.

draw(start (D,), rng) -> Estimate
estimate(readings (S,) or (S, M), positions (S, 2), traits (S, T), sensor, motion, prior) -> Estimate
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import numpy as np

from wsnsim.base.arrays import Estimate, Floats, finite, near, rows
from wsnsim.base.errors import Issue
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import MotionModel, SensorModel
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.models.bounds import ACCURACY, DEVIATION, PAYLOAD, STATE

DEVIATIONS = (5.0, 3.0, 5.0, 3.0)
UNITS = ("m", "m/s", "m", "m/s")
"""Units of the state that the default prior is for."""
TYPICAL = {"m": 5.0, "m/s": 3.0, "rad/s": 0.1}
"""Standard deviations by unit, for the example in a message; 1 for any other unit."""
MOST_SEARCHES = 1_000_000
"""Greatest number of instants in a run at which nodes search for a target (our choice)."""
LEVELS = 8
"""Greatest number of times that the lattice shrinks, each time by a factor of about 3."""


@part
class AroundTruth:
    """A Gaussian prior whose mean is sampled around the true start, with the same sample for every tracker.

    Our choice, with its standard deviations: Jiang, Song, Lin (2013) gives no prior.
    """

    sd: Annotated[tuple[float, ...], DEVIATION, "standard deviation of each column of the state"] = DEVIATIONS
    mean: Annotated[
        tuple[float, ...] | None, STATE, "mean of each column of the state; left out: sampled around the start"
    ] = None

    def draw(self, start: Floats, rng: np.random.Generator) -> Estimate:
        """The prior that filters are given: N(m0, diag(sd²)) with m0 ~ N(start, diag(sd²)), or the mean given."""
        sd = np.array(self.sd)
        mean = start + sd * rng.standard_normal(sd.size) if self.mean is None else np.array(self.mean)
        return Estimate(mean=mean, cov=np.diag(sd**2))

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the prior has another dimension than the state, or is the default of another state."""
        motion = setup.motions[0]
        columns = motion.columns
        if self.sd == DEVIATIONS and len(columns) == len(DEVIATIONS) and tuple(motion.units) != UNITS:
            yield Issue(
                ("prior", "sd"),
                f"the default is for columns in {', '.join(UNITS)}; the state is {_named(motion)}: "
                f"give {example_of(motion)}",
            )
        for key, values in (("sd", self.sd), ("mean", self.mean)):
            if values is not None and len(values) != len(columns):
                found = f"{len(values)} values for a state of {len(columns)} columns: {' '.join(columns)}"
                hint = f"; this is the default, give {example_of(motion)}" if values == DEVIATIONS else ""
                yield Issue(("prior", key), found + hint)


def _named(motion: MotionModel) -> str:
    """The columns of a state with their units."""
    pairs = zip(motion.columns, motion.units, strict=True)
    return ", ".join(f"{column} in {unit}" if unit else column for column, unit in pairs)


def example_of(motion: MotionModel) -> str:
    """Return the line of a scenario with a standard deviation for each state column of a motion model."""
    return f"prior: {{sd: [{', '.join(f'{TYPICAL.get(unit, 1.0):g}' for unit in motion.units)}]}}"


@part
class FromReadings:
    """A new track from readings: the position from their likelihood, the other columns from the spread of the prior.

    Our choice; Jiang, Song, Lin (2013) has no reacquisition. Mean and covariance of the position are those of its
    likelihood on a lattice that shrinks around them. One reading of a distance gives a ring around its node, two give
    the two crossings of their rings; one bearing gives a wedge, two cross; many give the inverse of the Fisher
    information. Beyond `outlier` standard deviations the
    log-likelihood of a reading falls with the logarithm of its deviation only (Student's t instead of a Gaussian), so
    that the other readings outweigh a few false ones.
    """

    lattice: Annotated[
        int,
        Quantity("", ge=11, le=201),
        "points along a side of the lattice; for a position of one column, their square",
    ] = 41
    outlier: Annotated[
        float, Quantity("", ge=1e-3, le=1e6), "standard deviations beyond which a reading counts as false"
    ] = 6.0
    floor: Annotated[float, ACCURACY, "lower bound of the standard deviation of the position"] = 1.0
    poll: Annotated[
        float | None,
        Quantity("s", ge=1e-2, le=1e6),
        "interval at which awake nodes search for a target without a track, for moving heads; left out: each step",
    ] = None
    detection_bits: Annotated[int, PAYLOAD, "bits of the message that a target has been detected"] = PACKET_BITS
    answer_bits: Annotated[int, PAYLOAD, "bits of the reading that answers that message"] = PACKET_BITS

    def estimate(
        self,
        readings: Floats,
        positions: Floats,
        traits: Floats,
        sensor: SensorModel,
        motion: MotionModel,
        prior: Estimate,
    ) -> Estimate:
        """The estimate from S >= 1 readings; the position's standard deviation is in [`floor`, sensing range].

        Readings that are not finite are ignored; if none remains, the target may be anywhere around the nodes. Columns
        other than the position have mean 0 and the mean square of the prior, mean² + variance.
        """
        known, columns = finite(sensor, readings), list(motion.position)
        point, spread = self._locate(
            readings[known], positions[known], traits[known], sensor, _box(positions[:, : len(columns)], sensor.reach)
        )
        mean = np.zeros(prior.mean.size)
        cov = np.diag(prior.mean**2 + np.diag(prior.cov))
        mean[columns] = point
        cov[np.ix_(columns, columns)] = _bounded(spread, self.floor, sensor.reach)
        return Estimate(mean=mean, cov=cov)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the sensing range is infinite, or if `poll` does not divide the step or is too short."""
        if np.isinf(setup.sensor.reach) and not setup.unlabelled:
            yield Issue(("sensor",), "its reach must be finite in a network: a new track is searched for within it")
        if self.poll is not None and isinstance(setup, NetworkSetup) and setup.nodes_search:
            times = setup.dt / self.poll
            if times * setup.steps > MOST_SEARCHES:
                yield Issue(
                    ("acquire", "poll"),
                    f"{times * setup.steps:.3g} searches in a run are too many; {MOST_SEARCHES:,} are allowed",
                )
            if abs(times - round(times)) > 1e-9 * times or round(times) < 1:
                yield Issue(
                    ("acquire", "poll"), f"a step of {setup.dt:g} s must be a whole number of times {self.poll:g} s"
                )

    def _locate(
        self, readings: Floats, positions: Floats, traits: Floats, sensor: SensorModel, box: tuple[Floats, Floats]
    ) -> tuple[Floats, Floats]:
        """Mean (P,) and covariance (P, P) of the position in a box, given by its centre (P,) and half width (P,).

        The box shrinks to the best lattice points while the likelihood is too narrow for the lattice. If these points
        lie apart, like the two crossings of two rings, the likelihood is tempered until it covers several points.
        """
        for _ in range(LEVELS):
            points = _lattice(*box, self.lattice)
            score = self._score(points, readings, positions, traits, sensor)
            weights, whole = _tempered(score)
            narrower = _around_best(points, score)
            if whole or np.all(narrower[1] > 0.9 * box[1]):
                break
            box = narrower
        mean = points @ weights
        apart = points - mean[:, None]
        return mean, (apart * weights) @ apart.T

    def _score(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, sensor: SensorModel
    ) -> Floats:
        """(N,) log-likelihood of the readings at points (P, N), with the tails of Student's t."""
        means, _, variances = sensor.linearise(points, positions, traits)
        limit = self.outlier**2
        measured = near(sensor, rows(sensor, readings)[:, None], means)
        squares = limit * np.log1p((measured - means) ** 2 / (limit * variances))
        total: Floats = -0.5 * (squares + np.log(variances)).sum(axis=0)

        return total


def _box(positions: Floats, reach: float) -> tuple[Floats, Floats]:
    """Centre and half width of the box in which a target may be that the nodes sense."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    return (low + high) / 2, (high - low) / 2 + reach


def _lattice(centre: Floats, half: Floats, side: int) -> Floats:
    """(P, side²) points of a square lattice, or of a line, edges included."""
    if centre.size == 1:
        return centre[:, None] + half[:, None] * np.linspace(-1.0, 1.0, side * side)
    offsets = np.linspace(-1.0, 1.0, side)
    x, y = np.meshgrid(centre[0] + half[0] * offsets, centre[1] + half[1] * offsets)
    return np.stack([x.ravel(), y.ravel()])


def _around_best(points: Floats, score: Floats) -> tuple[Floats, Floats]:
    """Centre and half width of the box around the best twentieth of the points, enlarged by one lattice step."""
    best = points[:, np.argpartition(score, -(score.size // 20))[-(score.size // 20) :]]
    low, high = best.min(axis=1), best.max(axis=1)
    side = round(score.size ** (1.0 / len(points)))
    step = (points.max(axis=1) - points.min(axis=1)) / (side - 1)
    return (low + high) / 2, (high - low) / 2 + step


def _tempered(score: Floats, enough: float = 12.0) -> tuple[Floats, bool]:
    """Normalised weights exp(β score), and whether β = 1. β is the largest 2^-n with `enough` effective points."""
    above = score - score.max()
    for halvings in range(64):
        weights = np.exp(above * 0.5**halvings)
        weights /= weights.sum()
        if (weights**2).sum() * enough <= 1.0:
            return weights, halvings == 0
    return weights, False


def _bounded(cov: Floats, floor: float, cap: float) -> Floats:
    """The covariance, its standard deviations along its own axes limited to [floor, cap]."""
    values, vectors = np.linalg.eigh((cov + cov.T) / 2)
    result: Floats = (vectors * np.clip(values, floor**2, cap**2)) @ vectors.T
    return result
