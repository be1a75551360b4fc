"""Scans that name no target: what is in them, what they cost, and that nothing depends on whose detections they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

import wsnsim.scenario as scenarios
from wsnsim.base.errors import ScenarioError
from wsnsim.base.tables import KIND, Memory
from wsnsim.experiment import simulate_run
from wsnsim.network import world
from wsnsim.network.scans import _poisson, _shuffled
from wsnsim.scenario.sweep import load_sweep
from wsnsim.scenario.texts import shipped

WANTED = dict.fromkeys(("truth", "readings", "detections", "estimates", "events", "energy", "nodes", "runs"), True)
JPDA = {"kind": "jpda", "filter": {"kind": "ekf"}}
KNOWN = {"kind": "known"}
STEPS = 16


def line(y: float, end: float) -> dict[str, Any]:
    """A target from the left to the right."""
    return {"kind": "waypoints", "points": [[0, -30, y], [STEPS, 30, end]]}


def scenario(**others: Any) -> dict[str, Any]:
    """A small network whose nodes report scans of two targets that cross."""
    return {
        "name": "scans", "seed": 7, "duration": f"{STEPS} s", "step": "1 s", "prior": {"sd": [2, 1, 2, 1]},
        "deploy": {"kind": "grid", "nodes": 16, "width": "80 m", "height": "80 m", "cover": False},
        "targets": [line(-20, 20), line(20, -20)], "energy": {"kind": "first_order"},
        "sensor": {"kind": "range_bearing", "range_sd": "1 m", "bearing_sd": "2 deg", "reach": "40 m"},
        "detection": {"kind": "unlabelled", "probability": 0.9, "clutter": 0.5}, "clusters": {"kind": "central"},
        "link": {"kind": "disk", "reach": "90 m"}, "tracker": JPDA, **others,
    }  # fmt: skip


def recorded(**others: Any) -> Memory:
    memory = Memory(WANTED)
    simulate_run(scenario(**others), 0, memory)
    return memory


def issues_of(**others: Any) -> list[str]:
    with pytest.raises(ScenarioError) as refused:
        scenarios.build(scenarios.load(scenario(**others)))
    return [issue.message for issue in refused.value.issues]


def test_a_scan_holds_the_labelled_readings_where_every_target_is_detected_without_clutter() -> None:
    labelled = recorded(detection={"kind": "perfect"}, tracker={"kind": "ekf"}).table("readings")
    scans = recorded(detection={"kind": "unlabelled", "probability": 1.0}).table("detections")
    keys = ("step", "node", "component", "reading")
    seen = set(zip(*(labelled[key] for key in ("target", *keys)), strict=True))
    told = set(zip(*(scans[key] for key in ("origin", *keys)), strict=True))
    assert told == seen


def test_clutter_is_poisson_uniform_over_the_space_of_the_sensor_and_misses_are_as_probable_as_said() -> None:
    table = recorded(detection={"kind": "unlabelled", "probability": 0.7, "clutter": 2.0}).table("detections")
    false = (table["origin"] == -1) & (table["component"] == 0)
    scans = 16 * STEPS
    assert abs(false.sum() - 2.0 * scans) < 4.0 * np.sqrt(2.0 * scans)
    ranges = table["reading"][false]
    assert (
        ranges.min() >= 0.0
        and ranges.max() <= 40.0
        and abs(ranges.mean() - 20.0) < 4.0 * 40.0 / np.sqrt(12 * ranges.size)
    )
    angles = table["reading"][(table["origin"] == -1) & (table["component"] == 1)]
    assert np.abs(angles).max() <= np.pi and abs(angles.mean()) < 4.0 * 2.0 * np.pi / np.sqrt(12 * angles.size)
    everything = recorded(detection={"kind": "unlabelled", "probability": 1.0}).table("detections")
    all_of_targets, of_targets = len(everything["node"]), (table["origin"] >= 0).sum()
    assert abs(of_targets / all_of_targets - 0.7) < 4.0 * np.sqrt(0.21 / (all_of_targets / 2))


def test_numbers_of_false_detections_are_the_quantiles_of_the_poisson_distribution() -> None:
    from scipy.stats import poisson

    shares = (np.arange(1000) + 0.5) / 1000
    for mean in (0.01, 0.5, 10.0, 300.0):
        np.testing.assert_array_equal(_poisson(shares, mean), poisson.ppf(shares, mean))


def test_the_order_of_detections_depends_on_their_values_alone() -> None:
    values = [3.0, 1.0, 2.0, 5.0, 4.0]
    pairs = [(value, target) for target, value in enumerate(values)]
    ways = {tuple(value for value, _ in _shuffled(list(reversed(pairs)), key)) for key in range(50)}
    assert len(ways) > 20
    assert all(_shuffled(pairs, key) == _shuffled(pairs[::-1], key) for key in range(50))


@pytest.mark.parametrize("clusters", ["central", "strongest_signal"])
def test_permuting_hidden_labels_changes_no_byte_of_estimates_and_events(clusters, monkeypatch) -> None:
    before, made = recorded(clusters={"kind": clusters}), world.make_readings
    monkeypatch.setattr(world, "make_readings", lambda *arguments: made(*arguments)[::-1])
    after = recorded(clusters={"kind": clusters})
    assert before.table("estimates")["confirmed"].any()
    assert (before.table("detections")["origin"] != after.table("detections")["origin"]).any()
    for table in ("estimates", "events"):
        columns = before.table(table)
        assert {name: column.tobytes() for name, column in columns.items()} == {
            name: column.tobytes() for name, column in after.table(table).items()
        }


def test_two_targets_closer_than_the_sensor_resolves_give_one_detection() -> None:
    near = [line(0.0, 0.0), line(0.1, 0.1)]
    resolved = {"kind": "unlabelled", "probability": 1.0}
    two = recorded(targets=near, detection=resolved).table("detections")
    one = recorded(targets=near, detection={**resolved, "resolution": [1.0, 0.5]}).table("detections")
    assert set(two["origin"]) == {0, 1} and two["detection"].max() == 1
    assert set(one["origin"]) == {0} and one["detection"].max() == 0
    assert 2 * len(one["reading"]) == len(two["reading"])
    pairs = two["reading"][two["component"] == 0].reshape(-1, 2)
    np.testing.assert_allclose(one["reading"][one["component"] == 0], pairs.mean(axis=1), rtol=1e-12)
    apart = recorded(targets=[line(0.0, 0.0), line(10.0, 10.0)], detection={**resolved, "resolution": [1.0, 1e-6]})
    assert set(apart.table("detections")["origin"]) == {0, 1}


def test_which_targets_are_resolved_does_not_depend_on_the_order_in_which_they_are_listed() -> None:
    places, close = (0.0, 1.2, 0.6), {"kind": "unlabelled", "probability": 1.0, "resolution": [1.0, 0.5]}
    sizes = []
    for order in ((0, 1, 2), (0, 2, 1)):
        table = recorded(targets=[line(places[i], places[i]) for i in order], detection=close).table("detections")
        sizes.append([table[name] for name in ("step", "node", "detection", "component")])
    np.testing.assert_array_equal(*sizes)


def test_a_false_detection_wakes_a_dormant_node_and_an_empty_field_costs_what_is_sent_for_clutter() -> None:
    nobody = {"kind": "constant_velocity", "start": [0, 1, 0, 1], "presence": []}
    empty = scenario(motion=nobody)
    del empty["targets"]
    joules = []
    for clutter in (0.0, 0.5, 2.0):
        memory = Memory(WANTED)
        summary = simulate_run({**empty, "detection": {"kind": "unlabelled", "clutter": clutter}}, 0, memory)
        woken = (memory.table("events")["kind"] == KIND["wake"]).sum()
        assert (woken > 1) == (clutter > 0.0)
        joules.append(summary.run["energy"])
        nodes, energy = memory.table("nodes"), memory.table("energy")
        each = np.bincount(energy["node"], energy["joules"], 16) if energy else np.zeros(16)
        np.testing.assert_allclose(each, nodes["energy_initial"] - nodes["energy_left"], rtol=1e-9, atol=1e-15)
    assert joules[0] < joules[1] < joules[2]


@pytest.mark.parametrize("kind", ["nearest_neighbour", "gnn", "pda", "jpda", "lmb", "mht"])
def test_one_certain_target_without_clutter_is_followed_as_by_the_plain_filter_in_a_network(kind) -> None:
    alone = [line(-20, 20)]
    plain = recorded(targets=alone, detection={"kind": "perfect"}, tracker={"kind": "ekf"}).table("estimates")
    tracker = {"kind": kind, "filter": {"kind": "ekf"}, "management": KNOWN, "gate": 1.0}
    tracks = recorded(targets=alone, detection={"kind": "unlabelled", "probability": 1.0}, tracker=tracker)
    found = tracks.table("estimates")
    assert set(found["track"]) == {0} and found["confirmed"].all()
    for name in ("px", "vx", "py", "vy", "sd_x", "sd_y", "cov_xy"):
        np.testing.assert_allclose(found[name], plain[name], rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(found["readings"], plain["readings"])


def rows_of_recordings() -> set[tuple[int, int, float, int]]:
    """(step, node, reading, target) of the last reading of each receiver in each of 12 steps, from the two tracks."""
    folder, found = shipped()["recorded_scans"].parent / "recorded" / "ble", set()
    names = pd.read_csv(folder / "receivers.csv")["receiver"].tolist()
    for target, name in enumerate(("straight_01", "rectangular_with_rotation")):
        track = pd.read_csv(folder / f"{name}.csv.gz")
        track["step"] = np.ceil(track["time"] / 0.5).astype(int)
        last = track[track["step"] < 12].groupby(["step", "receiver"], as_index=False).last()
        found |= {(row.step, names.index(row.receiver), row.rssi, target) for row in last.itertuples()}
    return found


def test_scans_of_two_recordings_hold_the_rows_of_both_in_an_order_without_names_and_clutter_beside_them() -> None:
    expected, memory = rows_of_recordings(), Memory(WANTED)
    simulate_run(scenarios.load("recorded_scans", ["duration=6 s", "detection.clutter=1"]), 0, memory)
    found = memory.table("detections")
    rows = list(zip(*(found[key].tolist() for key in ("step", "node", "reading", "origin")), strict=True))
    assert {row for row in rows if row[3] >= 0} == expected
    false = [row[2] for row in rows if row[3] < 0]
    assert abs(len(false) - 144) < 4 * 12 and min(false) >= -110 and max(false) <= -40
    assert set(found["detection"][found["origin"] == 0]) >= {0, 1}
    estimates = memory.table("estimates")
    assert set(estimates["track"]) == {0, 1} and estimates["confirmed"].all()


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("recorded_scans", "detection.resolution=[3]", "give none"),
        ("recorded_pf", "detection={kind: imperfect, missed: 0.1}", "use kind: perfect"),
    ],
)
def test_recorded_readings_are_neither_merged_nor_missed_again(name, change, said) -> None:
    with pytest.raises(ScenarioError, match=f"world that they come from: {said}"):
        scenarios.build(scenarios.load(name, [change]))


def scans(**options: Any) -> dict[str, Any]:
    """A scenario's detection with these options."""
    return {"detection": {"kind": "unlabelled", **options}}


