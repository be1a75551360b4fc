"""`wsnsim info` of datasheets and scenarios, and `wsnsim list` of what scenarios can name."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path

import pytest
import yaml

from tests.helpers.scenario_components import base_scenario
from wsnsim.base.tables import TABLES
from wsnsim.cli import main
from wsnsim.scenario.texts import shipped_parts

pytestmark = pytest.mark.usefixtures("fresh_folder")


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(list(arguments)) == 0
    return capsys.readouterr().out


def rows_of(text: str) -> dict[str, list[str]]:
    """The cells (value, unit, last column) of a text's first table by the names of its rows, wrapped cells joined."""
    lines = text.split("\n\n")[0].splitlines()
    head = next(i for i, line in enumerate(lines) if line.split()[:2] == ["value", "unit"])
    starts = [re.search(rf"\b{word}\b", lines[head]).start() for word in lines[head].split()]  # type: ignore[union-attr]
    rows: dict[str, list[str]] = {}
    for line in lines[head + 1 :]:
        cells = [line[a:b].strip() for a, b in itertools.pairwise([*starts, None])]
        if name := line[: starts[0]].strip():
            rows[name] = cells
        else:
            last = rows[next(reversed(rows))]
            last[:] = [f"{old} {more}".strip() for old, more in zip(last, cells, strict=True)]
    return rows


