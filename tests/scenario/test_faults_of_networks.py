"""The list of what goes wrong, and other lists: their kinds, their places in messages, --set, provenance."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from tests.helpers import scenario_components
from tests.helpers.scenario_components import base_scenario, faults_of, kind
from wsnsim import scenario
from wsnsim.scenario.registry import ROLES, kinds

TROUBLE = {"kind": kind("Trouble"), "at": 1}


def test_a_list_of_faults_becomes_parts_in_its_order() -> None:
    parts = scenario.build(scenario.load(base_scenario(faults=[TROUBLE, {**TROUBLE, "at": "2 s", "nodes": [1, 2]}])))
    assert parts.faults == (scenario_components.Trouble(at=1.0), scenario_components.Trouble(at=2.0, nodes=(1, 2)))


@pytest.mark.parametrize("written", [{}, {"faults": []}])
def test_no_list_is_an_empty_one(written: dict) -> None:
    loaded = scenario.load(base_scenario(**written))
    assert scenario.build(loaded).faults == ()
    assert scenario.resolved(loaded)["faults"] == []


@pytest.mark.parametrize(
    ("faults", "messages"),
    [
        (3, ["faults: error: expected a list of faults, got the number 3"]),
        ({"kind": "crash"}, ["faults: error: expected a list of faults, got a mapping"]),
        (["crash"], ["faults.0: error: expected a mapping such as {kind: crash}, got the text 'crash'"]),
        ([{"at": 3}], [
            "faults.0.kind: error: is missing; known: "
            "crash, restart, drain, blackout, link_loss, clock_step, stuck, bias",
        ]),
        ([TROUBLE, {"kind": "crush"}], ["faults.1.kind: error: unknown fault 'crush' (did you mean 'crash'?)"]),
        ([TROUBLE, {**TROUBLE, "att": 3}], ["faults.1.att: error: unknown key, did you mean 'at'?"]),
        ([TROUBLE, {"kind": kind("Trouble")}], ["faults.1.at: error: is missing: when it happens [s]"]),
        ([{**TROUBLE, "at": "1 m"}], [
            "faults.0.at: error: 'm' is a unit of length, expected time (for example '1 s')",
        ]),
        ([TROUBLE, {**TROUBLE, "at": 13}], ["faults.1: error: 13 s brings bad luck"]),
        ([TROUBLE, {**TROUBLE, "at": 4}], ["faults.1.at: error: 4 s is too late for NetworkSetup"]),
        ([TROUBLE, {**TROUBLE, "nodes": []}], ["faults.1: error: is aimed at nothing"]),
        ([TROUBLE, {**TROUBLE, "nodes": [7]}], ["deploy.nodes: error: there is no node 7"]),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_list_is_told_at_its_item(faults: object, messages: list[str]) -> None:
    assert faults_of(base_scenario(faults=faults)) == messages


def test_the_key_is_that_of_the_list() -> None:
    assert faults_of(base_scenario(fault=TROUBLE)) == ["fault: error: unknown key, did you mean 'faults'?"]


def test_a_fault_in_a_file_is_told_at_the_line_of_its_item(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(yaml.safe_dump(base_scenario()) + f"faults:\n- {{kind: '{kind('Trouble')}', at: 1}}\n"
                    f"- kind: {kind('Trouble')}\n  at: 4 s\n")  # fmt: skip
    line = len(path.read_text().splitlines())
    assert faults_of(path) == [f"{path}:{line}:7: error: faults.1.at: 4 s is too late for NetworkSetup"]


def test_set_reaches_into_the_list_of_faults() -> None:
    source = base_scenario(faults=[TROUBLE, TROUBLE])
    parts = scenario.build(scenario.load(source, ["faults.0.at=3"]))
    assert [fault.at for fault in parts.faults] == [3.0, 1.0]
    assert faults_of(source, "faults.1.at=4") == ["--set faults.1.at: error: 4 s is too late for NetworkSetup"]
    assert faults_of(source, "faults.2.at=4") == [
        "--set faults.2.at: error: faults has no item 2: it is a list of 2, counted from 0"
    ]
    assert scenario.build(scenario.load(source, ["faults=[]"])).faults == ()


def test_a_set_of_faults_is_added_to_a_shipped_scenario() -> None:
    loaded = scenario.load("pso_mhpf", ["faults=[{kind: crash, at: 3 s, fraction: 0.1}]", "faults.0.fraction=20 %"])
    (crash,) = scenario.build(loaded).faults
    assert (crash.mechanism, crash.at, crash.fraction, crash.duration) == ("crash", 3.0, 0.2, None)


def test_the_path_of_an_item_starts_from_the_folder_of_its_file(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(yaml.safe_dump(base_scenario(faults=[TROUBLE, {**TROUBLE, "path": "a.csv"}])))
    assert [fault.path for fault in scenario.load(path).faults] == ["", str(tmp_path / "a.csv")]


def test_a_list_survives_being_resolved_and_is_named_for_provenance() -> None:
    loaded = scenario.load(base_scenario(faults=[TROUBLE, {**TROUBLE, "nodes": [3]}]))
    assert scenario.load(json.loads(json.dumps(scenario.resolved(loaded)))) == loaded
    assert f"fault {kind('Trouble')}" in scenario.plugins(loaded)


def test_without_a_network_faults_act_on_sensors_or_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = base_scenario(network="none", faults=[TROUBLE])
    (found,) = faults_of(alone)
    assert found.startswith(
        "faults.0.kind: error: acts on batteries, radios, clocks or messages, and without a network"
    )
    monkeypatch.setattr(scenario_components.Trouble, "standalone", True, raising=False)
    assert len(scenario.build(scenario.load(alone)).faults) == 1


def test_what_a_motion_finds_in_itself_is_told_at_its_place_among_the_targets() -> None:
    good = {"kind": kind("Motion")}
    assert faults_of(base_scenario(motion=None, targets=[good, {"kind": kind("Motion"), "bound": 13}])) == [
        "targets.1: error: 13 m brings bad luck"
    ]
    assert faults_of(base_scenario(motion=None, targets=[good, {"kind": kind("ShyMotion")}])) == [
        "targets.1.start: error: does not like company"
    ]


def test_the_kinds_of_faults_are_those_that_the_network_performs() -> None:
    assert list(kinds("fault")) == [
        "crash", "restart", "drain", "blackout", "link_loss", "clock_step", "stuck", "bias",
    ]  # fmt: skip
    assert (ROLES["fault"].plural, ROLES["fault"].group) == ("faults", "wsnsim.faults")
