"""Runs on recorded readings: what reaches the filter, in and out of a network, and what a scenario may not change."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import wsnsim
from wsnsim import bounds, scenario
from wsnsim.analysis import notes, summary
from wsnsim.analysis.result_info import info_text
from wsnsim.base.errors import RunError, ScenarioError
from wsnsim.base.files import file_digest
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.tables import Memory
from wsnsim.experiment import load, replicate_of
from wsnsim.recording import read_json
from wsnsim.scenario import build
from wsnsim.scenario.sweep import load_sweep

STEPS, DT = 20, 0.5
PLACES = {"east": (10.0, 0.0), "north": (0.0, 10.0), "west": (-10.0, 0.0), "south": (0.0, -10.0)}


def distances(step: int) -> dict[str, float]:
    """The distance of a target that moves along x at 0.4 m/s from each node."""
    x = 0.2 * step - 2.0
    return {name: float(np.hypot(x - place[0], 1.0 - place[1])) for name, place in PLACES.items()}


def world(folder: Path, silent: set[tuple[int, str]] | None = None, **changed: float) -> dict[str, Any]:
    """A scenario on files in this folder. `changed`: readings as STEP_NAME=value; `silent`: those that are missing."""
    rows = ["time,node,reading"]
    for step in range(1, STEPS + 1):
        for name, distance in distances(step).items():
            if (step, name) not in (silent or set()):
                rows.append(f"{step * DT},{name},{changed.get(f's{step}_{name}', distance)}")
    (folder / "readings.csv").write_text("\n".join(rows))
    (folder / "track.csv").write_text("time,x,y\n0,-2,1\n10,2,1\n")
    (folder / "nodes.csv").write_text("id,x,y\n" + "".join(f"{n},{x},{y}\n" for n, (x, y) in PLACES.items()))
    return {
        "name": "recorded", "network": "none", "seed": 1, "duration": (STEPS + 1) * DT, "step": DT,
        "prior": {"sd": [0.5, 0.2, 0.5, 0.2]},
        "deploy": {"kind": "file", "path": str(folder / "nodes.csv"), "width": 40, "height": 40, "cover": False},
        "motion": {"kind": "recorded_track", "path": str(folder / "track.csv"), "q": 0.01},
        "sensor": {
            "kind": "recorded", "path": str(folder / "readings.csv"), "time_origin": 0.0,
            "law": {"kind": "range", "sd": 0.1, "reach": 5},
        },
        "tracker": {"kind": "ekf"},
    }  # fmt: skip


def network_world(folder: Path, **keys: Any) -> dict[str, Any]:
    """The same in a network."""
    data = world(folder, **keys)
    del data["network"]
    data["motion"]["time_origin"] = 0.0
    data["sensor"]["law"]["reach"] = 100
    return data | {
        "energy": {"kind": "first_order", "battery": 10},
        "link": {"kind": "disk", "reach": 100},
        "clusters": {"kind": "central"},
        "acquire": {"kind": "readings"},
        "detection": {"kind": "perfect"},
    }


def estimates(data: Any, table: str = "estimates", replicate: int = 0) -> dict[str, Any]:
    """A table of one run, composed step by step."""
    memory = Memory()
    replicate_of(build(load(data)), replicate, memory)
    return memory.table(table)


def first_difference(one: dict[str, Any], other: dict[str, Any]) -> int:
    """The first step at which the estimates differ; 0: none does."""
    differing = (one["px"] != other["px"]) | (one["py"] != other["py"])
    return int(one["step"][differing][0]) if differing.any() else 0


def test_the_filter_sees_the_rows_of_the_file_and_no_sample(tmp_path: Path) -> None:
    """Readings without noise: the estimate comes to the track; another seed changes the prior alone."""
    found = estimates(world(tmp_path))
    assert found["readings"].tolist() == [4] * STEPS
    assert found["error"][-1] < 0.05
    bias = {f"s{step}_east": distances(step)["east"] + 1.0 for step in range(1, STEPS + 1)}
    assert estimates(world(tmp_path, **bias))["error"][-1] > 0.2


@pytest.mark.thorough
@pytest.mark.parametrize("make", [world, network_world])
def test_one_changed_reading_changes_the_estimates_from_its_step_on(tmp_path: Path, make: Any) -> None:
    before, after = estimates(make(tmp_path)), estimates(make(tmp_path, s8_north=9.5))
    assert first_difference(before, after) == 8


@pytest.mark.parametrize("make", [world, network_world])
def test_a_gap_is_silence_wherever_the_target_is(tmp_path: Path, make: Any) -> None:
    """The law's sensing range of 5 m would have none of the readings."""
    found = estimates(make(tmp_path, silent={(8, "north"), (9, "north"), (9, "east")}))
    assert found["readings"].tolist() == [4] * 7 + [3, 2] + [4] * 11


