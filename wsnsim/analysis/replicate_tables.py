"""The tables of a result file for one Monte Carlo run.

read_replicate(path, replicate) -> ReplicateTables
first_replicate(path) -> int        check_replicate(path, replicate)
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

import wsnsim.recording as recording
from wsnsim.analysis import plot_data
from wsnsim.analysis.plot_data import Columns
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import ResultError, UsageError

EVENTS: Final = ("step", "target", "node", "kind", "what", "frame", "peer", "joules")


@dataclass(frozen=True)
class ReplicateTables:
    """The rows of one replicate; a table that the file does not hold is an empty dict.

    `dt` in s, NaN if the file does not say; `layout` None where there is no target; `words` are those of `events.what`;
    `unrecorded` names the tables that the file was not to hold.
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
        """Whether the position is one number: it is then drawn over time."""
        return self.layout is not None and len(self.layout.position) == 1

    @property
    def network(self) -> bool:
        """Whether nodes have a charge: without a network they have none."""
        return bool(self.nodes) and bool(np.isfinite(self.nodes["energy_initial"]).any())

    @property
    def last(self) -> int:
        """The last step of which anything is known."""
        return max((int(t["step"].max()) for t in (self.truth, self.guess, self.events) if t), default=0)

    @property
    def targets(self) -> list[int]:
        """The numbers of the targets."""
        return sorted({int(t) for table in (self.truth, self.guess) if table for t in np.unique(table["target"])})

    @property
    def axes(self) -> list[str]:
        """What stands at the axes of its picture."""
        if self.layout is None:
            return ["x [m]", "y [m]"]
        place = self.layout.position
        return ["time [s]" if self.flat else self.layout.label(place[0]), self.layout.label(place[-1])]

    def places(self, table: Columns) -> tuple[Floats, Floats]:
        """Across and up: the plane, or a position over time."""
        assert self.layout is not None, "a track has a motion model"
        place = self.layout.position
        return table["time"] if self.flat else table[place[0]], table[place[-1]]

    def missing(self) -> list[str]:
        """What the file does not hold, as a reader of its picture should know."""
        told = []
        if not self.nodes:
            told.append(self._none_of("nodes", "no nodes are drawn"))
        elif not self.network:
            told.append(
                "no radio is simulated, as the scenario has no network: no frames are drawn, no energy is spent"
            )
        elif not self.events:
            told.append(
                self._none_of("events", "no frames in flight are drawn, nor who sleeps")
                + "; the charge is that at the end"
            )
        if self.layout is not None:
            told += [] if self.truth else [self._none_of("truth", "no true way is drawn")]
            told += [] if self.guess else [self._none_of("estimates", "no estimates are drawn")]
        if self.guess and not np.isfinite(self.guess["error"]).any():
            told.append("no estimate was ever issued")
        return told

    def _none_of(self, table: str, told: str) -> str:
        """What is not drawn, as a table was not recorded, or has no rows."""
        if table in self.unrecorded:
            return f"{told}: table {table} was not recorded (record.{table}=true)"
        return f"{told}: table {table} has no rows"


def read_replicate(path: str | Path, replicate: int) -> ReplicateTables:
    """What the file holds of a replicate.

    Raises:
        UsageError: the file holds others, and not this one.
        ResultError: it cannot be read.
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
    return ReplicateTables(_step_of(path), layout, words, frozenset(wanted) - sizes.keys(), *tables)


def first_replicate(path: str | Path) -> int:
    """The first replicate of which the file holds rows; 0 if it holds none."""
    sizes = recording.tables(path)
    for table in ("runs", "truth", "estimates", "nodes"):
        if table in sizes and sizes[table].rows:
            return int(recording.read_table(path, table, ["replicate"])["replicate"].min())
    return 0


def check_replicate(path: str | Path, replicate: int) -> None:
    """Raise UsageError where the file holds runs that ended, and not this one."""
    if "runs" not in recording.tables(path):
        return
    held = recording.read_table(path, "runs", ["replicate"])["replicate"]
    if held.size and replicate not in held:
        told = f"{held.min()} … {held.max()}" if held.size > 1 else str(held[0])
        raise UsageError(f"{path}: there is no replicate {replicate}; it has {told}")


def _rows(path: str | Path, table: str, columns: tuple[str, ...], replicate: int, sizes: dict[str, Any]) -> Columns:
    """A table's columns of one replicate; empty if there are no rows. Only the span of rows that holds it is read."""
    if table not in sizes or not sizes[table].rows:
        return {}
    mine = np.flatnonzero(recording.read_table(path, table, ["replicate"])["replicate"] == replicate)
    if not mine.size:
        return {}
    first = int(mine[0])
    held = recording.read_table(path, table, columns, slice(first, int(mine[-1]) + 1))
    return {name: values[mine - first] for name, values in held.items()}


def _step_of(path: str | Path) -> float:
    """The seconds of a step; NaN if the file does not hold its scenario."""
    try:
        return float(json.loads(recording.read_text(path, "scenario/resolved_json"))["step"])
    except (ResultError, KeyError, TypeError, ValueError):
        return float("nan")
