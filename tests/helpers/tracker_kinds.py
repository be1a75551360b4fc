"""The trackers of the catalogue that follow one target, whose name each reading says."""

from __future__ import annotations

from wsnsim.scenario.registry import ROLES, Kind, load_class


def trackers_of_one_target() -> list[Kind]:
    """The kinds of trackers of one target."""
    return [kind for kind in ROLES["tracker"].kinds if not getattr(load_class(kind), "multi_target", False)]
