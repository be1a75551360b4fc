"""What the datasheet of a radio says of the link and the MAC: it takes the place of defaults that nobody wrote.

    with_radio(scenario) -> the scenario with these values

A value that a scenario writes stays, and the energy model refuses it if the radio contradicts it.
"""

from __future__ import annotations

from typing import Any, Final

from wsnsim.scenario.fields import PartModel
from wsnsim.scenario.schema import Scenario

LINK: Final = ("sensitivity", "modulation")
MAC: Final = ("rate", "turnaround")
"""Fields of links and MACs that have the name and the meaning of a value of the datasheet."""
STANDARD_RATE: Final = 250e3
"""The rate in bit/s at which the durations of MACs in symbols (`in_symbols`) have their defaults."""


def with_radio(scenario: Scenario) -> Scenario:
    """Return the scenario with what the radio of its energy model says, where link and MAC say nothing.

    Durations of the MAC in symbols take as many symbols at the rate of the radio. The output powers of link and energy
    model are one: each follows the other.
    """
    energy, link, mac = (getattr(scenario, role, None) for role in ("energy", "link", "mac"))
    radio = getattr(energy, "radio", None)
    if energy is None or link is None or mac is None or not isinstance(radio, PartModel):
        return scenario
    link = _filled(link, {name: getattr(radio, name, None) for name in LINK})
    mac = _filled(mac, {name: getattr(radio, name, None) for name in MAC})
    link = _filled(link, {"power": getattr(energy, "power", None)})
    energy = _filled(energy, {"power": getattr(link, "power", None)})
    longer = STANDARD_RATE / getattr(radio, "rate", STANDARD_RATE)
    mac = _filled(mac, {name: longer * getattr(mac, name) for name in getattr(mac.part, "in_symbols", ())})
    return scenario.model_copy(update={"energy": energy, "link": link, "mac": mac})


def _filled(model: PartModel, values: dict[str, Any]) -> PartModel:
    """Return a model with values for the fields that nobody wrote. A default of None means something, and stays."""
    new = {
        name: value
        for name, value in values.items()
        if None not in (value, getattr(model, name, None)) and name not in model.model_fields_set
    }
    return model.model_copy(update=new) if new else model
