"""The sensor model of readings that were recorded: a file in place of samples from a law.

recordings(names, targets, steps, dt) -> one Recording per target, (steps + 1, N)
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np

from wsnsim.base.arrays import SAME_TIME, Floats, Ints, first_steps, is_relative, means, near, since
from wsnsim.base.detections import ReportsScans
from wsnsim.base.errors import Issue, RunError, shortened
from wsnsim.base.files import content_digest
from wsnsim.base.initial_conditions import joined_by_name, node_names
from wsnsim.base.optional_ports import ConstantGaussian, LimitsReadings, Recording, Replays
from wsnsim.base.part import OfRole, Quantity, part
from wsnsim.base.ports import MotionModel, SensorModel
from wsnsim.base.sensing import is_perfect, recorded_traits
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.models import csvfile, row_checks
from wsnsim.models.bearing import TURN
from wsnsim.models.recorded_track import RecordedTrack
from wsnsim.models.sensing import OfLaw
from wsnsim.models.unit_checks import remedy

COUNT: Final = "count"
"""The trait of a node that is the number of readings of which its reading is the mean. It may change at each step."""


@part
class RepeatedReadings(OfLaw):
    """What filters assume of means of readings: the last trait of a node, `count`, says of how many.

    With Gaussian noise of a constant variance R, the n readings of a node in a step have the likelihood of n times
    their mean, but for a factor that does not depend on the state; the variance of the mean is R / n.
    """

    law: Any

    @property
    def trait_names(self) -> tuple[str, ...]:
        """The law's traits, and the count."""
        return (*self.law.trait_names, COUNT)

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, T + 1) the law's traits, and a count of 1."""
        return np.column_stack([self.law.draw_traits(nodes, rng), np.ones(nodes)])

    def measure(self, points: Floats, positions: Floats, traits: Floats, noise: Floats) -> Floats:
        """(n,) means of readings, given standard normal noise."""
        own, counts = traits[:, :-1], traits[:, -1]
        expected: Floats = self.law.measure(points, positions, own, np.zeros(len(noise)))
        drawn = near(self.law, self.law.measure(points, positions, own, noise), expected)
        return expected + (drawn - expected) / np.sqrt(counts)

    def log_likelihood(
        self, points: Floats, readings: Floats, positions: Floats, traits: Floats, owners: Ints | None = None
    ) -> Floats:
        """(N,) of all readings that the means stand for, but for a constant; as `SensorModel.log_likelihood`."""
        own, counts = traits[:, :-1], traits[:, -1].astype(np.int64)
        if owners is not None and readings.size:
            result: Floats = counts[owners] * self.law.log_likelihood(points, readings, positions, own, owners)
            return result
        each = np.repeat(np.arange(readings.size), counts)
        joint: Floats = self.law.log_likelihood(points, readings[each], positions[each], own[each])
        return joint

    def linearise(self, points: Floats, positions: Floats, traits: Floats) -> tuple[Floats, Floats, Floats]:
        """Expected readings (S, N), gradients (S, P, N), and the variances of the means (S, N)."""
        means, gradients, variances = self.law.linearise(points, positions, traits[:, :-1])
        return means, gradients, variances / traits[:, -1:]

    def assumed(self, gains: str, inflate: bool) -> RepeatedReadings:
        """The model that another filter assumes of the same means."""
        return RepeatedReadings(law=self.law.assumed(gains, inflate))

    def __getattr__(self, name: str) -> Any:
        """What else the law can do with a single reading, such as `ranges`: a mean is one."""
        if name.startswith("_") or name == "law":
            raise AttributeError(name)
        return getattr(self.law, name)


TIME: Final = Quantity("s", ge=-1e15, le=1e15)
NO_LIMITS: Final = (-math.inf, math.inf)


@part
class ReadingColumns:
    """The names of the columns of a file with recorded readings."""

    sheet: ClassVar[str] = ""

    time: Annotated[str, "the time, in s"] = "time"
    node: Annotated[str, "the name of the node"] = "node"
    reading: Annotated[str, "the reading, in the unit of the law"] = "reading"
    target: Annotated[str, "the number of the target, from 0; a file of one target may lack it"] = "target"


