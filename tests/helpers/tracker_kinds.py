"""The trackers of the catalogue that follow one target, whose name each reading says."""

from __future__ import annotations

from wsnsim.base.ports import port_of
from wsnsim.scenario.registry import ROLES, Kind, load_class


def trackers_of_one_target() -> list[Kind]:
    """The kinds of trackers of one target that have a head."""
    return [kind for kind in ROLES["tracker"].kinds if not port_of(load_class(kind))]


def trackers_without_a_head() -> list[Kind]:
    """The kinds of trackers that run on every participant."""
    return [kind for kind in ROLES["tracker"].kinds if port_of(load_class(kind)) == "HeadlessTracker"]
