"""From a scenario to parts, and back to plain values."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
import yaml

from tests.helpers import scenario_components
from tests.helpers.scenario_components import base_scenario, faults_of, kind
from wsnsim import scenario
from wsnsim.base.tables import RECORDED_BY_DEFAULT


def test_parts_are_the_classes_of_the_kinds_with_the_values_of_the_scenario() -> None:
    parts = scenario.build(scenario.load(base_scenario(seed=5, link={"kind": kind("Link"), "reach": "80 m"})))
    assert (parts.name, parts.seed, parts.steps, parts.dt) == ("small", 5, 99, 0.04)
    assert parts.link == scenario_components.Link(reach=80.0)
    assert parts.motions == (scenario_components.Motion(),)
    assert parts.until_clusters is None
    assert parts.record == RECORDED_BY_DEFAULT


@pytest.mark.parametrize(
    "tracker",
    [
        {"gains": "unknown", "inflate": True, "filter_noise_scale": 100},
        {"assumes": {"gains": "unknown", "inflate": True, "noise_scale": 100}},
        {"gains": "unknown", "assumes": {"inflate": True, "noise_scale": 100.0}},
    ],
)
def test_the_filter_is_told_what_the_tracker_assumes(tracker: dict) -> None:
    loaded = scenario.load(base_scenario(tracker={"kind": kind("Tracker"), **tracker}))
    parts = scenario.build(loaded)
    assert parts.filter_sensor == (parts.sensor, "unknown", True)
    assert parts.filter_motions == ((parts.motions[0], 100.0),)
    assert scenario.resolved(loaded)["tracker"]["assumes"] == {
        "gains": "unknown",
        "inflate": True,
        "noise_scale": 100.0,
    }


def test_a_tracker_may_have_a_field_of_its_own_that_is_called_like_a_short_form() -> None:
    parts = scenario.build(scenario.load(base_scenario(tracker={"kind": kind("GainTracker"), "gains": 7})))
    assert parts.tracker == scenario_components.GainTracker(gains=7.0)
    assert parts.filter_sensor == (parts.sensor, "known", False)


def test_what_parts_find_in_one_another_is_told_at_its_place(tmp_path: Path) -> None:
    text = yaml.safe_dump(base_scenario(deploy={"kind": kind("Deploy"), "nodes": 1}), sort_keys=False)
    path = tmp_path / "few.yaml"
    path.write_text(text)
    rows = {key: 1 + text.splitlines().index(f"{key}:") for key in ("deploy", "clusters")}
    assert faults_of(path) == [
        f"{path}:{rows['deploy'] + 2}:10: error: deploy.nodes: 1 nodes cannot form a cluster",
        f"{path}:{rows['clusters'] + 1}:3: error: clusters.minimum_active: more members than nodes",
    ]


def test_what_a_class_refuses_of_a_key_is_told_at_the_key(tmp_path: Path) -> None:
    path = tmp_path / "chain.yaml"
    path.write_text("extends: jiang_field\ntracker:\n  kind: imm\n  transition: [[0.9, 0.2], [0, 1]]\n")
    assert faults_of(path) == [f"{path}:4:15: error: tracker.transition: row 0 must add up to 1, adds up to 1.1"]


def test_what_a_class_refuses_is_told_at_its_role() -> None:
    assert faults_of(base_scenario(motion={"kind": kind("Motion"), "bound": 13})) == [
        "motion: error: 13 m brings bad luck"
    ]


def test_targets_share_their_state_columns() -> None:
    targets = [{"kind": kind("Motion")}, {"kind": kind("FlatMotion")}]
    assert faults_of(base_scenario(motion=None, targets=targets)) == [
        "targets.1: error: its state is (x), the first target's (px vx py vy): all must have the same"
    ]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"until": {"clusters": 16}},
        {"energy": {"kind": kind("Energy"), "battery": math.inf}},
        {"motion": None, "targets": [{"kind": kind("Motion"), "bound": 50}, {"kind": kind("Motion")}]},
        {"tracker": {"kind": kind("Tracker"), "gains": "unknown"}},
        {"record": {"particles": True, "events": False}},
    ],
)
def test_a_resolved_scenario_is_json_and_loads_as_an_equal_one(changes: dict) -> None:
    loaded = scenario.load(base_scenario(**changes))
    written = json.dumps(scenario.resolved(loaded), allow_nan=False)
    again = scenario.load(json.loads(written))
    assert again == loaded
    assert json.dumps(scenario.resolved(again)) == written


def test_kinds_from_outside_are_named_for_provenance() -> None:
    named = scenario.plugins(scenario.load(base_scenario()))
    assert f"tracker {kind('Tracker')}" in named
    assert len(named) == 19


@pytest.mark.parametrize(("deploy", "reach", "limit"), [
    ({"kind": "uniform", "width": "50 m", "height": "30 m"}, "400 m", 3400.0**0.5 / 3.0),
    ({"kind": "uniform", "width": "10 m", "height": "10 m"}, ".inf", 200.0**0.5 / 3.0),
    ({"kind": "uniform", "width": "50 m", "height": "30 m"}, "150 m", 50.0),
    ({"kind": "uniform", "width": "50 m", "height": "30 m"}, ".inf", 20.0),
    ({"kind": "anchors", "places": [[0, 0], [9, 0]]}, "400 m", 400.0 / 3.0),
])  # fmt: skip
def test_errors_that_the_field_can_hardly_hold_are_no_limit_of_a_lost_track(deploy, reach, limit) -> None:
    values = {"name": "x", "duration": 3, "step": 1, "network": "none", "deploy": {**deploy, "cover": False}}
    values |= {"motion": {"kind": "constant_velocity"}, "tracker": {"kind": "ekf"}}
    values |= {"sensor": {"kind": "range", "reach": reach}}
    assert scenario.build(scenario.load(values)).lost_limit == pytest.approx(limit)
    assert scenario.build(scenario.load({**values, "lost": {"limit": 99}})).lost_limit == 99.0
