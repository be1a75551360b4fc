"""What bound is wanted (its kind, readings, what filters know of the nodes), whether there is one, and what it says.

checked(query) -> query      assumed_gains(scenario), assumed_places(setup) -> word      unknown_constants(setup, query)
reason_without_bound(motion, kind) -> text or ''      cautions(setup, conditions), cautions_of_readings(setup) -> texts
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.base.initial_conditions import InitialConditions
from wsnsim.base.optional_ports import Continuous, IsShadowed
from wsnsim.base.ports import MotionModel
from wsnsim.base.sensing import gain_variance, has_gains
from wsnsim.base.setups import Setup, TrackingSetup
from wsnsim.bounds.covariances import UnknownConstants

KINDS: Final = ("unconditional", "per_trajectory")
READINGS: Final = ("in_range", "active", "arrived")
GAINS: Final = ("known", "unknown")
PLACES: Final = ("known", "unknown")


class BoundQuery(NamedTuple):
    """Which bound is wanted, and of which runs.

    Attributes:
        kind: one of `KINDS`.
        readings: one of `READINGS`.
        gains: one of `GAINS`.
        replicates: numbers of the runs.
        places: one of `PLACES`.
    """

    kind: str
    readings: str
    gains: str
    replicates: tuple[int, ...]
    places: str = "known"


def assumed_gains(scenario: Any) -> str:
    """Whether the scenario's tracker assumes known gains; `known` if it assumes nothing. Estimated ones are unknown."""
    assumes = getattr(getattr(scenario, "tracker", None), "assumes", None)
    return "known" if getattr(assumes, "gains", "known") == "known" else "unknown"


def assumed_places(setup: Setup) -> str:
    """Whether filters know where the nodes stand."""
    return "unknown" if setup.position_error else "known"


def unknown_constants(setup: TrackingSetup, query: BoundQuery) -> UnknownConstants:
    """What the filters of a query do not know of the nodes. Raises ValueError if no bound counts it."""
    if query.gains == "unknown" and query.kind == "per_trajectory" and getattr(setup.sensor, "clock_spread", None):
        raise ValueError("an unknown clock offset is common to all readings, and the bound takes biases as independent")
    gain = gain_variance(setup.sensor) if query.gains == "unknown" and has_gains(setup.sensor) else 0.0
    return UnknownConstants(gain, setup.position_error**2 if query.places == "unknown" else 0.0)


def checked(query: BoundQuery) -> BoundQuery:
    """The query itself. Raises UsageError if a word is not allowed, or if there are no runs."""
    for name, allowed in {"kind": KINDS, "readings": READINGS, "gains": GAINS, "places": PLACES}.items():
        if (value := getattr(query, name)) not in allowed:
            raise UsageError(f"{name}: '{value}': {did_you_mean(value, allowed)}")
    if not query.replicates:
        raise UsageError("replicates: a bound needs at least one run")
    return query


@dataclass(frozen=True)
class Bound:
    """The least root mean square position error, in the position's unit, at the steps 1, 2, ...

    Attributes:
        query: the kind of bound, and the runs that it is of.
        place: the state columns of the position.
        covariances: (R, targets, steps, D, D); R is the number of runs per trajectory, else 1.
        reason: why there is no bound; R is 0 then.
        cautions: why the bound is not strict, a sentence each.
        of_readings: what the bound takes of the readings that may be otherwise, a sentence each.
    """

    query: BoundQuery
    place: tuple[int, ...]
    covariances: Floats = field(repr=False)
    reason: str = ""
    cautions: tuple[str, ...] = ()
    of_readings: tuple[str, ...] = ()

    @property
    def each(self) -> Floats:
        """The least position error of each recursion, (R, targets, steps)."""
        variances = np.diagonal(self.covariances, axis1=-2, axis2=-1)
        result: Floats = np.sqrt(variances[..., list(self.place)].sum(axis=-1))
        return result

    @property
    def rmse(self) -> Floats:
        """The root mean square over recursions and targets at each step, (steps,); empty if there is no bound."""
        if self.reason:
            return np.empty(0)
        return np.sqrt(_mean(self.each**2))

    @property
    def columns(self) -> Floats:
        """The bound of each state column at each step, (steps, D); empty if there is no bound."""
        if self.reason:
            return np.empty((0, self.covariances.shape[-1]))
        return np.sqrt(_mean(np.diagonal(self.covariances, axis1=-2, axis2=-1)))

    @property
    def time_mean(self) -> float:
        """The mean of `rmse` over the steps, to compare with a time-averaged RMSE; NaN if there is no bound."""
        return metrics.mean_error(self.rmse)

    def time_mean_at(self, errors: Floats) -> float:
        """The same over the estimates that exist, to compare with a tracker that skips steps or ended early.

        Of one run it is the root mean square over steps and targets, as the RMSE beside it.

        Args:
            errors: (replicates, targets, steps) position errors, NaN where there is no estimate.
        """
        if self.reason:
            return float("nan")
        issued = self._where_issued(errors)
        return metrics.averaged_rmse(issued)

    def of_replicates_at(self, errors: Floats) -> Floats:
        """`of_replicates` over the estimates that exist, (R,), to compare with the RMSE of each run; as `time_mean_at`.

        A run without an estimate is NaN.
        """
        return np.array([metrics.rmse(one) for one in self._where_issued(errors)])

    def _where_issued(self, errors: Floats) -> Floats:
        """(replicates, targets, steps) the least errors where there is an estimate, NaN elsewhere."""
        return np.where(np.isfinite(errors), np.broadcast_to(self.each, errors.shape), np.nan)

    @property
    def of_replicates(self) -> Floats:
        """The root mean square over steps and targets of each recursion, (R,)."""
        return np.sqrt(_mean(self.each**2, (1, 2)))