@pytest.mark.parametrize("name", shipped_parts())
def test_every_value_of_a_shipped_sheet_is_shown_as_it_is_written_with_its_source(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = said(capsys, "info", name)
    told, rows = " ".join(text.split()), rows_of(text)
    sheet = yaml.safe_load(shipped_parts()[name].read_text(encoding="utf-8"))
    assert told.startswith(f"{sheet['name']}: a {sheet['sheet']}, from {sheet['source']}")
    for field, source in sheet["sources"].items():
        if field not in rows:  # a list of a grid: its source is below the grid
            assert f"{field}: {source}" in told
            assert all(str(item).partition(" ")[0] in told for item in sheet[field])
            continue
        value, unit, shown_source = rows[field]
        assert shown_source == source
        if isinstance(sheet[field], list):
            assert all(str(item).partition(" ")[0] in value for item in sheet[field])
        else:
            assert f"{value} {unit}".strip() == str(sheet[field])


@pytest.mark.thorough(fast=["particles"])
@pytest.mark.parametrize("name", [*shipped_parts(), "jiang_field", *TABLES])
def test_no_line_of_a_description_exceeds_100_columns(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert max(map(len, said(capsys, "info", name).splitlines())) <= 100


def test_a_sheet_as_json_is_in_si_units(capsys: pytest.CaptureFixture[str]) -> None:
    answer = json.loads(said(capsys, "info", "cc2420", "--json"))
    assert (answer["datasheet"], answer["sheet"], answer["name"]) == ("cc2420", "radio", "CC2420")
    rate = answer["values"]["rate"]
    assert (rate["value"], rate["unit"], rate["what"]) == (250e3, "bit/s", "bit rate on the air")
    assert "SWRS041" in rate["source"]
    assert len(answer["values"]["levels"]["value"]) == len(answer["values"]["transmit"]["value"])


def test_a_file_of_ones_own_is_shown_too_and_what_it_does_not_say(capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine.yaml").write_text(
        "sheet: processor\nname: Mine\nsource: me\nrate: 1e6\nrun: 3 mW\nidle: 1 mW\nsleep: 0\nwake: 0\n"
    )
    for name in ("mine", "mine.yaml", "./mine.yaml"):
        told = " ".join(said(capsys, "info", name).split())
        assert told.startswith("Mine: a processor, from me value unit source rate 1000000 Hz the file does not say")
        assert "run 3 mW the file" in told and "energy_per_cycle - J left out" in told


def test_a_bad_sheet_is_one_message_a_fault(capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine.yaml").write_text("sheet: processor\nname: Mine\nsource: me\nrate: fast\n")
    assert main(["info", "mine"]) == 2
    errors = capsys.readouterr().err
    assert "mine.yaml:4:7: error: rate: expected frequency (for example '1 Hz'), got the text 'fast'" in errors
    assert "mine.yaml:1:1: error: run: is missing: power while computing [W]" in errors


def test_a_scenario_shows_what_its_radio_rests_on_and_what_follows(capsys: pytest.CaptureFixture[str]) -> None:
    Path("air.yaml").write_text(
        "name: air\nduration: 2 s\ndeploy: {kind: uniform, nodes: 9, cover: false}\n"
        "energy: {kind: states, radio: cc2420, processor: msp430f1611}\nlink: {kind: log_normal}\n"
        "mac: {kind: csma}\nworkload: {kind: beacons}\n"
    )
    lines = [" ".join(line.split()) for line in said(capsys, "info", "air.yaml").splitlines()]
    for line in (
        "radio.sleep 6.6e-05 W power while asleep",
        "max_backoffs 4 macMaxCSMABackoffs: attempts after the first",
        "exponent 2.4 path-loss exponent: 2 in free space",
        # 12 bytes and 17 of preamble, header and checksum at 250 kbit/s
        "packet 232 bit on the air, with a payload of 12 bytes",
        "airtime 0.000928 s of a packet with a payload of 12 bytes",
        # 55 + 24 lg d = 95
        f"reach {10 ** (40 / 24):.6g} m distance at which the mean received power equals the sensitivity",
        # 62 mW of listening and 15.3 uW of a sleeping processor
        "power dormant 0.0620153 W radio 0.062 W, processor 1.53e-05 W",
    ):
        assert line in lines, line
    answer = json.loads(said(capsys, "info", "air.yaml", "--json"))
    assert answer["mac"]["kind"] == "csma"
    assert answer["mac"]["derived"]["airtime"] == {
        "value": 928e-6, "unit": "s", "what": "of a packet with a payload of 12 bytes",
    }  # fmt: skip
    assert answer["link"]["derived"]["audible"]["value"] > answer["link"]["derived"]["reach"]["value"]
    assert answer["energy"]["values"]["radio.receive"]["value"] == 0.062


def test_the_first_order_models_show_their_crossover(capsys: pytest.CaptureFixture[str]) -> None:
    shipped = said(capsys, "info", "pso_mhpf", "--json")
    assert "crossover" not in json.loads(shipped)["energy"]["derived"]
    assert json.loads(shipped)["energy"]["values"]["amplifier"]["unit"] == "J/bit/m2"
    Path("late.yaml").write_text("extends: pso_mhpf\nenergy: {kind: first_order_2002}\n")
    derived = json.loads(said(capsys, "info", "late.yaml", "--json"))["energy"]["derived"]
    assert derived["crossover"]["value"] == pytest.approx((10e-12 / 0.0013e-12) ** 0.5)


def test_a_scenario_is_said_in_words_with_each_of_its_targets(capsys: pytest.CaptureFixture[str]) -> None:
    text = said(capsys, "info", "two_targets")
    assert (
        text.startswith("two_targets, in SI units\n  time: duration 28.04 s, step 0.04 s")
        and max(map(len, text.splitlines())) <= 100
    )
    assert text.count("  targets: bounded_velocity (") == 2 and "  tracker: pso_mhpf (" in text
    assert said(capsys, "info", "ungm_pf").rstrip().endswith("threshold 1")
    assert json.loads(said(capsys, "info", "ungm_pf", "--json"))["resolved"]["tracker"]["particles"] == 100


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("cc2402", "unknown kind, scenario, datasheet or result 'cc2402' (did you mean 'cc2420'?)"),
        ("pso_mhfp", "unknown kind, scenario, datasheet or result 'pso_mhfp' (did you mean 'pso_mhpf'?)"),
        ("a\0b", "unknown kind, scenario, datasheet or result 'a"),
    ],
)
def test_what_is_nowhere_says_so(name: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", name]) == 2
    assert message in capsys.readouterr().err


def test_a_bad_scenario_has_its_faults_told(capsys: pytest.CaptureFixture[str]) -> None:
    Path("x.yaml").write_text(yaml.safe_dump(base_scenario(link={"kind": "disk", "reach": "1 s"})))
    assert main(["info", "x.yaml"]) == 2
    assert "link.reach: 's' is a unit of time" in capsys.readouterr().err


def test_the_lists_of_datasheets_and_of_the_new_roles(capsys: pytest.CaptureFixture[str]) -> None:
    parts = json.loads(said(capsys, "list", "datasheets", "--json"))["datasheets"]
    assert parts["sa1100"]["sheet"] == "processor" and "StrongARM" in parts["sa1100"]["what"]
    assert set(parts) == set(shipped_parts())
    assert "cc2420" in said(capsys, "list", "datasheets")
    for word, kind in (
        ("faults", "clock_step"), ("packings", "frames"), ("cpus", "processor (default)"), ("clocks", "drift"),
        ("detections", "imperfect"), ("sinks", "node"), ("workloads", "beacons"), ("macs", "tdma"),
    ):  # fmt: skip
        assert f"\n  {kind} " in said(capsys, "list", word)
