"""Former names of modules that plug-ins import: the one list of them, and the warning that each gives."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Mapping
from typing import Any, Final, NamedTuple


class Moved(NamedTuple):
    """Where the contents of a module are now, and the new names of those that were renamed as well."""

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
"""Each former module has a file of its own, whose `__getattr__` calls `moved`."""


def moved(module: str, name: str) -> Any:
    """The value of `name` from where a former module's contents are now; gives a DeprecationWarning.

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
