"""Façades: modules that hand on the names of others, which are imported at first use.

if TYPE_CHECKING:
    from wsnsim.models.links import Disk as Disk, Disk as DiskLink

__getattr__, __dir__ = facade(__name__)        the imports above are the only list of the names

`wsnsim.models` and `wsnsim.trackers` hand on what kinds.table lists; for type checkers, `python -m tests.stubs` writes
the same into a stub beside each.

    import_name("sensor", "range", "Range") -> "RangeSensor"        from wsnsim.models import RangeSensor

A tracker is imported by the name of its kind in CamelCase. So is another component, followed by its role if the kind is
one word. The class's own name can be imported as well.
"""

from __future__ import annotations

import functools
import importlib
import re
import sys
from collections import Counter
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, Final

from wsnsim.base.files import read_sections

_ALIAS: Final = re.compile(r"^    (\w+) = (\w+)$", re.MULTILINE)
_IMPORT: Final = re.compile(r"^    from (wsnsim\.[\w.]+) import (\([^()]+\)|[^()\n]+)$", re.MULTILINE)

NOUNS: Final = {
    "prior": "Prior", "deploy": "Deployment", "motion": "Motion", "sensor": "Sensor", "energy": "Energy",
    "battery": "Battery",
    "link": "Link", "mac": "Mac", "packing": "Packing", "routing": "Routing", "sleep": "Sleep", "cpu": "Cpu",
    "clock": "Clock", "sync": "Sync", "detection": "Detection", "sink": "Sink", "workload": "Workload",
    "fault": "Fault", "wakeup": "WakeUp", "clusters": "Clusters", "acquire": "Acquire", "management": "Management",
    "trigger": "Trigger",
}  # fmt: skip
"""What follows the kind, by role."""
TRACKERS: Final = "wsnsim.trackers"
MODELS: Final = "wsnsim.models"
KINDS: Final = Path(__file__).parents[1] / "scenario" / "kinds.table"


def facade(module: str, modules: Collection[str] = ()) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a module whose names its imports for type checkers list.

    Args:
        module: Name of the module, which is being imported.
        modules: Modules inside it that are imported when they are named, too.
    """

    def get(name: str) -> Any:
        if name in modules:
            return importlib.import_module(f"{module}.{name}")
        if name == "__all__":
            return sorted(homes(module))
        if name.startswith("__") or name not in homes(module):
            from wsnsim.base.errors import did_you_mean

            hint = did_you_mean(name, homes(module))
            raise AttributeError(f"module {module!r} has no attribute {name!r} ({hint})")
        home, own = homes(module)[name]
        return getattr(importlib.import_module(home), own)

    return get, lambda: sorted(homes(module))


@functools.cache
def homes(module: str) -> dict[str, tuple[str, str]]:
    """Return {name: (module, name there)} of what a façade hands on, read from its source, or from kinds.table."""
    if module in (TRACKERS, MODELS):
        return _kind_homes(module)
    text = sys.modules[module].__spec__.loader.get_source(module)  # type: ignore[union-attr]
    source = text.partition("if TYPE_CHECKING:")[2]
    imports = ((home, names.strip("()").split(",")) for home, names in _IMPORT.findall(source))
    found = {name.split()[0]: home for home, names in imports for name in names if name.strip()}
    return {name: (home, name) for name, home in found.items()} | {
        alias: (found[name], name) for alias, name in _ALIAS.findall(source)
    }


def _kind_homes(package: str) -> dict[str, tuple[str, str]]:
    """Return the names of a package: its classes, its kinds, and those in CamelCase that only one role has."""
    sections = [(role, rows) for (role, *_), rows in read_sections(KINDS) if package_of(role) == package]
    kinds = [(role, kind, *path.split(":")) for role, rows in sections for kind, path, *_ in rows]
    found = {own: (home, own) for _, _, home, own in kinds}
    shared = Counter(in_camel_case(kind) for _, kind, _, _ in kinds)
    for role, kind, home, own in kinds:
        found[import_name(role, kind, own)] = home, own
        if shared[in_camel_case(kind)] == 1:
            found.setdefault(in_camel_case(kind), (home, own))
    return found


def package_of(role: str) -> str:
    """Return the package whose names the kinds of a role are."""
    return TRACKERS if role in ("tracker", "management", "trigger") else MODELS


def import_name(role: str, kind: str, class_name: str) -> str:
    """Return the name under which a kind is imported."""
    if role == "tracker" or "_" in kind:
        return in_camel_case(kind)
    noun = NOUNS[role]
    if kind == "none" or kind.endswith(role) or class_name.lower().endswith(noun.lower()):
        return class_name
    return in_camel_case(kind) + noun


def in_camel_case(kind: str) -> str:
    """Return a kind as the name of a class: 'pso_mhpf' → 'PsoMhpf'."""
    return "".join(word[:1].upper() + word[1:] for word in kind.split("_"))
