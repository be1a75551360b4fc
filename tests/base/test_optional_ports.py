"""A method that stands for another one is believed only where one class defines both."""

from __future__ import annotations

from wsnsim.base.optional_ports import defined_together
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy


class Loud(AcousticEnergy):
    """Overrides what the law stands for."""

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        return 2.0 * super().log_likelihood(points, readings, positions, traits, owners)


class Lawful(Loud):
    """Overrides both."""

    log_likelihood = AcousticEnergy.log_likelihood

    def energy_law(self, traits):
        return super().energy_law(traits)


class Renamed(AcousticEnergy):
    """Overrides neither."""


class Wrapped:
    """Passes on what it lacks, and has a likelihood of its own."""

    def __init__(self, sensor):
        self._sensor = sensor

    def __getattr__(self, name):
        return getattr(self._sensor, name)

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        return -self._sensor.log_likelihood(points, readings, positions, traits, owners)


def test_a_class_that_overrides_one_of_two_methods_has_not_defined_them_together():
    law = ("energy_law", "log_likelihood")
    assert [defined_together(kind, *law) for kind in (AcousticEnergy, Renamed, Lawful)] == [True] * 3
    assert hasattr(Wrapped(AcousticEnergy()), "energy_law")
    assert [defined_together(kind, *law) for kind in (Loud, Wrapped, BoundedVelocity, object)] == [False] * 4
