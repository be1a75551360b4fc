"""Bounds on the tracking error: how small it can be, whatever the filter.

    bound(scenario, replicates=range(30), kind="unconditional") -> Bound        as `wsnsim compare` shows
    bound_of_run(path, readings="arrived", kind="per_trajectory") -> Bound      of the readings of a recorded run

`unconditional`: the posterior Cramér-Rao bound of Tichavský, Muravchik, Nehorai (1998). Expectations over trajectories
are means over those of the replicates, so it has their sampling error. Often loose.
`per_trajectory`: the same recursion along each truth alone, and the root of the mean. Tight, and no strict bound: at a
truth that is easy a filter may do better, as it may by being biased.

Either is for filters that know the law of the motion, the sensor and where nodes stand; that know of the start what the
scenario's prior tells; and that use nothing of the readings but their values. Who gives a reading and who is silent
also tells where the target is: no tracker of the catalogue uses that, unless by the likelihood of a `range` sensor that
reads noise out of its radius (`beyond: noise`). The first readings that count are those of step 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wsnsim import experiment, recording
from wsnsim import scenario as scenarios
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import ResultError, UsageError, did_you_mean
from wsnsim.base.ports import Informs
from wsnsim.base.setups import BeaconSetup, NetworkSetup, TrackingSetup
from wsnsim.bounds.covariances import Hearing, covariances
from wsnsim.bounds.information import in_range
from wsnsim.bounds.initial_draws import Drawn, cautions, drawn, objection
from wsnsim.bounds.used_readings import Recorded

KINDS = ("unconditional", "per_trajectory")
READINGS = ("in_range", "active", "arrived")
GAINS = ("known", "unknown")


class Asked(NamedTuple):
    """Which bound is asked for, on which replicates."""

    kind: str
    readings: str
    gains: str
    replicates: tuple[int, ...]


@dataclass(frozen=True)
class Bound:
    """How small the root mean square position error can be, in the position's unit, at the steps 1, 2, ...

    `covariances` (R, targets, steps, D, D): R is the number of replicates per trajectory, and 1 if unconditional.
    `reason`: why there is none, and then R is 0. `cautions`: what makes it less than strict, each in a sentence.
    """

    asked: Asked
    place: tuple[int, ...]
    covariances: Floats = field(repr=False)
    reason: str = ""
    cautions: tuple[str, ...] = ()

    @property
    def each(self) -> Floats:
        """(R, targets, steps): the root of the position's mean square error in each recursion."""
        variances = np.diagonal(self.covariances, axis1=-2, axis2=-1)
        return np.sqrt(variances[..., list(self.place)].sum(axis=-1))

    @property
    def rmse(self) -> Floats:
        """(steps,) the root of the mean over recursions and targets; empty if there is no bound."""
        if self.reason:
            return np.empty(0)
        return np.sqrt((self.each**2).mean(axis=(0, 1)))

    @property
    def columns(self) -> Floats:
        """(steps, D) the same for each column of the state; empty if there is no bound."""
        if self.reason:
            return np.empty((0, self.covariances.shape[-1]))
        return np.sqrt(np.diagonal(self.covariances, axis1=-2, axis2=-1).mean(axis=(0, 1)))

    @property
    def time_mean(self) -> float:
        """The mean over the steps of `rmse`, as the trackers' RMSE is taken; NaN if there is no bound."""
        return float(self.rmse.mean()) if self.rmse.size else float("nan")

    def time_mean_at(self, errors: Floats) -> float:
        """The same over what there is of estimates: `errors` (replicates, targets, steps) are NaN where there is none.

        What stands beside the RMSE of a tracker that skips steps, or that came to its end early.
        """
        if self.reason:
            return float("nan")
        squared = np.broadcast_to(self.each**2, errors.shape)
        return metrics.time_mean_rmse(
            np.where(np.isfinite(errors), np.sqrt(squared), np.nan).reshape(-1, errors.shape[-1])
        )

    @property
    def of_replicates(self) -> Floats:
        """(R,) root mean square over steps and targets; per trajectory, one a replicate."""
        return np.sqrt((self.each**2).mean(axis=(1, 2)))


def bound(
    scenario: Any, replicates: Sequence[int] = range(30), kind: str = "unconditional", gains: str | None = None
) -> Bound:
    """The bound for all readings in range, on the networks and truths of these replicates of a scenario.

    `gains`: known, unknown, or None for what the tracker assumes. Unknown ones are counted as such along each
    trajectory; see `bounding.gains`. The unconditional bound is then that for known gains, which bounds both: where
    nodes are drawn anew in each replicate, what an unknown gain takes away cancels out in the mean over them.

    Raises:
        UsageError: kind or gains are not among those named, or there are no replicates.
        ScenarioError, RunError: as `simulate`.
    """
    loaded = scenarios.load(scenario)
    problem = scenarios.build(loaded)
    asked = _checked(Asked(kind, "in_range", gains or _assumed(loaded), tuple(replicates)))
    if isinstance(problem, BeaconSetup) or (reason := _objection(problem, kind)):
        return _nothing(asked, "there is no target" if isinstance(problem, BeaconSetup) else reason)
    draws = [drawn(problem, number) for number in asked.replicates]
    return _made(problem, asked, draws, _all_in_range(problem, draws), _taken(problem))


