"""Whether a resolved scenario is a paper's set-up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

AS_IT_IS: Mapping[str, Any] = {"gains": "known", "inflate": False, "noise_scale": 1.0}
"""What a filter assumes that believes in the truth's own models."""


def believes_the_truth(resolved: Mapping[str, Any]) -> bool:
    """Whether the tracker assumes nothing else than the truth's models."""
    assumes = (resolved.get("tracker") or {}).get("assumes") or {}
    return all(assumes.get(key, value) == value for key, value in AS_IT_IS.items())


def same_set_up(resolved: Mapping[str, Any], set_up: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether every value of the set-up stands in the scenario, role by role."""
    return all(
        (resolved.get(role) or {}).get(key) == value for role, own in set_up.items() for key, value in own.items()
    )
