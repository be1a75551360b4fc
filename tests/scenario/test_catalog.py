"""The catalogue: its rows against the classes, plug-ins by dotted path and by entry point, the JSON Schema."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.scenario_components import base_scenario, faults_of, kind
from wsnsim import scenario
from wsnsim.base.errors import UsageError
from wsnsim.scenario.fields import part_model
from wsnsim.scenario.parameter_info import json_schema
from wsnsim.scenario.registry import ROLES, Kind, find, kinds, load_class, role_named
from wsnsim.scenario.texts import template

ROWS = [(role.name, row) for role in ROLES.values() for row in role.kinds]


@pytest.mark.thorough(fast=["deploy-jittered_grid"])
@pytest.mark.parametrize(("role", "row"), ROWS, ids=[f"{role}-{row.kind}" for role, row in ROWS])
def test_every_row_leads_to_a_part_that_can_stand_behind_its_role(role: str, row: Kind) -> None:
    model = part_model(role, row.kind)
    assert model.part is load_class(row)
    assert row.idea


@pytest.mark.thorough(fast=["fault"])
@pytest.mark.parametrize("role", ROLES)
def test_a_role_with_a_default_kind_may_be_left_out(role: str) -> None:
    default = ROLES[role].default
    if ROLES[role].optional:
        key = ROLES[role].listed
        assert getattr(scenario.load(base_scenario(**{key: None})), key) == ()
    elif ROLES[role].inner:
        assert not hasattr(scenario.load(base_scenario()), role)
    elif default is None:
        assert any(f.startswith(f"{role}: error: is missing") for f in faults_of(base_scenario(**{role: None})))
    else:
        assert getattr(scenario.load(base_scenario(**{role: None})), role).kind == default


def test_a_role_is_found_by_its_singular_and_its_plural() -> None:
    assert [role_named(word).name for word in ("tracker", "trackers", "energies", "clusters")] == [
        "tracker", "tracker", "energy", "clusters",
    ]  # fmt: skip
    with pytest.raises(UsageError, match=r"unknown role 'trakers' \(did you mean 'trackers'\?\)"):
        role_named("trakers")


def test_an_unknown_kind_names_the_nearest() -> None:
    with pytest.raises(LookupError, match=r"unknown deploy 'gird' \(did you mean 'grid'\?\)"):
        find("deploy", "gird")


@pytest.mark.parametrize(
    ("path", "fault"),
    [
        (kind("NoPart"), " is not a component: put @wsnsim.part on the class"),
        (kind("NoTracker"), " lacks 'start', 'step', 'hand_over', 'estimate', 'forecast', which every tracker needs"),
        (kind("OddField"), " has a field of type dict[str, float], which no scenario can write"),
        (kind("Nobody"), " cannot be imported: it has no class Nobody (known: "),
        ("__main__:Nobody", " cannot be imported: worker processes cannot see a notebook's classes: give workers=0"),
        (kind("base_scenario"), " is not a class"),
        ("nowhere.at_all:X", ": there is no module 'nowhere.at_all' in the working directory or on Python's path"),
        (":", " cannot be imported: ValueError: Empty module name"),
    ],
)
def test_a_class_that_cannot_be_used_says_why_in_one_line(path: str, fault: str) -> None:
    (found,) = faults_of(base_scenario(tracker={"kind": path}))
    assert found.startswith(f"tracker.kind: error: {path}{fault}")
    assert "\n" not in found


@pytest.mark.parametrize(
    ("key", "written", "said"),
    [
        ("mac", {"kind": kind("NamelessMac")}, "mac.kind: error: {} lacks 'mechanism', which every mac needs"),
        (
            "mac",
            {"kind": kind("OwnMac")},
            "mac.kind: error: {} lacks 'start', which a mac needs whose mechanism 'csmaa' is not built in "
            "(did you mean 'csma'?)",
        ),
        (
            "faults",
            [{"kind": kind("NamelessMac")}],
            "faults.0.kind: error: {} lacks 'mechanism', 'at', 'duration', 'nodes', 'fraction', 'region', 'head', "
            "which every fault needs",
        ),
    ],
)
def test_a_plug_in_without_a_member_of_its_port_is_refused_at_its_place(key: str, written: Any, said: str) -> None:
    path = (written[0] if isinstance(written, list) else written)["kind"]
    assert faults_of(base_scenario(**{key: written})) == [said.format(path)]


def test_a_plug_in_with_a_built_in_mechanism_needs_no_start() -> None:
    assert faults_of(base_scenario(mac={"kind": kind("BorrowingMac")})) == []


def test_a_module_that_fails_or_exits_when_imported_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "breaks_at_once.py").write_text("raise SystemExit('over\\nand out')\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert faults_of(base_scenario(tracker={"kind": "breaks_at_once:Tracker"})) == [
        f"tracker.kind: error: breaks_at_once:Tracker cannot be imported: {tmp_path}/breaks_at_once.py:1: "
        "SystemExit: over and out"
    ]


PLUGIN = '''
from typing import Annotated
from wsnsim.base.part import Quantity, part

@part
class Mine:
    """A tracker of another package."""
    memory: Annotated[float, Quantity("s", gt=0), "how long it remembers"] = 1.0
    def start(self, prior, scene): ...
    def step(self, belief, scene): ...
    def hand_over(self, belief, scene, successor): ...
    def estimate(self, belief): ...
    def forecast(self, belief, scene, ahead): ...
'''
ENTRY_POINTS = """
[wsnsim.trackers]
mine = mylab_trackers:Mine
broken = mylab_missing:Nothing
pso_mhpf = mylab_trackers:Mine
"""
PROBE = """
import json, sys
from wsnsim import scenario
from wsnsim.base import border
from wsnsim.base.errors import ScenarioError
from wsnsim.scenario.registry import find, kinds
from wsnsim.scenario.parameter_info import json_schema

