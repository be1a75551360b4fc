"""Small HDF5 files of named arrays, for what is computed between a scenario and an answer."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from wsnsim.base.errors import ResultError
from wsnsim.recording.atomic_files import reason, write_atomically


def write_arrays(place: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays into a file, as a whole or not at all. Raises StorageError."""

    def write(tmp: Path) -> None:
        with h5py.File(tmp, "w") as file:
            for name, values in arrays.items():
                file.create_dataset(name, data=values, fletcher32=np.ndim(values) > 0 and np.size(values) > 0)

    write_atomically(place, write)


def read_arrays(place: Path) -> dict[str, np.ndarray]:
    """The arrays of a file. Raises ResultError if it cannot be read."""
    try:
        with h5py.File(place, "r") as file:
            return {name: np.asarray(file[name]) for name in file}
    except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
        raise ResultError(f"{place}: cannot be read: {reason(error)}; remove it, and it is made again") from error
