"""Which bound is wanted: its kind, its readings, and what filters know of the nodes.

checked(query) -> query      assumed_gains(scenario), assumed_places(setup) -> word      unknown_constants(setup, query)
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.base.sensing import gain_variance, has_gains
from wsnsim.base.setups import Setup, TrackingSetup
from wsnsim.bounds.unknown_constants import UnknownConstants

KINDS: Final = ("unconditional", "per_trajectory")
READINGS: Final = ("in_range", "active", "arrived")
GAINS: Final = ("known", "unknown")
PLACES: Final = ("known", "unknown")


class BoundQuery(NamedTuple):
    """Which bound is wanted, and of which runs.

    Attributes:
        kind: one of `KINDS`.
        readings: one of `READINGS`.
        gains: one of `GAINS`.
        replicates: numbers of the runs.
        places: one of `PLACES`.
    """

    kind: str
    readings: str
    gains: str
    replicates: tuple[int, ...]
    places: str = "known"


def assumed_gains(scenario: Any) -> str:
    """Whether the scenario's tracker assumes known gains; `known` if it assumes nothing. Estimated ones are unknown."""
    assumes = getattr(getattr(scenario, "tracker", None), "assumes", None)
    return "known" if getattr(assumes, "gains", "known") == "known" else "unknown"


def assumed_places(setup: Setup) -> str:
    """Whether filters know where the nodes stand."""
    return "unknown" if setup.position_error else "known"


def unknown_constants(setup: TrackingSetup, query: BoundQuery) -> UnknownConstants:
    """What the filters of a query do not know of the nodes."""
    gain = gain_variance(setup.sensor) if query.gains == "unknown" and has_gains(setup.sensor) else 0.0
    return UnknownConstants(gain, setup.position_error**2 if query.places == "unknown" else 0.0)


def checked(query: BoundQuery) -> BoundQuery:
    """The query itself. Raises UsageError if a word is not allowed, or if there are no runs."""
    for name, value, allowed in (
        ("kind", query.kind, KINDS),
        ("readings", query.readings, READINGS),
        ("gains", query.gains, GAINS),
        ("places", query.places, PLACES),
    ):
        if value not in allowed:
            raise UsageError(f"{name}: '{value}': {did_you_mean(value, allowed)}")
    if not query.replicates:
        raise UsageError("replicates: a bound needs at least one run")
    return query
