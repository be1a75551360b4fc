"""The arrays of a result file that summary quantities are computed from, and the unit of its position.

read_arrays(path) -> ResultArrays        position_unit(path) -> 'm'
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wsnsim.analysis import plot_data
from wsnsim.analysis.quantities import QUANTITIES, ResultArrays
from wsnsim.base.arrays import Floats
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
