"""What a campaign costs beside its simulations: a task through each engine, the start, two workers, and memory.

`main(KIND, COUNT)` in a process of its own prints one kind of figures as JSON (see `KINDS`).
A task that costs nothing is one whose file is there: a worker looks, and says so.
"""

from __future__ import annotations

import functools
import json
import math
import multiprocessing
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.bench.timing import row
from wsnsim import __version__
from wsnsim.campaign.task import Task, TaskOutcome

EARLY, LATE, QUICK = 1_000, 10_000, 3_000
"""Tasks after which memory is looked at; and instead of the latter, where there is little time."""
STRETCH = 500
"""Tasks that are timed together."""
LOCAL, CLUSTER, EFFICIENCY = 1.0, 5.0, 0.93
"""ms a task; of two workers' throughput, what there must be."""
FLAT = 5.0
"""MB that memory may grow by: half a kilobyte a task."""
DASK, DASK_DRIVER = ("Dask, tasks that do nothing", "driver"), 2.0
"""The same of the driver of a Dask campaign over 3,000 tasks; it was 5.4 MB while the client kept what it had sent."""
SPINS, WORKERS = 4, 2


def campaign_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """Every figure of campaigns."""
    late = LATE if repeats >= 9 else QUICK
    yield from _engine_rows("local pool", _asked("local", late), LOCAL, late)
    if cluster := _asked("cluster", late):
        yield from _engine_rows("Dask", cluster, CLUSTER, late)
    else:
        yield row("Dask: a task", math.nan, "ms", CLUSTER, note="distributed is not installed")
    yield from _memory_rows("simulations of one step", _asked("simulated", late), late)
    yield row("wsnsim sweep: start to first result, wall", statistics.median(_first_result() for _ in range(3)), "s")
    yield from _efficiency_rows(max(3, repeats // 2))


def _engine_rows(name: str, found: dict[str, Any], bound: float, tasks: int) -> Iterator[dict[str, Any]]:
    costs = found["milliseconds"]
    note = f"best of {len(costs)} stretches of {STRETCH} tasks, median {statistics.median(costs):.2g}"
    yield row(f"{name}: a task that does nothing, {WORKERS} workers, wall", min(costs), "ms", bound, note=note)
    yield row(f"{name}: the same, CPU of the driver", found["cpu"], "ms")
    yield from _memory_rows(f"{name}, tasks that do nothing", found, tasks)


def _memory_rows(name: str, found: dict[str, Any], tasks: int) -> Iterator[dict[str, Any]]:
    """How much each process holds after a thousand tasks, and how much more after the last."""
    for who, (early, late) in found["megabytes"].items():
        note = f"{early:.0f} MB after {EARLY:,} tasks"
        bound = None if who == "scheduler" else DASK_DRIVER if (name, who) == DASK else FLAT  # Dask's keeps a log
        yield row(f"{name}: growth of the {who} to {tasks:,} tasks", late - early, "MB", bound, note=note)


def _efficiency_rows(turns: int) -> Iterator[dict[str, Any]]:
    """Two workers against one, in turn; and two bare processes against one, which is what the machine has to give."""
    found = _asked("efficiency", turns)
    alone = statistics.median(found["bare"])
    yield row("two bare processes / (2 x one): what the machine gives", alone, "", note="best 1")
    pool = statistics.median(found["pool"])
    yield row("two workers / (2 x one), tasks of a second", pool, "", at_least=EFFICIENCY)
    yield row("  of what the machine gives", pool / alone, "", at_least=EFFICIENCY)


def _asked(kind: str, count: int) -> dict[str, Any]:
    """Figures of one kind, from a process that has done nothing else."""
    command = [sys.executable, "-c", f"from tests.bench.campaigns import main; main({kind!r}, {count})"]
    answer = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    found: dict[str, Any] = json.loads(answer.splitlines()[-1])
    return found


def local(tasks: int) -> dict[str, Any]:
    """{"milliseconds": a task's of each stretch, "cpu": the driver's, "megabytes": {who: [early, late]}}."""
    from wsnsim.campaign.engines import LocalEngine

    with _task_that_is_done() as task:
        pool = LocalEngine(WORKERS)
        found = _measured(pool, task, tasks, lambda: {"worker": multiprocessing.active_children()[0].pid or 0})
        pool.close()
    return found


def cluster(tasks: int) -> dict[str, Any]:
    """The same of Dask's workers, over TCP on this machine; {} where Dask is not installed."""
    try:
        import distributed  # noqa: F401
    except ImportError:
        return {}
    from wsnsim.campaign.dask_engine import DaskEngine

    with _task_that_is_done() as task, _scheduler(Path(task.folder)) as (file, pids):
        engine = DaskEngine(Path(task.folder), scheduler_file=file, wait_for=60.0)
        found = _measured(engine, task, tasks, lambda: pids)
        engine.close()
    return found


def simulated(tasks: int) -> dict[str, Any]:
    """The memory of driver and worker over a campaign whose tasks are real, and as short as can be."""
    from wsnsim import campaign
    from wsnsim.campaign.engines import LocalEngine

    found: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = campaign.prepare(_plan(tasks), Path(place) / "x")

        def watch(progress: campaign.CampaignProgress) -> None:
            if progress.done >= (EARLY if not found else tasks):
                pids = {"driver": os.getpid(), "worker": multiprocessing.active_children()[0].pid or 0}
                for who, pid in pids.items():
                    held = found.setdefault(who, [])
                    if len(held) < 2:
                        held.append(_megabytes(pid))

        ended = campaign.run_campaign(folder, LocalEngine(WORKERS), on_progress=watch)
        assert ended.complete
    return {"megabytes": found}


def efficiency(turns: int) -> dict[str, Any]:
    """{"pool": ratios of a turn each, "bare": the same of processes that nobody feeds}."""
    from wsnsim.campaign.engines import LocalEngine

    count = _spins_of_a_second()
    one, two = (LocalEngine(workers, functools.partial(spin, count)) for workers in (1, WORKERS))
    warm = Task("", "", 0, 0, "warm", __version__)
    for pool in (one, two):
        _throughput(pool, warm, 2 * pool.workers)
    found: dict[str, list[float]] = {"pool": [], "bare": []}
    for _ in range(turns):
        single = _throughput(one, warm, SPINS)
        found["pool"].append(_throughput(two, warm, WORKERS * SPINS) / (WORKERS * single))
        alone, together = _bare_seconds(1, count), _bare_seconds(WORKERS, count)
        found["bare"].append(alone / together)
    one.close()
    two.close()
    return found


KINDS: dict[str, Callable[[int], dict[str, Any]]] = {
    "local": local,
    "cluster": cluster,
    "simulated": simulated,
    "efficiency": efficiency,
}


def spin(count: int, task: Task | None = None) -> TaskOutcome:
    """Keep a core busy, without memory and without a system call."""
    total = 0
    for i in range(count):
        total += i & 7
    return TaskOutcome("done", size=total)


def _spins_of_a_second() -> int:
    trial = 2_000_000
    began = time.process_time()
    spin(trial)
    return int(trial / (time.process_time() - began))


def _throughput(pool: Any, task: Task, tasks: int) -> float:
    """Tasks a second."""
    began = time.monotonic()
    _pumped(pool, task, tasks)
    return tasks / (time.monotonic() - began)


def _bare_seconds(processes: int, count: int) -> float:
    """Wall seconds that the slowest of several processes takes for its spins, its start not counted."""
    code = (
        f"import time; from tests.bench.campaigns import spin; began = time.monotonic();"
        f" [spin({count}) for _ in range({SPINS})]; print(time.monotonic() - began)"
    )
    command = [sys.executable, "-c", code]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(processes)]
    return max(float(process.communicate()[0]) for process in running)


def _pumped(engine: Any, task: Task, tasks: int) -> None:
    """Put tasks through an engine as the driver does: as many under way as it has room for."""
    given = ended = 0
    while ended < tasks:
        while given < tasks and given - ended < engine.window:
            engine.submit(task)
            given += 1
        for ending in engine.finished(0.25):
            assert isinstance(ending.outcome, TaskOutcome), ending.outcome
            assert ending.outcome.status in ("exists", "done"), ending.outcome
            ended += 1


def _measured(engine: Any, task: Task, tasks: int, others: Callable[[], dict[str, int]]) -> dict[str, Any]:
    _pumped(engine, task, EARLY)
    pids = {"driver": os.getpid(), **others()}
    early = {who: _megabytes(pid) for who, pid in pids.items()}
    began = time.process_time()
    rates = [_throughput(engine, task, STRETCH) for _ in range((tasks - EARLY) // STRETCH)]
    return {
        "milliseconds": [1000.0 / rate for rate in rates],
        "cpu": 1000.0 * (time.process_time() - began) / (len(rates) * STRETCH),
        "megabytes": {who: [early[who], _megabytes(pid)] for who, pid in pids.items()},
    }


def _megabytes(pid: int) -> float:
    """What a process holds in memory now; NaN if unknown."""
    status = Path(f"/proc/{pid}/status")
    found = re.search(r"VmRSS:\s+(\d+) kB", status.read_text()) if status.exists() else None
    return int(found[1]) * 1024 / 1e6 if found else math.nan


@contextmanager
def _task_that_is_done() -> Iterator[Task]:
    """A task of a campaign whose file is there."""
    from wsnsim import campaign

    with tempfile.TemporaryDirectory() as place:
        plan = _plan(1)
        folder = campaign.prepare(plan, Path(place) / "x")
        point = plan.points[0].id
        folder.batch(point, 0, 0).touch()
        yield Task(str(folder.path), point, 0, 0, "bench", __version__)


def _plan(replicates: int) -> Any:
    from wsnsim.scenario.sweep import load_sweep

    return load_sweep(
        {"name": "bench", "scenario": "ungm_pf", "set": {"duration": 2}, "block": 1, "replicates": replicates}
    )


@contextmanager
def _scheduler(place: Path) -> Iterator[tuple[Path, dict[str, int]]]:
    """A scheduler and workers of one thread each: the scheduler's file, and the pids of it and of one worker."""
    file = place / "scheduler.json"
    python = [sys.executable, "-m"]
    said: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    words = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    running = [subprocess.Popen([*python, "distributed.cli.dask_scheduler", *words], **said)]
    words = ["--host", "127.0.0.1", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    words += ["--local-directory", str(place)]
    running += [subprocess.Popen([*python, "distributed.cli.dask_worker", *words], **said) for _ in range(WORKERS)]
    try:
        until = time.monotonic() + 60.0
        while not file.exists() and time.monotonic() < until:
            time.sleep(0.1)
        yield file, {"scheduler": running[0].pid, "worker": running[1].pid}
    finally:
        for process in running:
            process.terminate()
        for process in running:
            process.wait(timeout=30)


def _first_result() -> float:
    """Seconds from the command until the first file of a campaign is there."""
    with tempfile.TemporaryDirectory() as place:
        words = ["sweep", "pso_mhpf", "--vary", "tracker.particles=100,200", "--set", "duration=0.4 s", "--quiet"]
        words += ["--replicates", "5", "--jobs", str(WORKERS), "--out", f"{place}/x"]
        began = time.monotonic()
        with subprocess.Popen([sys.executable, "-m", "wsnsim", *words], stdout=subprocess.DEVNULL) as running:
            while not any(Path(place).glob("x/*/r*.h5")) and running.poll() is None:
                time.sleep(0.005)
            seconds = time.monotonic() - began
            assert running.wait() == 0
    return seconds


def main(kind: str, count: int) -> None:
    """Print one kind of figures as JSON."""
    print(json.dumps(KINDS[kind](count)))
