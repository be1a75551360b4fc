"""Checks of what is given as a scenario, and of what is given to be built. Each raises UsageError."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wsnsim.base.errors import UsageError, shown_value


def demand_scenario(value: Any) -> None:
    """Refuse what is no scenario."""
    from wsnsim.scenario.schema import Scenario

    if not isinstance(value, str | Path | Mapping | Scenario):
        raise UsageError(
            "scenario: expected the name of a scenario, a file, a dict, or what wsnsim.load returned, got "
            + _shown(value)
        )


def demand_loaded(value: Any) -> None:
    """Refuse what is not a loaded scenario."""
    from wsnsim.scenario.schema import Scenario

    if not isinstance(value, Scenario):
        raise UsageError(f"scenario: expected what wsnsim.load returned, got {_shown(value)}")


def _shown(value: Any) -> str:
    """A value as a message shows it; of a result, also where its scenario is."""
    from wsnsim.scenario.schema import Scenario

    held = isinstance(getattr(value, "scenario", None), Scenario)
    return shown_value(value) + (" (its attribute `scenario` is one)" if held else "")
