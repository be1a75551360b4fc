"""check_tracker compares a tracker's whole runs with those that its requests make."""

from dataclasses import dataclass
from typing import Any

import pytest

from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.testing.whole_runs import demand_whole_runs
from wsnsim.trackers.sensor_chains import RelayKalman


@dataclass(frozen=True)
class Altered:
    """A tracker whose whole runs have other means: by a factor, and by a part that depends on the block."""

    honest: Any
    factor: float
    shared: float

    def whole_runs(self, block):
        made = self.honest.whole_runs(block)
        return made._replace(means=made.means * self.factor + self.shared * len(block.runs))

    def __getattr__(self, name):
        return getattr(self.honest, name)


def _check(factor=1.0, shared=0.0):
    demand_whole_runs(Altered(RelayKalman(), factor, shared), BoundedVelocity(), AcousticEnergy(), 1)


def test_equal_runs_pass():
    _check()


def test_other_means_are_found():
    with pytest.raises(AssertionError, match="whole_runs differs from the runs that start and step make: column"):
        _check(factor=1.0 + 1e-6)


def test_a_run_that_depends_on_the_others_of_its_block_is_found():
    with pytest.raises(AssertionError, match="a run alone differs from the same run in a block: column"):
        _check(shared=1e-11)


def test_options_that_are_not_offered_are_not_compared():
    @dataclass(frozen=True)
    class Refusing(Altered):
        def whole_runs(self, block):
            return None

    demand_whole_runs(Refusing(RelayKalman(), 1.0, 0.0), BoundedVelocity(), AcousticEnergy(), 1)
