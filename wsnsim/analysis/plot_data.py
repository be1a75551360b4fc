"""The data of plots: a result's columns for one track, for one step, or over all runs; and the tables of one run.

    heading(path);  lacking(path, what);  layout(path);  errors(path);  spent(path);  counts(path)
    course(path, columns, replicate, target);  nodes_of(path, replicate);  cloud(path, names, step, replicate, target)
    read_replicate(path, replicate) -> ReplicateTables;  first_replicate(path);  check_replicate(path, replicate)

Every function raises UsageError for a column, replicate, target or step that the file does not have, and ResultError
for a table that was not recorded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

import wsnsim.recording as recording
from wsnsim.analysis.multi_target import followed_estimates, followed_runs, is_unlabelled
from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.errors import ResultError, UsageError, did_you_mean
from wsnsim.base.tables import CAUSES, KIND

Columns = dict[str, np.ndarray]

NEEDS: Final = {
    "track": ("truth", "estimates"),
    "states": ("truth", "estimates"),
    "gospa": ("truth", "estimates", "runs"),
    "error": ("estimates",),
    "consistency": ("estimates",),
    "energy": ("energy_steps",),
    "particles": ("particles", "truth"),
    "step": ("truth", "estimates"),
}
"""What can be plotted, and the tables that it needs."""
OF_LABELS: Final = ("states", "consistency", "particles", "step")
"""What is drawn of the track of a target, which is none where readings name no target."""
EMPTY: Final = {
    "energy_steps": "no energy was spent (there is no network)",
    "particles": "the tracker had no particles to record",
}
"""Why a recorded table has no rows."""


class StateLayout(NamedTuple):
    """The state columns.

    Attributes:
        units: {column: unit}.
        position: the columns of the position.
    """

    units: dict[str, str]
    position: tuple[str, ...]

    def label(self, column: str) -> str:
        """The label of an axis for a state column."""
        return column + bracketed(self.units[column])

    def check(self, path: str | Path, column: str) -> None:
        """Raise UsageError unless the column is a state column."""
        if column not in self.units:
            raise UsageError(f"{path}: no state column '{column}' ({did_you_mean(column, self.units)})")


def bracketed(unit: str) -> str:
    """A unit in brackets as it follows a label; empty for a pure number."""
    return f" [{unit}]" if unit not in ("", "1") else ""


def plots_of(path: str | Path) -> tuple[str, ...]:
    """What is plotted of a result with all its tables if nothing else is asked for: keys of `NEEDS`."""
    left_out = OF_LABELS if is_unlabelled(path) else ("gospa", "step")
    return tuple(name for name in NEEDS if name not in left_out)


def lacking(path: str | Path, what: str) -> str:
    """Why the file cannot be plotted as `what`, a key of `NEEDS`; empty if it can."""
    sizes, unlabelled = recording.tables(path), is_unlabelled(path)
    if unlabelled and what in OF_LABELS:
        return "readings name no target, so that no track is of one"
    if not unlabelled and what == "gospa" and "estimates" in sizes:
        return "readings name their targets, so that no track must be assigned to one"
    for table in NEEDS["gospa" if unlabelled and what in ("track", "error") else what]:
        if table not in sizes:
            return f"table {table} was not recorded; run the scenario with record.{table}=true"
        if not sizes[table].rows:
            return EMPTY.get(table, f"table {table} has no rows")
    if what == "consistency" and not np.isfinite(recording.read_table(path, "estimates", ["nees"])["nees"]).any():
        return "no estimate has a covariance with an inverse"
    return ""


def demand(path: str | Path, what: str) -> None:
    """Raise ResultError if the file cannot be plotted as `what`."""
    reason = lacking(path, what)
    if reason:
        raise ResultError(f"{path}: cannot plot {what}: {reason}")


def stored_json(path: str | Path, name: str) -> dict[str, Any]:
    """One of a file's JSON texts; empty if the file holds none, as after a killed run."""
    return recording.read_json(path, name, optional=True)


def heading(path: str | Path) -> str:
    """The scenario's name and seed; empty if the file does not hold them."""
    scenario = stored_json(path, "scenario/resolved_json")
    return f"{scenario['name']}, seed {scenario['seed']}" if scenario else ""


