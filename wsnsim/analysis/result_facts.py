"""What answers and summaries are made of: short tables, position errors, joules by cause, kinds of workload and faults.

facts_of_file(path)      facts_of_report(report)      -> ResultFacts
position_unit(path) -> 'm'
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

import wsnsim.scenario as scenarios
from wsnsim.analysis import multi_target
from wsnsim.base import metrics
from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.multi_target import cutoff_of
from wsnsim.base.results import Report
from wsnsim.base.tables import CAUSES
from wsnsim.recording import attributes, read_json, read_table, tables

Table = Mapping[str, Any]
"""Columns by name."""
MANY_ROWS: Final = 500_000
"""Rows of the table `energy` above which the energy is summed from `energy_steps`, if that is shorter (our choice)."""
SHORT: Final = ("runs", "tracks", "reports")
"""The tables, without `energy`, that are read as a whole."""


class RecordedErrors(NamedTuple):
    """Position errors of runs.

    Attributes:
        replicates: (E,) numbers of the runs.
        steps: (K,) numbers of the steps, from 1 on.
        errors: (E, targets, K) position errors, NaN without an estimate.
    """

    replicates: Ints = np.empty(0, dtype=np.int64)
    steps: Ints = np.empty(0, dtype=np.int64)
    errors: Floats = np.empty((0, 0, 0))


@dataclass(frozen=True)
class ResultFacts:
    """What is known of the runs of a result.

    Attributes:
        runs: the columns of the table `runs`, (R,) each.
        tracks: the columns of the table `tracks`, (R, targets) each; a row each if runs differ in their tracks.
        reports: the columns of the table `reports`; empty if it was not recorded.
        recorded: the position errors.
        joules: energy (J) by cause, mean over the runs; empty without a network, or if it was not recorded.
        unit: unit of the position.
        workload: kind of the workload: `tracking`, `beacons`, `collection` or that of a plug-in.
        faults: kinds of the faults that the runs have.
        position: the number of position columns; 0 without a target.
    """

    runs: Mapping[str, Floats]
    tracks: Mapping[str, Floats] = field(default_factory=dict)
    reports: Mapping[str, Floats] = field(default_factory=dict)
    recorded: RecordedErrors = field(default_factory=RecordedErrors)
    joules: Mapping[str, float] = field(default_factory=dict)
    unit: str = "m"
    workload: str = "tracking"
    faults: tuple[str, ...] = ()
    position: int = 2

    @property
    def count(self) -> int:
        """The number of finished runs."""
        return next(iter(self.runs.values())).size if self.runs else 0

    @property
    def unlabelled(self) -> bool:
        """Whether readings name no target, so that tracks are assigned to targets afterwards."""
        return "gospa" in self.runs

    @property
    def cutoff(self) -> float:
        """The distance c of GOSPA, at and above which a track does not follow a target."""
        return cutoff_of(self.limit)

    @property
    def consistent(self) -> float:
        """The median NEES per column of a consistent filter."""
        return metrics.CONSISTENT_MEDIANS.get(self.position, np.nan)

    @property
    def has_network(self) -> bool:
        """Whether a network was simulated: without one, no energy is spent."""
        return bool(np.isfinite(self.column("energy")).any())

    def column(self, name: str) -> Floats:
        """A column of `runs`; NaN for each run if there is none."""
        return self.runs.get(name, np.full(self.count, np.nan))

    def mean(self, name: str) -> float:
        """The mean of the known values of a column of `runs`; NaN without one."""
        return metrics.mean_error(self.column(name))

    @property
    def limit(self) -> float:
        """The error from which on a track is lost; infinite if it is only without an estimate, NaN if it is unknown."""
        return float(self.column("lost_limit").min()) if self.count else np.nan

    @property
    def ever_lost(self) -> Bools:
        """(R,) the runs with a track lost at any time, the end included."""
        return (self.column("losses") > 0) | self.lost_at_the_end

    @property
    def lost_at_the_end(self) -> Bools:
        """(R,) the runs with a track lost at its last step."""
        return self.column("lost") > 0

    @property
    def tracked_shares(self) -> Floats:
        """Shares of the steps with measurements: of each run and target, or else of each run; 1 if unknown."""
        shares = self.tracks.get("tracked", self.column("tracked"))
        return np.where(np.isfinite(shares), shares, 1.0)

    @property
    def judged_errors(self) -> Floats:
        """The errors without those of runs in which a track was lost at any time; all of them if all were lost."""
        lost = self.ever_lost
        if not lost.any() or lost.all():
            return self.recorded.errors
        numbers = self.column("replicate")[lost]
        return np.where(np.isin(self.recorded.replicates, numbers)[:, None, None], np.nan, self.recorded.errors)


def facts_of_report(report: Report) -> ResultFacts:
    """The facts of runs that have just been made."""
    rows, tracks = [one.run for one in report.summaries], [row for one in report.summaries for row in one.tracks]
    steps = max((one.errors.shape[1] for one in report.summaries if one.errors.ndim > 1), default=0)
    recorded = dict(report.scenario.record).get("reports") and report.out.is_file()
    about = scenarios.resolved(report.scenario)
    unit = report.states[report.position[0]][1] if report.states else "m"
    runs = _columns({name: [row[name] for row in rows] for name in rows[0]})
    return ResultFacts(
        runs,
        _by_run({name: [row[name] for row in tracks] for name in tracks[0]} if tracks else {}, len(rows)),
        _columns(read_table(report.out, "reports")) if recorded else {},
        RecordedErrors(np.array([row["replicate"] for row in rows]), np.arange(1, steps + 1), errors_of(report, steps)),
        joules_of(report),
        **_context(unit, about, len(report.position) if report.states else 0),
    )


def errors_of(report: Report, steps: int) -> Floats:
    """(runs, targets, steps) position errors of a report, NaN after the end of a run."""
    errors = np.full((len(report.summaries), len(report.summaries[0].tracks), steps), np.nan)
    for into, one in zip(errors, report.summaries, strict=True):
        if one.errors.size:
            into[:, : one.errors.shape[1]] = one.errors
    return errors


def joules_of(report: Report) -> dict[str, float]:
    """Energy (J) by cause, mean over the runs of a report."""
    causes = sorted({cause for summary in report.summaries for cause in summary.joules})
    return {cause: float(np.mean([one.joules.get(cause, 0.0) for one in report.summaries])) for cause in causes}


def facts_of_file(path: str | Path) -> ResultFacts:
    """The facts of a result file; of its long tables, only the errors and the joules are read."""
    held = {name: size.rows for name, size in tables(path).items() if size.rows}
    runs, tracks, reports = (_columns(read_table(path, name)) if name in held else {} for name in SHORT)
    count = next(iter(runs.values())).size if runs else 0
    estimates: Table = {}
    if multi_target.is_unlabelled(path):
        estimates = _of_followed(path) if {"truth", "runs"} <= held.keys() else {}
    elif "estimates" in held:
        estimates = read_table(path, "estimates", ["replicate", "target", "step", "error"])
    energy = [name for name in ("energy", "energy_steps") if name in held]
    if len(energy) > 1 and held["energy"] > MANY_ROWS:
        energy.sort(key=held.__getitem__)
    joules = _joules(read_table(path, energy[0], ["cause", "joules"]), count) if energy and count else {}
    about, root = read_json(path, "scenario/resolved_json", optional=True), attributes(path)
    position = len(root["position"] or ()) if root["states"] else 0
    recorded, context = _errors(estimates), _context(position_unit(path), about, position)
    return ResultFacts(runs, _by_run(tracks, count), reports, recorded, joules, **context)


def _of_followed(path: str | Path) -> Table:
    """Columns of `estimates` as they are where readings name their target: of the tracks that follow targets."""
    pieces = [
        np.stack([np.full_like(run.errors, run.replicate), *np.indices(run.errors.shape), run.errors]).reshape(4, -1)
        for run in multi_target.followed_runs(path)
    ]
    replicates, targets, places, errors = np.concatenate(pieces, axis=1)
    return {"replicate": replicates, "target": targets, "step": places + 1, "error": errors}


def position_unit(path: str | Path) -> str:
    """The unit of the errors; metres in a file without a target."""
    root = attributes(path)
    return str(root["states"][(root["position"] or (0,))[0]][1]) if root["states"] else "m"


def _columns(table: Table) -> dict[str, Floats]:
    """The columns of a table that hold numbers."""
    columns = {name: np.asarray(table[name]) for name in table}
    return {name: values.astype(np.float64) for name, values in columns.items() if values.dtype.kind in "uifb"}


def _by_run(table: Table, runs: int) -> dict[str, Floats]:
    """The columns of the table `tracks`, (runs, targets) each; a row each if runs differ in their tracks."""
    columns = {name: column for name, column in _columns(table).items() if column.size}
    rows = runs if runs and all(column.size % runs == 0 for column in columns.values()) else -1
    return {name: column.reshape((rows, -1) if rows > 0 else (-1, 1)) for name, column in columns.items()}


def _errors(table: Table) -> RecordedErrors:
    """The position errors of the table `estimates`."""
    if not table:
        return RecordedErrors()
    names = ("replicate", "target", "step")
    (numbers, row), (targets, target), (steps, step) = (np.unique(table[name], return_inverse=True) for name in names)
    errors = np.full((numbers.size, targets.size, steps.size), np.nan)
    errors[row, target, step] = table["error"]
    return RecordedErrors(numbers.astype(np.int64), steps.astype(np.int64), errors)


def _joules(table: Table, runs: int) -> dict[str, float]:
    """Joules by cause, mean over the runs, of a table with the columns `cause` and `joules`."""
    sums = np.bincount(table["cause"], table["joules"], len(CAUSES)) / runs
    return {CAUSES[code]: float(sums[code]) for code in np.unique(table["cause"]) if code < len(CAUSES)}


def fault_kinds(resolved: Mapping[str, Any]) -> tuple[str, ...]:
    """The kinds of the faults of a resolved scenario."""
    return tuple(str(fault.get("kind")) for fault in resolved.get("faults", ()))


def _context(unit: str, resolved: Mapping[str, Any], position: int) -> dict[str, Any]:
    """What is known of a result beside its tables, from its resolved scenario: fields of `ResultFacts`."""
    workload = resolved.get("workload")
    kind = workload.get("kind") if isinstance(workload, Mapping) else None
    workload = kind if isinstance(kind, str) else "tracking"
    return {"unit": unit, "workload": workload, "faults": fault_kinds(resolved), "position": position}
