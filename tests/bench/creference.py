"""The C side of a ratio: reference.c compiled on the spot, in the ways in which it might be fastest.

with compiled() as programs: programs["gcc's width"](*problem.arguments, problem.keys) -> means, resampled
"""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

SOURCE = Path(__file__).with_name("reference.c")
FLAGS = ("-O3", "-march=native", "-ffast-math")
BUILDS = {"gcc's width": (), "widest": ("-DWIDE",), "widest, own maths": ("-DWIDE", "-DOWN"), "own maths": ("-DOWN",)}
VECTORISED = {"log", "exp", "sin", "cos"}
Program = Callable[..., tuple[np.ndarray, int]]


@contextmanager
def compiled() -> Iterator[dict[str, Program]]:
    """Every build of the filter by name; none where gcc is missing."""
    if shutil.which("gcc") is None:
        yield {}
        return
    with tempfile.TemporaryDirectory() as folder:
        yield {name: _program(Path(folder) / f"filter{i}", BUILDS[name]) for i, name in enumerate(BUILDS)}


def _program(place: Path, defines: tuple[str, ...]) -> Program:
    """Compiled and linked in two steps: gcc links -ffast-math with a start-up that flushes Python's denormals too."""
    thing, library = place.with_suffix(".o"), place.with_suffix(".so")
    subprocess.run(["gcc", *FLAGS, *defines, "-fPIC", "-c", str(SOURCE), "-o", str(thing)], check=True)
    subprocess.run(["gcc", "-shared", str(thing), "-o", str(library), "-lmvec", "-lm"], check=True)
    if "-DOWN" not in defines:
        found = set(re.findall(rb"_ZGV[bcde]N\d+v_(\w+)", thing.read_bytes()))
        missing = VECTORISED - {name.decode() for name in found}
        if missing:
            raise RuntimeError(f"gcc did not vectorise {', '.join(sorted(missing))}: this is not the reference")
    return _calling(ctypes.CDLL(str(library)).run)


def _calling(function: Any) -> Program:
    pointer = ctypes.c_void_p
    function.argtypes = [ctypes.c_int] * 3 + [pointer] * 7 + [ctypes.c_double, pointer, pointer]
    function.restype = ctypes.c_int

    def run(
        start: Any,
        readings: Any,
        positions: Any,
        gains: Any,
        law: Any,
        drift: Any,
        root: Any,
        threshold: Any,
        keys: Any,
    ) -> tuple[np.ndarray, int]:
        means = np.empty((readings.shape[0], 4))
        arrays = [start, readings, positions, gains, np.array(law), np.array(drift), np.array(root)]
        assert all(array.flags.c_contiguous for array in arrays), "C reads rows end to end"
        sizes = start.shape[1], *readings.shape
        pointers = [array.ctypes.data for array in arrays]
        resampled = function(*sizes, *pointers, threshold, keys.ctypes.data, means.ctypes.data)
        if resampled < 0:
            raise MemoryError("the C reference found no room")
        return means, resampled

    return run
