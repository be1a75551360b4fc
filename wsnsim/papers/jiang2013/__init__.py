"""Jiang, Song, Lin (2013): what the paper prints for PSO-MHPF, IPF and PPF (section 5, table 2, figures 8 and 9)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from wsnsim.papers.matching import same_set_up

SOURCE: Final = "Jiang 2013"
RMSE: Final = {"pso_mhpf": 2.5347, "ipf": 3.3710, "ppf": 4.5519}
"""Metres: the time mean of eq. (26)."""
ENERGY: Final = {"pso_mhpf": 1.82, "ipf": 2.33, "ppf": 2.45}
"""Joules that the network spent by the end of the run."""
CLUSTERS: Final = {"pso_mhpf": 16}
"""Horizontal segments of figure 6."""
STEP_ENERGY: Final = (2.364e-3, 3.378e-3)
"""Joules: the least and the largest energy of a step of PSO-MHPF in figure 6."""
TABLE_2: Final[Mapping[str, Mapping[str, Any]]] = {
    "deploy": {"kind": "uniform", "nodes": 256, "width": 400.0, "height": 400.0},
    "motion": {
        "kind": "bounded_velocity",
        "bound": 180.0,
        "c1": 0.75,
        "c2": 1.0,
        "q": 0.002,
        "sigma0": 1.0,
        "start": [-45.0, -20.0, -50.0, -35.0],
    },
    "sensor": {
        "kind": "acoustic_energy",
        "reach": 60.0,
        "decay": 2.2,
        "samples": 1000,
        "nonlinearity": 1.5,
        "gain_spread": 0.3,
        "intensity": 1e4,
        "noise": 1.0,
    },
    "energy": {
        "kind": "first_order",
        "electronics": 50e-9,
        "amplifier": 100e-12,
        "battery": 2.0,
        "capacitance": 0.67e-9,
        "voltage": 1.5,
        "sensing": 0.0,
    },
    "link": {"kind": "disk", "reach": 75.0, "loss": 0.0},
    "mac": {"kind": "ideal", "rate": None},
    "clusters": {"kind": "strongest_signal", "handover_fraction": 0.25, "minimum_active": 3},
    "tracker": {"particles": 400},
}
"""The paper's set-up, table 2; where it gives no value (I, σ², battery, processor), the value of our base scenario."""
BEYOND: Final[Mapping[str, Mapping[str, Any]]] = {
    "energy": {"idle": 0.0, "sleep": 0.0, "switch": 0.0},
    "cpu": {"kind": "processor", "rate": None, "cycles_per_flop": 1.0},
    "packing": {"kind": "none"},
    "clock": {"kind": "perfect"},
    "detection": {"kind": "perfect"},
    "sink": {"kind": "none"},
    "workload": {"kind": "tracking"},
}
"""What the paper knows nothing of, in a scenario of its world; older results do not say it."""


def published(resolved: Mapping[str, Any]) -> dict[str, float]:
    """The paper's figures for a resolved scenario: 'rmse' (m), 'energy' (J), 'clusters'.

    Empty unless the scenario is the paper's set-up, but for its tracker's variant and for which of the paper's two
    process covariances act (`motion.noise`).
    """
    kind = resolved.get("tracker", {}).get("kind", "")
    if resolved.get("network") or not same_set_up(resolved, TABLE_2) or not _knows_no_more(resolved):
        return {}
    if resolved.get("step") != 0.04 or not _as_long(resolved):
        return {}
    figures: dict[str, Mapping[str, float]] = {"rmse": RMSE, "energy": ENERGY, "clusters": CLUSTERS}
    return {name: float(table[kind]) for name, table in figures.items() if kind in table}


def _knows_no_more(resolved: Mapping[str, Any]) -> bool:
    """Whether nothing happens that the paper's world does not have: idle listening, drifting clocks, faults."""
    said = {role: resolved.get(role) or {} for role in BEYOND}
    same = (said[role].get(key, value) == value for role, own in BEYOND.items() for key, value in own.items())
    return not resolved.get("faults") and all(same)


def _as_long(resolved: Mapping[str, Any]) -> bool:
    """Whether a run is as long as the paper's, read as 700 steps or as 16 clusters."""
    until = resolved.get("until")
    return bool(until.get("clusters") == 16) if until else resolved.get("duration") == 28.0
