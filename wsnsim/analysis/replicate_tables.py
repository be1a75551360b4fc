"""The tables of a result file for one Monte Carlo run.

read_replicate(path, replicate) -> ReplicateTables
first_replicate(path) -> int        check_replicate(path, replicate)
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

import wsnsim.recording as recording
from wsnsim.analysis import plot_data
from wsnsim.analysis.plot_data import Columns
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import UsageError

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
    """

    dt: float
    layout: plot_data.StateLayout | None
    words: tuple[str, ...]
    unrecorded: frozenset[str]
    truth: Columns
    guess: Columns
    nodes: Columns
    events: Columns
    cloud: Columns

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
        return max((int(t["step"].max()) for t in (self.truth, self.guess, self.events) if t), default=0)

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
    layout = plot_data.layout(path) if root["states"] else None
    place = layout.position if layout else ()
    wanted: dict[str, tuple[str, ...]] = {
        "truth": ("target", "step", "time", *place),
        "estimates": ("target", "step", "time", *place, "error", "head", "issued"),
        "nodes": ("node", "x", "y", "energy_initial", "energy_left", "died_at"),
        "events": EVENTS,
        "particles": ("target", "step", *place, "weight"),
    }
    rows = {name: _rows(path, name, columns, replicate, sizes) for name, columns in wanted.items()}
    if not any(rows.values()):
        check_replicate(path, replicate)
    words = recording.meanings(path, "events", "what") if rows["events"] else ()
    tables = (rows[name] for name in wanted)
    step = float(plot_data.stored_json(path, "scenario/resolved_json").get("step", "nan"))  # it may hold no scenario
    return ReplicateTables(step, layout, words, frozenset(wanted) - sizes.keys(), *tables)


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
        raise UsageError(f"{path}: no replicate {replicate}; it has {plot_data.number_span(np.unique(held))}")


def _rows(path: str | Path, table: str, columns: tuple[str, ...], replicate: int, sizes: dict[str, Any]) -> Columns:
    """A table's columns of one run, empty without rows. Only the range of rows that holds the run is read."""
    if table not in sizes or not sizes[table].rows:
        return {}
    mine = np.flatnonzero(recording.read_table(path, table, ["replicate"])["replicate"] == replicate)
    if not mine.size:
        return {}
    first = int(mine[0])
    held = recording.read_table(path, table, columns, slice(first, int(mine[-1]) + 1))
    return {name: values[mine - first] for name, values in held.items()}