def bound_of_run(
    path: str | Path, readings: str = "arrived", kind: str = "per_trajectory", gains: str | None = None
) -> Bound:
    """The bound for the readings of a recorded run: of its clusters' `active` members, those that `arrived`, or all.

    Without a network all readings arrive. After the end of a run that was shorter than its scenario, nothing counts.

    Raises:
        UsageError: kind, readings or gains are not among those named.
        ResultError: the file cannot be read, or this version draws other truths than it holds.
    """
    loaded = scenarios.load(experiment.rerun_source(Path(path)))
    problem = scenarios.build(loaded)
    replicates = recording.read_table(path, "runs", ["replicate"])["replicate"].tolist()
    asked = _checked(Asked(kind, readings, gains or _assumed(loaded), tuple(replicates)))
    if isinstance(problem, BeaconSetup) or (reason := _objection(problem, kind)):
        return _nothing(asked, "there is no target" if isinstance(problem, BeaconSetup) else reason)
    draws = [drawn(problem, number) for number in replicates]
    _check_truths(path, problem, replicates, draws)
    if readings == "in_range" or not isinstance(problem, NetworkSetup):
        return _made(problem, asked, draws, _all_in_range(problem, draws), _taken(problem))
    if not {"events", "estimates", "clusters"} <= recording.tables(path).keys():
        return _nothing(
            asked, "the tables events, estimates and clusters are not all recorded: who heard what is not known"
        )
    recorded = Recorded(path, problem)
    return _made(
        problem, asked, draws, lambda row, target: recorded.heard(asked.replicates[row], target, asked.readings)
    )


def _assumed(scenario: Any) -> str:
    """What the scenario's tracker assumes of the gains; known where there is no tracker."""
    gains: str = getattr(getattr(getattr(scenario, "tracker", None), "assumes", None), "gains", "known")
    return gains


def _checked(asked: Asked) -> Asked:
    for name, allowed in (("kind", KINDS), ("readings", READINGS), ("gains", GAINS)):
        if getattr(asked, name) not in allowed:
            raise UsageError(f"{name}: '{getattr(asked, name)}': {did_you_mean(getattr(asked, name), allowed)}")
    if not asked.replicates:
        raise UsageError("replicates: a bound needs at least one")
    return asked


def _objection(problem: TrackingSetup, kind: str) -> str:
    """Why there is no bound; empty if nothing speaks against it yet."""
    if not isinstance(problem.sensor, Informs):
        return "the sensor does not say what its readings tell"
    return next(filter(None, (objection(motion, kind) for motion in problem.motions)), "")


def _nothing(asked: Asked, reason: str) -> Bound:
    return Bound(asked, (), np.empty((0, 0, 0, 0, 0)), reason)


def _made(problem: TrackingSetup, asked: Asked, draws: Sequence[Drawn], hearing: Hearing, taken: float = 1.0) -> Bound:
    try:
        made = covariances(problem, draws, hearing, asked.kind, asked.gains, taken)
    except ValueError as reason:
        return _nothing(asked, str(reason))
    return Bound(asked, tuple(problem.motions[0].position), made, "", tuple(cautions(problem, draws)))


def _all_in_range(problem: TrackingSetup, draws: Sequence[Drawn]) -> Hearing:
    """Everybody in range gives a reading."""
    places = [list(motion.position) for motion in problem.motions]
    return lambda row, target: in_range(
        problem.sensor, draws[row].truths[target][:, places[target]], draws[row].positions
    )


def _taken(problem: TrackingSetup) -> float:
    """The probability that a reading in range is taken."""
    return 1.0 - problem.detection.missed if isinstance(problem, NetworkSetup) else 1.0


def _check_truths(path: str | Path, problem: TrackingSetup, replicates: Sequence[int], draws: Sequence[Drawn]) -> None:
    """Raises ResultError where the file holds a truth, and it is not the one that is drawn now."""
    if "truth" not in recording.tables(path):
        return
    names = problem.motions[0].columns
    table = recording.read_table(path, "truth", ["replicate", "target", "step", *names])
    for replicate, one in zip(replicates, draws, strict=True):
        for target, truth in enumerate(one.truths):
            mine = (table["replicate"] == replicate) & (table["target"] == target)
            held = np.column_stack([table[name][mine] for name in names])
            if not np.allclose(held, truth[table["step"][mine]], rtol=1e-6, atol=1e-6):
                raise ResultError(f"{path}: holds another truth of replicate {replicate} than this version draws")
