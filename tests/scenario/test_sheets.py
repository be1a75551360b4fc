"""Datasheets: named or written out, beside the scenario or shipped, and every way to get them wrong."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from tests.helpers import scenario_components
from tests.helpers.files import write_yaml
from tests.helpers.scenario_components import base_scenario, faults_of, kind
from wsnsim import scenario
from wsnsim.base.errors import ScenarioError
from wsnsim.scenario import datasheets
from wsnsim.scenario.fields import names_of, nested_of
from wsnsim.scenario.registry import ROLES, load_class
from wsnsim.scenario.texts import sheets, shipped_parts

TINY = "sheet: radio\nname: Tiny\nrate: 10 kbit/s\nsleep: 2 uW\nsources:\n  sleep: datasheet, p. 3\n"
MADE = scenario_components.Sheet(name="Tiny", rate=1e4, sleep=2e-6)


pytestmark = pytest.mark.usefixtures("fresh_folder")


def with_radio(radio: object, **further: object) -> dict:
    return base_scenario(energy={"kind": kind("Sheets"), "radio": radio, **further})


def test_a_name_stands_for_the_fields_of_the_file_beside_the_scenario() -> None:
    write_yaml("there/tiny.yaml", TINY)
    path = write_yaml("there/x.yaml", yaml.safe_dump(with_radio("tiny")))
    energy = scenario.build(scenario.load(path)).energy
    assert energy == scenario_components.Sheets(radio=MADE)
    assert energy.beacon == scenario_components.Sheet(name="B", rate=1.0, sleep=0.5)


@pytest.mark.parametrize("name", ["tiny", "tiny.yaml", "there/tiny"])
def test_a_sheet_may_be_named_with_its_suffix_and_its_folder(name: str) -> None:
    write_yaml("tiny.yaml", TINY)
    write_yaml("there/tiny.yaml", TINY)
    assert scenario.build(scenario.load(with_radio(name))).energy.radio == MADE


def test_a_mapping_of_its_fields_is_a_sheet_too() -> None:
    written = {"name": "Tiny", "rate": "10 kbit/s", "sleep": "2 uW"}
    energy = scenario.build(scenario.load(with_radio(written, spare={**written, "extra": 1}))).energy
    assert energy.radio == MADE
    assert energy.spare == scenario_components.Sheet(name="Tiny", rate=1e4, sleep=2e-6, extra=1.0)


def test_a_resolved_scenario_holds_the_numbers_and_runs_without_the_file() -> None:
    path = Path(write_yaml("tiny.yaml", TINY))
    loaded = scenario.load(with_radio("tiny"))
    text = json.dumps(scenario.resolved(loaded), allow_nan=False)
    path.unlink()
    again = scenario.load(json.loads(text))
    assert again == loaded
    assert scenario.build(again).energy == scenario.build(loaded).energy
    assert json.loads(text)["energy"]["radio"]["sleep"] == 2e-6


def test_set_names_a_sheet_and_reaches_into_one() -> None:
    write_yaml("tiny.yaml", TINY)
    write_yaml("other.yaml", TINY.replace("Tiny", "Other"))
    loaded = scenario.load(with_radio("tiny"), ["energy.radio.sleep=5 mW"])
    assert (loaded.energy.radio.sleep, loaded.energy.radio.rate) == (5e-3, 1e4)
    loaded = scenario.load(with_radio("tiny"), ["energy.radio=other", "energy.radio.sleep=5 mW"])
    assert (loaded.energy.radio.name, loaded.energy.radio.sleep) == ("Other", 5e-3)
    assert faults_of(with_radio("tiny"), "energy.radio.slep=1") == [
        "--set energy.radio.slep: error: unknown key, did you mean 'sleep'?"
    ]
    assert faults_of(with_radio("tiny"), "energy.radio.sleep=1 m") == [
        "--set energy.radio.sleep: error: 'm' is a unit of length, expected power (for example '1 W')"
    ]


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (TINY.replace("sleep: 2 uW\n", ""),
         "tiny.yaml:1:1: error: energy.radio.sleep: is missing: while it is off [W]"),
        (TINY.replace("sleep: 2", "slep: 2"),
         "tiny.yaml:4:1: error: energy.radio.slep: unknown key, did you mean 'sleep'?"),
        (TINY.replace("2 uW", "2 uJ"),
         "tiny.yaml:4:8: error: energy.radio.sleep: 'uJ' is a unit of energy, expected power (for example '1 W')"),
        (TINY.replace("2 uW", "-2 uW"), "tiny.yaml:4:8: error: energy.radio.sleep: must be at least 0, is -2e-06"),
        (TINY + "sleep: 3 uW\n", "tiny.yaml:7:1: error: energy.radio: duplicate key 'sleep' (first at line 4)"),
        (TINY + "levels: [0, 1]\n", "tiny.yaml:1:1: error: energy.radio: one power a level"),
        (TINY + "extends: x\n", "tiny.yaml:7:1: error: energy.radio.extends: unknown key, known: extra, levels, "),
        (TINY.replace("  sleep", "  slep"),
         "tiny.yaml:6:3: error: energy.radio.sources.slep: unknown field, did you mean 'sleep'?"),
        (TINY.replace("datasheet, p. 3", "3"),
         "tiny.yaml:6:10: error: energy.radio.sources.sleep: expected a text, got the number 3"),
        (TINY.replace("\n  sleep: datasheet, p. 3", " none"),
         "tiny.yaml:5:10: error: energy.radio.sources: expected a mapping of fields to texts, got the text 'none'"),
        (TINY.replace("sheet: radio\n", ""),
         "tiny.yaml:1:1: error: energy.radio.sheet: is not a datasheet: expected a key 'sheet' that says what it "
         "describes, such as 'sheet: radio'"),
        ("sheet: [", "tiny.yaml:2:1: error: energy.radio: not valid YAML: "),
        ("", "tiny.yaml:1:1: error: is empty"),
        ("\0", "tiny.yaml: error: is a binary file (or not UTF-8), expected YAML text"),
        (TINY.replace("2 uW", "2 W"), "tiny.yaml:4:8: error: energy.radio.sleep: sleeps badly"),
    ],
)  # fmt: skip
def test_a_fault_of_a_sheet_stands_in_the_sheet(text: str, fault: str) -> None:
    write_yaml("tiny.yaml", text)
    found = faults_of(with_radio("tiny"))
    assert any(one.startswith(str(Path("tiny.yaml").resolve().parent / fault)) for one in found), found


def test_the_line_of_a_sheet_is_shown_with_a_caret() -> None:
    write_yaml("tiny.yaml", TINY.replace("2 uW", "2 uJ"))
    with pytest.raises(ScenarioError) as caught:
        scenario.load(with_radio("tiny"))
    assert str(caught.value).endswith("\n    sleep: 2 uJ\n           ^")


@pytest.mark.parametrize(
    ("radio", "fault"),
    [
        ("cc2402", "there is no datasheet 'cc2402' of a radio (did you mean 'cc2420'?)"),
        ("zzz", "there is no datasheet 'zzz' of a radio (known: cc1000, cc2420, nrf52840_radio)"),
        ("a\0b", "there is no datasheet 'a?b' of a radio (known: cc1000, cc2420, nrf52840_radio)"),
        ("x" * 5000, None),
        ("sa1100", "'sa1100' is a datasheet of a processor, expected one of a radio "
                   "(known: cc1000, cc2420, nrf52840_radio)"),
        ("nrf52840", "'nrf52840' is a datasheet of a processor, expected one of a radio "
                     "(did you mean 'nrf52840_radio'?)"),
        (3, "expected the name of a datasheet (known: cc1000, cc2420, nrf52840_radio) or a mapping, got the number 3"),
        (["cc2420"],
         "expected the name of a datasheet (known: cc1000, cc2420, nrf52840_radio) or a mapping, got a list"),
        (None, "expected a mapping, got nothing"),
    ],
)  # fmt: skip
def test_a_name_without_a_sheet_says_which_there_are(radio: object, fault: str | None) -> None:
    (found,) = faults_of(with_radio(radio))
    assert len(found) < 300
    assert found == f"energy.radio: error: {fault}" if fault else "there is no datasheet 'xxx" in found


def test_what_a_tree_without_its_sheet_lacks_is_not_told_besides() -> None:
    assert len(faults_of(with_radio("cc2402"))) == 1


@pytest.mark.parametrize("path", shipped_parts().values(), ids=shipped_parts())
def test_every_shipped_sheet_is_whole_and_says_where_each_value_comes_from(path: Path) -> None:
    profile = datasheets.datasheet(path)
    assert profile.sheet in ("radio", "processor")
    told = {value.field: value.source for value in profile.values if value.source != "left out"}
    assert set(told) - {"name", "source"} >= {"rate", "sleep", "wake"}
    assert all(
        source and source != "the file does not say"
        for field, source in told.items()
        if field not in ("name", "source")
    )
    for value in profile.values:
        assert getattr(profile.part, value.field) == value.value


def test_every_shipped_sheet_can_be_named_where_one_of_its_kind_is_wanted() -> None:
    states = load_class(next(row for row in ROLES["energy"].kinds if row.kind == "states"))
    assert list(nested_of(states)) == ["radio", "processor"]
    for field, part in nested_of(states).items():
        other = {"radio": "processor=msp430f1611", "processor": "radio=cc2420"}[field]
        for name in sheets(field):
            loaded = scenario.load("pso_mhpf", ["energy.kind=states", f"energy.{other}", f"energy.{field}={name}"])
            assert set(names_of(part)) == set(type(getattr(loaded.energy, field)).model_fields)


def test_a_profile_of_a_bad_sheet_is_its_faults() -> None:
    for text, fault in [
        (TINY.replace("radio", "rado"), "tiny.yaml:1:8: error: sheet: unknown kind of datasheet "
                                        "(did you mean 'radio'?)"),
        (TINY, "tiny.yaml:1:1: error: receive: is missing: power while receiving a frame [W]"),
        ("a: 1\n", "tiny.yaml:1:1: error: sheet: is not a datasheet"),
    ]:  # fmt: skip
        with pytest.raises(ScenarioError) as caught:
            datasheets.datasheet(Path(write_yaml("tiny.yaml", text)))
        assert any(str(one).startswith(fault) for one in caught.value.issues), str(caught.value)
