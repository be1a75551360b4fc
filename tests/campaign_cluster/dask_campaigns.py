"""What tests of campaigns on Dask ask of folders and engines."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

import wsnsim
from wsnsim import campaign
from wsnsim.campaign.dask_engine import DaskEngine
from wsnsim.campaign.engines import FinishedTask
from wsnsim.campaign.task import Task
from wsnsim.recording.folder import Folder
from wsnsim.scenario.registry import PluginAccess, Plugins
from wsnsim.scenario.sweep import load_sweep

from .dask_processes import PATIENCE

TRUSTED = PluginAccess(Plugins.ANY)
"""What the drivers of these tests give to their workers."""
ODD = {"tracker": {"kind": "mylab_odd:Odd"}, "duration": "5 s"}
Begun = Callable[..., Folder]


def begun_in(place: Path) -> Begun:
    """begin(keys of a sweep file): a campaign on disk, with the odd tracker unless `set` changes it."""

    def begin(**written: Any) -> Folder:
        plan = load_sweep({"name": "odd", "scenario": "ungm_pf", "set": ODD, "block": 1, **written})
        return campaign.prepare(plan, place / plan.name)

    return begin


def rows(folder: Folder) -> pd.DataFrame:
    return wsnsim.read(folder.path, "runs").drop(columns="cpu_seconds")


def marks(folder: Folder) -> int:
    """Number of running tasks."""
    return sum(not mark.name.startswith("driver.") for mark in folder.path.glob("running/*.log"))


def task_of(folder: Folder, number: int = 0) -> Task:
    point = folder.manifest().points[0].id
    return Task(str(folder.path), point, number, number, "vm-1-abc", wsnsim.__version__, access=TRUSTED)


def endings_of(engine: DaskEngine, count: int = 1) -> list[FinishedTask]:
    """The next `count` finished tasks."""
    found: list[FinishedTask] = []
    end = time.monotonic() + PATIENCE
    while len(found) < count:
        assert time.monotonic() < end, "no task finished in time"
        found += engine.finished(0.1)
    return found