def inner(**options: Any) -> dict[str, Any]:
    """A scenario's tracker with this filter."""
    return {"tracker": {**JPDA, "filter": options}}


GAINS = {"kind": "ekf", "gains": "unknown"}
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "a tracker of one target": ({"tracker": {"kind": "pf"}}, "pf follows one target"),
    "labelled readings": ({"detection": {"kind": "perfect"}}, "each reading names its target"),
    "a filter without Gaussian moments": ({"tracker": {**JPDA, "filter": {"kind": "pf"}}}, "Gaussian moments"),
    "a filter of the nearest reading": (inner(kind="ekf", readings="nearest"), "must be all: a track"),
    "an iterated filter": (inner(kind="ekf", iterations=3), "must be 1: a track"),
    "sigma points without room": (inner(kind="ukf", kappa=-5), "-5 must be greater than -4"),
    "assumptions of the inner filter": ({"tracker": {**JPDA, "filter": GAINS}}, "tracker.assumes"),
    "readings that add up": ({"sensor": {"kind": "acoustic_energy"}}, "adds up"),
    "readings that name a cell": ({"sensor": {"kind": "binary"}}, "names a cell"),
    "relative readings": ({"sensor": {"kind": "tdoa", "reach": "60 m"}}, "only differences"),
    "an unbounded space": ({"sensor": {"kind": "rssi"}}, "have no bounds: give detection.window"),
    "a probability of 0": (scans(probability=0), "greater than 0"),
    "a probability above 1": (scans(probability=1.5), "at most 1"),
    "an empty window": (scans(window=[[3, 1], [0, 1]]), "is empty"),
    "a window of one component": (scans(window=[[0, 1]]), "per component (range, bearing)"),
    "a resolution of three components": (scans(resolution=[1, 1, 1]), "per component"),
    "a gate that admits nothing": ({"tracker": {**JPDA, "gate": 0}}, "greater than 0"),
    "a head that moves at each step": ({"clusters": {"kind": "moving_head", "main": "detection"}}, "use central"),
    "heads that are elected": ({"clusters": {"kind": "strongest_signal", "successor_rule": "elect"}}, "use central"),
    "nodes woken ahead": ({"wakeup": {"kind": "directed_flood"}}, "not woken ahead of tracks"),
    "an end by clusters": ({"until": {"clusters": 3}}, "no number of clusters"),
    "no network": ({"network": "none"}, "need a network"),
    "a management at the top": ({"management": KNOWN}, "unknown key"),
    "an unknown management": ({"tracker": {**JPDA, "management": {"kind": "m_of"}}}, "did you mean 'm_of_n'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_done_with_scans_is_refused_with_one_message(case) -> None:
    changes, said = REFUSED[case]
    messages = issues_of(**changes)
    assert len(messages) == 1 and said in messages[0]
    with pytest.raises(ScenarioError) as refused:
        load_sweep(scenario(**changes), vary=["seed=1,2"])
    assert [issue.message for issue in refused.value.issues] == messages