@pytest.mark.thorough
def test_a_node_that_crashed_or_sleeps_does_not_measure(tmp_path: Path) -> None:
    crashed = network_world(tmp_path) | {"faults": [{"kind": "crash", "at": 5.0, "nodes": [3]}]}
    assert estimates(crashed)["readings"].tolist() == [4] * 9 + [3] * 11
    asleep = network_world(tmp_path) | {"sleep": {"kind": "duty_cycle", "period": 4.0, "awake_share": 0.25}}
    assert 0 < estimates(asleep)["readings"].sum() < 4 * STEPS


def test_a_node_out_of_radio_range_of_the_head_is_not_heard(tmp_path: Path) -> None:
    data = network_world(tmp_path) | {"clusters": {"kind": "central", "x": 10.0, "y": 0.0}}
    near = estimates(data | {"link": {"kind": "disk", "reach": 14.5}, "routing": {"kind": "minimum_hop"}})
    assert set(near["readings"].tolist()) <= {3, 4}


@pytest.mark.thorough
def test_a_sensor_fault_changes_what_was_recorded(tmp_path: Path) -> None:
    data = network_world(tmp_path)
    biased = data | {"faults": [{"kind": "bias", "at": 5.0, "nodes": [1], "offset": 2.0}]}
    assert first_difference(estimates(data), estimates(biased)) == 10


@pytest.mark.thorough
def test_many_runs_at_once_give_the_same_as_one_by_one(tmp_path: Path) -> None:
    data = world(tmp_path)
    for batch in (True, False):
        wsnsim.run(data, replicates=3, out=tmp_path / f"{batch}.h5", batch=batch)
    one, other = (wsnsim.read(tmp_path / f"{batch}.h5", "estimates") for batch in (True, False))
    assert one.equals(other) and one["px"].nunique() > STEPS


def test_two_targets_have_readings_of_their_own(tmp_path: Path) -> None:
    data = world(tmp_path)
    rows = (tmp_path / "readings.csv").read_text().splitlines()
    both = [rows[0] + ",target", *(row + ",0" for row in rows[1:]), *(row + ",1" for row in rows[1:9])]
    (tmp_path / "readings.csv").write_text("\n".join(both))
    motion = data.pop("motion")
    found = estimates(data | {"targets": [motion, motion]})
    counts = [found["readings"][found["target"] == target].tolist() for target in (0, 1)]
    assert counts == [[4] * STEPS, [4, 4] + [0] * (STEPS - 2)]


@pytest.mark.parametrize("make", [world, network_world])
def test_sampled_readings_have_the_heights_of_nodes_and_of_a_recorded_track(tmp_path: Path, make: Any) -> None:
    data = make(tmp_path)
    (tmp_path / "track.csv").write_text("time,x,y,z\n0,-2,1,0\n10,2,1,2\n")
    nodes = [f"{name},{x},{y},3" for name, (x, y) in PLACES.items()]
    (tmp_path / "nodes.csv").write_text("\n".join(["id,x,y,z", *nodes]))
    law = {"kind": "rssi", "z0": -40, "eta": 2, "d0": 1, "sd": 1e-6, "target_height": 1.0, "reach": 100}
    data |= {"sensor": law, "record": {"readings": True}}
    memory = Memory({"readings": True})
    replicate_of(build(load(data)), 0, memory)
    found = memory.table("readings")
    places = np.array(list(PLACES.values()))[found["node"]]
    part = found["step"] / STEPS
    apart = np.column_stack([-2 + 4 * part - places[:, 0], 1 - places[:, 1], 2 * part - 3])
    expected = -40 - 20 * np.log10(np.linalg.norm(apart, axis=1))
    assert len(expected) >= 4 * STEPS and np.abs(found["reading"] - expected).max() < 1e-4


