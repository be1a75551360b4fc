"""The contract check of batteries: `check_battery`."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.batteries import Battery, BatteryState
from wsnsim.models.energy import FirstOrder
from wsnsim.testing.table import demand, demand_each, examined

NODES: Final = 8
ROUNDING: Final = 1e-9
"""Share of the greatest charge by which ledgers may differ."""


def check_battery(battery: Battery, joules: float = 2.0) -> None:
    """Check a battery against the rules of its port (`wsnsim.plugins.Battery`), without and with a load.

    Args:
        battery: The component, built, for a network of 8 nodes.
        joules: What the energy model says of a battery, in J.

    Raises:
        AssertionError: The component breaks a rule, which the message names. start: the same generator gives the same
            batteries, and none holds more than its capacity. at once: what is drawn at once lowers what is drawable
            by as much. ledger: what was left, harvested, spent and lost adds up. time: two spans are the span of
            both, and what is drawable falls by no more than load and self-discharge take. death: a battery is empty
            when the span says so, not earlier, and lives longer with half of the load. nodes: a battery does not
            depend on the others.
    """
    battery = examined(battery, Battery)
    setup: Any = SimpleNamespace(energy=FirstOrder(battery=joules), deploy=None)
    with demand("start"):
        first, again = (battery.draw(setup, NODES, (), np.random.default_rng(1)) for _ in range(2))
        assert all(map(np.array_equal, first, again)), "the same generator gives other batteries"
        assert all(column.shape[-1] == NODES for column in first), f"arrays must be over the {NODES} nodes"
        assert (first.left <= first.capacity * (1.0 + ROUNDING)).all(), "a battery holds more than its capacity"
    powers = battery.drawable(first) / 1e4 * np.linspace(0.2, 1.0, NODES)
    demand_each(CHECKS, battery, first, np.where(np.isfinite(powers), powers, 1.0))


def _check_at_once(battery: Battery, state: BatteryState, _: Floats) -> None:
    before, part = battery.drawable(state), np.where(np.isfinite(state.left), battery.drawable(state) / 3.0, 1.0)
    after = battery.drawable(battery.draw_at_once(state, part))
    _demand_near(after, before - part, state, "what is drawable is lowered by another amount than was drawn")


def _check_ledger(battery: Battery, state: BatteryState, watts: Floats) -> None:
    for seconds in (1.0, 1e3, 1e5):
        done = battery.advance(state, watts, seconds, battery.income(0.0).watts)
        lost = done.spent + done.leaked + done.unstored + done.surplus
        _demand_near(state.left + done.harvested - lost, done.state.left, state, "the ledger of a span does not add up")
        lived = np.minimum(done.died_after, seconds)
        _demand_near(done.spent, watts * lived, state, "`spent` is not the load times the time")


def _check_time(battery: Battery, state: BatteryState, watts: Floats) -> None:
    whole = battery.advance(state, watts, 500.0).state
    parts = battery.advance(battery.advance(state, watts, 200.0).state, watts, 300.0).state
    _demand_near(whole.left, parts.left, state, "two spans are not the span of both")
    before, after = battery.drawable(state), battery.drawable(whole)
    most = (watts + state.leak) * 500.0 + ROUNDING * _finite(state.capacity).max(initial=1.0)
    assert (before <= after + most).all(), "what is drawable falls by more than load and self-discharge take"


def _check_death(battery: Battery, state: BatteryState, watts: Floats) -> None:
    died = battery.advance(state, watts, 1e9).died_after
    dead = np.isfinite(died)
    before = battery.advance(state, watts, np.where(dead, died * (1.0 - 1e-6), 1.0))
    assert np.isinf(before.died_after).all(), "a battery is empty earlier if the span ends earlier"
    left, power = battery.drawable(before.state)[dead], (watts + state.leak)[dead]
    assert (left <= 2e-6 * power * died[dead] + ROUNDING).all(), "a battery dies though something is drawable"
    half = battery.advance(state, watts / 2.0, 1e9).died_after
    assert (half >= died).all(), "a battery with half of the load dies earlier"


def _check_nodes(battery: Battery, state: BatteryState, watts: Floats) -> None:
    order = np.arange(NODES)[::-1]
    turned = battery.advance(state.of(order), watts[order], 500.0).state.left[order]
    _demand_near(battery.advance(state, watts, 500.0).state.left, turned, state, "a battery depends on the others")


CHECKS: Final = {
    "at once": _check_at_once, "ledger": _check_ledger, "time": _check_time, "death": _check_death,
    "nodes": _check_nodes,
}  # fmt: skip


def _finite(values: Floats) -> Floats:
    return values[np.isfinite(values)]


def _demand_near(one: Floats, other: Floats, state: BatteryState, message: str) -> None:
    finite = np.isfinite(state.capacity)
    allowed = ROUNDING * _finite(state.capacity).max(initial=1.0)
    assert (np.abs(one[finite] - other[finite]) <= allowed).all(), message
