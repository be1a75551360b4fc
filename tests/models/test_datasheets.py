"""The datasheets that come with wsnsim: every value is there, has a source, and is in order."""

import dataclasses
from pathlib import Path
from typing import Annotated, get_args, get_origin, get_type_hints

import pytest
import yaml

from wsnsim.base.part import Quantity
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.scenario.units import si

FOLDER = Path(__file__).parents[2] / "scenarios" / "parts"
NAMES = sorted(path.stem for path in FOLDER.glob("*.yaml"))
CLASSES = {"radio": RadioSheet, "processor": ProcessorSheet}


def read(name):
    return yaml.safe_load((FOLDER / f"{name}.yaml").read_text(encoding="utf-8"))


def quantity_of(kind, field):
    hint = get_type_hints(kind, include_extras=True)[field]
    assert get_origin(hint) is Annotated
    return next((note for note in get_args(hint) if isinstance(note, Quantity)), None)


def sheet(name):
    """The part of a file, its quantities in SI units."""
    content = read(name)
    kind = CLASSES[content.pop("sheet")]
    del content["sources"]
    made = {}
    for field, value in content.items():
        quantity = quantity_of(kind, field)
        values = [si(v, quantity.unit) if isinstance(v, str) and quantity else v for v in _list(value)]
        made[field] = tuple(values) if isinstance(value, list) else values[0]
    return kind(**made)


def _list(value):
    return value if isinstance(value, list) else [value]


def test_the_sheets_of_the_design_are_there():
    assert {"cc2420", "cc1000", "msp430f1611", "sa1100", "nrf52840"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_value_says_where_it_comes_from(name):
    content = read(name)
    fields = {field.name for field in dataclasses.fields(CLASSES[content["sheet"]])}
    given = set(content) - {"sheet", "sources"}
    assert given <= fields
    assert set(content["sources"]) == given - {"name", "source"}
    assert all(isinstance(text, str) and len(text) > 5 for text in content["sources"].values())


@pytest.mark.parametrize("name", NAMES)
def test_the_values_are_within_their_bounds_and_in_order(name):
    part = sheet(name)
    for field in dataclasses.fields(part):
        quantity, value = quantity_of(type(part), field.name), getattr(part, field.name)
        for number in _list(list(value) if isinstance(value, tuple) else value):
            if quantity and number is not None:
                assert quantity.ge <= number <= quantity.le, field.name
    if isinstance(part, ProcessorSheet):
        assert part.sleep <= part.idle < part.run
    else:
        assert part.sleep < part.listen == part.receive
        assert part.noise < part.sensitivity
        by_level = [watts for _, watts in sorted(zip(part.levels, part.transmit, strict=True))]
        assert by_level == sorted(by_level)


def test_the_cc2420_draws_what_its_currents_say():
    """18.8 mA received and 17.4 mA sent at 0 dBm, at 3.3 V, of the datasheet; to a milliwatt's tenth."""
    radio = sheet("cc2420")
    assert radio.receive == pytest.approx(18.8e-3 * 3.3, abs=1e-4)
    assert radio.transmit[radio.levels.index(0)] == pytest.approx(17.4e-3 * 3.3, abs=1e-6)
    assert radio.transmit[radio.levels.index(-15)] == pytest.approx(9.9e-3 * 3.3, abs=1e-6)


def test_the_cc2420_sleeps_in_power_down_and_in_its_other_states_by_name():
    """20 uA, 426 uA and 0.02 uA at 3.3 V; the crystal needs 0.86 ms and the regulator 0.6 ms to start (SWRS041)."""
    radio = sheet("cc2420")
    assert radio.voltage == 3.3
    assert radio.sleeping(None) == radio.sleeping("power_down")
    currents = {"power_down": 20e-6, "idle": 426e-6, "regulator_off": 0.02e-6}
    assert set(radio.sleep_states) == set(currents)
    for state, current in currents.items():
        assert radio.sleeping(state).power == pytest.approx(current * radio.voltage, rel=0.01)
    idle, down, off = (radio.sleeping(state) for state in ("idle", "power_down", "regulator_off"))
    assert down.wake - idle.wake == pytest.approx(0.86e-3)
    assert 256 * 14 * down.power == pytest.approx(0.2365, abs=1e-4), "joules of 256 sleeping radios in 14 s"
    assert off.wake - down.wake == pytest.approx(0.6e-3)
    from_idle = idle.wake * idle.wake_power
    assert down.wake * down.wake_power == pytest.approx(from_idle + 0.86e-3 * idle.power, rel=1e-3)
    assert off.wake * off.wake_power == pytest.approx(from_idle + 0.86e-3 * idle.power + 0.6e-3 * down.power, rel=1e-3)


@pytest.mark.parametrize("missing", ["sleep_powers", "sleep_wakes", "sleep_wake_powers"])
def test_sleep_states_have_a_value_each(missing):
    with pytest.raises(ValueError, match=f"sleep_states has 3 items and {missing} 2: one a state"):
        dataclasses.replace(sheet("cc2420"), **{missing: (0.0, 0.0)})


def test_the_processors_cycle_costs_what_it_draws_over_its_rate():
    assert sheet("msp430f1611").cycle == pytest.approx(5.4e-3 / 8e6)
    assert sheet("sa1100").cycle == pytest.approx(0.4 / 206e6)
