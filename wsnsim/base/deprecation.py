"""Former names of modules that plug-ins import: the list of them, and the deprecation warning at their use."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Mapping
from typing import Any, Final, NamedTuple


class Moved(NamedTuple):
    """The module that replaces a former one, and {former name: new name} for what was renamed in it."""

    module: str
    renamed: Mapping[str, str] = {}


MOVED: Final[Mapping[str, Moved]] = {
    "wsnsim.base.asks": Moved("wsnsim.base.requests", {"Ask": "Request"}),
    "wsnsim.base.bench": Moved("wsnsim.offline.measurements", {"sensed": "sample_readings"}),
    "wsnsim.base.loopback": Moved("wsnsim.offline.loopback"),
    "wsnsim.base.problem": Moved(
        "wsnsim.base.setups",
        {
            "Common": "Setup",
            "Problem": "TrackingSetup",
            "Radio": "RadioSetup",
            "Parts": "NetworkSetup",
            "Beacons": "BeaconSetup",
        },
    ),
}
"""Each former module still has a file, whose `__getattr__` calls `moved`."""
RENAMED: Final[Mapping[str, Mapping[str, Moved]]] = {
    "wsnsim.experiment": {"simulate": Moved("wsnsim.experiment", {"simulate": "simulate_run"})},
    "wsnsim.base.ports": {"Member": Moved("wsnsim.base.requests")},
    "wsnsim.base.radio": {
        "Draw": Moved("wsnsim.base.radio", {"Draw": "ModePower"}),
        "Draws": Moved("wsnsim.base.radio", {"Draws": "ContinuousPower"}),
    },
    "wsnsim.base.sleeping": {
        "Message": Moved("wsnsim.base.sleeping", {"Message": "WakeUpMessage"}),
        "Plan": Moved("wsnsim.base.sleeping", {"Plan": "WakeUpPlan"}),
    },
}
"""Former names of modules that are where they were, whose `__getattr__` calls `renamed`."""


def moved(module: str, name: str) -> Any:
    """Return what a former module called `name`, from its new module, with a DeprecationWarning.

    Raises:
        AttributeError: The module never had this name.
    """
    new = MOVED[module]
    if name.startswith("__"):
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    now = new.renamed.get(name, name)
    value = getattr(importlib.import_module(new.module), now)
    warnings.warn(f"{module}.{name} is now {new.module}.{now}", DeprecationWarning, stacklevel=3)
    return value


def renamed(module: str, name: str) -> Any:
    """Return what a module formerly called `name`, with a DeprecationWarning.

    Raises:
        AttributeError: The module has no such name.
    """
    if name not in RENAMED[module]:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    new = RENAMED[module][name]
    now = new.renamed.get(name, name)
    warnings.warn(f"{module}.{name} is now {new.module}.{now}", DeprecationWarning, stacklevel=3)
    return getattr(importlib.import_module(new.module), now)


def uses_former(component: object, former: str, present: str) -> bool:
    """Whether the class of a component defines a member's former name nearer to itself than the present one."""
    for ancestor in type(component).__mro__:
        if present in vars(ancestor):
            return False
        if former in vars(ancestor):
            return True
    return False
