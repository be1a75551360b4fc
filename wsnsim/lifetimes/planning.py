"""From a scenario to the plan of an estimate: when targets come, how one visit is simulated, and what is asked.

    setup, plan = lifetime_plan(scenario)

A scenario whose motion is not `visits` is one visit: its target moves for the duration of the scenario, and comes again
and again.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Final

from wsnsim.base.errors import UsageError
from wsnsim.base.setups import NetworkSetup, TrackingSetup
from wsnsim.lifetimes.estimate import EPOCHS, LifetimePlan
from wsnsim.lifetimes.library import Visit
from wsnsim.models.visits import Crossing, Visits
from wsnsim.scenario.build import build
from wsnsim.scenario.lifetime import CRITERIA, AskedLifetime

HOURLY: Final = 1.0 / 3600.0
"""Visits per second where nobody says how many."""
LEAST: Final = 12
"""Visits that are simulated first."""
REPEATS: Final = 2
"""Paths of each draw of the loads."""
EARLY: Final = {"first_death": 0.0, "dead_10": 0.1}
"""Criteria that end an estimate early, and the share of nodes that are dead then."""


def lifetime_plan(scenario: Any) -> tuple[NetworkSetup, LifetimePlan]:
    """The setup of a scenario, whose runs have the network of the first, and the plan of its estimate.

    Raises:
        ScenarioError: a component finds an issue.
        UsageError: the scenario has no network, no target or several, recorded readings, or visits that overlap.
    """
    setup, asked = build(scenario), scenario.lifetime or AskedLifetime.model_construct()
    if reason := _refused(setup):
        raise UsageError(f"{scenario.name}: {reason}")
    assert isinstance(setup, NetworkSetup)
    visits = _visits(scenario, setup, asked)
    if issue := visits.closeness():
        raise UsageError(f"{scenario.name}: {'lifetime.times' if asked.times else 'motion'}: {issue.message}")
    steps = (math.ceil(time / setup.dt - 1e-9) for time in (asked.lead, asked.tail, visits.longest))
    window = Visit(visits, *(count * setup.dt for count in steps))
    shares: dict[str, Any] = {
        name: getattr(asked, name) for name in ("horizon", "error", "tolerance", "coverage", "connected", "tracked")
    }
    if asked.until in EARLY:
        known = CRITERIA[: CRITERIA.index(asked.until) + 1]
        shares |= {"last": EARLY[asked.until], "epochs": EPOCHS[:1], "known": known}
    plan = LifetimePlan(
        window, least=min(LEAST, asked.episodes), most=asked.episodes, draws=math.ceil(asked.paths / REPEATS),
        repeats=REPEATS, later=min(LEAST, asked.episodes), **shares,
    )  # fmt: skip
    return dataclasses.replace(setup, network=0), plan


def _refused(setup: Any) -> str:
    """Why a scenario has no lifetime; '' if it has one."""
    if isinstance(setup, TrackingSetup) and not isinstance(setup, NetworkSetup):
        return "network: none has no batteries; a lifetime needs a network"
    if not isinstance(setup, NetworkSetup):
        return "workload: the network has no target; a lifetime needs one that comes and goes (intrusions may be 0)"
    if setup.unlabelled:
        return "detection: false detections keep nodes busy without a target; a lifetime needs readings that name it"
    if setup.recorded is not None:
        return "sensor: recorded readings are one visit; a lifetime needs a sensor whose readings can be simulated"
    if len(setup.motions) > 1:
        return f"targets: a lifetime needs one target, which comes again and again; there are {len(setup.motions)}"
    return ""


def _visits(scenario: Any, setup: NetworkSetup, asked: AskedLifetime) -> Visits:
    """When targets come, and how they move. What the block `lifetime` says goes before what the motion says."""
    motion: Any = setup.motions[0]
    own = motion if isinstance(motion, Visits) else None
    if own is not None and asked.intrusions is None and asked.times is None and asked.profile is None:
        return own
    if asked.profile is not None and (asked.intrusions == 0.0 or (own and not own.rate and asked.intrusions is None)):
        raise UsageError(f"{scenario.name}: lifetime.profile: needs visits at a rate: give intrusions above 0, too")
    rate = asked.intrusions if asked.intrusions is not None else getattr(own, "rate", None) or HOURLY
    timing: dict[str, Any] = {"rate": rate, "profile": asked.profile, "times": None, "path": None}
    if asked.times is not None or not rate:
        timing |= {"rate": None, "times": asked.times or ()}
    elif asked.profile is None and own is not None:
        timing["profile"] = own.profile
    try:
        if own is not None:
            return dataclasses.replace(own, **timing)
        lasting = None if isinstance(motion, Crossing) else scenario.duration
        return Visits(of=motion, lasting=lasting, **timing)
    except ValueError as error:
        raise UsageError(f"{scenario.name}: lifetime.intrusions: {str(error).removeprefix('rate: ')}") from None
