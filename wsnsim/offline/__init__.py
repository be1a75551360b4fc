"""A tracker without a network. `offers_batch` says whether many runs may be made at once."""

from __future__ import annotations

from wsnsim.base.arrays import components_of
from wsnsim.base.initial_conditions import offers_whole_runs
from wsnsim.base.setups import NetworkSetup, Setup, TrackingSetup


def offers_batch(setup: Setup) -> bool:
    """Whether the batch engine might run a scenario.

    It does without a network, with a tracker that offers whole runs, constant traits, and readings of one component.
    """
    if not isinstance(setup, TrackingSetup) or isinstance(setup, NetworkSetup):
        return False
    if len(components_of(setup.sensor)) > 1:
        return False
    changing = (setup.recorded and setup.recorded.counted) or getattr(setup.filter_sensor, "adapts", False)
    return offers_whole_runs(setup.tracker) and not changing
