"""Cramér-Rao lower bounds on the tracking error.

    bound(scenario, replicates=range(30), kind="unconditional") -> Bound        as `wsnsim compare` shows
    bound_of_run(path, readings="arrived", kind="per_trajectory") -> Bound      of the readings of recorded runs
    bounds_of_run(path, readings, ...) -> [Bound, ...]                          of several kinds of readings, together

Two kinds:

- `unconditional`: the posterior (Bayesian) CRLB of Tichavský, Muravchik, Nehorai (1998). Expectations over
  trajectories are means over those of the runs, so it has their sampling error. It is often loose.
- `per_trajectory`: the trajectory-conditional CRLB, the same recursion along each trajectory alone, then the root mean
  square over trajectories. It is tight but not a strict bound: given an easy trajectory, a filter that is biased may
  have a smaller error.

Both are for filters that know the motion model, the sensor model and the scenario's prior, and that use only the values
of readings. Along a trajectory, filters know the gains and the positions of nodes, or only what they assume of them
(`gains`, `places`); the posterior bound takes both as known. What else a filter assumes wrongly, such as ten times the
process noise, changes nothing: the bound is that of the truth. Which nodes have a reading also depends on the target's
position. No tracker of the catalogue uses that, except through the likelihood of a `range` sensor that yields noise out
of its range (`beyond: noise`). The first readings that count are those of step 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.base.errors import ResultError
from wsnsim.base.initial_conditions import InitialConditions, node_names, sample_initial_conditions
from wsnsim.base.optional_ports import Informs
from wsnsim.base.runs import tracked
from wsnsim.base.sensing import has_gains
from wsnsim.base.setups import BeaconSetup, NetworkSetup, TrackingSetup
from wsnsim.bounds.covariances import ReadingsOf, least_covariances
from wsnsim.bounds.information import RecordedReadings, UsedReadings, in_range
from wsnsim.bounds.least_errors import (
    GAINS,
    KINDS,
    PLACES,
    READINGS,
    Bound,
    BoundQuery,
    assumed_gains,
    assumed_places,
    cautions,
    cautions_of_readings,
    checked,
    reason_without_bound,
    unknown_constants,
)
from wsnsim.recording import read_table, table_names
from wsnsim.scenario import Plugins, build, load
from wsnsim.stored_scenario import rerun_source

__all__ = ["GAINS", "KINDS", "PLACES", "READINGS", "Bound", "BoundQuery", "bound", "bound_of_run", "bounds_of_run"]

KNOWN_GAINS: Final = "the posterior CRLB takes gains as known, and filters do not know them: it may be loose"
NO_TARGET: Final = "the scenario has no target"


def bound(
    scenario: Any,
    replicates: Sequence[int] = range(30),
    kind: str = "unconditional",
    gains: str | None = None,
    places: str | None = None,
) -> Bound:
    """The bound for all readings in range, on the networks and trajectories of these runs of a scenario.

    Args:
        scenario: what `wsnsim.load` takes.
        replicates: numbers of the runs.
        kind: one of `KINDS`.
        gains: one of `GAINS`, or None for what the tracker assumes. Unknown gains count along each trajectory only.
            The posterior bound is then that for known gains, which is a bound in both cases:
            where nodes are placed at random in each run, the effect of an unknown gain averages out.
        places: one of `PLACES`: whether filters know where nodes stand, or only with the error `deploy.position_error`;
            None: they do not if there is an error. It counts along each trajectory only, as `gains`.

    Raises:
        UsageError: kind, gains or places are not allowed, or there are no runs.
        ScenarioError, RunError: as `simulate`.
    """
    loaded = load(scenario)
    setup = build(loaded)
    known = gains or assumed_gains(loaded), tuple(replicates), places or assumed_places(setup)
    query = checked(BoundQuery(kind, "in_range", *known))
    if isinstance(setup, BeaconSetup) or (reason := _reason_without_bound(setup, kind)):
        return _no_bound(query, NO_TARGET if isinstance(setup, BeaconSetup) else reason)
    numbers = tracked(query.replicates, "trajectories of a bound sampled")
    conditions = [sample_initial_conditions(setup, number) for number in numbers]
    return _bound(setup, query, conditions, _all_in_range(setup, conditions), 1.0 - setup.detection.missed)


def bound_of_run(
    path: str | Path,
    readings: str = "arrived",
    kind: str = "per_trajectory",
    gains: str | None = None,
    plugins: bool = False,
) -> Bound:
    """The bound for the readings of recorded runs.

    Without a network all readings arrive. After the end of a run that was shorter than its scenario, no reading counts.

    Args:
        path: a result file.
        readings: `in_range`, those of `active` members of the clusters, or those that `arrived` at the head.
        kind: one of `KINDS`.
        gains: as `bound`.
        plugins: whether plug-ins that the result's scenario names are imported; without it, none is.

    Raises:
        UsageError: kind, readings or gains are not allowed.
        ResultError: the file cannot be read, or holds other trajectories than this version samples.
        ScenarioError: the scenario is invalid, or needs a plug-in.
    """
    return bounds_of_run(path, (readings,), kind, gains, plugins=plugins)[0]


def bounds_of_run(
    path: str | Path,
    readings: Sequence[str] = READINGS,
    kind: str = "per_trajectory",
    gains: str | None = None,
    replicates: Sequence[int] | None = None,
    scenario: Any = None,
    plugins: bool = False,
) -> list[Bound]:
    """The bounds for several kinds of readings of recorded runs, in the order given; otherwise as `bound_of_run`.

    The trajectories are sampled once for all of them.

    Args:
        path: a result file.
        readings: the kinds of readings.
        kind: one of `KINDS`.
        gains: as `bound`.
        replicates: numbers of the runs in the file; None: the file says which they are.
        scenario: the scenario of the file; None: the file says which it is.
        plugins: as `bound_of_run`.

    Raises:
        UsageError: kind, readings or gains are not allowed.
        ResultError: the file cannot be read, or holds other trajectories than this version samples.
        ScenarioError: the scenario is invalid, or needs a plug-in.
    """
    allowed = Plugins.ANY if plugins else Plugins.NONE
    loaded = load(rerun_source(Path(path)), plugins=allowed) if scenario is None else load(scenario)
    setup = build(loaded)
    if replicates is None:
        replicates = read_table(path, "runs", ["replicate"])["replicate"].tolist()
    numbers = tuple(replicates)
    known = gains or assumed_gains(loaded), numbers, assumed_places(setup)
    queries = [checked(BoundQuery(kind, one, *known)) for one in readings]
    if isinstance(setup, BeaconSetup) or (reason := _reason_without_bound(setup, kind)):
        return [_no_bound(query, NO_TARGET if isinstance(setup, BeaconSetup) else reason) for query in queries]
    conditions = [sample_initial_conditions(setup, number) for number in numbers]
    _check_truths(path, setup, numbers, conditions)
    recorded = None
    tables = {"events", "estimates", "clusters"}
    told = isinstance(setup, NetworkSetup) and not (setup.unlabelled or setup.headless)
    if told and tables <= set(table_names(path)):
        recorded = RecordedReadings(path, setup)
    return [_bound_for(setup, query, conditions, recorded) for query in queries]


def _bound_for(
    setup: TrackingSetup, query: BoundQuery, conditions: Sequence[InitialConditions], recorded: RecordedReadings | None
) -> Bound:
    """The bound for the readings of a query; `recorded` is None if the file does not say which ones arrived."""
    if query.readings == "in_range" or not isinstance(setup, NetworkSetup):
        return _bound(setup, query, conditions, _all_in_range(setup, conditions), 1.0 - setup.detection.missed)
    if recorded is None:
        reason = "they name no target" if setup.unlabelled else "it needs the tables events, estimates and clusters"
        reason = "without a head they go from neighbour to neighbour" if setup.headless else reason
        return _no_bound(query, f"which readings arrived is unknown: {reason}")
    return _bound(
        setup, query, conditions, lambda row, target: recorded.used(query.replicates[row], target, query.readings)
    )


def _reason_without_bound(setup: TrackingSetup, kind: str) -> str:
    """Why there is no bound for this setup; empty if nothing is known against it yet."""
    if not isinstance(setup.sensor, Informs):
        return "the sensor model has no information matrix"
    if setup.has_absences and kind == "unconditional":
        return "a target may be absent, which the motion model does not say: use kind per_trajectory"
    return next(filter(None, (reason_without_bound(motion, kind) for motion in setup.motions)), "")


def _no_bound(query: BoundQuery, reason: str) -> Bound:
    return Bound(query, (), np.empty((0, 0, 0, 0, 0)), reason)


def _bound(
    setup: TrackingSetup,
    query: BoundQuery,
    conditions: Sequence[InitialConditions],
    readings_of: ReadingsOf,
    detected: float = 1.0,
) -> Bound:
    try:
        found = least_covariances(setup, conditions, readings_of, query.kind, unknown_constants(setup, query), detected)
    except ValueError as reason:
        return _no_bound(query, str(reason))
    place, about = tuple(setup.motions[0].position), tuple(cautions_of_readings(setup))
    if query.gains == "unknown" and query.kind == "unconditional" and has_gains(setup.sensor):
        about = (*about, KNOWN_GAINS)
    places_known = query.kind == "unconditional" or query.places == "known"
    return Bound(query, place, found, "", tuple(cautions(setup, conditions, places_known)), about)


def _all_in_range(setup: TrackingSetup, conditions: Sequence[InitialConditions]) -> ReadingsOf:
    """The rule that every node in range has a reading; of recorded readings, those that were recorded."""
    if setup.recorded is not None:
        names = node_names(setup, len(conditions[0].positions))
        recordings = setup.recorded.recordings(names, len(setup.motions), setup.steps, setup.dt)
        return lambda _row, target: UsedReadings(*np.nonzero(recordings[target].counts))
    places = [list(motion.position) for motion in setup.motions]
    return lambda row, target: in_range(
        setup.sensor, conditions[row].truths[target][:, places[target]], conditions[row].positions
    )


def _check_truths(
    path: str | Path, setup: TrackingSetup, replicates: Sequence[int], conditions: Sequence[InitialConditions]
) -> None:
    """Raise ResultError if the file holds other trajectories than the ones sampled now."""
    if "truth" not in table_names(path):
        return
    names = setup.motions[0].columns
    table = read_table(path, "truth", ["replicate", "target", "step", *names])
    for replicate, one in zip(replicates, conditions, strict=True):
        for target, truth in enumerate(one.truths):
            mine = (table["replicate"] == replicate) & (table["target"] == target)
            held = np.column_stack([table[name][mine] for name in names])
            if not np.allclose(held, truth[table["step"][mine]], rtol=1e-6, atol=1e-6, equal_nan=True):
                raise ResultError(
                    f"{path}: holds another ground-truth trajectory of replicate {replicate} than this version samples"
                )
