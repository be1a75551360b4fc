"""Whether a resolved scenario is a paper's set-up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def same_set_up(resolved: Mapping[str, Any], set_up: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether every value of the set-up stands in the scenario, role by role."""
    return all(
        (resolved.get(role) or {}).get(key) == value for role, own in set_up.items() for key, value in own.items()
    )
