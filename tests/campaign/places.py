"""A tracker that misbehaves where it is told to, campaigns of it, and what is looked at afterwards.

`write_lab(folder)` puts the tracker into a file of its own, as a user's would be; `sweep_of(...)` is a sweep of it that
takes milliseconds a replicate.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, final

import pandas as pd

import wsnsim
from wsnsim import __version__
from wsnsim.campaign.engines import Ending
from wsnsim.campaign.task import Task, perform
from wsnsim.recording.folder import Folder, Manifest, PointOnDisk

LAB = '''
import ctypes
import os
import signal
import sys
import time
from typing import Annotated

import numpy as np

import wsnsim
from wsnsim.base.rng import HEAD_KEY, Streams, derive

SEED = 20220101


def first_key(replicate):
    return derive(derive(Streams(SEED, replicate).key("tracker"), 0), 1, HEAD_KEY)


def misbehave(mood):
    if mood == "raises" and not os.path.exists("cured"):
        raise ValueError("out of sorts")
    if mood == "exits":
        sys.exit(7)
    if mood == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if mood == "crashes":
        ctypes.string_at(8)
    if mood == "sleeps":
        time.sleep(3600)
    while mood == "hangs":
        pass


@wsnsim.part
class Moody:
    """A guess of its own at every step, but for one replicate, in which it does something else."""

    mood: Annotated[str, "raises, exits, killed, crashes, sleeps or hangs"] = "calm"
    at: Annotated[int, wsnsim.Quantity("", ge=0), "in this replicate"] = 0
    pause: Annotated[float, wsnsim.Quantity("s", ge=0), "how long a step takes"] = 0.0

    def start(self, prior, scene):
        yield wsnsim.Compute(0.0)
        return prior

    def step(self, belief, scene):
        if scene.step == 1 and self.mood != "calm" and scene.key == first_key(self.at):
            misbehave(self.mood)
        time.sleep(self.pause)
        yield wsnsim.Compute(10.0)
        guess = np.random.default_rng(scene.key).normal(size=1)
        return wsnsim.Estimate(belief.mean + guess, belief.cov)

    def hand_over(self, belief, scene, successor):
        yield wsnsim.Compute(0.0)
        return belief

    def estimate(self, belief):
        return belief

    def forecast(self, belief, scene, ahead):
        return belief


def die_at_once(*arguments):
    os._exit(1)
'''
QUICK: Mapping[str, Any] = {"tracker.kind": "moody:Moody", "duration": "3 s"}


def write_lab(folder: Path) -> Path:
    """The folder, with the tracker in it as moody.py."""
    (folder / "moody.py").write_text(LAB)
    return folder


def sweep_of(points: Iterable[Mapping[str, Any]], replicates: int = 4, **said: Any) -> dict[str, Any]:
    """A sweep with a point for each of these settings of the tracker."""
    laid = [{f"tracker.{key}": value for key, value in point.items()} for point in points]
    return {"name": "moods", "scenario": "ungm_pf", "set": dict(QUICK), "points": laid, "block": 2, **said} | (
        {} if "until" in said else {"replicates": replicates}
    )


def write_sweep(place: Path, sweep: Mapping[str, Any]) -> str:
    """The sweep as a file (JSON is YAML); its name."""
    place.write_text(json.dumps(sweep))
    return str(place)


def bare_campaign(path: Path, replicates: Mapping[str, int], block: int = 5, **said: Any) -> Folder:
    """A campaign's folder with a manifest only, for an engine that simulates nothing."""
    folder = Folder(path)
    points = tuple(PointOnDisk(name, {"key": name}, "w", count) for name, count in replicates.items())
    folder.write_manifest(Manifest("c", ("key",), points, block, __version__, **said))
    return folder


def files_of(path: Path) -> dict[str, tuple[int, bytes]]:
    """(time of writing, bytes) of every result file of a campaign."""
    return {str(p.relative_to(path)): (p.stat().st_mtime_ns, p.read_bytes()) for p in path.glob("*/r*.h5")}


def children(pid: int) -> list[int]:
    """The processes that a process has started, those that are dead but not buried left out."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = stat.read_text().rpartition(")")[2].split()[:2]
        except OSError:
            continue
        if int(parent) == pid and state != "Z":
            found.append(int(stat.parent.name))
    return found


def lives(pid: int) -> bool:
    """Whether a process runs."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_for(said: Callable[[], Any], seconds: float = 30.0) -> Any:
    """What is said, once it is true."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if answer := said():
            return answer
        time.sleep(0.02)
    raise AssertionError("it did not come to be in time")


def environment(**said: str) -> dict[str, str]:
    """The environment of a command of ours."""
    return {**os.environ, "OMP_NUM_THREADS": "1", **said}


@final
class Inline:
    """An engine that runs each task in this process, for tests of what is not the pool's."""

    def __init__(self, workers: int = 1) -> None:
        self.window = 1
        self._tasks: list[Task] = []

    def submit(self, task: Task) -> None:
        self._tasks.append(task)

    def ended(self, wait: float) -> list[Ending]:
        return [Ending(task, perform(task)) for task in self.withdraw()]

    def withdraw(self) -> list[Task]:
        tasks, self._tasks = self._tasks, []
        return tasks

    def close(self) -> None:
        """Nothing stays open."""


def tables_of(path: Path) -> dict[str, pd.DataFrame]:
    """All that a campaign recorded, but for times."""
    return {name: wsnsim.read(path, name).drop(columns="cpu_seconds", errors="ignore") for name in ("runs", "tracks")}


def assert_same(one: Mapping[str, pd.DataFrame], other: Mapping[str, pd.DataFrame]) -> None:
    """The tables are equal in every byte of every column."""
    for name in one:
        pd.testing.assert_frame_equal(one[name], other[name], check_exact=True)
        for column in one[name].select_dtypes("number"):
            assert one[name][column].to_numpy().tobytes() == other[name][column].to_numpy().tobytes()
