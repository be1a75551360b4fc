"""What is measured, each as rows {name, value, unit, bound, within}. CPU seconds are medians over repetitions."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import simpy

from tests.bench.kernels import Tape
from tests.bench.script import Recorded, Replayed, Script
from wsnsim import experiment, scenario
from wsnsim.base.tables import Memory

SCENARIOS = ("pso_mhpf", "ipf", "ppf", "central_pf")
PER_FRAME, PER_STEP = 8, 150


def row(name: str, value: float, unit: str, bound: float | None = None) -> dict[str, Any]:
    """One figure; `within` says whether it keeps to its bound."""
    return {"name": name, "value": value, "unit": unit, "bound": bound, "within": bound is None or value <= bound}


def all_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """Every figure, as soon as it is known."""
    yield from startup_rows()
    yield from tracker_rows(repeats)
    yield from seam_rows(repeats)


def startup_rows() -> Iterator[dict[str, Any]]:
    """How long a newcomer waits: `--help`, and the first run of all with nothing compiled."""
    python = [sys.executable, "-m", "wsnsim"]
    walls = [_wall([*python, "--help"]) for _ in range(7)]
    yield row("wsnsim --help, wall", 1000 * statistics.median(walls[1:]), "ms", 150)
    with tempfile.TemporaryDirectory() as folder:
        cold = {**os.environ, "NUMBA_CACHE_DIR": folder}
        one_step = [
            *python,
            "run",
            "pso_mhpf",
            "--set",
            "duration=0.4 s",
            "--quiet",
            "--out",
            str(Path(folder) / "x.h5"),
        ]
        yield row("first run after installation ready within, wall", _wall(one_step, cold), "s", 15)
        yield row("the same with kernels cached, wall", _wall(one_step, cold), "s")


def tracker_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """CPU seconds a replicate of each shipped tracker, event log and digest on."""
    for name in SCENARIOS:
        parts = scenario.build(scenario.load(name))
        experiment._simulate(parts, 0, Memory())
        seconds = median_cpu(lambda parts=parts: experiment._simulate(parts, 0, Memory()), repeats)
        yield row(f"{name}: CPU a replicate of {parts.steps} steps", seconds, "s", 0.5 if name == "pso_mhpf" else None)


def seam_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """PSO-MHPF without its mathematics, against bare SimPy timeouts; and its kernels alone."""
    parts = scenario.build(scenario.load("pso_mhpf"))
    script, tape = Script(), Tape()
    summary = experiment._simulate(replace(parts, tracker=Recorded(parts.tracker, script)), 0, Memory())
    with tape.recording():
        experiment._simulate(parts, 0, Memory())
    seam, whole, kernels, bare = paired_medians(
        [
            lambda: experiment._simulate(replace(parts, tracker=Replayed(script)), 0, Memory()),
            lambda: experiment._simulate(parts, 0, Memory()),
            tape.play,
            lambda: bare_timeouts(100_000),
        ],
        repeats,
    )
    timeout = bare / 100_000
    frames, steps = summary.run["frames_sent"], summary.run["steps"]
    yield row("bare SimPy timeout, 100 processes", 1e6 * timeout, "µs")
    yield row("pso_mhpf: frames a replicate", frames, "frames")
    yield row("pso_mhpf: the seam alone, CPU a replicate", seam, "s")
    yield row(
        "pso_mhpf: the seam, in timeouts beyond 150 a step, a frame",
        (seam / timeout - PER_STEP * steps) / frames,
        "",
        8,
    )
    yield row("pso_mhpf: its kernels alone, CPU a replicate", kernels, "s")
    yield row("pso_mhpf: whole run, CPU a replicate", whole, "s", 0.5)
    yield row("pso_mhpf: whole run / (kernels + seam)", whole / (kernels + seam), "", 1.5)


def bare_timeouts(count: int) -> None:
    """SimPy alone: 100 processes that do nothing but wait."""
    env = simpy.Environment()

    def waiter() -> Any:
        while True:
            yield env.timeout(1.0)

    for _ in range(100):
        env.process(waiter())
    env.run(until=count / 100)


def median_cpu(act: Callable[[], Any], repeats: int) -> float:
    """Median CPU seconds of an act."""
    return paired_medians([act], repeats)[0]


def paired_medians(acts: list[Callable[[], Any]], repeats: int) -> list[float]:
    """Median CPU seconds of each of several acts, taken in turn, so that a drifting machine serves all alike."""
    seconds: list[list[float]] = [[] for _ in acts]
    for _ in range(repeats):
        for act, mine in zip(acts, seconds, strict=True):
            began = time.process_time()
            act()
            mine.append(time.process_time() - began)
    return [statistics.median(mine) for mine in seconds]


def _wall(command: list[str], env: dict[str, str] | None = None) -> float:
    began = time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=env)
    return time.monotonic() - began
