"""wsnsim: a discrete-event simulator of wireless sensor networks that track moving targets.

    import wsnsim

    wsnsim.run("pso_mhpf", replicates=30, out="results/pso_mhpf.h5")
    wsnsim.read("results/pso_mhpf.h5", "estimates").groupby("step").error.median()

The public API; its modules are imported at first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from wsnsim.base.version import __version__ as __version__

if TYPE_CHECKING:
    from wsnsim.analysis.frames import read
    from wsnsim.api.plotting import plot
    from wsnsim.api.result import Result
    from wsnsim.api.running import run, simulate
    from wsnsim.api.sweep_result import SweepResult
    from wsnsim.api.sweeping import compare, sweep
    from wsnsim.base.errors import Issue, ResultError, RunError, ScenarioError, StorageError, UsageError, WsnsimError
    from wsnsim.base.gathered import Gathered
    from wsnsim.base.part import Quantity, part
    from wsnsim.base.ports import Estimate, MotionModel, Scene, SensorModel, Tracker
    from wsnsim.base.recorders import Memory
    from wsnsim.base.requests import (
        Broadcast,
        Compute,
        Delivery,
        Flow,
        Gather,
        GatheredReadings,
        GatherReadings,
        Local,
        Member,
        Parcel,
        Scatter,
        Send,
    )
    from wsnsim.bounds import bound
    from wsnsim.experiment import load
    from wsnsim.fitting import fit
    from wsnsim.scenario.build import build
    from wsnsim.testing import (
        check_fault,
        check_mac,
        check_motion,
        check_sensor,
        check_sync,
        check_tracker,
        check_wakeup,
        check_workload,
    )

_HOMES = {
    "run": "wsnsim.api.running",
    "simulate": "wsnsim.api.running",
    "Result": "wsnsim.api.result",
    "load": "wsnsim.experiment",
    "read": "wsnsim.analysis.frames",
    "plot": "wsnsim.api.plotting",
    "bound": "wsnsim.bounds",
    "sweep": "wsnsim.api.sweeping",
    "compare": "wsnsim.api.sweeping",
    "fit": "wsnsim.fitting",
    "part": "wsnsim.base.part",
    "Quantity": "wsnsim.base.part",
    "Tracker": "wsnsim.base.ports",
    "Scene": "wsnsim.base.ports",
    "Estimate": "wsnsim.base.ports",
    "Member": "wsnsim.base.requests",
    "Parcel": "wsnsim.base.requests",
    "Local": "wsnsim.base.requests",
    "Gather": "wsnsim.base.requests",
    "GatherReadings": "wsnsim.base.requests",
    "Gathered": "wsnsim.base.gathered",
    "GatheredReadings": "wsnsim.base.requests",
    "Scatter": "wsnsim.base.requests",
    "Broadcast": "wsnsim.base.requests",
    "Send": "wsnsim.base.requests",
    "Compute": "wsnsim.base.requests",
    "Issue": "wsnsim.base.errors",
    "ResultError": "wsnsim.base.errors",
    "RunError": "wsnsim.base.errors",
    "ScenarioError": "wsnsim.base.errors",
    "StorageError": "wsnsim.base.errors",
    "UsageError": "wsnsim.base.errors",
    "WsnsimError": "wsnsim.base.errors",
    "check_fault": "wsnsim.testing",
    "check_mac": "wsnsim.testing",
    "check_motion": "wsnsim.testing",
    "check_sensor": "wsnsim.testing",
    "check_sync": "wsnsim.testing",
    "check_tracker": "wsnsim.testing",
    "check_wakeup": "wsnsim.testing",
    "check_workload": "wsnsim.testing",
    "Delivery": "wsnsim.base.requests",
    "Flow": "wsnsim.base.requests",
    "MotionModel": "wsnsim.base.ports",
    "SensorModel": "wsnsim.base.ports",
    "Memory": "wsnsim.base.recorders",
    "build": "wsnsim.scenario.build",
    "SweepResult": "wsnsim.api.sweep_result",
}
__all__ = [
    "Broadcast", "Compute", "Delivery", "Estimate", "Flow", "Gather", "GatherReadings", "Gathered",
    "GatheredReadings", "Issue", "Local", "Member", "Memory", "MotionModel", "Parcel", "Quantity", "Result",
    "ResultError", "RunError", "Scatter", "ScenarioError", "Scene", "Send", "SensorModel", "StorageError",
    "SweepResult", "Tracker", "UsageError", "WsnsimError", "bound", "build", "check_fault", "check_mac", "check_motion",
    "check_sensor", "check_sync", "check_tracker", "check_wakeup", "check_workload", "compare", "fit", "load",
    "part", "plot", "read", "run", "simulate", "sweep",
]  # fmt: skip


MODULES = frozenset({"bounds", "experiment", "models", "plugins", "scenario", "testing", "trackers"})
"""Modules that are imported when they are named: `wsnsim.testing.check_tracker`."""


def __getattr__(name: str) -> Any:
    if name in MODULES:
        return importlib.import_module(f"wsnsim.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module 'wsnsim' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
