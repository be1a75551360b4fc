"""How long a command takes before and beside the simulation: imports, cached kernels, summaries, campaigns."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.bench.timing import median_ratio, row

WSNSIM = (sys.executable, "-m", "wsnsim")
ONE_STEP = (*WSNSIM, "run", "pso_mhpf", "--set", "duration=0.4 s", "--quiet", "--out")
ONE_KERNEL = (
    "import numpy; from wsnsim.kernels.ungm import joint_log_likelihood as kernel; x = numpy.ones(2); kernel(x, x, 1.0)"
)
SIXTEEN = ("--replicates", "16", "--quiet", "--out")


def startup_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """How long a newcomer waits, and what the command line takes over what it does."""
    walls = [_wall([*WSNSIM, "--help"]) for _ in range(7)]
    yield row("wsnsim --help, wall", 1000 * statistics.median(walls[1:]), "ms", 150)
    with tempfile.TemporaryDirectory() as folder:
        cold = {**os.environ, "NUMBA_CACHE_DIR": folder}
        step = [*ONE_STEP, str(Path(folder) / "x.h5")]
        yield row("first run after installation ready within, wall", _wall(step, cold), "s", 15)
        yield row("the same with kernels cached, wall", _wall(step, cold), "s")
    yield from _one_step_rows(repeats)
    yield from _sweep_rows(max(repeats // 3, 2))


def _one_step_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """One step of a scenario against the import of NumPy; and what Numba alone takes of it."""
    numpy = [sys.executable, "-c", "import numpy"]
    numba = [sys.executable, "-c", ONE_KERNEL]
    with tempfile.TemporaryDirectory() as folder:
        commands = [numpy, [*ONE_STEP, str(Path(folder) / "x.h5")], numba]
        bare, step, loaded = _paired_cpu(commands, repeats)
    ratio = median_ratio(step, bare)
    yield row("one step through the command line / import numpy, CPU", ratio, "", 4.5, note="kernels cached")
    yield row("import of Numba and one cached kernel / import numpy, CPU", median_ratio(loaded, bare), "")


def _sweep_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """A campaign of one point on one worker against the same runs in one file."""
    with tempfile.TemporaryDirectory() as folder:
        runs: list[float] = []
        sweeps: list[float] = []
        for turn in range(repeats + 1):  # the first one fills caches
            out = Path(folder) / str(turn)
            alone = [*WSNSIM, "run", "pso_mhpf", *SIXTEEN, f"{out}.h5"]
            axis = ["--vary", "tracker.particles=400", "-j", "1"]
            swept = [*WSNSIM, "sweep", "pso_mhpf", *axis, *SIXTEEN, str(out)]
            for command, seconds in ((alone, runs), (swept, sweeps)):
                seconds.append(_cpu(command))
    yield row("sweep -j1 / run, CPU, 16 replicates", median_ratio(sweeps[1:], runs[1:]), "", 1.03)


def _paired_cpu(commands: list[list[str]], repeats: int) -> list[list[float]]:
    """CPU seconds of commands, taken in turn after a first turn that fills caches."""
    turns = [[_cpu(command) for command in commands] for _ in range(repeats + 1)][1:]
    return [list(seconds) for seconds in zip(*turns, strict=True)]


def _cpu(command: list[str]) -> float:
    """The CPU seconds of a command and of all its processes."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    _wall(command)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def _wall(command: list[str], env: dict[str, str] | None = None) -> float:
    """The seconds of a command on the clock."""
    began = time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=env)
    return time.monotonic() - began
