"""The motion model of a trajectory that was recorded, in the plane or in space."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Annotated, Any, ClassVar, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Floats, rounding, since
from wsnsim.base.errors import Issue, RunError, shortened
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import TrackingSetup
from wsnsim.models import csvfile, row_checks
from wsnsim.models.unit_checks import degrees_said, remedy
from wsnsim.models.waypoints import FARTHEST_POINT, INTENSITY, LEAST_APART, Straight, sampled

SAME_PLACE: Final = 1e-3
"""Largest distance (m) of two places of one time (our choice)."""
LATEST: Final = 1e15
"""s: greatest time (our choice)."""
TIME: Final = Quantity("s", ge=-LATEST, le=LATEST)


@part
class TrackColumns:
    """The names of the columns of a file with a recorded trajectory."""

    sheet: ClassVar[str] = ""

    time: Annotated[str, "the time, in s"] = "time"
    x: Annotated[str, "the coordinate x, in m"] = "x"
    y: Annotated[str, "the coordinate y, in m"] = "y"
    z: Annotated[str, "the height, in m; a file may lack it"] = "z"


class RecordedPoints(NamedTuple):
    """The points of a file: distinct times (n,), ascending, points (n, 2 or 3), and rows that cannot be used."""

    times: Floats
    points: Floats
    bad: tuple[row_checks.BadRow, ...]


def recorded_points(path: str, names: Mapping[str, str], skip_bad_rows: bool, skipping: str) -> RecordedPoints:
    """The trajectory of a file, whose rows may stand in any order.

    Args:
        path: The file.
        names: Its names of time, x, y and z; it may lack z.
        skip_bad_rows: Whether rows that cannot be used are left out, instead of refused.
        skipping: What the message says that leaves them out.

    Raises:
        RunError: The file cannot be used, or has several movers; the message names file and line, or the movers.
    """
    rows = csvfile.read_rows(path, csvfile.Wanted(numbers=names, optional=("z",)), "points of a trajectory")
    _demand_one_mover(path, names)
    rows = rows.without(*_conflicts(rows), skip=skip_bad_rows, remedy=skipping)
    times, first = np.unique(rows.numbers["time"], return_index=True)
    if len(times) < 2:
        raise RunError(f"{path}: at least two points of different times are needed")
    return RecordedPoints(times, rows.points[first, : 3 if "z" in rows.numbers else 2], rows.bad)


@part
class RecordedTrack(Straight):
    """A recorded trajectory: interpolated linearly between the rows of a CSV file, at rest before and after them.

    With `gap`, the target is absent instead before the first row, after the last one, and between two rows that are
    further apart.

    The velocity is that of the leg between two rows. Rows may stand in any order. Rows of one time must be at one
    place, to 1 mm; the first counts. Filters do not know the trajectory: they assume near-constant velocity with
    process noise of intensity q. A column z gives the height, which a sensor's law may use; the filter's state stays
    in the plane. All of this is our choice.
    """

    recorded: ClassVar[bool] = True

    path: Annotated[str, "CSV file, also .gz, with a header that names time, x and y, and perhaps z"]
    header: Annotated[TrackColumns, "the names of the file's columns, where they differ"] = TrackColumns()
    gap: Annotated[
        float | None,
        Quantity("s", gt=0.0),
        "greatest time between two rows over which the target is present; left out: it always is",
    ] = None
    time_origin: Annotated[
        float | None, TIME, "time in the file that is 0 in the run; default: that of the first row"
    ] = None
    skip_bad_rows: row_checks.SkipBadRows = False
    digest: Annotated[str, "digest of the file; '': that of the present file, which the result stores"] = ""
    q: Annotated[float, INTENSITY, "intensity of the noise in the velocity that filters assume"] = 0.05

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, 4) the trajectory, NaN where the target is absent; `rng` is not used.

        Raises:
            RunError: the file cannot be read; the message names file and line.
        """
        track = self.track
        states = sampled(track.times, track.points[:, :2], steps, dt)
        if self.gap is not None:
            now, equal = np.arange(steps + 1) * dt, rounding(dt)
            before, after = (np.searchsorted(track.times, now + shift) for shift in (equal, -equal))
            times = np.concatenate([[-np.inf], track.times, [np.inf]])
            states[times[after + 1] - times[before] > self.gap + equal] = np.nan
        return states

    @property
    def may_be_absent(self) -> bool:
        """Whether the target is absent where the file has no rows."""
        return self.gap is not None

    def heights(self, steps: int, dt: float) -> Floats | None:
        """(steps + 1,) the height in m at each step; None if the file has no column z."""
        track = self.track
        if track.points.shape[1] < 3:
            return None
        heights: Floats = np.interp(np.arange(steps + 1) * dt, track.times, track.points[:, 2])
        return heights

    @cached_property
    def track(self) -> RecordedPoints:
        """The trajectory, its times from the origin on. Raises RunError with file and line if it cannot be read."""
        csvfile.demand_digest(self.path, self.digest)
        return self._recorded._replace(times=since(self._recorded.times, self.origin))

    @property
    def origin(self) -> float:
        """The time (s) in the file that is 0 in the run."""
        return float(self._recorded.times[0]) if self.time_origin is None else self.time_origin

    def skipped_rows(self, setup: Any) -> list[str]:
        """The rows that are left out, a text each with file, line and reason; none unless `skip_bad_rows` allows it."""
        return row_checks.row_texts(self.path, self._recorded.bad) if self.skip_bad_rows else []

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the file cannot be read or is not that of the digest, has bad rows, or holds degrees."""
        if said := degrees_said(self.path, "track", self.header.x, self.header.y):
            yield Issue(("motion", "header"), said)
        try:
            _ = self.track
        except RunError as error:
            yield Issue(("motion", "path"), str(error))

    @cached_property
    def _recorded(self) -> RecordedPoints:
        """The points of the file."""
        names = self.header
        numbers = {"time": names.time, "x": names.x, "y": names.y, "z": names.z}
        return recorded_points(self.path, numbers, self.skip_bad_rows, row_checks.SKIPPING)


def movers_said(path: str, column: str, names: row_checks.TextColumn, times: Floats, x: Floats, y: Floats) -> str:
    """The message that refuses a path at times (n,), which a column makes less than half as long; '' if it does not.

    Its values are several movers. Where each value belongs to a part of one path, such as the node that heard the
    target, the parts together are as long as the path. A column with a value for less than three rows numbers rows
    (our choices).
    """
    movers, codes = names
    if not 1 < len(movers) <= len(codes) / 3:
        return ""
    places, order = x + 1j * y, np.argsort(times, kind="stable")
    each = order[np.argsort(codes[order], kind="stable")]
    with np.errstate(over="ignore", invalid="ignore"):  # places that are too far are refused elsewhere
        whole, parts = np.abs(np.diff(places[order])), np.abs(np.diff(places[each]))
    if not parts[np.diff(codes[each]) == 0].sum() < 0.5 * whole.sum():
        return ""
    option = f"--column {shlex.quote(f'id={column}')} {shlex.join(f'--id={mover}' for mover in movers[:2])}"
    return (
        f"{path}: the column '{column}' names {len(movers)} movers, {shortened(', '.join(movers))}: give each a file "
        f"of its own, such as {remedy(path, 'track', option)}"
    )


def _demand_one_mover(path: str, names: Mapping[str, str]) -> None:
    """Refuse a file with a column that names several movers. Raises RunError that names them."""
    for column in csvfile.identifiers(path, names.values()):
        rows = csvfile.read_rows(
            path, csvfile.Wanted({"id": column}, {key: names[key] for key in ("time", "x", "y")}), ""
        )
        if said := movers_said(path, column, rows.texts["id"], *(rows.numbers[key] for key in ("time", "x", "y"))):
            raise RunError(said)


def _conflicts(rows: row_checks.CsvRows) -> Iterator[row_checks.Check]:
    """Yield which rows are too far away, at another place than the first of their time, or at nearly its time."""
    times, lines, points = rows.numbers["time"], rows.lines, np.nan_to_num(rows.points)
    far = (np.abs(points) > FARTHEST_POINT).any(axis=1) | (np.abs(times) > LATEST)
    yield far, f"x, y and z must be within ±{FARTHEST_POINT:g} m, time within ±{LATEST:g} s"
    first = row_checks.first_of_equal(~far, times)
    apart = np.linalg.norm(points - points[first], axis=1)
    yield (
        apart > SAME_PLACE,
        lambda i: (
            f"at the time {times[i]:.15g} s it is {apart[i]:.3g} m from the place in line {lines[first[i]]}; at most "
            f"{SAME_PLACE:g} m is allowed"
        ),
    )
    order = np.flatnonzero(~far)[np.argsort(times[~far], kind="stable")]
    before, later = np.arange(len(times)), np.zeros(len(times))
    before[order[1:]], later[order[1:]] = order[:-1], np.diff(times[order])
    yield (
        (later > 0.0) & (later < LEAST_APART * (1.0 - 1e-6)),
        lambda i: f"is {later[i]:.3g} s after line {lines[before[i]]}; {LEAST_APART:g} s are the least that is allowed",
    )
