"""Without a network, sensors report what they report in one with the same seed: detection and faults act there, too."""

import copy
from typing import Any

import numpy as np
import pytest

from wsnsim import experiment, scenario
from wsnsim.base.errors import ScenarioError
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.rng import Streams
from wsnsim.base.tables import Memory
from wsnsim.network.imperfect_readings import StandaloneReports
from wsnsim.offline.batch import Batches

STANDALONE: dict[str, Any] = {
    "name": "missed", "seed": 1, "duration": "10 s", "step": "0.5 s", "network": "none",
    "deploy": {"kind": "anchors", "places": [[100, 0], [0, 100], [-80, -60], [60, 80]]},
    "motion": {"kind": "constant_velocity", "start": [0, 1, 0, 0.5], "variances": [0.05]},
    "prior": {"sd": [1, 1, 1, 1]},
    "sensor": {"kind": "range", "sd": "1 m", "reach": "110 m"},
    "tracker": {"kind": "ekf"},
}  # fmt: skip
NETWORK = {
    "network": None, "energy": {"kind": "first_order"}, "link": {"kind": "disk", "reach": "400 m"},
    "mac": {"kind": "ideal"}, "clusters": {"kind": "central"},
}  # fmt: skip
CASES: dict[str, dict[str, Any]] = {
    "missed": {"detection": {"kind": "imperfect", "missed": 0.6}},
    "false alarms": {
        "sensor": {"kind": "range", "reach": "95 m"},
        "detection": {"kind": "imperfect", "false_alarm": 0.3},
    },
    "biased and stuck sensors": {"detection": {"kind": "imperfect", "bias_sd": 50, "stuck": 0.3, "stuck_at": 7}},
    "stuck at a value": {"faults": [{"kind": "stuck", "at": "2 s", "nodes": [0, 1], "value": 7}]},
    "stuck at the last": {"faults": [{"kind": "stuck", "at": "2 s", "duration": "3 s", "fraction": 0.5}]},
    "bias": {"faults": [{"kind": "bias", "at": "0 s", "duration": "4 s", "region": [0, 100, 70], "offset": 9}]},
    "crash": {"faults": [{"kind": "crash", "at": "2 s", "duration": "3 s", "nodes": [1, 3]}]},
    "restart": {"faults": [{"kind": "restart", "at": "4 s", "duration": "1 s", "nodes": [3]}]},
    "restart in a crash while stuck": {
        "faults": [
            {"kind": "crash", "at": "2 s", "nodes": [1, 3]},
            {"kind": "stuck", "at": "3 s", "nodes": [1, 3]},
            {"kind": "restart", "at": "4.2 s", "duration": "1 s", "nodes": [3]},
        ]
    },
    "two targets": {
        "motion": None,
        "targets": [STANDALONE["motion"], STANDALONE["motion"] | {"start": [50, -1, 0, 1]}],
        "detection": {"kind": "imperfect", "missed": 0.4, "bias_sd": 3},
        "faults": [{"kind": "stuck", "at": "2 s", "fraction": 0.5}],
    },
    "a range and a bearing": {
        "sensor": {"kind": "range_bearing", "reach": "110 m"},
        "detection": {"kind": "imperfect", "missed": 0.4},
        "faults": [{"kind": "bias", "at": "2 s", "fraction": 0.5, "offset": 9, "component": "range"}],
    },
}


def source(*changes: dict[str, Any]) -> dict[str, Any]:
    values = copy.deepcopy(STANDALONE) | {key: value for change in changes for key, value in change.items()}
    return {key: value for key, value in values.items() if value is not None}


def readings_of(*changes: dict[str, Any]) -> list[tuple[float, ...]]:
    memory = Memory({"readings": True})
    experiment.simulate_run(source({"record": {"readings": True}}, *changes), 1, memory)
    table = memory.table("readings")
    return sorted(zip(*(table[name].tolist() for name in table), strict=True))


@pytest.mark.thorough(fast=["missed", "restart in a crash while stuck", "a range and a bearing"])
@pytest.mark.parametrize("case", CASES)
def test_readings_are_those_of_the_network_run(case: str) -> None:
    change = CASES[case]
    perfect = {key: value for key, value in change.items() if key not in ("detection", "faults")}
    alone = readings_of(change)
    assert alone and alone != readings_of(perfect)
    assert alone == readings_of(change, NETWORK)


def test_reports_do_not_depend_on_how_many_steps_are_asked_for_at_once() -> None:
    setup = scenario.build(scenario.load(source(CASES["two targets"])))
    conditions = sample_initial_conditions(setup, 0)
    whole, each = (StandaloneReports(setup, conditions, Streams(1, 0), 1) for _ in range(2))
    one_by_one = np.concatenate([each(step, 1) for step in range(20)])
    np.testing.assert_array_equal(whole(0, 100), one_by_one)
    assert len(one_by_one) == 20 and len(each(20, 5)) == 0


@pytest.mark.parametrize("case", ["missed", "restart in a crash while stuck", "two targets"])
def test_the_batch_of_such_runs_has_the_bits_of_single_runs(case: str) -> None:
    setup = scenario.build(scenario.load(source(CASES[case])))
    batch, single = (Memory(dict.fromkeys(("tracks", "estimates"), True)) for _ in range(2))
    batches = Batches(setup, batch, StandaloneReports)
    assert len(batches.next([3])) + len(batches.next([0, 1])) == 3
    for replicate in (3, 0, 1):
        experiment.replicate_of(setup, replicate, single)
    for table in ("tracks", "estimates"):
        one, other = batch.table(table), single.table(table)
        assert [name for name in one if not np.array_equal(one[name], other[name], equal_nan=True)] == []


@pytest.mark.parametrize(
    ("fault", "path", "words"),
    [
        ({"kind": "drain", "nodes": [0], "joules": 1}, "faults.0.kind", "crash, restart, stuck, bias"),
        ({"kind": "blackout", "nodes": [0]}, "faults.0.kind", "without a network there are sensors alone"),
        ({"kind": "link_loss", "nodes": [0], "loss": 0.5}, "faults.0.kind", "without a network there are sensors"),
        ({"kind": "clock_step", "nodes": [0], "offset": 1}, "faults.0.kind", "without a network there are sensors"),
        ({"kind": "crash", "head": 0}, "faults.0.head", "no cluster head in a scenario without a network"),
    ],
)
def test_a_fault_that_needs_a_network_is_refused_with_the_reason(fault: dict[str, Any], path: str, words: str) -> None:
    with pytest.raises(ScenarioError) as raised:
        scenario.build(scenario.load(source({"faults": [fault | {"at": 1}]})))
    (issue,) = raised.value.issues
    assert str(issue).startswith(f"{path}: error: ") and words in issue.message
