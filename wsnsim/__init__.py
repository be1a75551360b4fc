"""wsnsim: a discrete-event simulator of wireless sensor networks that track moving targets.

    import wsnsim

    wsnsim.run("pso_mhpf", replicates=30, out="results/pso_mhpf.h5")
    wsnsim.read("results/pso_mhpf.h5", "estimates").groupby("step").error.median()

The public API; its modules are imported at first use.
"""

from __future__ import annotations

import importlib
import warnings
from typing import TYPE_CHECKING, Any

from wsnsim.base.version import __version__ as __version__

if TYPE_CHECKING:
    from wsnsim.analysis.comparison import compare
    from wsnsim.analysis.frames import read
    from wsnsim.base.gathered import Gathered
    from wsnsim.base.part import Quantity, part
    from wsnsim.base.ports import Estimate, Scene, Tracker
    from wsnsim.base.requests import (
        Broadcast,
        Compute,
        Gather,
        GatheredReadings,
        GatherReadings,
        Local,
        Member,
        Parcel,
        Scatter,
        Send,
    )
    from wsnsim.campaign import sweep
    from wsnsim.experiment import load, run, simulate
    from wsnsim.fitting import fit

_HOMES = {
    "run": "wsnsim.experiment",
    "simulate": "wsnsim.experiment",
    "load": "wsnsim.experiment",
    "read": "wsnsim.analysis.frames",
    "sweep": "wsnsim.campaign",
    "compare": "wsnsim.analysis.comparison",
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
}
__all__ = [
    "Broadcast", "Compute", "Estimate", "Gather", "GatherReadings", "Gathered", "GatheredReadings", "Local", "Member",
    "Parcel", "Quantity", "Scatter", "Scene", "Send", "Tracker", "compare", "fit", "load", "part", "read", "run",
    "simulate", "sweep",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name == "compared":
        warnings.warn("wsnsim.compared was renamed to wsnsim.compare", DeprecationWarning, stacklevel=2)
        name = "compare"
    if name not in _HOMES:
        raise AttributeError(f"module 'wsnsim' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
