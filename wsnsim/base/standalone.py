"""Many standalone runs at once: what a tracker is given of them, what it returns, and the port that offers it.

A run here is one target of one Monte Carlo run without a network. There are R runs of K steps, S sensors and D state
columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

from wsnsim.base.arrays import Estimate, Floats, Ints, Keys
from wsnsim.base.ports import MotionModel, SensorModel


class StandaloneRun(NamedTuple):
    """One target of one run, as a standalone filter sees it.

    Attributes:
        prior: The prior of the filter.
        readings: (K + 1, S) measurements of the steps 0 to K; NaN where a sensor has none.
        positions: (S, 2) assumed positions of the sensors, in m.
        traits: (S, T) constants of the sensors.
        keys: (K + 1,) counter key of the head at each step, as `Scene.key`.
    """

    prior: Estimate
    readings: Floats
    positions: Floats
    traits: Floats
    keys: Keys


@dataclass(frozen=True, slots=True)
class StandaloneBlock:
    """Runs that have everything else in common.

    Attributes:
        runs: the R runs.
        motion: the motion model that the filter assumes.
        sensor: the sensor model that the filter assumes.
        steps: K, the number of steps.
        dt: the length of a step in s.
    """

    runs: Sequence[StandaloneRun]
    motion: MotionModel
    sensor: SensorModel
    steps: int
    dt: float


class BlockEstimates(NamedTuple):
    """The estimates of all runs of a block at the steps 1 to K.

    Attributes:
        means: (R, K, D).
        covs: (R, K, D, D).
        effective: (R, K) effective numbers of particles; NaN without particles.
        nis: (R, K) normalised innovations squared; NaN without an innovation.
        nis_dof: (R, K) their degrees of freedom.
        cycles: (R,) operations of the head, those of the start included.
    """

    means: Floats
    covs: Floats
    effective: Floats
    nis: Floats
    nis_dof: Ints
    cycles: Floats


@runtime_checkable
class WholeRuns(Protocol):
    """Optional port of a tracker: many standalone runs in one call, without requests.

    Readings have one component, which may be an angle; runs whose readings have several are made request by request.
    It is for trackers whose members send one reading in one packet at each step, to a head that does the rest. Each run
    must not depend on the other runs of the block, and must equal the run that `start` and `step` make: `check_tracker`
    compares them.
    """

    def whole_runs(self, block: StandaloneBlock) -> BlockEstimates | None:
        """The estimates of all runs of a block; None if the tracker's present options are not offered."""


def offers_whole_runs(tracker: object) -> bool:
    """Whether a tracker has the port `WholeRuns`, and `whole_runs` knows all of its methods.

    A subclass that has a method or a property of its own, and inherits `whole_runs`, may do something else in `step`.
    """
    for kind in type(tracker).__mro__:
        if "whole_runs" in vars(kind):
            return True
        if any(hasattr(value, "__get__") and not name.startswith("__") for name, value in vars(kind).items()):
            return False
    return False