@pytest.mark.thorough
def test_nodes_that_search_between_steps_find_what_was_recorded_there(tmp_path: Path) -> None:
    """The recording has readings at the steps alone, and so have the instants of a search."""
    data = network_world(tmp_path) | {
        "clusters": {"kind": "moving_head", "main": "detection"},
        "acquire": {"kind": "readings", "poll": 0.1},
        "sleep": {"kind": "ris", "period": 1.0, "probability": 0.6},
        "wakeup": {"kind": "directed_flood"},
    }
    setup = build(load(data))
    assert setup.polls == 5 and setup.recorded is not None
    (between,) = setup.recorded.recordings(tuple(PLACES), 1, STEPS * 5, DT / 5)
    assert np.flatnonzero(between.counts.any(axis=1)).tolist() == [5 * step for step in range(1, STEPS + 1)]
    assert estimates(data)["readings"].max() == 4


def issues(data: Any, *overrides: str) -> str:
    """The message of a scenario that is refused."""
    with pytest.raises(ScenarioError) as caught:
        build(load(data, overrides))
    return str(caught.value)


def test_a_scenario_that_samples_what_was_recorded_is_refused(tmp_path: Path) -> None:
    data = network_world(tmp_path)
    assert "detection errors of the world" in issues(data | {"detection": {"kind": "imperfect", "missed": 0.1}})
    walk = data | {"motion": {"kind": "random_waypoint"}}
    assert "motion.kind: error: readings were recorded of one trajectory" in issues(walk)


def test_two_origins_of_time_that_differ_are_refused(tmp_path: Path) -> None:
    data = world(tmp_path)
    del data["sensor"]["time_origin"]
    assert "begins at 0 s, the readings at 0.5 s: give time_origin for both" in issues(data)
    data["sensor"]["time_origin"] = data["motion"]["time_origin"] = 0.25
    assert estimates(data)["readings"].tolist() == [4] * STEPS


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("sensor.law.kind=rang", "law.kind: error: unknown sensor 'rang' (did you mean 'range'?)"),
        ("sensor.law.sdd=2", "law.sdd: error: unknown key, did you mean 'sd'?"),
        ("sensor.law.sd=-2", "law.sd: error: must be at least 1e-06, is -2"),
        ("sensor.law.reach=1e8", "law.reach: error: must be at most 1e+07, or .inf, is 1e+08"),
        ("sensor.law=5", "law: error: expected a mapping such as {kind: acoustic_energy}, got the number 5"),
        ("sensor.law={}", "law.kind: is missing; known: acoustic_energy, "),
        ("sensor.columns.node=who", "readings.csv:1: the header must name the columns who, time and reading"),
        ("sensor.columns=who", "sensor.columns: error: expected a mapping, got the text 'who'"),
        ("sensor.path=none.csv", "none.csv: cannot be read: No such file"),
        ("deploy.columns.id=y", "the node '0.0' stands in line"),
    ],
)
def test_a_wrong_value_within_a_component_is_named_by_its_keys(tmp_path: Path, override: str, message: str) -> None:
    assert message in issues(world(tmp_path), override).replace("--set sensor", "sensor")


def test_a_law_that_is_missing_is_named(tmp_path: Path) -> None:
    data = world(tmp_path)
    del data["sensor"]["law"]
    assert "sensor.law: error: is missing: the sensor model that filters take" in issues(data)


