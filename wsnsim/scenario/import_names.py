"""The names under which kinds are imported in Python.

    import_name("tracker", "ekf", "ExtendedKalman") -> "Ekf"        from wsnsim.trackers import Ekf
    import_name("sensor", "range", "Range") -> "RangeSensor"        from wsnsim.models import RangeSensor

A tracker has the name of its kind in CamelCase. So has another component, followed by its role if the kind is one word.
The class's own name can be imported as well.
"""

from __future__ import annotations

from collections import Counter
from typing import Final

from wsnsim.scenario.kinds import ROLES

NOUNS: Final = {
    "prior": "Prior", "deploy": "Deployment", "motion": "Motion", "sensor": "Sensor", "energy": "Energy",
    "link": "Link", "mac": "Mac", "packing": "Packing", "routing": "Routing", "sleep": "Sleep", "cpu": "Cpu",
    "clock": "Clock", "sync": "Sync", "detection": "Detection", "sink": "Sink", "workload": "Workload",
    "fault": "Fault", "wakeup": "WakeUp", "clusters": "Clusters", "acquire": "Acquire",
}  # fmt: skip
"""What follows the kind, by role."""
TRACKERS: Final = "wsnsim.trackers"
MODELS: Final = "wsnsim.models"


def import_line(role: str, kind: str) -> str:
    """Return the line that imports a built-in kind: 'from wsnsim.trackers import Ekf'.

    Raises:
        KeyError: there is no such role or kind.
    """
    paths = {info.kind: info.path for info in ROLES[role].kinds}
    return f"from {package_of(role)} import {import_name(role, kind, paths[kind].partition(':')[2])}"


def package_of(role: str) -> str:
    """Return the package whose names the kinds of a role are."""
    return TRACKERS if role == "tracker" else MODELS


def import_name(role: str, kind: str, class_name: str) -> str:
    """Return the name under which a kind is imported."""
    if role == "tracker" or "_" in kind:
        return in_camel_case(kind)
    noun = NOUNS[role]
    if kind == "none" or kind.endswith(role) or class_name.lower().endswith(noun.lower()):
        return class_name
    return in_camel_case(kind) + noun


def homes(package: str) -> dict[str, str]:
    """Return {name: 'module:Class'} of everything that a package hands on.

    These are the name of each kind, the name of its class, and the kind in CamelCase where it is that of one kind only.
    """
    infos = [(role, info) for role in ROLES.values() if package_of(role.name) == package for info in role.kinds]
    found = {info.path.partition(":")[2]: info.path for _, info in infos}
    shared = Counter(in_camel_case(info.kind) for _, info in infos)
    for role, info in infos:
        found[import_name(role.name, info.kind, info.path.partition(":")[2])] = info.path
        short = in_camel_case(info.kind)
        if shared[short] == 1:
            found.setdefault(short, info.path)
    return found


def in_camel_case(kind: str) -> str:
    """Return a kind as the name of a class: 'pso_mhpf' → 'PsoMhpf'."""
    return "".join(word[:1].upper() + word[1:] for word in kind.split("_"))
