"""What the datasheet of a radio says of the link and the MAC: it takes the place of defaults that nobody wrote.

    with_radio(scenario) -> the scenario with these values

A value that a scenario writes stays, and the energy model refuses it if the radio contradicts it.
"""

from __future__ import annotations

import math
from typing import Any, Final

from wsnsim.scenario.fields import PartModel
from wsnsim.scenario.schema import InvalidComponent, Scenario, built

LINK: Final = ("sensitivity", "modulation")
MAC: Final = ("rate", "turnaround")
"""Fields of links and MACs that have the name and the meaning of a value of the datasheet."""
STANDARD_RATE: Final = 250e3
"""The rate in bit/s at which the durations of MACs in symbols (`in_symbols`) have their defaults."""


def with_radio(scenario: Scenario) -> Scenario:
    """Return the scenario with what the radio of its energy model says, where link, MAC and energy model say nothing.

    Durations of the MAC in symbols take as many symbols at the rate of the radio. The output powers of link and energy
    model are one: each follows the other. Where a MAC turns radios off for a shorter time than the usual sleep state
    allows, they are in the state with the least power that they can leave in time.
    """
    energy, link, mac = (getattr(scenario, role, None) for role in ("energy", "link", "mac"))
    radio = getattr(energy, "radio", None)
    rate = getattr(radio, "rate", None)
    if energy is None or link is None or mac is None or not isinstance(rate, float) or rate <= 0.0:
        return scenario
    link = _filled(link, {name: getattr(radio, name, None) for name in LINK})
    mac = _filled(mac, {name: getattr(radio, name, None) for name in MAC})
    link = _filled(link, {"power": getattr(energy, "power", None)})
    energy = _filled(energy, {"power": getattr(link, "power", None)})
    mac = _filled(
        mac, {name: STANDARD_RATE / rate * getattr(mac, name) for name in getattr(mac.part, "in_symbols", ())}
    )
    energy = _in_time(energy, radio, mac)
    return scenario.model_copy(update={"energy": energy, "link": link, "mac": mac})


def _filled(model: PartModel, values: dict[str, Any]) -> PartModel:
    """Return a model with values for the fields that nobody wrote. A default of None means something, and stays."""
    new = {
        name: value
        for name, value in values.items()
        if None not in (value, getattr(model, name, None)) and name not in model.model_fields_set
    }
    return model.model_copy(update=new) if new else model


def _in_time(energy: PartModel, radio: Any, mac: PartModel) -> PartModel:
    """Return an energy model with the sleep state that a MAC needs, unless the usual one will do or one is written."""
    try:
        shortest = getattr(built(mac), "shortest_off", math.inf)
    except InvalidComponent:
        return energy
    states = getattr(radio, "sleep_states", ())
    wakes = dict(zip(states, getattr(radio, "sleep_wakes", ()), strict=False))
    usual = wakes.get(getattr(energy, "sleep_state", None), getattr(radio, "wake", 0.0))
    if not hasattr(energy, "off_state") or "off_state" in energy.model_fields_set or radio.doze + usual <= shortest:
        return energy
    offers = zip(radio.sleep_powers, states, strict=False)
    quick = [offer for offer in offers if radio.doze + wakes.get(offer[1], math.inf) <= shortest]
    return energy.model_copy(update={"off_state": min(quick)[1]}) if quick else energy
