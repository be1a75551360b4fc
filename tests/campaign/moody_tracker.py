"""A tracker that misbehaves on demand, in a file as a user would write it, and sweeps of it that take milliseconds."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from wsnsim.campaign.task import _scenario
from wsnsim.scenario.fields import part_model
from wsnsim.scenario.registry import PluginAccess, Plugins

MODULE = '''
import ctypes
import multiprocessing
import os
import signal
import sys
import time
from typing import Annotated

import numpy as np

import wsnsim
from wsnsim.base.runs import tracked
from wsnsim.base.rng import HEAD_KEY, Streams, derive
from wsnsim.campaign.task import TaskOutcome

SEED = 20220101


def first_key(replicate):
    return derive(derive(Streams(SEED, replicate).key("tracker"), 0), 1, HEAD_KEY)


def misbehave(mood):
    if mood in ("raises", "starts") and not os.path.exists("cured"):
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
        time.sleep(0.01)


@wsnsim.part
class Moody:
    """A tracker that guesses at random, and misbehaves in one step of one replicate."""

    mood: Annotated[str, "raises, starts (raises there), exits, killed, crashes, sleeps or hangs"] = "calm"
    at: Annotated[int, wsnsim.Quantity("", ge=0), "replicate in which it misbehaves"] = 0
    pause: Annotated[float, wsnsim.Quantity("s", ge=0), "duration of a step"] = 0.0

    def start(self, prior, scene):
        misbehave(self.mood if self.mood == "starts" else "")
        yield wsnsim.Compute(0.0)
        return prior

    def step(self, belief, scene):
        if scene.step == 1 and scene.key == first_key(self.at):
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


REPORTED = []


def describe_process(task):
    list(tracked([1], "items worked on"))
    name = type(multiprocessing.current_process()).__name__
    return TaskOutcome("done", f"{name}, {len(REPORTED)} reported")


def die_at_once(*arguments):
    os._exit(1)
'''
TRUSTED: Final = PluginAccess(Plugins.ANY)
"""What the drivers of these tests give to their workers."""
QUICK: Mapping[str, Any] = {"tracker.kind": "moody:Moody", "duration": "3 s"}


def write_moody_tracker(folder: Path) -> Path:
    """Write the tracker to moody.py in the folder. One that another test wrote and imported is forgotten."""
    sys.modules.pop("moody", None)
    part_model.cache_clear()
    _scenario.cache_clear()
    (folder / "moody.py").write_text(MODULE)
    return folder


def sweep_of(points: Iterable[Mapping[str, Any]], replicates: int = 4, **more: Any) -> dict[str, Any]:
    """A sweep with one point per setting of the tracker."""
    settings = [{f"tracker.{key}": value for key, value in point.items()} for point in points]
    return {"name": "moods", "scenario": "ungm_pf", "set": dict(QUICK), "points": settings, "block": 2, **more} | (
        {} if "until" in more else {"replicates": replicates}
    )


def write_sweep(place: Path, sweep: Mapping[str, Any]) -> str:
    """Write the sweep to a file (JSON is YAML) and return the file's name."""
    place.write_text(json.dumps(sweep))
    return str(place)