border.checked_setup = lambda setup: setup  # the components have no behaviour
source = json.load(sys.stdin)
loaded = scenario.load(source, ["tracker.kind=mine", "tracker.memory=2 min"])
try:
    scenario.load(source, ["tracker.kind=broken"])
except ScenarioError as error:
    broken = str(error)
schema = json_schema()
print(json.dumps({
    "memory": scenario.build(loaded).tracker.memory,
    "plugins": scenario.plugins(loaded),
    "broken": broken,
    "row": kinds("tracker")["mine"]._asdict(),
    "own": find("tracker", "pso_mhpf").path,
    "schema": "Mine" in schema["$defs"],
}))
"""


@pytest.fixture
def installed(tmp_path: Path) -> dict[str, str]:
    """The environment of a process in which a package with entry points is installed."""
    (tmp_path / "mylab_trackers.py").write_text(PLUGIN)
    info = tmp_path / "mylab-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mylab\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    here = Path(__file__).resolve().parents[len(__name__.split(".")) - 1]
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(here)])}


@pytest.mark.thorough
def test_an_installed_package_adds_a_tracker(installed: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROBE], input=json.dumps(base_scenario()), env=installed, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    assert answer["memory"] == 120.0
    assert "tracker mine (mylab 1.2)" in answer["plugins"]
    assert answer["row"]["idea"] == "plug-in of mylab 1.2"
    assert answer["own"] == "wsnsim.trackers.pso_mhpf:PsoMhpf"
    assert answer["schema"] is True
    assert answer["broken"] == (
        "--set tracker.kind: error: 'broken' (mylab_missing:Nothing) cannot be imported: "
        "ModuleNotFoundError: No module named 'mylab_missing'"
    )


@pytest.mark.thorough
def test_the_schema_knows_every_kind_with_its_fields_and_units() -> None:
    schema = json.loads(json.dumps(json_schema(), allow_nan=False))
    disk = schema["$defs"]["Disk"]
    assert disk["additionalProperties"] is False
    assert disk["properties"]["kind"]["const"] == "disk"
    assert disk["properties"]["reach"]["description"].endswith("[m]")
    number, text = disk["properties"]["reach"]["anyOf"]
    assert (number["type"], number["minimum"], text["type"]) == ("number", 1e-3, "string")
    places = [(role.name, key, key == role.listed) for role in ROLES.values() for key in role.keys]
    assert ("motion", "targets", True) in places and ("fault", "faults", True) in places
    for role, key, several in places:
        place = schema["properties"][key]["items"] if several else schema["properties"][key]
        names = [choice["$ref"].rpartition("/")[2] for choice in place.get("anyOf", [place])]
        assert {schema["$defs"][name]["properties"]["kind"]["const"] for name in names} == set(kinds(role))


@pytest.mark.thorough
def test_the_schema_demands_keys_only_of_files_that_extend_nothing() -> None:
    schema = json_schema()
    assert "required" not in schema
    assert schema["if"] == {"required": ["extends"]}
    demanded = schema["else"]
    assert {"name", "duration"} == set(demanded["required"])
    network, targets = demanded["allOf"]
    assert network["if"]["properties"]["network"] == {"const": "none"}
    assert {"deploy", "energy", "link"} == set(network["else"]["required"])
    assert targets["if"]["properties"]["workload"]["properties"]["kind"] == {"enum": ["beacons", "collection"]}
    assert {"sensor", "tracker"} == set(targets["else"]["required"])
    assert targets["else"]["oneOf"] == [{"required": ["motion"]}, {"required": ["targets"]}]
    kinds_of_deploy = {
        one["properties"]["kind"]["const"]: one["required"] for one in demanded["properties"]["deploy"]["anyOf"]
    }
    assert kinds_of_deploy["file"] == ["kind", "path"]


@pytest.mark.thorough
def test_the_schema_takes_a_data_sheet_by_its_name_or_by_its_fields() -> None:
    schema = json_schema()
    fields, name = schema["$defs"]["States"]["properties"]["radio"]["anyOf"]
    assert name["type"] == "string"
    sheet = schema["$defs"][fields["$ref"].rpartition("/")[2]]
    assert sheet["additionalProperties"] is False
    assert sheet["properties"]["sleep"]["description"].endswith("[W]")


@pytest.mark.parametrize(
    "lines",
    [
        "mac: {kind: xmac}",
        "link: {kind: disk}",
        "sensor: {kind: bearing, sd: 2 deg, reach: 60 m}",
        "tracker: {kind: ukf}",
    ],
)
def test_what_a_new_scenario_mentions_is_good_too(tmp_path: Path, lines: str) -> None:
    key, _, value = lines.partition(": ")
    text = template("fresh")
    mentioned = value if key == "sensor" else value.removeprefix("{kind: ").removesuffix("}")
    assert mentioned in text
    path = tmp_path / "fresh.yaml"
    path.write_text(text)
    assert faults_of(path, f"{key}={value}") == []


@pytest.mark.parametrize("bench", [False, True])
def test_a_new_scenario_is_a_good_one(tmp_path: Path, bench: bool) -> None:
    path = tmp_path / "fresh.yaml"
    path.write_text(template("fresh", bench))
    assert faults_of(path) == []
    assert scenario.load(path).name == "fresh"


@pytest.mark.thorough(fast=["beacons"])
@pytest.mark.parametrize("path", scenario.shipped().values(), ids=scenario.shipped())
def test_every_shipped_scenario_that_names_itself_is_a_good_one(path: Path) -> None:
    faults = faults_of(path)
    if "\nname:" in path.read_text(encoding="utf-8"):
        assert faults == []
        assert scenario.load(path).name == path.stem
    else:
        assert {fault.partition(": error: ")[2].partition(":")[0] for fault in faults} == {"name", "tracker"}
