"""The baseline of a comparison: the point that differences are from. Nothing heavy is imported here.

demand_baseline(plan, by, wanted)      baseline_point(manifest, by, wanted) -> its label      label(values) -> text
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

from wsnsim.base.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from wsnsim.recording.folder import Manifest
    from wsnsim.scenario.sweep_schema import Plan

SCENARIO: Final = "scenario"
"""The swept key of a sweep over several scenarios."""


def demand_baseline(plan: Plan | Manifest, by: Sequence[str], wanted: str | None) -> None:
    """Raise UsageError unless the campaign can be compared with this baseline."""
    baseline_point(plan, tuple(by) or keys_by_default(plan.keys), wanted)


def baseline_point(manifest: Plan | Manifest, by: Sequence[str], wanted: str | None) -> str | None:
    """The wanted baseline, or else the campaign's first point; None if nothing is compared.

    Raises:
        UsageError: there is no such point, or a baseline is wanted and nothing is compared.
    """
    names = [label(point.settings.get(key) for key in by) for point in manifest.points]
    if wanted is None:
        return names[0] if by else None
    if not by:
        raise UsageError(f"a baseline requires a key to compare by: --by {' or '.join(manifest.keys)}")
    if wanted not in names:
        raise UsageError(f"{manifest.name} has no point '{wanted}' ({did_you_mean(wanted, set(names))})")
    return wanted


def keys_by_default(keys: Sequence[str]) -> tuple[str, ...]:
    """The keys compared by default: the scenarios if there are several, or else the only swept key."""
    return (SCENARIO,) if SCENARIO in keys else tuple(keys) if len(keys) == 1 else ()


def label(values: Iterable[Any]) -> str:
    """Values of settings as a short text."""
    return ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values)