@part
class RecordedSensor(OfLaw):
    """Readings that were recorded, from a CSV file with a row per reading: time, node, reading, and perhaps target.

    Rows may stand in any order. A reading at the time t belongs to the first step k with k dt >= t - `time_origin`, so
    that no step uses a reading of the future, but for the rounding of times, which is 1 µs; those before the origin
    belong to step 0, those after the last step are not used. A node without a reading in a step is silent. Of several
    readings of a node in a step, the `mean` or the `last` counts as one reading, or `all` enter the likelihood: the
    mean of n readings, with the variance R / n. The mean of angles is their mean direction, whatever their order. Nodes
    are known by the names that the deployment gives them, else by their numbers. No reading is sampled, and where the
    target is plays no part in who has one. `law` is what filters, heads and bounds take the readings to follow. All of
    this is our choice.
    """

    path: Annotated[str, "CSV file, also .gz, with a header that names time, node and reading; more are ignored"]
    law: Annotated[SensorModel, OfRole("sensor"), "the sensor model that filters take the readings to follow"]
    columns: Annotated[ReadingColumns, "the names of the file's columns, where they differ"] = ReadingColumns()
    several: Annotated[Literal["mean", "last", "all"], "which reading counts, of several of a node in a step"] = "mean"
    time_origin: Annotated[
        float | None, TIME, "time in the file that is 0 in the run; default: the first reading's"
    ] = None
    skip_bad_rows: row_checks.SkipBadRows = False
    in_sample: Annotated[bool, "whether the law may be one that was fitted to these readings (its `fitted_on`)"] = False
    digest: Annotated[str, "digest of the file; '': that of the present file, which the result stores"] = ""

    def __post_init__(self) -> None:
        """Raises ValueError if the law is itself a recording, or has cells and several readings are averaged."""
        if isinstance(self.law, Replays):
            raise ValueError("law: must be a sensor model that can be computed, not recorded readings")
        if self.several != "last" and getattr(self.law, "reading_bits", None) is not None:
            raise ValueError("several: a mean of readings is in no cell of a law that quantises: use last")

    def draw_traits(self, nodes: int, rng: np.random.Generator) -> Floats:
        """(nodes, T) as the law, without gains that it would sample: 1, or 0 dB, in their place."""
        return recorded_traits(self.law, nodes, rng)

    def assumed(self, gains: str, inflate: bool) -> SensorModel:
        """The model that a filter assumes: that of the law, or of means of its readings."""
        assumed = self.law.assumed(gains, inflate)
        return RepeatedReadings(law=assumed) if self.counted else assumed

    @property
    def counted(self) -> bool:
        """Whether filters are told how many readings a mean stands for."""
        return self.several == "all"

    def recordings(self, names: Sequence[str], targets: int, steps: int, dt: float) -> list[Recording]:
        """The readings of each target by nodes of these names, (steps + 1, N) each.

        Raises:
            RunError: the file cannot be read, is not that of the digest, or has rows that cannot be used. The message
                names file and lines.
        """
        table, bad = self._table, self._bad(names, targets)
        if bad and not self.skip_bad_rows:
            raise RunError(row_checks.bad_rows_text(self.path, bad, table.total, row_checks.SKIPPING))
        times, nodes, values, of = self.rows(names, targets)
        numbers = first_steps(times, dt)
        used = numbers <= steps
        where = np.maximum(numbers[used], 0.0).astype(np.int64), nodes[used]
        values, of = values[used], of[used]
        shape = (steps + 1, len(names))
        return [self._of_target([axis[of == target] for axis in where], values[of == target], shape)
                for target in range(targets)]  # fmt: skip

    def rows(self, names: Sequence[str], targets: int) -> tuple[Floats, Ints, Floats, Ints]:
        """(n,) time from the origin (s), node, reading and target of each row that can be used, in the order of time.

        Raises:
            RunError: as `recordings`, but for single rows.
        """
        number, nodes, of = self._table.numbers, self._nodes(names), self._targets
        used = (nodes >= 0) & (of >= 0) & (of < targets)
        return since(number["time"][used], self.origin), nodes[used], number["reading"][used], of[used]

    @property
    def origin(self) -> float:
        """The time (s) in the file that is 0 in the run."""
        return float(self._table.numbers["time"][0]) if self.time_origin is None else self.time_origin

    def skipped_rows(self, setup: TrackingSetup) -> list[str]:
        """The rows that are left out, a text each with file, line and reason; none unless `skip_bad_rows` allows it."""
        if not self.skip_bad_rows:
            return []
        return row_checks.row_texts(self.path, self._bad(node_names(setup), len(setup.motions)))

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the file cannot be used, or if the scenario changes what was recorded."""
        yield from super().check(setup)
        try:
            found = self.recordings(node_names(setup), len(setup.motions), setup.steps, setup.dt)
        except RunError as error:
            yield Issue(("sensor", "path"), str(error))
            return
        if is_relative(self.law) and any((each.counts > 1).any() for each in found):
            message = "a node has several times of arrival in a step, of emissions at unknown times that differ"
            yield Issue(("sensor", "several"), f"{message}: give a step (and time_origin) that holds one of each node")
        yield from recorded_issues(self, setup)

    def _of_target(self, where: Sequence[Ints], values: Floats, shape: tuple[int, int]) -> Recording:
        """The recording of one target, from (steps, nodes) and values in the order of time."""
        cells = np.ravel_multi_index((where[0], where[1]), shape)
        counts = np.bincount(cells, minlength=shape[0] * shape[1])
        if self.several == "last":
            readings = np.full(len(counts), np.nan)
            readings[cells] = values  # of equal indices, the last value stays
        else:
            readings = means(self.law, values, cells, len(counts))
        return Recording(readings.reshape(shape), counts.reshape(shape))

    def _nodes(self, names: Sequence[str]) -> Ints:
        """(n,) the number of each row's node; -1 for one that the deployment does not have.

        Raises:
            RunError: it has none of them.
        """
        near = functools.partial(csvfile.identifiers, self.path, (self.columns.node,))
        known, codes = self._table.texts["node"]
        return joined_by_name(known, names, self.path, "the deployment", near)[codes]

    def _bad(self, names: Sequence[str], targets: int) -> list[row_checks.BadRow]:
        """All rows that cannot be used, ascending: those of unknown nodes and targets too."""
        table, of, known = self._table, self._targets, shortened(", ".join(names))
        own, codes = table.texts["node"]
        strangers = row_checks.refused(
            table.lines,
            (self._nodes(names) < 0, lambda row: (
                f"the deployment has no node '{own[codes[row]]}' (its nodes: {known})"
            )),
            ((of < 0) | (of >= targets), lambda row: (
                f"there is no target {of[row]}: allowed are 0 to {targets - 1}"
            )),
        )  # fmt: skip
        return row_checks.limited(self.path, itertools.chain(table.bad, strangers))

    @cached_property
    def _table(self) -> row_checks.CsvRows:
        """The rows in the order of time. Raises RunError if the file cannot be read, or is not that of the digest."""
        csvfile.demand_digest(self.path, self.digest)
        names = self.columns
        numbers = {"time": names.time, "reading": names.reading, "target": names.target}
        rows = csvfile.read_rows(
            self.path, csvfile.Wanted({"node": names.node}, numbers, optional=("target",)), "readings"
        )
        rows = rows.without(*self._checks(rows))
        if not rows.lines.size:
            raise RunError(row_checks.bad_rows_text(self.path, rows.bad, rows.total))
        return rows.at(np.argsort(rows.numbers["time"], kind="stable"))

    @property
    def _targets(self) -> Ints:
        """(n,) the target of each row."""
        return self._table.numbers.get("target", np.zeros(len(self._table.lines))).astype(np.int64)

    def _checks(self, rows: row_checks.CsvRows) -> Iterator[row_checks.Check]:
        """Yield which rows have a reading that the law cannot give, no number of a target, or repeat another row."""
        least, most = self.law.reading_limits if isinstance(self.law, LimitsReadings) else NO_LIMITS
        readings, targets = rows.numbers["reading"], rows.numbers.get("target", np.zeros(len(rows.lines)))
        beyond = (readings < least) | (readings > most)
        between = f"{self.columns.reading} must be between {least:g} and {most:g}"
        if most == TURN and beyond.any():
            between = f"{between} rad; degrees? Write: {remedy(self.path, 'readings', '--unit deg')}; it"
        yield beyond, lambda row: f"{between}, is {readings[row]:g}"
        broken = (targets != np.floor(targets)) | (np.abs(targets) > 1e9)
        yield broken, lambda row: f"{self.columns.target} must be a whole number, is {targets[row]:g}"
        first = row_checks.first_of_equal(~(beyond | broken), rows.numbers["time"], rows.texts["node"].codes, targets)
        repeated = "repeats time, node and target of line {}"
        yield first != np.arange(len(first)), lambda row: repeated.format(rows.lines[first[row]])


MOST_STEPS: Final = 20
"""Number of steps by which two trajectories are compared."""


def recorded_issues(sensor: Any, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield issues of components that sample what was recorded, of differing origins of time, and of in-sample laws.

    A law must not be judged on the readings to which it was fitted.

    A law is in-sample if its `fitted_on` contains the digest of the file of readings.
    """
    if not sensor.in_sample and _is_in_sample(sensor):
        message = "these readings are among those that the law was fitted to: use others, or say in_sample: true"
        yield Issue(("sensor", "path"), message)
    for number, motion in enumerate(setup.motions):
        key = ("motion", "kind") if len(setup.motions) == 1 else ("targets", number, "kind")
        if not _is_given(motion, setup):
            message = "readings were recorded of one trajectory, and this one is sampled at random: use recorded_track"
            yield Issue(key, f"{message} (or waypoints)")
        elif isinstance(motion, RecordedTrack):
            yield from _other_origin(sensor, motion)
    if sensor.counted:
        yield from _cannot_count(sensor, setup)
    message = "recorded readings have the detection errors of the world that they come from"
    if isinstance(setup.detection, ReportsScans):
        if any(setup.detection.resolution):
            yield Issue(("detection", "resolution"), f"{message}: give none")
    elif not is_perfect(setup.detection):
        yield Issue(("detection", "kind"), f"{message}: use kind: perfect (or unlabelled)")


