"""The nodes of a scenario, with their duty cycles and background consumption."""

from __future__ import annotations

import numpy as np
import simpy

from wsnsim.base.arrays import Floats
from wsnsim.base.continuous_power import continuous_power
from wsnsim.base.radio import ContinuousPower, Mode
from wsnsim.base.rng import derive_all
from wsnsim.base.setups import NetworkSetup, RadioSetup
from wsnsim.network.energy.background_consumption import BackgroundConsumption
from wsnsim.network.energy.consumption import Consumption
from wsnsim.network.energy.duty_cycles import DutyCycles, ScheduledDutyCycles
from wsnsim.network.nodes import Nodes


def make_nodes(env: simpy.Environment, setup: RadioSetup, positions: Floats, traits: Floats, key: int) -> Nodes:
    """Return the nodes of a scenario with their duty cycles and background consumption.

    Args:
        env: The clock.
        setup: The scenario.
        positions: (N, 2) in m.
        traits: (N, T) constants of the sensors.
        key: The random key of sleep schedules.
    """
    duty_cycles: DutyCycles = DutyCycles(setup.sleep.rest)
    if setup.sleep.rest is Mode.SCHEDULED:
        duty_cycles = ScheduledDutyCycles(env, setup.sleep, derive_all(key, np.arange(len(positions))))
    consumption: Consumption = Consumption()
    model, searching = continuous_power(setup.energy), _search_power(setup)
    if model is not None and (_costs_over_time(model) or searching):
        horizon = (setup.steps + 1) * setup.dt
        consumption = BackgroundConsumption(env, model, duty_cycles, len(positions), horizon, searching)
    return Nodes(positions, traits, setup.energy.battery, setup.link.reach, duty_cycles, consumption)


def _search_power(setup: RadioSetup) -> float:
    """Mean power in W that a node which is awake spends on measurements that look for targets."""
    if not isinstance(setup, NetworkSetup) or not setup.nodes_search:
        return 0.0
    return setup.energy.sense() / (setup.acquire.poll or setup.dt)


def _costs_over_time(model: ContinuousPower) -> bool:
    """Whether waiting or switching costs anything in any mode."""
    powers = [model.mode_power(mode) for mode in Mode]
    return any(power.radio or power.processor for power in powers) or any(
        model.switching(before, after) for before in Mode for after in Mode
    )
