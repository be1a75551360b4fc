"""wsnsim: a discrete-event simulator of wireless sensor networks that track moving targets.

    import wsnsim

    wsnsim.run("pso_mhpf", replicates=30, out="results/pso_mhpf.h5")
    wsnsim.read("results/pso_mhpf.h5", "estimates").groupby("step").error.median()

The public API; its modules are imported at first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wsnsim.base.facades import facade
from wsnsim.base.version import __version__ as __version__

if TYPE_CHECKING:
    # fmt: off
    # isort: off
    from wsnsim.analysis.frames import read as read
    from wsnsim.api.lifetime import lifetime as lifetime, LifetimeResult as LifetimeResult
    from wsnsim.api.result import gospa as gospa, plot as plot, Result as Result
    from wsnsim.api.running import quiet as quiet, run as run, simulate as simulate
    from wsnsim.api.sweeping import compare as compare, sweep as sweep, SweepResult as SweepResult
    from wsnsim.base.arrays import Estimate as Estimate
    from wsnsim.base.errors import (
        Issue as Issue, ResultError as ResultError, RunError as RunError, ScenarioError as ScenarioError,
        StorageError as StorageError, UsageError as UsageError, WsnsimError as WsnsimError,
    )
    from wsnsim.base.part import part as part, Quantity as Quantity
    from wsnsim.base.ports import (
        MotionModel as MotionModel, Scene as Scene, SensorModel as SensorModel, Tracker as Tracker,
    )
    from wsnsim.base.requests import (
        Broadcast as Broadcast, Compute as Compute, Delivery as Delivery, Flow as Flow, Gather as Gather,
        Gathered as Gathered, GatheredReadings as GatheredReadings, GatherLate as GatherLate,
        GatherReadings as GatherReadings, Local as Local, Member as Member, Parcel as Parcel,
        Scatter as Scatter, Send as Send,
    )
    from wsnsim.base.tables import Memory as Memory
    from wsnsim.bounds import bound as bound
    from wsnsim.experiment import load as load
    from wsnsim.fitting import fit as fit
    from wsnsim.scenario.build import build as build
    from wsnsim.testing import (
        check_battery as check_battery,
        check_fault as check_fault, check_mac as check_mac, check_motion as check_motion,
        check_multi_tracker as check_multi_tracker, check_sensor as check_sensor,
        check_sync as check_sync, check_tracker as check_tracker, check_wakeup as check_wakeup,
        check_workload as check_workload,
    )

MODULES = frozenset({"bounds", "experiment", "models", "plugins", "scenario", "testing", "trackers"})
"""Modules that are imported when they are named: `wsnsim.testing.check_tracker`."""
__getattr__, __dir__ = facade(__name__, MODULES)