def _mean(values: Floats, axes: tuple[int, int] = (0, 1)) -> Floats:
    """The mean over two axes where the target is present; NaN where it never is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        result: Floats = np.nanmean(values, axis=axes)
    return result


KNOWN_ASSOCIATION: Final = (
    "the bound knows of which target each detection is: it leaves out clutter, detections of several targets at once, "
    "and the targets that no track follows"
)
FAULTLESS: Final = "faults are not counted: the bound for readings in range is that without faults"


def reason_without_bound(motion: MotionModel, kind: str) -> str:
    """Why there is no bound of this kind for a target with this motion model; empty if there is one.

    The posterior bound holds for trajectories sampled from the motion model that filters are given. Along one
    trajectory, the motion model only determines how fast past information decays.
    """
    if getattr(motion, "recorded", False):
        return "the trajectory was recorded: it is no sample of a motion model"
    if isinstance(motion, Continuous):
        return "a motion along given waypoints has no probability density"
    if kind == "per_trajectory":
        return ""
    course = getattr(motion, "course", "free")
    if course == "in_room":
        return "trajectories are conditioned on staying in a room: they are not samples of the motion model"
    if course != "free":
        return f"the trajectory has a prescribed {course}: it is not a sample of the motion model"
    if getattr(motion, "box", None) is not None:
        return "the trajectory is reflected at a box that is not part of the motion model of the filters"
    return ""


def cautions(setup: TrackingSetup, conditions: Sequence[InitialConditions], places_known: bool = True) -> Iterator[str]:
    """The reasons why a bound is not strict for these runs, a sentence each.

    `places_known`: whether the bound takes the positions of nodes as known.
    """
    prior: Any = setup.prior
    if getattr(prior, "mean", None) is not None and any(_starts_elsewhere(prior, m) for m in setup.motions):
        yield "filters are given a fixed prior: the bound holds on average over starts sampled from it"
    yield from sorted({reason_without_bound(motion, "unconditional") for motion in setup.motions} - {""})
    if getattr(setup.sensor, "beyond", "") == "noise" and math.isfinite(setup.sensor.reach):
        yield "sensors out of range read noise, which tells where the target is not: the bound does not count that"
    if setup.has_absences:
        yield "a target may be absent: the bound begins from the prior each time it comes, trackers from readings"
    yield from cautions_of_readings(setup)
    if setup.position_error and places_known:
        yield "the bound takes node positions as known: the filters have only assumed ones (deploy.position_error)"
    for target, motion in enumerate(setup.motions):
        bound = getattr(motion, "bound", None)
        positions = np.array([one.truths[target][:, list(motion.position)] for one in conditions])
        if bound is not None and np.any(np.abs(positions) > bound):
            yield "the target turns back at a line: the information in that sudden turn is not counted"
            return


def cautions_of_readings(setup: TrackingSetup) -> Iterator[str]:
    """Those of the cautions that are about readings: what the bound takes to be otherwise than it is."""
    if setup.faults:
        yield FAULTLESS
    if setup.unlabelled:
        yield KNOWN_ASSOCIATION
    if getattr(setup.sensor, "adapts", False):
        yield "thresholds follow a prediction: the bound takes those about the true reading, which no filter knows"
    if setup.recorded is not None:
        yield "readings were recorded: the bound is that of the law (sensor.law), which they need not follow"
    elif isinstance(setup.sensor, IsShadowed) and setup.sensor.shadowing:
        yield "shadowing correlates readings along the path: the bound takes them as independent, without shadowing"


def _starts_elsewhere(prior: Any, motion: Any) -> bool:
    """Whether trajectories do not start at samples of the prior."""
    spread = getattr(motion, "start_sd", None)
    return spread is None or not np.allclose(spread, prior.sd) or not np.allclose(motion.start, prior.mean)