def test_values_of_the_law_can_be_set_replaced_and_are_stored(tmp_path: Path) -> None:
    data = world(tmp_path)
    loaded = scenario.load(data, ["sensor.law.sd=0.4"])
    assert build(loaded).sensor.sd == 0.4 and scenario.load(scenario.resolved(loaded)) == loaded
    assert scenario.resolved(loaded)["sensor"]["law"]["reach"] == 5.0
    data["sensor"]["law"] = {"kind": "acoustic_energy", "decay": 2.0}
    other = build(scenario.load(data, ["sensor.law.kind=range", "sensor.law.sd=2"]))
    assert type(other.sensor).__name__ == "Range" and other.sensor.sd == 2.0


def test_a_law_may_be_a_plugin_which_the_provenance_names(tmp_path: Path) -> None:
    data = world(tmp_path)
    data["sensor"]["law"] = {"kind": "wsnsim.models.ranging:Range", "sd": 0.1}
    assert scenario.plugins(scenario.load(data)) == ("sensor wsnsim.models.ranging:Range",)


@pytest.mark.thorough
def test_a_file_that_changed_or_is_gone_is_refused_with_its_result(tmp_path: Path) -> None:
    path, out = tmp_path / "readings.csv", tmp_path / "out.h5"
    wsnsim.run(world(tmp_path), replicates=1, out=out)
    assert estimates(out)["readings"].sum() == 4 * STEPS
    text = path.read_text()
    path.write_text(text.replace(",east,", ",west,", 1).replace(",west,", ",east,", 1) + "\n10.5,east,3\n")
    assert "readings.csv: the file has changed: its digest is" in issues(out)
    path.unlink()
    assert "readings.csv: cannot be read: No such file" in issues(out)
    path.write_text(text)
    assert estimates(out)["readings"].sum() == 4 * STEPS


def test_a_file_that_changes_after_the_scenario_was_read_is_refused(tmp_path: Path) -> None:
    loaded = scenario.load(world(tmp_path))
    (tmp_path / "readings.csv").write_text("time,node,reading\n0.5,east,1\n")
    with pytest.raises((RunError, ScenarioError), match="the file has changed"):
        estimates(loaded)


def test_the_result_names_its_files_and_the_rows_that_were_left_out(tmp_path: Path) -> None:
    data = world(tmp_path)
    with (tmp_path / "readings.csv").open("a") as file:
        file.write("\n3,east,nan\n4,nobody,5\n")
    data["sensor"]["skip_bad_rows"] = True
    report = wsnsim.experiment.run(data, replicates=1, out=tmp_path / "out.h5")
    stored = read_json(tmp_path / "out.h5", "provenance_json")
    digests = {name: file_digest(tmp_path / name) for name in ("readings.csv", "track.csv")}
    assert stored["recorded_files"] == digests and stored["skipped_rows"] == {"readings.csv": 2}
    assert [row.split(": ")[0] for row in stored["skipped"]] == ["readings.csv:82", "readings.csv:83"]
    text = info_text(tmp_path / "out.h5")
    assert f"recorded     readings.csv ({digests['readings.csv']}), 2 rows left out\n" in text
    said = " ".join(text.split())  # without the line breaks of a terminal
    assert "readings.csv:83: the deployment has no node 'nobody' (its nodes: east, north, west, south)" in said
    (note,) = notes.of_report(report, summary.as_json(report))
    assert note.startswith("2 rows of readings.csv left out, such as readings.csv:82: reading must be a finite number")


def test_silence_of_all_nodes_is_noted(tmp_path: Path) -> None:
    gap = {(step, name) for step in (3, 4, 5) for name in PLACES}
    assert notes.of_setup(build(load(world(tmp_path, silent=gap)))) == [
        "no node has a recorded reading of target 0 at 3 of 20 steps"
    ]


def test_a_bound_uses_the_readings_that_were_recorded_under_the_law(tmp_path: Path) -> None:
    """Along a given trajectory of a motion model; a recorded one has no bound, and says why."""
    reason = bounds.bound(world(tmp_path), range(1), "per_trajectory").reason
    assert reason == "the trajectory was recorded: it is no sample of a motion model"
    found = []
    for silent in (set(), {(step, "east") for step in range(1, STEPS + 1)}):
        data = world(tmp_path, silent=silent)
        data["motion"] = {"kind": "constant_velocity", "start": [-2, 0.4, 1, 0], "truth_noise": False}
        found.append(bounds.bound(data, range(1), "per_trajectory"))
    assert "readings were recorded: the bound is that of the law (sensor.law), which they need not follow" in (
        found[0].cautions
    )
    assert found[0].rmse[-1] < found[1].rmse[-1]


