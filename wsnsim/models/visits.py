"""Motion models of targets that come and go: a straight crossing of an area, and visits at random or listed times.

A target is absent where its state is NaN. Nobody tells the network when it comes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, Final

import numpy as np

from wsnsim.base.arrays import Floats, Keys, first_steps, rounding
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import OfRole, Quantity, part
from wsnsim.base.ports import MotionModel
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.models import csvfile
from wsnsim.models.bounds import LENGTH, PLACE
from wsnsim.models.motion import InPlane
from wsnsim.models.waypoints import INTENSITY, Straight, sampled

HOURS: Final = 24
DAY: Final = 86_400.0
SAMPLE: Final = 4096
"""Crossings of which the mean duration is computed: it has an error of about 0.5 %."""


@part
class Crossing(Straight):
    """A straight line at constant speed, from a point on one side of a rectangle to a point on another; then absent.

    The side of entry, that of exit and both points are uniform (our choice).
    """

    width: Annotated[float, LENGTH, "width of the area, in x"] = 400.0
    height: Annotated[float, LENGTH, "height of the area, in y"] = 400.0
    centre: Annotated[tuple[float, float], PLACE, "x and y of the area's centre"] = (0.0, 0.0)
    speed: Annotated[tuple[float, float], Quantity("m/s", gt=0.0, le=1e6), "range of the speed, uniform"] = (5.0, 5.0)
    q: Annotated[float, INTENSITY, "intensity of the noise in the velocity that filters assume"] = 0.05

    may_be_absent = True

    def __post_init__(self) -> None:
        """Raises ValueError if the least speed exceeds the greatest."""
        if self.speed[0] > self.speed[1]:
            raise ValueError(f"speed: the first is the least, the second the greatest, got {list(self.speed)}")

    @property
    def longest(self) -> float:
        """The longest possible duration of a crossing in s."""
        return math.hypot(self.width, self.height) / self.speed[0]

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, 4) one crossing from time 0 on; NaN once the target has left."""
        (ends,), (seconds,) = self._crossings(1, rng)
        states = sampled(np.array([0.0, seconds]), ends, steps, dt)
        states[np.arange(steps + 1) * dt > seconds] = np.nan
        return states

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield an issue if the area and the field of a network have no point in common."""
        if isinstance(setup, NetworkSetup):
            field = setup.deploy.field
            apart = np.abs(np.subtract(self.centre, field.centre))
            if (apart > np.add((self.width, self.height), (field.width, field.height)) / 2.0).any():
                yield Issue(("motion", "centre"), "the target would cross an area beside the field")

    def mean_duration(self) -> float:
        """The mean duration of a crossing in s, from 4096 crossings."""
        return float(self._crossings(SAMPLE, np.random.default_rng(0))[1].mean())

    def _crossings(self, count: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Ends (n, 2, 2) of crossings in m, and their durations (n,) in s."""
        first = rng.integers(4, size=count)
        sides = np.stack([first, (first + rng.integers(1, 4, size=count)) % 4], axis=1)
        along, across = rng.random((count, 2)) - 0.5, np.where(sides < 2, -0.5, 0.5)
        upright = sides % 2 == 0
        places = np.stack([np.where(upright, across, along), np.where(upright, along, across)], axis=-1)
        ends = places * (self.width, self.height) + self.centre
        return ends, np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / rng.uniform(*self.speed, size=count)


