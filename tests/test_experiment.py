"""The straight line, from a scenario to its file: what a researcher relies on."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.spatial import KDTree

import wsnsim
from tests.helpers.recordings import recording as recording_of
from tests.helpers.recordings import short
from wsnsim import experiment, recording, scenario, verification
from wsnsim.analysis import summary_text
from wsnsim.base.errors import ScenarioError
from wsnsim.base.tables import CAUSES, EVENT_CAUSE, KIND, Memory
from wsnsim.stored_scenario import rerun_source

TRACKERS = ("pso_mhpf", "ipf", "ppf", "central_pf")


@pytest.fixture(scope="module")
def files():
    """The folder with two short runs of every tracker."""
    return {recording_of(name).parent for name in TRACKERS}.pop()


@pytest.mark.thorough
@pytest.mark.parametrize("name", TRACKERS[1:])
def test_every_tracker_chases_the_identical_truth_over_the_identical_network(files, name):
    for table, columns in {"truth": None, "nodes": ("replicate", "node", "x", "y", "gain")}.items():
        first, other = (recording.read_table(files / f"{n}.h5", table, columns) for n in ("pso_mhpf", name))
        assert first.keys() == other.keys()
        assert all(np.array_equal(first[key], other[key]) for key in first)


@pytest.mark.parametrize("name", TRACKERS[1:3])
def test_the_first_cluster_is_the_same_for_trackers_under_the_same_policy(files, name):
    for replicate in (0, 1):
        first = [recording.read_table(files / f"{n}.h5", "clusters") for n in ("pso_mhpf", name)]
        rows = [int(np.flatnonzero(table["replicate"] == replicate)[0]) for table in first]
        for column in ("formed", "head", "members"):
            assert first[0][column][rows[0]] == first[1][column][rows[1]]


@pytest.mark.thorough
def test_replicates_differ_and_each_is_the_same_whatever_ran_before_it(files):
    prints = recording.read_table(files / "pso_mhpf.h5", "runs")["fingerprint"]
    assert prints[0] != prints[1]
    alone = experiment.simulate_run(short("pso_mhpf"), replicate=1)
    assert alone.run["fingerprint"] == prints[1]


@pytest.mark.thorough
def test_the_fingerprint_is_the_same_in_another_process_and_without_a_log(files):
    code = (
        "from wsnsim import experiment, scenario\n"
        "s = scenario.load('pso_mhpf', ['duration=4.04 s', 'tracker.particles=40', 'record.events=false'])\n"
        "print(experiment.simulate_run(s).run['fingerprint'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout) == recording.read_table(files / "pso_mhpf.h5", "runs")["fingerprint"][0]


@pytest.mark.parametrize("name", TRACKERS)
def test_the_ledger_closes_for_every_node(files, name):
    energy = recording.read_table(files / f"{name}.h5", "energy")
    nodes = recording.read_table(files / f"{name}.h5", "nodes")
    for replicate in (0, 1):
        mine, standing = energy["replicate"] == replicate, nodes["replicate"] == replicate
        by_cause = np.bincount(energy["node"][mine], weights=energy["joules"][mine], minlength=256)
        left, initial = nodes["energy_left"][standing], nodes["energy_initial"][standing]
        if np.isfinite(initial).all():
            assert np.allclose(by_cause, initial - left, rtol=1e-9, atol=1e-15)
    total = recording.read_table(files / f"{name}.h5", "runs")["energy"].sum()
    assert energy["joules"].sum() == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize("name", TRACKERS)
def test_the_events_and_the_positions_in_the_file_reproduce_the_energy_of_the_air_by_equations_9_and_10(files, name):
    events = recording.read_table(files / f"{name}.h5", "events")
    nodes = recording.read_table(files / f"{name}.h5", "nodes", ("replicate", "x", "y"))
    energy = recording.read_table(files / f"{name}.h5", "energy")
    positions = np.stack([nodes["x"], nodes["y"]], axis=1).reshape(2, 256, 2)
    sent = np.isin(events["kind"], [KIND["send"], KIND["relay"]])
    starts = positions[events["replicate"][sent], events["node"][sent]]
    ends = positions[events["replicate"][sent], events["peer"][sent]]
    distance = np.where(events["peer"][sent] < 0, 75.0, np.linalg.norm(starts - ends, axis=1))
    bits = events["bits"][sent]
    heard = events["bits"][events["cause"] == EVENT_CAUSE["rx"]]
    by_cause = {cause: energy["joules"][energy["cause"] == code].sum() for code, cause in enumerate(CAUSES)}
    assert np.sum(bits * 50e-9) == pytest.approx(by_cause["tx_electronics"], rel=1e-9)
    assert np.sum(bits * 100e-12 * distance**2) == pytest.approx(by_cause["tx_amplifier"], rel=1e-9)
    assert np.sum(heard * 50e-9) == pytest.approx(by_cause["rx"], rel=1e-9)
    computed = events["joules"][events["cause"] == EVENT_CAUSE["cpu"]].sum()
    assert computed == pytest.approx(by_cause["cpu"], rel=1e-9)


def test_every_receive_names_a_frame_that_was_sent(files):
    events = recording.read_table(files / "ppf.h5", "events")
    for replicate in (0, 1):
        mine = events["replicate"] == replicate
        sent = set(events["frame"][mine & np.isin(events["kind"], [KIND["send"], KIND["relay"]])])
        assert set(events["frame"][mine & (events["kind"] == KIND["receive"])]) <= sent


@pytest.mark.thorough
def test_a_result_repeats(files):
    answer = verification.verify(files / "ipf.h5")
    assert answer.ok, answer.text
    assert "repeats" in answer.text and len(answer.rows) == 2


@pytest.mark.thorough
def test_a_result_that_was_tampered_with_does_not_repeat(files, tmp_path):
    copy = tmp_path / "copy.h5"
    copy.write_bytes((files / "ppf.h5").read_bytes())
    with h5py.File(copy, "r+") as file:
        file["estimates/error"][5] += 0.5
    answer = verification.verify(copy)
    assert not answer.ok and "DOES NOT REPEAT" in answer.text
    assert [row["equal"] for row in answer.rows] == [False, True]


@pytest.mark.thorough
def test_made_on_another_kind_of_processor_values_are_compared_to_a_tolerance_and_it_says_so(files, tmp_path):
    copy = tmp_path / "copy.h5"
    copy.write_bytes((files / "ipf.h5").read_bytes())
    with h5py.File(copy, "r+") as file:
        stored = json.loads(file["provenance_json"][()])
        del file["provenance_json"]
        other = {"cpu_features": ["another"], "git": {"commit": "0123456789abcdef", "dirty": False}}
        file["provenance_json"] = json.dumps(stored | other)
        file["estimates/error"][5] *= 1 + 1e-9
    answer = verification.verify(copy)
    assert answer.ok and "other CPU features" in answer.text
    assert "made by commit 0123456789ab, run again by " in answer.text


@pytest.mark.thorough
def test_a_plain_dict_is_a_scenario(files):
    plain = rerun_source(files / "pso_mhpf.h5")
    again = wsnsim.experiment.simulate_run(plain)
    assert again.run["fingerprint"] == recording.read_table(files / "pso_mhpf.h5", "runs")["fingerprint"][0]
    smallest = {
        "name": "mine",
        "seed": 3,
        "duration": 1.0,
        "step": "40 ms",
        "deploy": {"kind": "uniform", "nodes": 120, "width": "200 m", "height": 200},
        "motion": {"kind": "bounded_velocity", "start": [0, 10, 0, 5]},
        "sensor": {"kind": "acoustic_energy"},
        "energy": {"kind": "first_order"},
        "link": {"kind": "disk"},
        "tracker": {"kind": "ipf", "particles": 50},
    }
    memory = Memory()
    result = wsnsim.experiment.simulate_run(smallest, recorder=memory)
    assert result.run["steps"] == 24
    assert len(memory.table("estimates")["error"]) == 24


@pytest.mark.thorough
def test_literal_equation_18_visibly_fails_and_crashes_nothing():
    literal = ("tracker.random_factors=false", "tracker.iterations=70", "duration=10 s")
    failed = [experiment.simulate_run(scenario.load("pso_mhpf", literal), r) for r in range(2)]
    default = [experiment.simulate_run(scenario.load("pso_mhpf", ["duration=10 s"]), r) for r in range(2)]
    for bad, good in zip(failed, default, strict=True):
        assert bad.run["rmse"] > 2 * good.run["rmse"]


@pytest.mark.thorough
def test_accepting_by_the_likelihood_alone_errs_by_more_than_what_counts_as_lost():
    for number in range(3):
        run = experiment.simulate_run(scenario.load("pso_mhpf", ["tracker.acceptance=likelihood"]), number).run
        assert run["median_error"] > run["lost_limit"] and run["rmse"] > 1.5 * run["lost_limit"]


@pytest.mark.thorough
def test_on_small_batteries_nodes_die_the_ledger_still_closes_and_the_summary_says_when(tmp_path):
    small = scenario.load("lifetime", ["duration=8 s", "tracker.particles=40", "energy.battery=2 mJ"])
    report = experiment.run(small, out=tmp_path / "x.h5")
    run = report.summaries[0].run
    assert 0 <= run["first_death"] < 8 and run["alive"] < 256
    nodes = recording.read_table(tmp_path / "x.h5", "nodes")
    energy = recording.read_table(tmp_path / "x.h5", "energy")
    spent = np.bincount(energy["node"], weights=energy["joules"], minlength=256)
    assert np.allclose(spent, nodes["energy_initial"] - nodes["energy_left"], rtol=1e-9, atol=1e-15)
    dead = np.isfinite(nodes["died_at"])
    assert np.all(nodes["energy_left"][dead] == 0) and np.all(nodes["energy_left"][~dead] > 0)
    events = recording.read_table(tmp_path / "x.h5", "events")
    points = np.random.default_rng(1).uniform(-200, 200, (20_000, 2))
    living = np.stack([nodes["x"], nodes["y"]], axis=1)[~dead]
    assert run["coverage"] == pytest.approx(np.mean(KDTree(living).query(points)[0] <= 60.0), abs=0.01)
    deaths = dict(
        zip(
            events["node"][events["kind"] == KIND["death"]],
            events["time"][events["kind"] == KIND["death"]],
            strict=True,
        )
    )
    assert deaths == {node: nodes["died_at"][node] for node in np.flatnonzero(dead)}
    for node, died in deaths.items():
        assert events["time"][events["node"] == node].max() <= died, "the dead do nothing"
    told = summary_text.text(report, {})
    assert "first death" in told and "first track loss" in told


@pytest.mark.thorough
def test_several_targets_each_have_their_track():
    plain = scenario.resolved(short("pso_mhpf"))
    first = plain.pop("motion")
    memory = Memory()
    plain["targets"] = [first, {**first, "start": [100.0, 10.0, 100.0, -20.0]}]
    result = wsnsim.experiment.simulate_run(plain, recorder=memory)
    assert len(result.tracks) == 2
    assert not any(track["lost"] for track in result.tracks)
    assert set(memory.table("clusters")["target"]) == {0, 1}


def test_particles_are_recorded_where_they_are_wanted():
    memory = Memory({"particles": True})
    experiment.simulate_run(scenario.load(short("pso_mhpf"), ["duration=0.44 s"]), recorder=memory)
    table = memory.table("particles")
    for step in range(1, 11):
        weights = table["weight"][table["step"] == step]
        assert len(weights) == 40
        assert weights.sum() == pytest.approx(1.0)
    assert np.isfinite(table["px"]).all()


@pytest.mark.thorough
def test_a_killed_run_leaves_no_file_under_the_final_name(tmp_path):
    out = tmp_path / "x.h5"
    command = [sys.executable, "-m", "wsnsim", "run", "pso_mhpf", "--replicates", "500", "--quiet", "--out", str(out)]
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob("*.tmp")) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(1.0)
    running.kill()
    running.wait()
    assert not out.exists()
    assert len(list(tmp_path.glob("*.tmp"))) == 1


@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_leaves_nothing_behind_and_no_traceback(tmp_path, number):
    out = tmp_path / "x.h5"
    command = [sys.executable, "-m", "wsnsim", "run", "pso_mhpf", "--replicates", "500", "--quiet", "--out", str(out)]
    listens = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}  # though started in the background
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **listens)
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob("*.tmp")) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(0.5)
    os.kill(running.pid, number)
    _, told = running.communicate(timeout=30)
    assert running.returncode in (130, 143)
    assert "Traceback" not in told
    assert list(Path(tmp_path).iterdir()) == []


def test_a_deployment_that_cannot_be_covered_is_refused_or_given_up_with_a_reason(tmp_path):
    with pytest.raises(ScenarioError, match="cover"):
        experiment.run(scenario.load("pso_mhpf", ["deploy.nodes=10"]), out=tmp_path / "x.h5")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def sleeping():
    """Short runs of a network that sleeps and is woken by a flood, and of one that nobody wakes: (tables, words)."""
    made = {}
    for name in ("gmtt", "ris"):
        memory = Memory()
        experiment.simulate_run(scenario.load(name, ["duration=62 s"]), recorder=memory)
        made[name] = memory
    return made


@pytest.mark.thorough(fast=["ris"])
@pytest.mark.parametrize("name", ["gmtt", "ris"])
def test_the_figures_of_a_track_are_those_that_a_hand_counts_in_its_estimates(sleeping, name):
    """Steps of 2 s, reports every 10 s: of 30 steps, 6 are due to the sink."""
    estimates, (track,) = sleeping[name].table("estimates"), rows_of_table(sleeping[name].table("tracks"))
    steps = rows_of_table(estimates)
    in_time = [row for row in steps if row["issued"] <= row["time"] + 2.0]
    for column, least in (("tracked", 1), ("tracked_three", 3)):
        assert track[column] == pytest.approx(sum(row["readings"] >= least for row in in_time) / 30)
    sure = [row["error"] for row in steps if row["readings"] >= 3 and np.isfinite(row["error"])]
    assert track["mean_error_three"] == pytest.approx(sum(sure) / len(sure))
    assert track["rmse_three"] == pytest.approx((sum(error**2 for error in sure) / len(sure)) ** 0.5)
    assert track["median_error_three"] == pytest.approx(np.median(sure))
    due = [row for row in steps if row["step"] % 5 == 0]
    assert all(np.isnan(row["received"]) for row in steps if row not in due)
    assert (track["due"], track["received"]) == (6, sum(np.isfinite(row["received"]) for row in due))
    assert track["in_time"] == pytest.approx(sum(row["received"] <= row["time"] + 2.0 for row in due) / 6)
    assert track["woken"] == sum(row["woken"] for row in steps)
    assert track["ineffective"] == sum(row["ineffective"] for row in steps) <= track["woken"]
    assert track["ineffective_twenty"] == sum(row["ineffective"] for row in steps if row["step"] <= 20)
    (run,) = rows_of_table(sleeping[name].table("runs"))
    assert (run["tracked"], run["tracked_three"]) == (track["tracked"], track["tracked_three"])


def test_every_message_that_wakes_nodes_has_its_row_and_the_events_agree(sleeping):
    wakeups, events = sleeping["gmtt"].table("wakeups"), sleeping["gmtt"].table("events")
    estimates = sleeping["gmtt"].table("estimates")
    words = sleeping["gmtt"].words.all()
    flood = events["what"] == words.index("track")
    for row in rows_of_table(wakeups):
        frames = flood & (events["sequence"] == row["sequence"])
        sent = frames & np.isin(events["kind"], [KIND["send"], KIND["relay"]])
        assert sent.sum() == 1 + row["forwards"] and events["node"][sent][0] == row["node"]
        assert row["time"] <= events["time"][sent].min() and row["expires"] > row["time"]
    assert wakeups["called"].sum() == (events["kind"] == KIND["called"]).sum() > 0
    assert set(wakeups["foreseen"].tolist()) == {0, 1} and np.all(wakeups["radius"] >= 40.0)
    for row in rows_of_table(estimates):
        mine = wakeups["step"] == row["step"]
        assert row["woken"] == wakeups["woken"][mine].sum()
        assert row["ineffective"] == wakeups["ineffective"][mine].sum()
    assert sleeping["ris"].table("wakeups") == {}


def rows_of_table(columns):
    """A table's rows, as mappings."""
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def test_on_the_bench_estimates_come_at_their_step_nobody_sleeps_and_no_report_is_due():
    done = experiment.simulate_run(scenario.load("rkf", ["duration=20 s", "tracker.kind=ekf"]))
    (track,) = done.tracks
    assert (track["tracked"], track["delay"], track["due"], track["woken"]) == (1.0, 0.0, 0, 0)
    assert np.isnan(track["in_time"])
    assert np.isnan(done.run["awake"]) and done.run["tracked"] == 1.0
