"""What pictures are drawn from: a result's columns for one track, for one step, or over all runs.

    heading(path);  lacking(path, what);  layout(path);  errors(path);  spent(path);  counts(path)
    course(path, columns, replicate, target);  nodes_of(path, replicate);  cloud(path, names, step, replicate, target)

A column, replicate, target or step that the file does not have is a UsageError, a table that was not recorded a
ResultError.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

import wsnsim.recording as recording
from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.errors import ResultError, UsageError, did_you_mean
from wsnsim.base.tables import CAUSES

Columns = dict[str, np.ndarray]

NEEDS: Final = {
    "track": ("truth", "estimates"),
    "states": ("truth", "estimates"),
    "error": ("estimates",),
    "energy": ("energy_steps",),
    "particles": ("particles", "truth"),
}
"""What can be drawn, and the tables that it needs."""
EMPTY: Final = {
    "energy_steps": "no energy was spent (a scenario without a network spends none)",
    "particles": "the tracker had no particles to record",
}
"""What it means that a table was recorded and has no rows."""


class StateLayout(NamedTuple):
    """The state columns with their units, and which of them are the position."""

    units: dict[str, str]
    position: tuple[str, ...]

    def label(self, column: str) -> str:
        """A state column as an axis says it."""
        return column + bracketed(self.units[column])

    def check(self, path: str | Path, column: str) -> None:
        """Raise UsageError unless the column is one of the states'."""
        if column not in self.units:
            raise UsageError(f"{path}: there is no state column '{column}' ({did_you_mean(column, self.units)})")


class RunCounts(NamedTuple):
    """How many runs a file holds, targets in each, and runs that lost a track; None if that was not recorded."""

    runs: int
    targets: int
    lost: int | None


def bracketed(unit: str) -> str:
    """A unit as it follows a word on an axis; nothing where there is none."""
    return f" [{unit}]" if unit else ""


def lacking(path: str | Path, what: str) -> str:
    """Why the file cannot show it ('track', 'states', 'error', 'energy', 'particles'); '' if it can."""
    sizes = recording.tables(path)
    for table in NEEDS[what]:
        if table not in sizes:
            return f"table {table} was not recorded; run the scenario with record.{table}=true"
        if not sizes[table].rows:
            return EMPTY.get(table, f"table {table} has no rows")
    return ""


def demand(path: str | Path, what: str) -> None:
    """Raise ResultError where the file cannot show it."""
    reason = lacking(path, what)
    if reason:
        raise ResultError(f"{path}: cannot draw {what}: {reason}")


def heading(path: str | Path) -> str:
    """The scenario's name and seed; '' if the file does not hold them."""
    try:
        scenario = json.loads(recording.read_text(path, "scenario/resolved_json"))
    except ResultError:
        return ""
    return f"{scenario['name']}, seed {scenario['seed']}"


def layout(path: str | Path) -> StateLayout:
    """How a file's states are laid out. One that does not say which are the position: px and py, or the first."""
    root = recording.attributes(path)
    names = [name for name, _ in root["states"]]
    place = root["position"] or [i for i, name in enumerate(names) if name in ("px", "py")] or [0]
    return StateLayout(dict(root["states"]), tuple(names[i] for i in place))


def course(path: str | Path, columns: Sequence[str], replicate: int, target: int) -> tuple[Columns, Columns]:
    """One track: the truth's time and `columns`, and the estimates' with the claimed sd and the heads."""
    claimed = [f"sd_{axis}" for axis, _ in zip("xy", layout(path).position, strict=False)]
    truth = _track(path, "truth", ("time", *columns), replicate, target)
    return truth, _track(path, "estimates", ("time", *columns, *claimed, "head"), replicate, target)


def cloud(
    path: str | Path, names: Sequence[str], step: int, replicate: int, target: int
) -> tuple[Columns, dict[str, float]]:
    """The particles at a step: the columns `names` and their weights; and where the target truly was."""
    held = _track(path, "particles", ("step", *names, "weight"), replicate, target)
    truth = _track(path, "truth", ("step", *names), replicate, target)
    true = _chosen(truth, _at(path, "truth", truth["step"], "step", step))
    return _chosen(held, _at(path, "particles", held["step"], "step", step)), {name: true[name][0] for name in names}


