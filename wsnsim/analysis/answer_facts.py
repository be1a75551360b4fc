"""What answers and summaries are made of: columns of the short tables, arrays, joules by cause, and errors of clocks.

facts_of_file(path)      facts_of_tables(tables, scenario)      facts_of_report(report)
read_arrays(path) -> ResultArrays        position_unit(path) -> 'm'
clock_figures(report) -> dict            clock_rows(figures) -> [(name, value)]
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

import wsnsim.scenario as scenarios
from wsnsim.analysis import plot_data
from wsnsim.analysis.plot_data import stored_json
from wsnsim.analysis.quantities import QUANTITIES, ResultArrays
from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.results import Report
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import CAUSES
from wsnsim.recording import attributes, read_table, tables


def read_arrays(path: str | Path) -> ResultArrays:
    """The arrays of a result file; of the long tables, only the errors are read."""
    held = tables(path)
    runs = read_table(path, "runs") if "runs" in held else {}
    columns = {name: column.astype(np.float64) for name, column in runs.items() if column.dtype.kind in "uif"}
    errors = plot_data.errors(path).errors if "estimates" in held and held["estimates"].rows else np.empty((0, 0, 0))
    about = attributes(path)
    tracks = _tracks(path, len(runs.get("replicate", ())))
    return ResultArrays(errors, columns, bool(about["states"]), tracks, len(about["position"] or ()))


def _tracks(path: str | Path, runs: int) -> dict[str, Floats]:
    """The columns of the table `tracks`, (runs, targets) each; a row each if runs differ in their tracks."""
    if "tracks" not in tables(path) or not tables(path)["tracks"].rows:
        return {}
    columns = read_table(path, "tracks", _latencies(path))
    rows = runs if runs and all(column.size % runs == 0 for column in columns.values()) else None
    return {name: column.astype(np.float64).reshape(rows or column.size, -1) for name, column in columns.items()}


def _latencies(path: str | Path) -> list[str]:
    """The columns of `tracks` that quantities need, as far as the file has them."""
    needed = [name for quantity in QUANTITIES.values() if quantity.of_tracks for name in quantity.columns]
    return [name for name in needed if name in tables(path)["tracks"].columns]


def position_unit(path: str | Path) -> str:
    """The unit of the errors; metres in a file without a target."""
    if not attributes(path)["states"]:
        return "m"
    layout = plot_data.layout(path)
    return layout.units[layout.position[0]]


CLOCK_COLUMNS: Final = ("error", "error_max", "spread", "spread_max", "synchronised")
TIME_UNITS: Final = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def clock_figures(report: Report) -> dict[str, float]:
    """The columns of `clocks` at the end of runs, mean over runs, with names such as `clock_error`.

    NaN where the table was not recorded.
    """
    if not dict(report.scenario.record).get("clocks"):
        return {f"clock_{name}": math.nan for name in CLOCK_COLUMNS}
    table = read_table(report.out, "clocks", ["replicate", *CLOCK_COLUMNS])
    last = np.flatnonzero(np.diff(table["replicate"].astype(np.int64), append=-1))
    return {f"clock_{name}": float(table[name][last].mean()) if last.size else math.nan for name in CLOCK_COLUMNS}


def clock_rows(figures: Mapping[str, float]) -> list[tuple[str, str]]:
    """The lines of a summary; none where clocks were not recorded or show the true time."""
    if not figures["clock_error_max"] > 0.0:
        return []
    error, spread = (
        f"{_seconds(figures[f'clock_{name}'])}, at most {_seconds(figures[f'clock_{name}_max'])}"
        for name in ("error", "spread")
    )
    result = [("clocks from true time at the end", error), ("clocks from their mean at the end", spread)]
    if figures["clock_synchronised"] > 0.0:
        result.append(("nodes that take their clock for synchronised", f"{figures['clock_synchronised']:.0%}"))
    return result


def _seconds(time: float) -> str:
    """A time in the largest unit of which it is at least one."""
    size, unit = next(((size, unit) for size, unit in TIME_UNITS if time >= size), TIME_UNITS[-1])
    return f"{time / size:.3g} {unit}"


Table = Mapping[str, Any]
"""Columns by name: a DataFrame, or a mapping to arrays."""
MANY_ROWS: Final = 500_000
"""Rows of the table `energy` above which the energy is summed from `energy_steps`, if that is shorter (our choice)."""
SHORT: Final = ("runs", "tracks", "reports")
"""The tables, without `energy`, that are read as a whole."""
NAN: Final = float("nan")


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
class AnswerFacts:
    """What is known of the runs of a result.

    Attributes:
        runs: the columns of the table `runs`, (R,) each.
        tracks: the columns of the table `tracks`.
        reports: the columns of the table `reports`; empty if it was not recorded.
        recorded: the position errors.
        joules: energy (J) by cause, mean over the runs; empty without a network, or if it was not recorded.
        unit: unit of the position.
        workload: kind of the workload: `tracking`, `beacons`, `collection` or that of a plug-in.
        faults: kinds of the faults that the runs have.
    """

    runs: Mapping[str, Floats]
    tracks: Mapping[str, Floats] = field(default_factory=dict)
    reports: Mapping[str, Floats] = field(default_factory=dict)
    recorded: RecordedErrors = field(default_factory=RecordedErrors)
    joules: Mapping[str, float] = field(default_factory=dict)
    unit: str = "m"
    workload: str = "tracking"
    faults: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """The number of finished runs."""
        return next(iter(self.runs.values())).size if self.runs else 0

    @property
    def has_network(self) -> bool:
        """Whether a network was simulated: without one, no energy is spent."""
        return bool(np.isfinite(self.column("energy")).any())

    def column(self, name: str) -> Floats:
        """A column of `runs`; NaN for each run if there is none."""
        return self.runs.get(name, np.full(self.count, NAN))

    def mean(self, name: str) -> float:
        """The mean of the known values of a column of `runs`; NaN without one."""
        known = self.column(name)
        known = known[np.isfinite(known)]
        return float(known.mean()) if known.size else NAN

    @property
    def limit(self) -> float:
        """The error from which on a track is lost; infinite if it is only without an estimate, NaN if it is unknown."""
        return float(self.column("lost_limit").min()) if self.count else NAN

    @property
    def ever_lost(self) -> Bools:
        """(R,) the runs with a track lost at any time, the end included."""
        return (self.column("losses") > 0) | self.lost_at_the_end

    @property
    def lost_at_the_end(self) -> Bools:
        """(R,) the runs with a track lost at its last step."""
        lost: Bools = self.column("lost") > 0
        return lost

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
        return np.where(np.isin(self.recorded.replicates, numbers)[:, None, None], NAN, self.recorded.errors)


def facts_of_report(report: Report) -> AnswerFacts:
    """The facts of runs that have just been made."""
    rows, tracks = [one.run for one in report.summaries], [row for one in report.summaries for row in one.tracks]
    causes = {cause for summary in report.summaries for cause in summary.joules}
    steps = max((one.errors.shape[1] for one in report.summaries if one.errors.ndim > 1), default=0)
    errors = np.full((len(rows), len(report.summaries[0].tracks), steps), NAN)
    for into, one in zip(errors, report.summaries, strict=True):
        if one.errors.size:
            into[:, : one.errors.shape[1]] = one.errors
    recorded = dict(report.scenario.record).get("reports") and report.out.is_file()
    return AnswerFacts(
        _columns({name: [row[name] for row in rows] for name in rows[0]}),
        _columns({name: [row[name] for row in tracks] for name in tracks[0]}) if tracks else {},
        _columns(read_table(report.out, "reports")) if recorded else {},
        RecordedErrors(np.array([row["replicate"] for row in rows]), np.arange(1, steps + 1), errors),
        {cause: float(np.mean([one.joules.get(cause, 0.0) for one in report.summaries])) for cause in causes},
        report.states[report.position[0]][1] if report.states else "m",
        _workload(scenarios.resolved(report.scenario)),
        fault_kinds(scenarios.resolved(report.scenario)),
    )


def facts_of_file(path: str | Path) -> AnswerFacts:
    """The facts of a result file; of its long tables, only the errors and the joules are read."""
    held = {name: size.rows for name, size in tables(path).items() if size.rows}
    found: dict[str, Table] = {name: read_table(path, name) for name in SHORT if name in held}
    if "estimates" in held:
        found["estimates"] = read_table(path, "estimates", ["replicate", "target", "step", "error"])
    energy = [name for name in ("energy", "energy_steps") if name in held]
    if len(energy) > 1 and held["energy"] > MANY_ROWS:
        energy.sort(key=lambda name: held[name])
    if energy:
        found["energy"] = read_table(path, energy[0], ["replicate", "cause", "joules"])
    return _of_columns(found, stored_json(path, "scenario/resolved_json"), position_unit(path))


def facts_of_tables(found: Mapping[str, Table], scenario: Any) -> AnswerFacts:
    """The facts of tables in memory.

    Args:
        found: tables by name, as DataFrames or as mappings of columns to arrays. `runs` must be there; `tracks`,
            `estimates`, `energy` and `reports` say more.
        scenario: the Scenario of the runs.
    """
    setup = scenarios.build(scenario)
    motion = setup.motions[0] if isinstance(setup, TrackingSetup) else None
    unit = motion.units[motion.position[0]] if motion else "m"
    return _of_columns(found, scenarios.resolved(scenario), unit)


def _of_columns(found: Mapping[str, Table], scenario: Mapping[str, Any], unit: str) -> AnswerFacts:
    runs = _columns(found.get("runs", {}))
    if not runs or not next(iter(runs.values())).size:
        return AnswerFacts({})
    errors = _errors(found.get("estimates", {}))
    joules = _joules(found.get("energy", {}), next(iter(runs.values())).size)
    tracks, reports = (_columns(found.get(name, {})) for name in ("tracks", "reports"))
    return AnswerFacts(runs, tracks, reports, errors, joules, unit, _workload(scenario), fault_kinds(scenario))


def _columns(table: Table) -> dict[str, Floats]:
    """The columns of a table that hold numbers."""
    columns = {name: np.asarray(table[name]) for name in table}
    return {name: values.astype(np.float64) for name, values in columns.items() if values.dtype.kind in "uifb"}


def _errors(table: Table) -> RecordedErrors:
    """The position errors of the table `estimates`."""
    if not {"replicate", "target", "step", "error"} <= set(table) or not len(table["step"]):
        return RecordedErrors()
    names = ("replicate", "target", "step")
    (numbers, row), (targets, target), (steps, step) = (
        np.unique(np.asarray(table[name]), return_inverse=True) for name in names
    )
    errors = np.full((numbers.size, targets.size, steps.size), NAN)
    errors[row, target, step] = np.asarray(table["error"])
    return RecordedErrors(numbers.astype(np.int64), steps.astype(np.int64), errors)


def _joules(table: Table, runs: int) -> dict[str, float]:
    """Joules by cause, mean over the runs, of a table with the columns `cause` (words or codes) and `joules`."""
    if not {"cause", "joules"} <= set(table):
        return {}
    causes, joules = np.asarray(table["cause"]), np.asarray(table["joules"], dtype=np.float64)
    words: Sequence[str] = CAUSES
    names, code = np.unique(causes, return_inverse=True)
    sums = np.bincount(code, joules, names.size) / runs
    named = [words[int(name)] if causes.dtype.kind in "ui" and int(name) < len(words) else str(name) for name in names]
    return dict(zip(named, sums.tolist(), strict=True))


def fault_kinds(resolved: Mapping[str, Any]) -> tuple[str, ...]:
    """The kinds of the faults of a resolved scenario."""
    return tuple(str(fault.get("kind")) for fault in resolved.get("faults", ()))


def _workload(resolved: Mapping[str, Any]) -> str:
    """The kind of the workload of a resolved scenario."""
    workload = resolved.get("workload")
    kind = workload.get("kind") if isinstance(workload, Mapping) else None
    return kind if isinstance(kind, str) else "tracking"