def layout(path: str | Path) -> StateLayout:
    """The state columns of a file. If it does not say which are the position, the first is."""
    root = recording.attributes(path)
    return StateLayout(dict(root["states"]), tuple(root["states"][i][0] for i in root["position"] or (0,)))


def course(path: str | Path, columns: Sequence[str], replicate: int, target: int) -> tuple[Columns, Columns]:
    """One track: time and `columns` of the ground truth, and of the estimates with their sd and the cluster heads."""
    claimed = [f"sd_{axis}" for axis, _ in zip("xy", layout(path).position, strict=False)]
    truth = _track(path, "truth", ("time", *columns), replicate, target)
    return truth, _track(path, "estimates", ("time", *columns, *claimed, "head"), replicate, target)


def cloud(
    path: str | Path, names: Sequence[str], step: int, replicate: int, target: int
) -> tuple[Columns, dict[str, float]]:
    """The particles at a step, as the columns `names` and `weight`, and the true values of these columns."""
    held = _track(path, "particles", ("step", *names, "weight"), replicate, target)
    truth = _track(path, "truth", ("step", *names), replicate, target)
    true = _chosen(truth, _at(path, "truth", truth["step"], "step", step))
    return _chosen(held, _at(path, "particles", held["step"], "step", step)), {name: true[name][0] for name in names}


def last_step_with_particles(path: str | Path, replicate: int, target: int) -> int:
    """The last step with recorded particles."""
    return int(_track(path, "particles", ("step",), replicate, target)["step"].max())


def nodes_of(path: str | Path, replicate: int) -> Columns:
    """The positions of a run's nodes and their initial energy; empty if not recorded."""
    return _rows(path, "nodes", ("node", "x", "y", "energy_initial"), replicate)


def woken_regions(path: str | Path, replicate: int, target: int) -> Columns:
    """The centres of the regions in which nodes were woken; empty if there are none, or not recorded."""
    held = _rows(path, "wakeups", ("target", "x", "y"), replicate)
    return _chosen(held, held["target"] == target) if held else held


def errors(path: str | Path) -> tuple[Floats, Ints, Floats]:
    """The position errors of a file, (runs, targets, steps), NaN without an estimate; the steps; their times (s).

    The steps are those that have rows in the table `estimates`; where readings name no target, all steps, with the
    errors of the tracks that follow the targets.
    """
    if is_unlabelled(path):
        runs = list(followed_runs(path))
        steps = np.arange(1, runs[0].followed.shape[1] + 1)
        return np.stack([run.errors for run in runs]), steps, steps * runs[0].rule.dt
    table = recording.read_table(path, "estimates", ["replicate", "target", "step", "time", "error"])
    axes = [np.unique(table[name], return_inverse=True) for name in ("replicate", "target", "step")]
    result = np.full([known.size for known, _ in axes], np.nan)
    result[tuple(at for _, at in axes)] = table["error"]
    steps, at = axes[-1]
    times = np.zeros(len(steps))
    times[at] = table["time"]
    return result, steps, times


def spent(path: str | Path) -> tuple[Floats, Floats, int]:
    """Cumulative energy in J (causes, steps), the mean over runs; the times (steps,); and the number of runs."""
    table = recording.read_table(path, "energy_steps", ["replicate", "step", "time", "cause", "joules"])
    every = recording.read_table(path, "runs", ["replicate"]) if "runs" in recording.table_names(path) else table
    runs = len(np.unique(every["replicate"]))
    steps, at = np.unique(table["step"], return_inverse=True)
    result, times = np.zeros((len(CAUSES), len(steps))), np.zeros(len(steps))
    np.add.at(result, (table["cause"], at), table["joules"] / runs)
    times[at] = table["time"]
    return np.cumsum(result, axis=1), times, runs


def _track(path: str | Path, table: str, columns: Sequence[str], replicate: int, target: int) -> Columns:
    """A table's columns for one replicate and target, which must be there."""
    held = recording.read_table(path, table, ["replicate", "target", *columns])
    held = _chosen(held, _at(path, table, held["replicate"], "replicate", replicate))
    return _chosen(held, _at(path, table, held["target"], "target", target))