def points_of(data: dict[str, Any], folder: Path) -> list[Any]:
    """The points of a sweep over the law's noise."""
    (folder / "base.yaml").write_text(yaml.safe_dump(data))
    sweep = {"name": "noise", "scenario": str(folder / "base.yaml"), "grid": {"sensor.law.sd": [0.1, 0.2]}}
    return list(load_sweep(sweep).points)


def test_a_changed_file_is_another_point_of_a_campaign(tmp_path: Path) -> None:
    before, after = points_of(world(tmp_path), tmp_path), points_of(world(tmp_path, s8_north=9.5), tmp_path)
    assert len({point.id for point in (*before, *after)}) == 4
    assert [point.settings["sensor.law.sd"] for point in before] == [0.1, 0.2]
    assert points_of(world(tmp_path), tmp_path) == before


def repeated(folder: Path, times: int, spread: float = 0.0) -> dict[str, Any]:
    """The scenario with several readings of each node in a step, which differ by `spread` around their mean."""
    data = world(folder)
    rows = ["time,node,reading"]
    for step in range(1, STEPS + 1):
        for name, distance in distances(step).items():
            offsets = spread * (np.arange(times) - (times - 1) / 2)
            rows += [f"{step * DT - 0.01 * i},{name},{distance + offset}" for i, offset in enumerate(offsets)]
    (folder / "readings.csv").write_text("\n".join(rows))
    data["sensor"]["several"] = "all"
    return data


@pytest.mark.thorough(fast=["ekf"])
@pytest.mark.parametrize("kind", ["ekf", "pf", "ipf", "gpf", "rkf", "ppf", "pso_mhpf", "ics_pf", "trilateration"])
def test_all_readings_of_a_step_say_as_much_as_a_mean_with_less_noise(tmp_path: Path, kind: str) -> None:
    """Four readings with a standard deviation of 0.2 m are one with 0.1 m: in the requests of every tracker."""
    counted = repeated(tmp_path, 4, spread=0.05) | {"tracker": {"kind": kind}, "duration": 4.0}
    counted["sensor"]["law"]["sd"] = 0.2
    one = estimates(counted)
    mean = repeated(tmp_path, 4, spread=0.05) | {"tracker": {"kind": kind}, "duration": 4.0}
    mean["sensor"]["several"] = "mean"
    other = estimates(mean)
    for column in ("px", "vx", "py", "vy", "sd_x", "sd_y"):
        assert np.allclose(one[column], other[column], rtol=0, atol=1e-6), column


def test_the_noise_of_a_mean_follows_from_the_count_of_its_step(tmp_path: Path) -> None:
    """Against a Kalman update by hand: the first step of an EKF whose nodes have 4, 1, 1 and 0 readings."""
    data = repeated(tmp_path, 4)
    rows = (tmp_path / "readings.csv").read_text().splitlines()
    kept = [row for row in rows if ",east," in row or row.split(",")[0] not in ("0.49", "0.48", "0.47")]
    (tmp_path / "readings.csv").write_text("\n".join(row for row in kept if not row.startswith("0.5,south")))
    loaded = build(load(data))
    assert loaded.recorded is not None
    counts = loaded.recorded.recordings(tuple(PLACES), 1, STEPS, DT)[0].counts
    assert counts[1].tolist() == [4, 1, 1, 0]
    conditions = sample_initial_conditions(loaded, 0)
    prior = conditions.priors[0]
    jacobian, noise = loaded.filter_motions[0].matrices(prior.mean[:, None], DT, 0.0)
    mean, cov = jacobian[0] @ prior.mean, jacobian[0] @ prior.cov @ jacobian[0].T + noise
    apart = mean[[0, 2]] - conditions.positions[:3]
    ranges = np.linalg.norm(apart, axis=1)
    slope = np.zeros((3, 4))
    slope[:, [0, 2]] = apart / ranges[:, None]
    seen = np.array(list(distances(1).values()))[:3]
    gain = cov @ slope.T @ np.linalg.inv(slope @ cov @ slope.T + np.diag(0.01 / np.array([4.0, 1.0, 1.0])))
    expected = mean + gain @ (seen - ranges)
    found = estimates(data)
    assert np.allclose([found[name][0] for name in ("px", "vx", "py", "vy")], expected, rtol=0, atol=1e-9)