@part
class Visits(InPlane):
    """A target that comes at random times, moves as another model says, and leaves; one visit at a time.

    Visits come at `rate` in the long run: the time from the end of one to the begin of the next is exponential, with
    the mean 1/rate less the mean duration of a visit. `profile` gives the rate over the hours of a day, which begins at
    time 0, relative to its mean. `times`, or a file, lists the times at which visits begin instead.
    """

    of: Annotated[MotionModel, OfRole("motion"), "the motion of one visit, from its start on"]
    lasting: Annotated[
        float | None, Quantity("s", gt=0.0, le=1e9), "how long a visit lasts; left out: until `of` is absent"
    ] = None
    rate: Annotated[float | None, Quantity("1/s", gt=0.0, le=1.0), "visits per time in the long run"] = None
    times: Annotated[
        tuple[float, ...] | None, Quantity("s", ge=0.0, le=1e12), "when visits begin, ascending; in place of `rate`"
    ] = None
    path: Annotated[str | None, "CSV file, also .gz, with a column time (s): when visits begin, ascending"] = None
    profile: Annotated[
        tuple[float, ...] | None, Quantity("", ge=0.0, le=1e6), "24 factors of the rate, one for each hour of a day"
    ] = None

    may_be_absent = True

    def __post_init__(self) -> None:
        """Raises ValueError for values that contradict each other."""
        if [self.rate, self.times, self.path].count(None) != 2:
            raise ValueError("give one of rate, such as 1/h, times, at which visits begin, and path, a file of times")
        if self.lasting is None and not isinstance(self.of, Crossing):
            raise ValueError("lasting: of this motion, say how long a visit lasts")
        if self.profile is not None and (self.rate is None or len(self.profile) != HOURS or not sum(self.profile)):
            raise ValueError("profile: expected 24 factors, one for each hour and not all 0, beside a rate")
        if self.times is not None and (np.diff(self.times) <= 0.0).any():
            raise ValueError("times: must ascend")
        if self.rate is not None and not min(self.gaps()) > 0.0:
            raise ValueError(
                f"rate: {max(self.hourly()) * 3600:g} visits an hour of {self.duration():g} s each would overlap; one "
                f"target makes fewer than {3600 / self.duration():g} an hour: lower it, or give several targets"
            )

    @property
    def columns(self) -> tuple[str, ...]:  # type: ignore[override]
        """The columns of the motion of a visit."""
        return self.of.columns

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """The units of the motion of a visit."""
        return self.of.units

    @property
    def position(self) -> tuple[int, ...]:  # type: ignore[override]
        """The columns that are the position."""
        return self.of.position

    def duration(self) -> float:
        """The mean duration of a visit in s."""
        return self.lasting if self.lasting is not None else self.of.mean_duration()  # type: ignore[attr-defined]

    def hourly(self) -> Floats:
        """(24,) visits per s in each hour of a day, in the long run."""
        assert self.rate is not None
        return self.rate * (np.ones(HOURS) if self.profile is None else np.array(self.profile) / np.mean(self.profile))

    def gaps(self) -> Floats:
        """(24,) mean time (s) from the end of a visit to the begin of the next, in each hour of a day."""
        with np.errstate(divide="ignore"):
            return 1.0 / self.hourly() - self.duration()

    def after(self, end: Floats, waits: Floats) -> Floats:
        """(n,) when visits begin whose predecessors ended at the times `end` (n,); `waits` (n,): in mean gaps."""
        return _passed(end, waits, 1.0 / self.gaps())

    def after_several(self, begun: Floats, count: int, waits: Floats, stay: Floats) -> Floats:
        """(n,) when the last of `count` visits ends, from the times `begun` (n,) on, at which the target is absent.

        Args:
            begun: in s.
            count: number of visits.
            waits: (n,) sums of the times between them, in mean gaps.
            stay: (n,) s that they last in all.
        """
        if count == 1 or self.profile is None:
            return self.after(begun, waits) + stay
        hourly = self.hourly()
        present = self.duration() * float((hourly**2).sum() / hourly.sum())  # share of a visit's interval
        amount = waits * (1.0 - present) + stay / self.duration() * present
        return _passed(begun, amount, hourly)

    def truth(self, steps: int, dt: float, rng: np.random.Generator) -> Floats:
        """(steps + 1, D) the visits, NaN between them. A visit begins with the first step at or after its time."""
        states = np.full((steps + 1, len(self.columns)), np.nan)
        longest = int(first_steps(self.longest, dt))
        number, end, free = 0, 0.0, 0
        while (begin := self._begin(number, end, rng)) <= steps * dt + rounding(dt):
            first = max(int(first_steps(begin, dt)), free)
            visit = self.of.truth(longest if self.lasting is None else longest - 1, dt, rng)
            there = np.isfinite(visit[:, 0])
            visit = visit[: len(visit) if there.all() else int(there.argmin())]
            if first > steps:
                break
            states[first : first + len(visit)] = visit[: steps + 1 - first]
            # the target is absent for a step at least, and what is rounded in one visit is not passed on to the next
            number, free = number + 1, first + len(visit) + 1
            whole = self.lasting is not None and len(visit) == longest
            end = begin + (self.longest if whole else min(self.longest, (len(visit) - 0.5) * dt))
        return states

    def _begin(self, number: int, end: float, rng: np.random.Generator) -> float:
        """When the visit of this number begins, the one before having ended; infinite if there is none."""
        if self.rate is not None:
            return float(self.after(np.array([end]), rng.exponential(size=1))[0])
        return float(self.begins[number]) if number < self.begins.size else math.inf

    @cached_property
    def begins(self) -> Floats:
        """(n,) when the listed visits begin in s. Raises RunError if the file cannot be used."""
        return (
            np.array(self.times or ()) if self.path is None else csvfile.timed_rows(self.path, "times").numbers["time"]
        )

    @property
    def longest(self) -> float:
        """The longest possible duration of a visit in s."""
        return self.lasting if self.lasting is not None else self.of.longest  # type: ignore[attr-defined]

    def closeness(self) -> Issue | None:
        """What is wrong with the listed visits: their file, or that two of them would overlap."""
        place = ("motion", "path" if self.path else "times")
        try:
            closest = float(np.diff(self.begins).min(initial=np.inf))
        except RunError as error:
            return Issue(place, str(error))
        if closest > self.longest:
            return None
        return Issue(
            place,
            f"visits last up to {self.longest:g} s, and two begin {closest:g} s apart: one target makes one visit "
            "at a time; leave more time between them, or give several targets",
        )

    def frequency(self, horizon: float) -> float:
        """Visits per s in the long run; of listed ones, those that begin before the horizon (s) over the horizon."""
        return self.rate if self.rate is not None else float((self.begins < horizon).sum()) / horizon

    def propagate(self, states: Floats, dt: float, keys: Keys, time: float = 0.0) -> Floats:
        """(D, N) each state after one step of a visit, with process noise."""
        return self.of.propagate(states, dt, keys, time)

    def advance(self, states: Floats, dt: float, time: float = 0.0) -> Floats:
        """(D, N) each state after one step of a visit, without noise."""
        return self.of.advance(states, dt, time)

    def matrices(self, states: Floats, dt: float, time: float = 0.0) -> tuple[Floats, Floats]:
        """The derivative (N, D, D) and the process covariance (D, D) of a visit."""
        return self.of.matrices(states, dt, time)

    def log_transition(self, after: Floats, before: Floats, dt: float, time: float = 0.0) -> Floats:
        """(N,) the log densities of a step of a visit."""
        return self.of.log_transition(after, before, dt, time)

    def assumed(self, noise_scale: float) -> MotionModel:
        """The model that a filter assumes of a target that is there: that of a visit."""
        return self.of.assumed(noise_scale)

    def check(self, setup: TrackingSetup) -> Iterator[Issue]:
        """Yield the issues of the motion of a visit, and one for visits within visits."""
        if isinstance(self.of, Visits):
            yield Issue(("motion", "of"), "a visit is no series of visits: name the motion of one")
            return
        if issue := self.closeness():
            yield issue
        yield from getattr(self.of, "check", lambda _: ())(setup)


def _passed(begun: Floats, amount: Floats, hourly: Floats) -> Floats:
    """(n,) the times from `begun` (n,) on at which `amount` (n,) of what comes at `hourly` (24,) per s has come."""
    sums = np.concatenate([[0.0], np.cumsum(DAY / HOURS * hourly)])
    hours = np.linspace(0.0, DAY, HOURS + 1)
    days, within = np.divmod(begun, DAY)
    more, rest = np.divmod(np.interp(within, hours, sums) + amount, sums[-1])
    # where nothing comes for hours, the end of these is meant
    times: Floats = (days + more) * DAY + np.interp(rest, sums, hours)
    return times
