"""The continuous power of an energy model, whether its method has the present name or the former one."""

from __future__ import annotations

import warnings
from typing import Protocol, runtime_checkable

from wsnsim.base.deprecation import uses_former
from wsnsim.base.radio import ContinuousPower, EnergyModel, Mode, ModePower


@runtime_checkable
class DrawsPower(Protocol):
    """`ContinuousPower` under the former name of its first method."""

    def draw(self, mode: Mode) -> ModePower:
        """See `ContinuousPower`."""
        ...

    def switching(self, before: Mode, after: Mode) -> float:
        """See `ContinuousPower`."""
        ...

    def turnaround(self) -> float:
        """See `ContinuousPower`."""
        ...

    def seconds(self, cycles: float) -> float:
        """See `ContinuousPower`."""
        ...


class RenamedPower:
    """The `ContinuousPower` of a model that has the former names."""

    def __init__(self, model: DrawsPower) -> None:
        self.mode_power = model.draw
        self.switching = model.switching
        self.turnaround = model.turnaround
        self.seconds = model.seconds


class NoPower:
    """The `ContinuousPower` of a model for which time costs nothing."""

    def mode_power(self, mode: Mode) -> ModePower:
        """Return zeros."""
        return ModePower(0.0, False, 0.0, False)

    def switching(self, before: Mode, after: Mode) -> float:
        """Return 0."""
        return 0.0

    def turnaround(self) -> float:
        """Return 0."""
        return 0.0

    def seconds(self, cycles: float) -> float:
        """Return 0."""
        return 0.0


def continuous_power(energy: EnergyModel) -> ContinuousPower | None:
    """Return the part of an energy model that costs over time, or None if it has none."""
    if uses_former(energy, "draw", "mode_power") and isinstance(energy, DrawsPower):
        message = f"{type(energy).__name__}.draw(mode) was renamed to mode_power(mode)"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return RenamedPower(energy)
    return energy if isinstance(energy, ContinuousPower) else None