def test_all_readings_are_refused_where_their_number_cannot_count(tmp_path: Path) -> None:
    in_network = network_world(tmp_path)
    in_network["sensor"]["several"] = "all"
    assert "nodes send one reading a step and not how many it stands for: use mean or last" in issues(in_network)
    energy = repeated(tmp_path, 2)
    energy["sensor"]["law"] = {"kind": "acoustic_energy"}
    assert "all needs a law of independent readings whose noise is Gaussian with a constant variance" in issues(energy)
    wide = repeated(tmp_path, 2) | {"tracker": {"kind": "ekf", "assumes": {"gains": "unknown", "inflate": True}}}
    wide["sensor"]["law"] = {"kind": "rssi", "gain_spread": 3}
    (tmp_path / "readings.csv").write_text("time,node,reading\n0.5,east,-60\n0.6,east,-61\n")
    assert "tracker.assumes.inflate: error: the variance that inflate adds is common" in issues(wide)


def rssi_world(folder: Path, **assumes: Any) -> dict[str, Any]:
    """The scenario on files with a law whose gains are not listed, and what the tracker assumes."""
    data = world(folder, **{f"s{step}_{name}": -60.0 for step in range(1, STEPS + 1) for name in PLACES})
    data["sensor"]["law"] = {"kind": "rssi", "gain_spread": 4}
    return data | {"tracker": {"kind": "ekf", "assumes": assumes}}


def test_gains_of_recorded_readings_are_not_sampled_and_taken_as_known(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"list them \(sensor\.law\.gains\), or say unknown or estimated") as caught:
        scenario.build(scenario.load(rssi_world(tmp_path)))
    assert "tracker.assumes.gains" in str(caught.value)
    listed = rssi_world(tmp_path)
    listed["sensor"]["law"]["gains"] = [1, 2, 3, 4]
    found = sample_initial_conditions(scenario.build(scenario.load(listed)), 0)
    assert found.traits.tolist() == [[1], [2], [3], [4]]
    acoustic = rssi_world(tmp_path)
    acoustic["sensor"]["law"] = {"kind": "acoustic_energy"}
    with pytest.raises(ScenarioError, match=r"set sensor\.law\.gain_spread: 0, or say unknown"):
        scenario.build(scenario.load(acoustic))


@pytest.mark.parametrize("gains", ["unknown", "estimated"])
def test_unknown_gains_of_recorded_readings_are_not_sampled(tmp_path: Path, gains: str) -> None:
    """Neither the table of nodes nor a filter or bound has a gain that nobody measured."""
    data = rssi_world(tmp_path, gains=gains)
    assert not sample_initial_conditions(scenario.build(scenario.load(data)), 0).traits.any()
    assert estimates(data, "nodes")["gain"].tolist() == [1.0] * len(PLACES)


def test_a_node_without_a_name_is_refused_and_shifts_no_other(tmp_path: Path) -> None:
    data = world(tmp_path)
    path = tmp_path / "nodes.csv"
    path.write_text(path.read_text().replace("north", ""))
    with pytest.raises(ScenarioError, match=r"nodes\.csv:3: id must not be empty"):
        scenario.build(scenario.load(data))


def test_gains_are_as_many_as_the_nodes_of_a_file(tmp_path: Path) -> None:
    data = rssi_world(tmp_path)
    data["sensor"]["law"]["gains"] = [1, 2, 3]
    with pytest.raises(ScenarioError, match="3 gains for 4 nodes"):
        scenario.build(scenario.load(data))