def telling_step(path: str | Path, replicate: int, target: int) -> int:
    """The step of the largest error after the first tenth of a run, else the middle of the run."""
    held = _track(path, "estimates", ("step", "error"), replicate, target)
    steps, errors = (held[name][len(held["step"]) // 10 :] for name in ("step", "error"))
    known = np.isfinite(errors)
    return int(steps[known][errors[known].argmax()] if known.any() else np.median(held["step"]))


def sensing_nodes(path: str | Path, step: int, replicate: int) -> np.ndarray:
    """The nodes that sensed at a step; empty if events were not recorded."""
    held = _rows(path, "events", ("step", "kind", "node"), replicate)
    return np.unique(held["node"][(held["step"] == step) & (held["kind"] == KIND["sense"])]) if held else np.empty(0)


def _at(path: str | Path, table: str, numbers: np.ndarray, name: str, wanted: int) -> np.ndarray:
    """Which numbers are the wanted one, which must be among them."""
    chosen: np.ndarray = numbers == wanted
    if not chosen.any():
        raise UsageError(f"{path}: table {table} has no {name} {wanted}; it has {number_span(np.unique(numbers))}")
    return chosen


def _chosen(columns: Columns, rows: np.ndarray) -> Columns:
    return {name: values[rows] for name, values in columns.items()}


def number_span(numbers: np.ndarray) -> str:
    """Sorted numbers as a text: one by one if they are few, else the first and the last."""
    if numbers.size <= 6:
        return ", ".join(str(number) for number in numbers.tolist()) or "none"
    gaps = int(numbers[-1]) - int(numbers[0]) + 1 > numbers.size
    return f"{numbers[0]} … {numbers[-1]}{', with gaps' if gaps else ''}"


EVENTS: Final = ("step", "target", "node", "kind", "what", "frame", "peer", "joules")


@dataclass(frozen=True)
class ReplicateTables:
    """The tables of one Monte Carlo run; one that the file does not hold is an empty dict.

    Attributes:
        dt: length of a step in s, NaN if unknown.
        layout: the state columns, None without a target.
        words: the categories of `events.what`.
        unrecorded: names of the tables that were not to be recorded.
        truth: the ground truth.
        guess: the estimates.
        nodes: the nodes.
        events: the event log.
        cloud: the particles.
        unlabelled: all tracks where readings name no target, and `guess` has those that follow a target; else None.
        headless: whether there is no cluster head; the column `head` is then the gateway, whose estimate was recorded.
    """

    dt: float
    layout: StateLayout | None
    words: tuple[str, ...]
    unrecorded: frozenset[str]
    truth: Columns
    guess: Columns
    nodes: Columns
    events: Columns
    cloud: Columns
    unlabelled: Columns | None = None
    headless: bool = False

    @property
    def groups(self) -> list[int]:
        """What events are of: the targets, or where readings name none, the groups of tracks."""
        if self.unlabelled is None:
            return self.targets
        return sorted(
            {int(number) for number in np.unique(self.events["target"]) if number >= 0} if self.events else ()
        )

    @property
    def flat(self) -> bool:
        """Whether the position has one column; it is then drawn over time."""
        return self.layout is not None and len(self.layout.position) == 1

    @property
    def network(self) -> bool:
        """Whether there is a network: only then, nodes have a battery."""
        return bool(self.nodes) and bool(np.isfinite(self.nodes["energy_initial"]).any())

    @property
    def last(self) -> int:
        """The last recorded step."""
        return max(
            (int(t["step"].max()) for t in (self.truth, self.guess, self.events, self.unlabelled) if t), default=0
        )

    @property
    def targets(self) -> list[int]:
        """The numbers of the targets."""
        return sorted({int(t) for table in (self.truth, self.guess) if table for t in np.unique(table["target"])})

    @property
    def axes(self) -> list[str]:
        """The labels of the two axes."""
        if self.layout is None:
            return ["x [m]", "y [m]"]
        place = self.layout.position
        return ["time [s]" if self.flat else self.layout.label(place[0]), self.layout.label(place[-1])]

    def places(self, table: Columns) -> tuple[Floats, Floats]:
        """The values on the two axes: the plane, or time and position."""
        assert self.layout is not None, "a track has a motion model"
        place = self.layout.position
        return table["time"] if self.flat else table[place[0]], table[place[-1]]

    def missing(self) -> list[str]:
        """The sentences that say what cannot be drawn because the file does not hold it."""
        missing = []
        if not self.nodes:
            missing.append(self._without("nodes", "no nodes are drawn"))
        elif not self.network:
            missing.append("the scenario has no network: no frames are drawn and no energy is spent")
        elif not self.events:
            missing.append(
                self._without("events", "no frames and no sleeping nodes are drawn")
                + "; the residual energy is that at the end"
            )
        if self.layout is not None:
            missing += [] if self.truth else [self._without("truth", "no ground-truth trajectory is drawn")]
            missing += [] if self.guess else [self._without("estimates", "no estimates are drawn")]
        if self.guess and not np.isfinite(self.guess["error"]).any():
            missing.append("no estimate was issued")
        return missing

    def _without(self, table: str, consequence: str) -> str:
        """A sentence that says what is not drawn because the table is missing or empty."""
        if table in self.unrecorded:
            return f"{consequence}: table {table} was not recorded (record.{table}=true)"
        return f"{consequence}: table {table} has no rows"


def read_replicate(path: str | Path, replicate: int) -> ReplicateTables:
    """Read the tables of one run.

    Raises:
        UsageError: the file does not hold this run.
        ResultError: the file cannot be read.
    """
    root, sizes = recording.attributes(path), recording.tables(path)
    plan = layout(path) if root["states"] else None
    place = plan.position if plan else ()
    wanted: dict[str, tuple[str, ...]] = {
        "truth": ("target", "step", "time", *place),
        "estimates": ("target", "step", "time", *place, "error", "head", "issued"),
        "nodes": ("node", "x", "y", "energy_initial", "energy_left", "died_at"),
        "events": EVENTS,
        "particles": ("target", "step", *place, "weight"),
    }
    named = not is_unlabelled(path)
    rows = {
        name: _rows(path, name, columns, replicate) for name, columns in wanted.items() if named or name != "estimates"
    }
    if not named:
        followed = followed_estimates(path, replicate)
        rows["estimates"] = {name: followed[name] for name in wanted["estimates"]} if followed["step"].size else {}
        columns = ("step", "time", "track", *place, "confirmed")
    unlabelled = None if named else _rows(path, "estimates", columns, replicate)
    if not any(rows.values()):
        check_replicate(path, replicate)
    words = recording.meanings(path, "events", "what") if rows["events"] else ()
    truth, guess, nodes, events, cloud = (rows[name] for name in wanted)
    step = float(stored_json(path, "scenario/resolved_json").get("step", "nan"))  # it may hold no scenario
    unrecorded = frozenset(wanted) - sizes.keys()
    tables = truth, guess, nodes, events, cloud, unlabelled
    return ReplicateTables(step, plan, words, unrecorded, *tables, is_headless(path))


def is_headless(path: str | Path) -> bool:
    """Whether a result is of a network without a cluster head."""
    tables = recording.tables(path)
    return "estimates" in tables and "disagreement" in tables["estimates"].columns


def first_replicate(path: str | Path) -> int:
    """The number of the first run with rows in the file; 0 if there is none."""
    sizes = recording.tables(path)
    for table in ("runs", "truth", "estimates", "nodes"):
        if table in sizes and sizes[table].rows:
            return int(recording.read_table(path, table, ["replicate"])["replicate"].min())
    return 0


def check_replicate(path: str | Path, replicate: int) -> None:
    """Raise UsageError if the file holds complete runs, but not this one."""
    if "runs" not in recording.table_names(path):
        return
    held = recording.read_table(path, "runs", ["replicate"])["replicate"]
    if held.size and replicate not in held:
        raise UsageError(f"{path}: no replicate {replicate}; it has {number_span(np.unique(held))}")


def _rows(path: str | Path, table: str, columns: tuple[str, ...], replicate: int) -> Columns:
    """A table's columns of one run, empty without rows. Only the range of rows that holds the run is read."""
    sizes = recording.tables(path)
    if table not in sizes or not sizes[table].rows:
        return {}
    mine = np.flatnonzero(recording.read_table(path, table, ["replicate"])["replicate"] == replicate)
    if not mine.size:
        return {}
    first = int(mine[0])
    held = recording.read_table(path, table, columns, slice(first, int(mine[-1]) + 1))
    return {name: values[mine - first] for name, values in held.items()}
