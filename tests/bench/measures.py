"""What is measured, each as a row (see `timing`). CPU seconds are medians over repetitions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from tests.bench.air import radio_rows
from tests.bench.batch import batch_rows
from tests.bench.campaigns import campaign_rows
from tests.bench.kernels import Tape
from tests.bench.lossy import lossy_rows
from tests.bench.mostly_off import mostly_off_rows
from tests.bench.ratios import compile_rows, filter_rows, kernel_rows
from tests.bench.results import result_rows
from tests.bench.scale import scale_rows
from tests.bench.script import Recorded, Replayed, Script
from tests.bench.shipped import shipped_rows
from tests.bench.sleeping import sleeping_rows
from tests.bench.startup import startup_rows
from tests.bench.timing import bare_timeouts, median_cpu, paired_medians, row
from wsnsim import experiment, scenario
from wsnsim.base.tables import Memory

SCENARIOS = ("pso_mhpf", "ipf", "ppf", "central_pf")
PER_FRAME, PER_STEP = 8, 150


def all_rows(repeats: int, only: str | None = None) -> Iterator[dict[str, Any]]:
    """Every figure, or those of one group, as soon as it is known; each says its `group`."""
    for name, rows in GROUPS.items():
        if only in (None, name):
            yield from ({"group": name} | figure for figure in rows(repeats))


def tracker_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """CPU seconds a replicate of each shipped tracker, event log and digest on."""
    for name in SCENARIOS:
        parts = scenario.build(scenario.load(name))
        experiment.replicate_of(parts, 0, Memory())
        seconds = median_cpu(lambda parts=parts: experiment.replicate_of(parts, 0, Memory()), repeats)
        yield row(f"{name}: CPU a replicate of {parts.steps} steps", seconds, "s", 0.5 if name == "pso_mhpf" else None)


def seam_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """PSO-MHPF without its mathematics, against bare SimPy timeouts; and its kernels alone."""
    parts = scenario.build(scenario.load("pso_mhpf"))
    script, tape = Script(), Tape()
    summary = experiment.replicate_of(replace(parts, tracker=Recorded(parts.tracker, script)), 0, Memory())
    with tape.recording():
        experiment.replicate_of(parts, 0, Memory())
    seam, whole, kernels, bare = paired_medians(
        [
            lambda: experiment.replicate_of(replace(parts, tracker=Replayed(script)), 0, Memory()),
            lambda: experiment.replicate_of(parts, 0, Memory()),
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
        6,
    )
    yield row("pso_mhpf: its kernels alone, CPU a replicate", kernels, "s")
    yield row("pso_mhpf: whole run, CPU a replicate", whole, "s", 0.5)
    yield row("pso_mhpf: a replicate in memory, in bare timeouts", whole / timeout, "timeouts", 280_000)
    yield row("pso_mhpf: whole run / (kernels + seam)", whole / (kernels + seam), "", 1.5)


GROUPS: dict[str, Callable[[int], Iterator[dict[str, Any]]]] = {
    "startup": startup_rows,
    "compiling": compile_rows,
    "filters": filter_rows,
    "kernels": kernel_rows,
    "trackers": tracker_rows,
    "seam": seam_rows,
    "radio": radio_rows,
    "lossy": lossy_rows,
    "scale": scale_rows,
    "sleeping": sleeping_rows,
    "mostly_off": mostly_off_rows,
    "batch": batch_rows,
    "campaigns": campaign_rows,
    "results": result_rows,
    "scenarios": shipped_rows,
}
