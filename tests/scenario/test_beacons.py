"""A network without a target: what may be left out, what is ignored, what is a fault."""

from __future__ import annotations

import json

import pytest

from tests.helpers import scenario_components
from tests.helpers.scenario_components import base_scenario, beacon_scenario, faults_of, kind
from wsnsim import scenario
from wsnsim.base.setups import BeaconSetup, NetworkSetup, TrackingSetup

OF_TARGETS = ("prior", "motion", "sensor", "wakeup", "clusters", "acquire", "detection", "sink", "tracker")


def test_beacons_need_no_target_and_nothing_that_follows_one() -> None:
    parts = scenario.build(scenario.load(beacon_scenario(faults=[{"kind": kind("Trouble"), "at": 2}])))
    assert type(parts) is BeaconSetup
    assert parts.workload == scenario_components.Beaconing()
    assert parts.link == scenario_components.Link(reach=75.0)
    assert parts.faults == (scenario_components.Trouble(at=2.0),)
    assert (parts.name, parts.seed, parts.steps, parts.dt) == ("small", 1, 3, 1.0)


@pytest.mark.parametrize(
    "role", ["deploy", "energy", "link", "mac", "packing", "routing", "sleep", "cpu", "clock", "workload"]
)
def test_what_the_radio_needs_is_needed_all_the_same(role: str) -> None:
    made = faults_of(beacon_scenario(**{role: None}))
    if role in ("deploy", "energy", "link"):
        assert any(fault.startswith(f"{role}: error: is missing") for fault in made)
    elif role != "workload":
        assert made == []
    else:  # without a workload, the network tracks
        assert {fault.partition(":")[0] for fault in made} == {"motion", "sensor", "tracker"}


def test_what_follows_a_target_is_checked_and_then_ignored() -> None:
    full = base_scenario(workload={"kind": kind("Beaconing")})
    parts = scenario.build(scenario.load(full))
    assert type(parts) is BeaconSetup and not hasattr(parts, "tracker")
    assert faults_of(full | {"sensor": {"kind": kind("Sensor"), "reach": -1}}) == [
        "sensor.reach: error: must be greater than 0, is -1"
    ]
    assert faults_of(full | {"motion": {"kind": kind("Motion"), "bound": 13}}) == []


def test_steps_of_beacons_are_a_second_unless_they_are_said() -> None:
    assert scenario.load(beacon_scenario()).step == 1.0
    assert scenario.load(beacon_scenario(step="0.5 s")).steps == 8
    assert scenario.load(base_scenario()).step == 0.04
    assert faults_of(beacon_scenario(duration=1.5)) == [
        "duration: error: 1.5 s is not a whole number of steps of 1 s (nearest: 2 s)"
    ]


@pytest.mark.parametrize(
    ("changes", "faults"),
    [
        ({"until": {"clusters": 3}}, ["until: error: without a target there are no clusters to end at"]),
        ({"lost": {"window": 3}}, ["lost: error: without a target there is no track that could be lost"]),
        ({"network": "none"}, [
            "workload.kind: error: a scenario without a target needs a network: remove 'network: none'",
        ]),
        ({"faults": [{"kind": kind("Trouble"), "at": 4}]}, ["faults.0.at: error: 4 s is too late for BeaconSetup"]),
        ({"workload": {"kind": "beacon"}}, None),
        ({"workload": 3}, None),
    ],
)  # fmt: skip
def test_what_makes_no_sense_without_a_target_is_a_fault(changes: dict, faults: list[str] | None) -> None:
    found = faults_of(beacon_scenario(**changes))
    if faults is None:
        assert any(
            "unknown workload 'beacon' (did you mean 'beacons'?)" in one or "got the number 3" in one for one in found
        )
    else:
        assert found == faults


def test_the_kind_is_settled_by_set_too() -> None:
    changed = scenario.load(base_scenario(), [f"workload.kind={kind('Beaconing')}"])
    assert type(scenario.build(changed)) is BeaconSetup
    back = scenario.load(base_scenario(workload={"kind": kind("Beaconing")}), ["workload.kind=tracking"])
    assert type(scenario.build(back)) is NetworkSetup


def test_a_resolved_scenario_of_beacons_loads_as_an_equal_one() -> None:
    loaded = scenario.load(beacon_scenario(step=0.5))
    written = json.dumps(scenario.resolved(loaded), allow_nan=False)
    assert scenario.load(json.loads(written)) == loaded
    assert type(scenario.build(scenario.load(json.loads(written)))) is BeaconSetup


def test_kinds_that_are_ignored_are_not_named_for_provenance() -> None:
    named = scenario.plugins(scenario.load(base_scenario(workload={"kind": kind("Beaconing")})))
    assert {name.partition(" ")[0] for name in named} == {
        "deploy", "energy", "link", "mac", "packing", "routing", "sleep", "cpu", "clock", "workload",
    }  # fmt: skip


def test_a_bench_and_a_network_have_what_is_theirs() -> None:
    bench = scenario.build(scenario.load(base_scenario(network="none")))
    assert type(bench) is TrackingSetup and not hasattr(bench, "mac")
    network = scenario.build(scenario.load(base_scenario()))
    assert type(network) is NetworkSetup and not hasattr(network, "workload")
    for role in ("packing", "cpu", "clock", "detection", "sink"):
        assert getattr(network, role) == scenario_components.Plain()


def test_beacons_with_the_parts_that_come_with_wsnsim_are_built() -> None:
    source = {
        "name": "air", "duration": "20 s", "deploy": {"kind": "uniform", "nodes": 100, "cover": False},
        "energy": {"kind": "states", "radio": "cc2420", "processor": "msp430f1611"}, "link": {"kind": "log_normal"},
        "mac": {"kind": "csma"}, "workload": {"kind": "beacons", "period": "1 s"},
    }  # fmt: skip
    parts = scenario.build(scenario.load(source))
    assert (type(parts), parts.steps, parts.workload.period) == (BeaconSetup, 19, 1.0)
    assert set(scenario.resolved(scenario.load(source))).isdisjoint({*OF_TARGETS, "lost", "until"})
