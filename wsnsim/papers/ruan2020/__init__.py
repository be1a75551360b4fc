"""Ruan, Wang, Yang, Zhang (2020): what the paper prints for PF, GPF, PSO-GPF and GSA-GPF (table 1)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from wsnsim.papers.matching import believes_the_truth, same_set_up

SOURCE: Final = "Ruan 2020"
TABLE_1: Final[Mapping[str, Mapping[int, float]]] = {
    "pf": {50: 1.2539, 100: 0.7443, 200: 0.6356},
    "gpf": {50: 0.6094, 100: 0.5006, 200: 0.3836},
    "pso_gpf": {50: 0.5374, 100: 0.4515, 200: 0.3503},
    "gsa_gpf": {50: 0.4502, 100: 0.3599, 200: 0.3119},
}
"""Metres: the time mean of eq. (10), by the number of particles."""
BETTER: Final[Mapping[str, float]] = {"pso_gpf": 0.1623, "gpf": 0.2612, "pf": 0.641}
"""Section 3.1: by what share GSA-GPF is better than each, with 50 particles."""
ROOM: Final[Mapping[str, Mapping[str, Any]]] = {
    "deploy": {"kind": "anchors", "places": [[0.0, 5.0], [5.0, 10.0], [10.0, 0.0]]},
    "motion": {"kind": "constant_velocity", "start": [0.0, 0.5, 0.0, 0.5]},
    "sensor": {"kind": "rssi", "z0": -37.8, "eta": 2.3, "sd": 0.5},
    "prior": {"mean": [0.0, 0.5, 0.0, 0.5]},
}


def published(resolved: Mapping[str, Any]) -> dict[str, float]:
    """'rmse' (m) for the simulation's set-up, whichever variant, noise input and truth are taken; {} for any other."""
    tracker = resolved.get("tracker", {})
    table = TABLE_1.get(tracker.get("kind", ""), {})
    ours = resolved.get("network") == "none" and resolved.get("step") == 0.5 and believes_the_truth(resolved)
    ours = ours and same_set_up(resolved, ROOM)
    return {"rmse": table[tracker["particles"]]} if ours and tracker.get("particles") in table else {}
