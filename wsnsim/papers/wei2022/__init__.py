"""Wei, Guo (2022): what the paper prints for PF, CS-PF and ICS-PF (tables 1 and 2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from wsnsim.papers.matching import believes_the_truth, same_set_up

SOURCE: Final = "Wei 2022"
TABLE_1: Final[Mapping[str, Mapping[int, float]]] = {
    "pf": {30: 6.0001, 60: 5.1002, 100: 4.7011},
    "cs_pf": {30: 4.3138, 60: 4.0031, 100: 4.0132},
    "ics_pf": {30: 4.0062, 60: 3.6275, 100: 3.1075},
}
"""RMSE of the growth model's state, by the number of particles."""
TABLE_2: Final[Mapping[str, tuple[float, float, float, float]]] = {
    "pf": (1.2301, 0.2132, 1.2218, 0.2428),
    "cs_pf": (1.1406, 0.0615, 1.0103, 0.0608),
    "ics_pf": (0.0306, 0.0213, 0.0253, 0.0102),
}
"""RMSE of px, vx, py, vy."""
SECONDS: Final[Mapping[str, float]] = {"pf": 50.36, "cs_pf": 35.32, "ics_pf": 28.36}
"""Run times of section 4.2, on a machine that is not named."""
ONE_SENSOR: Final[Mapping[str, Any]] = {"kind": "anchors", "places": [[0.0, 0.0]]}
GROWTH: Final[Mapping[str, Mapping[str, Any]]] = {
    "deploy": ONE_SENSOR,
    "prior": {"mean": [0.1]},
    "motion": {"kind": "ungm", "q": 1.0, "rate": 1.2, "start": [0.1]},
    "sensor": {"kind": "squared", "variance": 1.0},
}
PLANE: Final[Mapping[str, Mapping[str, Any]]] = {
    "deploy": ONE_SENSOR,
    "prior": {"mean": [71.0, 2.66, 18.9, 7.8]},
    "motion": {
        "kind": "constant_velocity",
        "noise_input": "accelerations",
        "variances": [0.72],
        "start": [70.0, 5.0, 21.0, 8.0],
    },
    "sensor": {"kind": "range_from_origin", "sd": 1.0},
    "tracker": {"particles": 200},
}


def published(resolved: Mapping[str, Any]) -> dict[str, float]:
    """'rmse_x' of experiment 1, or 'rmse_px', 'rmse_vx' ... of experiment 3, for that set-up; {} for any other.

    Whatever the tracker's variant; the paper does not give the steps of its runs, so these may be any.
    """
    tracker = resolved.get("tracker", {})
    kind = tracker.get("kind", "")
    if resolved.get("network") != "none" or kind not in TABLE_1 or not believes_the_truth(resolved):
        return {}
    if same_set_up(resolved, GROWTH) and tracker.get("particles") in TABLE_1[kind]:
        return {"rmse_x": TABLE_1[kind][tracker["particles"]]}
    if same_set_up(resolved, PLANE):
        return dict(zip(("rmse_px", "rmse_vx", "rmse_py", "rmse_vy"), TABLE_2[kind], strict=True))
    return {}
