"""The continuous power of an energy model, if time costs it anything."""

from __future__ import annotations

from wsnsim.base.radio import ContinuousPower, EnergyModel, Mode, ModePower


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
    return energy if isinstance(energy, ContinuousPower) else None