def last_step_with_particles(path: str | Path, replicate: int, target: int) -> int:
    """The last step of which the file holds particles."""
    return int(_track(path, "particles", ("step",), replicate, target)["step"].max())


def nodes_of(path: str | Path, replicate: int) -> Columns:
    """Where the nodes of a run stand, with their charge; empty if that was not recorded."""
    if "nodes" not in recording.tables(path):
        return {}
    held = recording.read_table(path, "nodes", ["replicate", "node", "x", "y", "energy_initial"])
    return _chosen(held, held["replicate"] == replicate)


def woken_regions(path: str | Path, replicate: int, target: int) -> Columns:
    """Where the regions were that nodes were woken in, by their centres; empty if none was, or none recorded."""
    tables = recording.tables(path)
    if "wakeups" not in tables or not tables["wakeups"].rows:
        return {}
    held = recording.read_table(path, "wakeups", ["replicate", "target", "x", "y"])
    return _chosen(held, (held["replicate"] == replicate) & (held["target"] == target))


def errors(path: str | Path) -> tuple[Floats, Floats]:
    """(tracks, steps) position errors, NaN where a run has no estimate or had ended; and the steps' times."""
    table = recording.read_table(path, "estimates", ["replicate", "target", "step", "time", "error"])
    steps, at = np.unique(table["step"], return_inverse=True)
    tracks, row = np.unique(np.stack([table["replicate"], table["target"]], axis=1), axis=0, return_inverse=True)
    result, times = np.full((len(tracks), len(steps)), np.nan), np.zeros(len(steps))
    result[row.ravel(), at] = table["error"]
    times[at] = table["time"]
    return result, times


def steps_of(path: str | Path) -> Ints:
    """The steps that have rows in `estimates`, in order: those of `errors`."""
    return np.unique(recording.read_table(path, "estimates", ["step"])["step"])


def counts(path: str | Path) -> RunCounts:
    """How many runs and targets the estimates are of, and how many runs lost a track."""
    table = recording.read_table(path, "estimates", ["replicate", "target"])
    runs, targets = (len(np.unique(table[name])) for name in ("replicate", "target"))
    known = "runs" in recording.tables(path)
    return RunCounts(runs, targets, int(recording.read_table(path, "runs", ["lost"])["lost"].sum()) if known else None)


def spent(path: str | Path) -> tuple[Floats, Floats, int]:
    """(causes, steps) joules that a run has spent by each step, the mean over runs; the times; and how many runs."""
    table = recording.read_table(path, "energy_steps", ["replicate", "step", "time", "cause", "joules"])
    every = recording.read_table(path, "runs", ["replicate"]) if "runs" in recording.tables(path) else table
    runs = len(np.unique(every["replicate"]))
    steps, at = np.unique(table["step"], return_inverse=True)
    result, times = np.zeros((len(CAUSES), len(steps))), np.zeros(len(steps))
    np.add.at(result, (table["cause"], at), table["joules"] / runs)
    times[at] = table["time"]
    return np.cumsum(result, axis=1), times, runs


def _track(path: str | Path, table: str, columns: Sequence[str], replicate: int, target: int) -> Columns:
    """A table's columns for one replicate and target, which it must have."""
    held = recording.read_table(path, table, ["replicate", "target", *columns])
    held = _chosen(held, _at(path, table, held["replicate"], "replicate", replicate))
    return _chosen(held, _at(path, table, held["target"], "target", target))


def _at(path: str | Path, table: str, numbers: np.ndarray, name: str, wanted: int) -> np.ndarray:
    """Where the numbers are the one wanted, which must be among them."""
    chosen: np.ndarray = numbers == wanted
    if not chosen.any():
        raise UsageError(f"{path}: there is no {name} {wanted} in table {table}; it has {_span(np.unique(numbers))}")
    return chosen


def _chosen(columns: Columns, rows: np.ndarray) -> Columns:
    return {name: values[rows] for name, values in columns.items()}


def _span(numbers: np.ndarray) -> str:
    """Which numbers there are: one by one if they are few, else from the first to the last."""
    if numbers.size <= 6:
        return ", ".join(str(number) for number in numbers.tolist()) or "none"
    gaps = int(numbers[-1]) - int(numbers[0]) + 1 > numbers.size
    return f"{numbers[0]} … {numbers[-1]}{', with gaps' if gaps else ''}"
