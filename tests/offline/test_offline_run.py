"""The bench: a run without a network gives the same tables, and the same truth and readings as one with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wsnsim
from wsnsim import experiment, recording, scenario, verification
from wsnsim.base.errors import RunError, ScenarioError
from wsnsim.base.tables import Memory
from wsnsim.models.ranging import Range
from wsnsim.offline import loopback
from wsnsim.offline.loopback import sample_readings
from wsnsim.trackers.bootstrap_pf import Pf

GROWTH = {
    "name": "growth",
    "network": "none",
    "step": 1,
    "duration": 21,
    "prior": {"sd": [1]},
    "motion": {"kind": "ungm"},
    "sensor": {"kind": "squared"},
    "tracker": {"kind": "pf", "particles": 50},
}


def ran(source, *overrides: str, replicate: int = 0):
    memory = Memory()
    summary = wsnsim.experiment.simulate_run(wsnsim.load(source, overrides), replicate, memory)
    return memory, summary


def test_a_filter_alone_writes_truth_estimates_and_figures_of_its_own_state_columns():
    memory, summary = ran(GROWTH)
    truth, estimates = memory.table("truth"), memory.table("estimates")
    assert truth["x"].size == 21 and estimates["x"].size == 20
    assert np.array_equal(estimates["error"], np.abs(estimates["x"] - truth["x"][1:]))
    assert summary.run["rmse"] == pytest.approx(np.sqrt(np.mean(estimates["error"] ** 2)))
    assert summary.column_rmse[0, 0] == pytest.approx(summary.run["rmse"])
    assert "sd_y" not in estimates and np.all(estimates["readings"] == 1)
    assert np.isnan(summary.run["energy"]) and memory.table("events") == {} and summary.clusters == 0


def test_the_same_seed_repeats_and_replicates_differ():
    first, again, other = (ran(GROWTH, replicate=k)[1].run["fingerprint"] for k in (3, 3, 4))
    assert first == again != other


@pytest.mark.thorough
def test_the_file_has_the_columns_and_the_units_of_the_state(tmp_path: Path):
    report = experiment.run(scenario.load(GROWTH), replicates=2, out=tmp_path / "growth.h5")
    about = recording.attributes(report.out)
    assert about["states"] == (("x", ""),) and about["position"] == (0,)
    frame = wsnsim.read(report.out, "estimates")
    assert list(frame.columns)[4:9] == ["issued", "x", "sd_x", "error", "head"]
    assert len(frame) == 40 and frame.error.notna().all()
    assert verification.verify(report.out).ok


@pytest.mark.thorough
@pytest.mark.parametrize("tracker", ["ekf", "pf"])
def test_with_all_sensors_in_one_cluster_the_network_gives_the_benchs_estimates(tracker):
    """So truth, prior and readings are the same; for the particle filter, the tracker's own draws are, too."""
    changes = (
        f"tracker.kind={tracker}",
        "duration=40 s",
        "link.reach=2000",
        "sensor.reach=3000",
        "clusters.kind=central",
    )
    network, _ = ran("liu_network", *changes)
    alone, _ = ran("liu_network", *changes, "network=none")
    assert np.array_equal(network.table("truth")["px"], alone.table("truth")["px"])
    for column in ("px", "vx", "ax", "readings"):
        assert np.array_equal(network.table("estimates")[column], alone.table("estimates")[column])
    assert set(alone.table("estimates")["readings"].tolist()) == {8}


def test_on_the_bench_all_readings_arrive_and_are_counted_as_a_network_would_carry_them():
    _, summary = ran("rkf", "duration=11 s")
    assert (summary.run["frames_sent"], summary.run["packets_sent"]) == (70, 70)  # seven sensors besides the head
    assert summary.run["cycles"] > 0
    memory, _ = ran("rkf", "duration=11 s", "sensor.beyond=silent", "tracker.kind=ekf")
    assert set(memory.table("estimates")["readings"].tolist()) == {3}  # those within 400 m of the start


def test_a_sensor_out_of_reach_has_no_reading_unless_it_reads_noise():
    points, positions = np.array([[0.0], [10.0]]), np.array([[0.0, 1.0], [30.0, 0.0]])
    silent = sample_readings(Range(reach=25.0, sd=0.1), points, positions, np.empty((2, 0)), 5)
    noisy = sample_readings(Range(reach=25.0, sd=0.1, beyond="noise"), points, positions, np.empty((2, 0)), 5)
    assert np.isfinite(silent).tolist() == [[True, False], [True, True]]
    assert np.isfinite(noisy).all() and abs(noisy[0, 1]) < 1.0
    assert np.array_equal(silent[1], noisy[1])


def test_readings_do_not_depend_on_how_many_steps_are_drawn_at_a_time(monkeypatch):
    whole = ran("rkf", "duration=30 s")[1].run["fingerprint"]
    monkeypatch.setattr(loopback, "MOST_AHEAD", 56)
    assert ran("rkf", "duration=30 s")[1].run["fingerprint"] == whole


def test_several_targets_are_followed_one_after_the_other():
    two = {**GROWTH, "targets": [{"kind": "ungm"}, {"kind": "ungm", "start": [5.0]}]}
    del two["motion"]
    memory, summary = ran(two)
    assert summary.errors.shape == (2, 20)
    assert set(memory.table("truth")["target"].tolist()) == {0, 1}


def test_the_particles_are_written_if_they_are_wanted():
    memory = Memory({"particles": True})
    wsnsim.experiment.simulate_run(wsnsim.load(GROWTH), 0, memory)
    table = memory.table("particles")
    for step in (1, 20):
        mine = table["step"] == step
        assert mine.sum() == 50 and table["weight"][mine].sum() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("until.clusters=3", "without a network there are no clusters to end at"),
        ("network=nonne", "network: error: unknown value 'nonne' (did you mean 'none'?)"),
        ("lost.limit=-1", "lost.limit: error: must be greater than 0, is -1"),
        ("prior.sd=[1, 2]", "prior.sd: error: 2 values for a state of 1 columns: x"),
        ("tracker.gains=unknown", "tracker.assumes.gains: error: squared has no gains that could be unknown"),
    ],
)
def test_what_a_bench_cannot_do_is_refused(change, message):
    with pytest.raises(ScenarioError) as refused:
        scenario.build(scenario.load(GROWTH, [change]))
    assert message in str(refused.value).replace("--set ", "")


def test_roles_of_a_network_may_be_left_out_on_the_bench_alone():
    networked = {key: value for key, value in GROWTH.items() if key != "network"}
    with pytest.raises(ScenarioError) as refused:
        scenario.load(networked)
    missing = [line.partition(":")[0] for line in str(refused.value).splitlines() if "is missing" in line]
    assert sorted(missing) == ["deploy", "energy", "link"]


class NotFinite(Pf):
    """Loses its number in the third step."""

    def filtered(self, pool, seen, scene):
        belief = super().filtered(pool, seen, scene)
        return belief if scene.step < 3 else replace(belief, mean=np.array([np.nan]))


def test_a_tracker_that_fails_names_seed_replicate_and_time():
    problem = replace(scenario.build(scenario.load(GROWTH)), tracker=NotFinite(particles=5))
    message = r"the run failed at 3 s of simulated time \(seed 0, replicate 1\): the tracker's estimate .* not finite"
    with pytest.raises(RunError, match=message):
        experiment.replicate_of(problem, 1, Memory())
