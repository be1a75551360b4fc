"""Many standalone runs at once have the tables of the same runs one by one."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import wsnsim.scenario as scenario
from wsnsim import experiment
from wsnsim.base.errors import RunError
from wsnsim.base.tables import Memory
from wsnsim.cli import main
from wsnsim.offline import batch, offers_batch
from wsnsim.offline.batch import Batches
from wsnsim.recording import read_table, read_text
from wsnsim.trackers.bootstrap_pf import Pf
from wsnsim.verification import _excuses

TABLES = dict.fromkeys(("runs", "tracks", "nodes", "truth", "estimates", "covariances"), True)
CASES = {
    "bootstrap, resampled at every step": ("range_pf", ["duration=8 s"]),
    "bootstrap, one column of position": ("ungm_pf", ["duration=20 s"]),
    "bootstrap in a field, resampled at times": (
        "central_pf",
        ["network=none", "duration=1 s", "tracker.particles=60"],
    ),
    "bootstrap, few sensors in reach": (
        "central_pf",
        ["network=none", "duration=2 s", "tracker.particles=50", "sensor.reach=20 m", "deploy.cover=false"],
    ),
    "Gaussian particle filter": ("indoor_gpf", ["tracker.particles=30"]),
    "Gaussian particle filter, silent steps": (
        "central_pf",
        ["network=none", "duration=2 s", "tracker.kind=gpf", "sensor.reach=15 m", "deploy.cover=false"],
    ),
    "extended Kalman filter": ("rkf", ["duration=20 s", "tracker.kind=ekf"]),
    "relaying filter": ("rkf", ["duration=15 s"]),
    "relaying filter, sensors that come and go": (
        "central_pf",
        ["network=none", "duration=1 s", "tracker.kind=rkf", "sensor.reach=20 m", "deploy.cover=false"],
    ),
    "one filter per sensor": ("imsf", ["duration=15 s"]),
    "one filter per sensor, sensors that come and go": (
        "central_pf",
        ["network=none", "duration=1 s", "tracker.kind=imsf", "sensor.reach=20 m", "deploy.cover=false"],
    ),
    "losses, some of which end": (
        "central_pf",
        [
            "network=none",
            "duration=4 s",
            "tracker.kind=ekf",
            "lost.window=0.2 s",
            "lost.limit=3 m",
            "deploy.nodes=60",
            "deploy.cover=false",
        ],
    ),
    "two targets": ("two_targets", ["network=none", "duration=1 s", "tracker.kind=central_pf", "tracker.particles=40"]),
    "extended Kalman filter, silent steps": (
        "central_pf",
        ["network=none", "duration=2 s", "tracker.kind=ekf", "sensor.reach=15 m", "deploy.cover=false"],
    ),
}


def _setup(case: str) -> Any:
    name, changes = CASES[case]
    return scenario.build(scenario.load(name, changes))


def _differing(one: Memory, other: Memory) -> list[str]:
    """Columns that are not equal bit by bit, `cpu_seconds` apart."""
    found = []
    for table in TABLES:
        left, right = one.table(table), other.table(table)
        assert list(left) == list(right) and left
        found += [f"{table}.{name}" for name in left if not np.array_equal(left[name], right[name], equal_nan=True)]
    return [name for name in found if name != "runs.cpu_seconds"]


def _batched(setup: Any, replicates: list[int]) -> tuple[Memory, list[Any]]:
    memory, summaries = Memory(TABLES), []
    batches = Batches(setup, memory)
    while len(summaries) < len(replicates):
        done = batches.next(replicates[len(summaries) :])
        assert done, "the engine must not hand back a run"
        summaries += done
    return memory, summaries


@pytest.mark.thorough(
    fast=[
        "bootstrap in a field, resampled at times",
        "Gaussian particle filter, silent steps",
        "one filter per sensor, sensors that come and go",
    ]
)
@pytest.mark.parametrize("case", CASES)
def test_tables_of_a_batch_are_those_of_single_runs_bit_by_bit(case):
    setup, replicates, composed = _setup(case), [3, 0, 1, 7], Memory(TABLES)
    alone = [experiment.replicate_of(setup, replicate, composed) for replicate in replicates]
    memory, summaries = _batched(setup, replicates)
    assert _differing(composed, memory) == []
    for one, other in zip(alone, summaries, strict=True):
        assert one.run.keys() == other.run.keys()
        assert [row.keys() for row in one.tracks] == [row.keys() for row in other.tracks]
        np.testing.assert_array_equal(one.errors, other.errors)
        np.testing.assert_array_equal(one.column_rmse, other.column_rmse)


def _file(path: Any, batch: bool, record: str) -> Any:
    source = scenario.load("range_pf", ["duration=6 s", f"record.{record}=true"])
    experiment.run(source, replicates=range(2, 9), out=path, batch=batch)
    return path


@pytest.mark.thorough
def test_files_of_both_engines_have_equal_tables_and_say_which_engine_made_them(tmp_path):
    paths = [_file(tmp_path / f"{batch}.h5", batch, "covariances") for batch in (True, False)]
    assert [json.loads(read_text(path, "provenance_json"))["engine"] for path in paths] == ["batch", "composed"]
    for table in ("runs", "tracks", "truth", "estimates", "covariances"):
        one, other = (read_table(path, table) for path in paths)
        assert list(one["replicate"][[0, -1]]) == [2, 8]
        for name in one.keys() - {"cpu_seconds"}:
            np.testing.assert_array_equal(one[name], other[name], err_msg=f"{table}.{name}")


def test_runs_whose_particles_are_recorded_are_composed(tmp_path):
    path = _file(tmp_path / "x.h5", True, "particles")
    assert json.loads(read_text(path, "provenance_json"))["engine"] == "composed"
    assert len(read_table(path, "particles")["weight"])


def test_a_network_and_a_tracker_without_the_port_are_not_offered():
    assert offers_batch(_setup("two targets"))
    assert not offers_batch(scenario.build(scenario.load("central_pf")))
    assert not offers_batch(scenario.build(scenario.load("range_cs_pf")))


def test_a_tracker_that_inherits_whole_runs_and_has_a_step_of_its_own_is_composed():
    class Renamed(Pf):
        particles = 30

    class Shifted(Pf):
        def filtered(self, pool, seen, scene):
            raise AssertionError("asked in composed runs only")

    setup = _setup("bootstrap, one column of position")
    assert offers_batch(replace(setup, tracker=Renamed()))
    assert not offers_batch(replace(setup, tracker=Shifted()))


def test_an_option_that_is_not_offered_is_composed(tmp_path):
    source = scenario.load("rkf", ["duration=4 s", "tracker.kind=ekf", "tracker.readings=nearest"])
    report = experiment.run(source, replicates=3, out=tmp_path / "x.h5")
    assert [summary.run["replicate"] for summary in report.summaries] == [0, 1, 2]
    assert json.loads(read_text(tmp_path / "x.h5", "provenance_json"))["engine"] == "composed"


def test_progress_names_the_last_run_of_each_block(tmp_path):
    seen: list[int] = []
    source = scenario.load("range_pf", ["duration=2 s"])
    experiment.run(source, replicates=40, out=tmp_path / "x.h5", progress=lambda each: seen.append(each.replicate))
    assert seen == sorted(seen) and seen[-1] == 39


@pytest.mark.thorough
@pytest.mark.parametrize(("flags", "batched"), [([], True), (["--no-batch"], False)])
def test_the_command_line_makes_batches_unless_told_not_to(tmp_path, capsys, flags, batched):
    path = str(tmp_path / "x.h5")
    words = ["run", "ungm_pf", "--set", "duration=3 s", "--replicates", "3", "--out", path, "--quiet", *flags]
    assert main(words) == 0 and main(["info", path]) == 0 and main(["verify", path]) == 0
    assert ("engine       batch" in capsys.readouterr().out) == batched


def test_runs_whose_measurements_take_too_much_memory_are_composed(monkeypatch):
    setup = _setup("bootstrap, one column of position")
    assert len(Batches(setup, Memory({})).next([0])) == 1
    monkeypatch.setattr(batch, "MOST_NUMBERS", setup.steps)
    assert Batches(setup, Memory({})).next([0]) == []


def test_whole_runs_of_another_shape_are_refused(tmp_path, monkeypatch):
    made = Pf.whole_runs
    monkeypatch.setattr(Pf, "whole_runs", lambda self, block: made(self, block)._replace(cycles=np.zeros(9)))
    with pytest.raises(
        RunError, match=r"failed \(seed \d+, replicate 0\): whole_runs: cycles must have the shape \(1,\), not \(9,\)"
    ):
        experiment.run(scenario.load("ungm_pf", ["duration=2 s"]), replicates=2, out=tmp_path / "x.h5")


def test_files_of_a_plug_ins_whole_runs_are_verified_with_a_tolerance():
    made = {"engine": "batch", "plugins": ["tracker mine"]}
    assert _excuses(made, {}) == ["engine"]
    assert _excuses({**made, "engine": "composed"}, {}) == _excuses({**made, "plugins": []}, {}) == []


@pytest.mark.parametrize(
    "place", ["wsnsim.trackers.bootstrap_pf.cloud_runs", "wsnsim.offline.loopback.sample_readings"]
)
def test_a_failure_of_a_block_says_how_to_find_its_run(tmp_path, monkeypatch, place):
    def fail(*arguments):
        raise ZeroDivisionError("no reading")

    monkeypatch.setattr(place, fail)
    said = "ZeroDivisionError: no reading; --no-batch says at what simulated time"
    with pytest.raises(RunError, match=rf"^the run failed \(seed \d+, replicate 0\): {said}$"):
        experiment.run(scenario.load("ungm_pf", ["duration=2 s"]), replicates=2, out=tmp_path / "x.h5")
    setup = scenario.build(scenario.load("ungm_pf", ["duration=2 s"]))
    said = said.replace("says", "says in which, and")
    with pytest.raises(RunError, match=rf"^one of 2 runs .* failed \(seed \d+, replicates 3 to 4\): {said}$"):
        batch.run_batch(setup, [3, 4], Memory({}))


def test_blocks_keep_their_memory_where_many_sensors_measure():
    setup = _setup("bootstrap, one column of position")
    assert batch._most_runs(setup, 1) == batch.MOST_RUNS
    for sensors in (10**4, 10**5):
        runs = batch._most_runs(setup, sensors)
        assert runs >= 1 and runs * sensors * (setup.steps + 1) <= batch.MOST_NUMBERS
    assert batch._most_runs(setup, 10**9) == 0, "not even one"