def _is_in_sample(sensor: Any) -> bool:
    """Whether the law was fitted to the file of readings; its content counts, not its name or compression."""
    fitted_on = getattr(sensor.law, "fitted_on", ())
    return bool(fitted_on) and content_digest(sensor.path) in fitted_on


def _cannot_count(sensor: Any, setup: TrackingSetup) -> Iterator[Issue]:
    """Yield issues where a filter cannot take into account that a reading is the mean of several."""
    key = ("sensor", "several")
    if isinstance(setup, NetworkSetup):
        yield Issue(key, "in a network, nodes send one reading a step and not how many it stands for: use mean or last")
    if is_relative(sensor.law) or not (isinstance(sensor.law, ConstantGaussian) and sensor.law.constant_gaussian):
        message = "all needs a law of independent readings whose noise is Gaussian with a constant variance"
        yield Issue(key, f"{message}: use mean or last")
    if getattr(getattr(setup.filter_sensor, "law", None), "inflate", False):
        message = "the variance that inflate adds is common to all readings of a node: use several: mean or last"
        yield Issue(("tracker", "assumes", "inflate"), message)


def _is_given(motion: MotionModel, setup: TrackingSetup) -> bool:
    """Whether a trajectory does not depend on random numbers: it is the same with two seeds."""
    steps = min(setup.steps, MOST_STEPS)
    one, other = (motion.truth(steps, setup.dt, np.random.default_rng(seed)) for seed in (1, 2))
    return bool(np.array_equal(one, other))


def _other_origin(sensor: Any, motion: RecordedTrack) -> Iterator[Issue]:
    """Yield an issue if readings and trajectory begin at different times, unless both origins are given."""
    if None not in (sensor.time_origin, motion.time_origin):
        return
    apart = motion.origin - sensor.origin
    if abs(apart) > SAME_TIME:
        message = (
            f"the trajectory begins at {motion.origin:.15g} s, the readings at {sensor.origin:.15g} s: give "
            "time_origin for both"
        )
        yield Issue(("sensor", "time_origin"), message)
