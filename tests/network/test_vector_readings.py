"""Readings of several components, and angles: sensing, faults, elections, files, track initiation, recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wsnsim
from wsnsim.base.errors import ScenarioError
from wsnsim.base.tables import Memory
from wsnsim.cli import main
from wsnsim.models.bearing import TURN, Bearing

RADIO = {"energy": {"kind": "first_order"}, "link": {"kind": "disk", "reach": "50 m"}}
KEYS = ["step", "node", "component"]


def scenario(network: bool = True, sensor: str = "range_bearing", **other: Any) -> dict[str, Any]:
    """Twelve anchors around a walking target."""
    made = {
        "name": "bearings", "seed": 3, "duration": "20 s", "step": "1 s", "record": {"readings": True},
        "prior": {"sd": [1, 0.5, 1, 0.5]},
        "deploy": {"kind": "anchors", "places": [[x, y] for x in (0, 7, 14, 21) for y in (0, 9, 18)]},
        "motion": {"kind": "waypoints", "q": 0.05, "points": [[0, 2, 2], [10, 18, 4], [20, 16, 16]]},
        "sensor": {"kind": sensor, "reach": "20 m"}, "tracker": {"kind": "ekf"}, "acquire": {}, "detection": {},
        "clusters": {},
    }  # fmt: skip
    for name in () if network else ("acquire", "detection", "clusters"):
        made.pop(name)
    return {**made, **(RADIO if network else {"network": "none"}), **other}


def simulated(made: dict[str, Any], replicate: int = 0) -> tuple[Memory, Any]:
    memory = Memory({"readings": True, "estimates": True, "events": True, "clusters": True})
    return memory, wsnsim.experiment.simulate_run(wsnsim.load(made), replicate, memory)


def values(memory: Memory) -> dict[tuple[int, int, int], float]:
    """{(step, node, component): number} of the table `readings`."""
    table = memory.table("readings")
    components = table.get("component", np.zeros(len(table["step"]), dtype=int))
    keys = zip(table["step"].tolist(), table["node"].tolist(), components.tolist(), strict=True)
    return dict(zip(keys, table["reading"].tolist(), strict=True))


@pytest.mark.thorough
@pytest.mark.parametrize("sensor", ["bearing", "range_bearing"])
def test_readings_are_the_same_with_a_network_and_without_one_and_the_target_is_tracked(sensor: str) -> None:
    memory, summary = simulated(scenario(sensor=sensor))
    alone, offline = simulated(scenario(network=False, sensor=sensor))
    found, expected = values(memory), values(alone)
    assert found and found == {key: expected[key] for key in found}
    assert {component for _, _, component in found} == ({0} if sensor == "bearing" else {0, 1})
    assert summary.run["rmse"] < 1.0 and offline.run["rmse"] < 1.0
    readings, estimates = memory.table("readings"), memory.table("estimates")
    sensing = {step: len(set(readings["node"][readings["step"] == step])) for step in range(1, 21)}
    assert all(count <= sensing[step] for step, count in zip(estimates["step"], estimates["readings"], strict=True))
    counted = 1 if sensor == "bearing" else 2
    assert (estimates["nis_dof"] == counted * estimates["readings"]).all()


@pytest.mark.thorough
def test_every_reading_is_one_packet_whatever_its_components() -> None:
    packets = []
    for sensor in ("bearing", "range_bearing"):
        memory, summary = simulated(scenario(sensor=sensor))
        packets.append((summary.run["packets_sent"], len({key[:2] for key in values(memory)})))
    assert packets[0] == packets[1]


@pytest.mark.thorough
@pytest.mark.parametrize("which", ["range", "bearing"])
def test_a_bias_hits_the_component_that_is_named_from_its_time_on(which: str) -> None:
    fault = {"kind": "bias", "offset": 0.7, "nodes": [4], "at": "5.5 s", "duration": "3 s", "component": which}
    place = ("range", "bearing").index(which)
    healthy, hit = (values(simulated(scenario(**more))[0]) for more in ({}, {"faults": [fault]}))
    for (step, node, component), value in hit.items():
        expected = 0.7 if node == 4 and 6 <= step <= 8 and component == place else 0.0
        assert value == pytest.approx(healthy[step, node, component] + expected, abs=1e-12)


@pytest.mark.thorough
def test_a_reading_freezes_as_a_whole_or_in_the_component_that_is_named() -> None:
    healthy = values(simulated(scenario())[0])
    for which, places in (("", {0, 1}), ("bearing", {1})):
        fault = {"kind": "stuck", "nodes": [4], "at": "5.5 s", "component": which}
        for (step, node, component), value in values(simulated(scenario(faults=[fault]))[0]).items():
            frozen = node == 4 and step > 5 and component in places
            assert value == healthy[5 if frozen else step, node, component]


def test_a_fault_names_a_component_that_readings_have() -> None:
    fault = {"kind": "bias", "offset": 0.7, "nodes": [4], "at": "5 s"}
    for component, message in (("", r"components range, bearing: name the one"), ("azimut", r"unknown component 'azi")):
        made = scenario(faults=[{**fault, "component": component}])
        with pytest.raises(ScenarioError, match=message):
            wsnsim.scenario.build(wsnsim.load(made))
    wsnsim.scenario.build(wsnsim.load(scenario(sensor="bearing", faults=[fault])))


@pytest.mark.thorough
def test_missed_readings_are_whole_ones_and_false_alarms_and_biases_have_all_components() -> None:
    healthy = values(simulated(scenario())[0])
    missed = values(simulated(scenario(detection={"kind": "imperfect", "missed": 0.4}))[0])
    assert 0 < len(missed) < 0.8 * len(healthy) and all(healthy[key] == value for key, value in missed.items())
    alarmed = values(simulated(scenario(detection={"kind": "imperfect", "false_alarm": 0.3}))[0])
    assert len(alarmed) > len(healthy)
    for found in (missed, alarmed):
        assert {key for key in found if key[2] == 0} == {(step, node, 0) for step, node, _ in found}
    biased = values(simulated(scenario(detection={"kind": "imperfect", "bias_sd": 0.5}))[0])
    offsets = {key[1:]: set() for key in biased}
    for key, value in biased.items():
        offsets[key[1:]].add(round(value - healthy[key], 9))
    assert all(len(each) == 1 for each in offsets.values()), "a node's error of calibration is constant"
    each = np.array([[*offsets[node, 0], *offsets[node, 1]] for node in range(12)])
    assert np.abs(each).min() > 0.0 and abs(np.corrcoef(each.T)[0, 1]) < 0.8


@pytest.mark.thorough
def test_an_election_takes_equal_bearings_for_equal_and_the_shortest_range() -> None:
    for sensor, nearest in (("bearing", False), ("range_bearing", True)):
        memory, _ = simulated(scenario(sensor=sensor, prior={"sd": [1, 0.5, 1, 0.5]}))
        head = memory.table("clusters")["head"][0]
        first = {node: value for (step, node, component), value in values(memory).items() if step == component == 0}
        assert head == (min(first, key=first.__getitem__) if nearest else min(first))


@pytest.mark.thorough
@pytest.mark.parametrize("sensor", ["bearing", "range_bearing"])
def test_heads_that_move_search_with_them_and_follow_the_target(sensor: str) -> None:
    clusters = {"kind": "moving_head", "main": "detection", "sampling": 0.01, "quiet": 0.1, "cap": 0.3, "patience": 3}
    _, summary = simulated(scenario(sensor=sensor, clusters=clusters))
    assert summary.run["tracked"] > 0.9 and summary.run["rmse"] < 2.0


def test_a_file_has_a_row_for_each_component_and_diff_names_the_one_that_differs(tmp_path: Path, capsys: Any) -> None:
    fault = {"kind": "bias", "offset": 0.5, "nodes": [4], "at": "5.5 s", "component": "bearing"}
    for name, more in (("a", {}), ("b", {"faults": [fault]})):
        wsnsim.run(wsnsim.load(scenario(duration="7 s", **more)), replicates=1, out=tmp_path / f"{name}.h5")
    table = wsnsim.read(tmp_path / "a.h5", "readings")
    assert list(table) == ["replicate", "target", "step", "time", "node", "component", "reading"]
    assert not table.duplicated(["replicate", "target", *KEYS]).any()
    assert main(["diff", str(tmp_path / "a.h5"), str(tmp_path / "b.h5")]) == 1
    assert "first differing reading: step 6, node 4, target 0, component 1: A " in capsys.readouterr().out
    wsnsim.run(wsnsim.load(scenario(sensor="bearing", duration="2 s")), replicates=1, out=tmp_path / "c.h5")
    assert "component" not in wsnsim.read(tmp_path / "c.h5", "readings")


@pytest.mark.thorough
def test_runs_without_a_network_are_made_one_by_one_or_at_once_with_the_same_rows(tmp_path: Path) -> None:
    for sensor, engine in (("bearing", "batch"), ("range_bearing", "composed")):
        made = scenario(network=False, sensor=sensor, record={}, tracker={"kind": "pf", "particles": 100})
        report = wsnsim.experiment.run(wsnsim.load(made), replicates=3, out=tmp_path / f"{sensor}.h5")
        single = [wsnsim.experiment.simulate_run(wsnsim.load(made), run).run["fingerprint"] for run in range(3)]
        assert [one.run["fingerprint"] for one in report.summaries] == single
        assert wsnsim.recording.read_json(report.out, "provenance_json")["engine"] == engine


def recorded(folder: Path, turns: bool) -> dict[str, Any]:
    """Bearings of the walking target in a file; with `turns`, some of them have a turn more or less."""
    made = scenario(network=False, sensor="bearing")
    found = values(simulated(made)[0])
    rng, lines = np.random.default_rng(1), ["time,node,reading"]
    for (step, node, _), value in sorted(found.items()):
        for part in (0.2, 0.1):  # two rows of the same node in each step
            shift = TURN * rng.integers(-1, 1) if turns and value > 0.0 else 0.0
            lines.append(f"{max(step - part, 0.0) if step else 0.0},{node},{float(value + shift)!r}")
            if not step:
                break
    path = folder / f"bearings_{turns}.csv"
    path.write_text("\n".join(lines) + "\n")
    law = {"kind": "bearing", "reach": "20 m"}
    return made | {"sensor": {"kind": "recorded", "path": str(path), "time_origin": 0.0, "law": law}}


def test_recorded_bearings_may_have_whole_turns_and_their_mean_is_that_of_near_ones(tmp_path: Path) -> None:
    runs = [simulated(recorded(tmp_path, turns))[0].table("estimates")["error"] for turns in (False, True)]
    np.testing.assert_allclose(runs[0], runs[1], atol=1e-9)
    assert runs[0].max() < 2.0


def test_readings_of_several_components_cannot_be_recorded(tmp_path: Path) -> None:
    made = recorded(tmp_path, False)
    made["sensor"]["law"] = {"kind": "range_bearing", "reach": "20 m"}
    with pytest.raises(ScenarioError, match=r"one number in a row, and a reading of this law has 2: range, bearing"):
        wsnsim.scenario.build(wsnsim.load(made))


@pytest.mark.thorough
def test_a_head_knows_the_headings_of_its_nodes() -> None:
    own = {"kind": "bearing", "reach": "20 m", "heading": "own"}
    memory, summary = simulated(scenario() | {"sensor": own})
    common, _ = simulated(scenario() | {"sensor": {"kind": "bearing", "reach": "20 m"}})
    assert summary.run["rmse"] < 1.0 and Bearing(heading="own").trait_names == ("heading",)
    assert values(memory) != values(common)
