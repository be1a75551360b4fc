"""What a reader must know beside the figures: targets out of range, steps without an estimate, figures without a value.

of_setup(setup) -> notes      of_report(report, figures) -> notes      reasons(report, figures) -> {figure: reason}
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

import wsnsim.scenario as scenarios
from wsnsim.analysis import connectivity
from wsnsim.analysis.phrases import counted
from wsnsim.analysis.plot_data import stored_json
from wsnsim.analysis.quantities import FIGURES, NETWORK_ONLY
from wsnsim.analysis.setup_notes import in_a_check, named
from wsnsim.base.arrays import Floats, planar
from wsnsim.base.errors import RunError
from wsnsim.base.initial_conditions import InitialConditions, node_names, sample_initial_conditions, sample_positions
from wsnsim.base.recorded_files import COUNTS, ROWS, provenance_of
from wsnsim.base.results import Report
from wsnsim.base.setups import BeaconSetup, NetworkSetup, Setup, TrackingSetup

NO_ESTIMATE: Final = "no step has an estimate"
NO_NETWORK: Final = "no network is simulated"
UNKNOWN: Final = "it is not known in any run"
OF_THREE: Final = ("rmse_three", "mean_error_three", "median_error_three")
"""Errors at the steps with three readings or more."""
ON_REQUEST: Final = "it is computed by `wsnsim run --bound`"
LEAST_RUNS: Final = 5
"""Runs from which on there are intervals (see `quantities`)."""


class _Visibility(NamedTuple):
    """Of how many steps of a target it is out of the sensing range of all nodes, and outside the field."""

    steps: int
    unheard: int
    outside: int
    nearest: float


def of_setup(setup: Setup, replicate: int = 0) -> list[str]:
    """What makes a valid scenario hopeless or harder than it looks: its values, and the initial conditions of a run."""
    found = in_a_check(setup)
    try:
        if isinstance(setup, BeaconSetup):
            return found + _parted(setup, sample_positions(setup, setup.link.reach, replicate), replicate)
        if not isinstance(setup, TrackingSetup):
            return found
        conditions = sample_initial_conditions(setup, replicate)
    except RunError as error:
        return [*found, f"run {replicate} cannot start: {error}"]
    found += _skipped(provenance_of(setup))
    if setup.recorded is not None:
        found += _silent_steps(setup)
    else:
        found += _visibility_notes(setup, [_visibilities(setup, conditions, setup.steps)], f"run {replicate}")
    return found + (_parted(setup, conditions.positions, replicate) if isinstance(setup, NetworkSetup) else [])


def of_report(report: Report, figures: Mapping[str, Any]) -> list[str]:
    """Which steps have no estimate, and whether targets were out of range in runs that were not tracked throughout."""
    missing, steps = figures["without_estimate"], figures["steps"] * figures["targets"]
    notes = []
    if missing == steps:
        notes = ["no step has an estimate: there is no error"]
    elif missing:
        count = f"{missing:,.4g} of {steps:,} steps"
        notes = [f"{count} have no estimate (mean of the runs); errors are over the others"]
    poor = [summary for summary in report.summaries if any(track["tracked"] < 1.0 for track in summary.tracks)]
    if report.out.is_file():  # it may have been moved since
        notes += _skipped(stored_json(report.out, "provenance_json"))
    setup = scenarios.build(report.scenario) if poor else None
    if not isinstance(setup, TrackingSetup):
        return notes
    if setup.recorded is not None:
        return notes + _silent_steps(setup)
    seen = [
        _visibilities(setup, sample_initial_conditions(setup, summary.run["replicate"]), summary.run["steps"])
        for summary in poor
    ]
    when = (
        f"run {poor[0].run['replicate']}" if len(poor) == 1 else f"mean of the {len(poor)} runs with steps not tracked"
    )
    return notes + _visibility_notes(setup, seen, when)


def _skipped(provenance: Mapping[str, Any]) -> list[str]:
    """How many rows of recorded files are left out, and which is the first of each file."""
    rows: Sequence[str] = provenance.get(ROWS, ())
    first = {name: next((row for row in rows if row.startswith(f"{name}:")), "") for name in provenance.get(COUNTS, {})}
    return [
        f"{counted(count, 'row')} of {name} left out" + (f", such as {first[name]}" if first[name] else "")
        for name, count in provenance.get(COUNTS, {}).items()
    ]


def _silent_steps(setup: TrackingSetup) -> list[str]:
    """At how many steps no node has a recorded reading of a target."""
    assert setup.recorded is not None, "readings are sampled"
    recordings = setup.recorded.recordings(node_names(setup), len(setup.motions), setup.steps, setup.dt)
    silent = [int((recording.counts[1:].sum(axis=1) == 0).sum()) for recording in recordings]
    return [
        f"no node has a recorded reading of target {target} at {count:,} of {setup.steps:,} steps"
        for target, count in enumerate(silent)
        if count
    ]


def _parted(setup: BeaconSetup | NetworkSetup, positions: Floats, replicate: int) -> list[str]:
    """The note on a network that falls into parts."""
    said = connectivity.note(setup, positions)
    return [f"run {replicate}: {said}"] if said else []


def reasons(report: Report, figures: Mapping[str, Any]) -> dict[str, str]:
    """Why each figure without a value has none."""
    unknown = [
        key
        for key, value in figures.items()
        for each in (value.values() if isinstance(value, Mapping) else (value,))
        if isinstance(each, float) and math.isnan(each)
    ]
    return {key: _reason(key, report, figures) for key in unknown}


def _reason(key: str, report: Report, figures: Mapping[str, Any]) -> str:
    base = key.removesuffix("_low").removesuffix("_high")
    known = figures.get(base, math.nan)
    if base != key and isinstance(known, float) and math.isfinite(known):
        few = len(report.summaries) < LEAST_RUNS
        return f"an interval needs {LEAST_RUNS} runs" if few else "it is known in too few runs"
    if base.startswith("bound") and figures["bound_reason"]:
        return str(figures["bound_reason"])
    if base in NETWORK_ONLY and report.scenario.network is not None:
        return NO_NETWORK
    if base in OF_THREE and math.isnan(figures["rmse"]):
        return NO_ESTIMATE
    return (FIGURES[base].unknown if base in FIGURES else "") or UNKNOWN


def _visibilities(setup: TrackingSetup, conditions: InitialConditions, steps: int) -> list[_Visibility]:
    """How well each target can be seen over the steps of a run."""
    from scipy.spatial import KDTree  # slow to import, and needed only if a target was not tracked throughout

    tree = KDTree(conditions.positions)
    found = []
    for motion, truth in zip(setup.motions, conditions.truths, strict=True):
        points = planar(truth[1 : steps + 1, list(motion.position)])
        distances = tree.query(points)[0]
        inside = setup.deploy.field.contains(points)
        unheard = int((distances > setup.sensor.reach).sum())
        found.append(_Visibility(len(points), unheard, int((~inside).sum()), float(distances.min(initial=math.inf))))
    return found


def _visibility_notes(setup: TrackingSetup, runs: Sequence[Sequence[_Visibility]], when: str) -> list[str]:
    """What is said of the targets that no node can measure at some steps."""
    notes = []
    for target in range(len(setup.motions)):
        of = [run[target] for run in runs]
        steps, unheard, outside = (
            float(np.mean([getattr(each, key) for each in of])) for key in _Visibility._fields[:3]
        )
        reach = f"the sensing range of {setup.sensor.reach:g} m"
        if unheard == steps:
            nearest = min(each.nearest for each in of)
            notes.append(
                f"{when}: target {target} is never within {reach} of a node; the nearest is {nearest:.4g} m away"
            )
        elif unheard:
            count = f"{unheard:,.4g} of {steps:,.4g} steps"
            notes.append(f"{when}: target {target} is not within {reach} of any node at {count}")
        if unheard and outside:
            place = named(setup.deploy.field)
            notes.append(f"{when}: target {target} is outside {place} at {outside:,.4g} of {steps:,.4g} steps")
    return notes
