"""No figure without a value is left without a reason, and what no node can measure is said."""

from __future__ import annotations

import json
import math

import pytest

import wsnsim
from wsnsim import experiment, load
from wsnsim.analysis import notes, summary, summary_text
from wsnsim.cli.shared import group
from wsnsim.scenario import build

FAR = (
    "deploy={kind: anchors, places: [[190, 190], [195, 190], [190, 195]], width: 400 m, height: 400 m, centre: [0, 0]}"
)
HOPELESS = ["duration=1 s", "lost.window=0.4 s", "tracker.kind=ekf", FAR]
LEAVES = [
    "duration=11 s",
    "step=1 s",
    "tracker.kind=ekf",
    "motion={kind: waypoints, points: [[0, -90, 0], [10, 310, 0]]}",
]


def run_of(tmp_path, overrides, name="pso_mhpf", replicates=1):
    return experiment.run(load(name, overrides), replicates=replicates, out=tmp_path / "x.h5")


def test_check_says_that_no_node_can_ever_measure_the_target_and_succeeds(capsys, tmp_path):
    assert (
        group.main(
            ["check", "pso_mhpf", *(word for line in HOPELESS for word in ("--set", line))], standalone_mode=False
        )
        == 0
    )
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "pso_mhpf: ok" and len(said) == 2
    assert said[1].startswith(
        "  note: run 0: target 0 is never within the sensing range of 60 m of a node; the nearest is 3"
    )


def test_check_says_for_how_many_steps_a_trajectory_is_outside_the_nodes():
    first, second = notes.of_setup(build(load("pso_mhpf", LEAVES)))
    assert first.startswith("run 0: target 0 is not within the sensing range of 60 m of any node at ")
    assert "is outside the field of 400 m by 400 m around (0, 0) at 3 of 10 steps" in second


@pytest.mark.parametrize("name", ["pso_mhpf", "gmtt", "ekf_real", "rkf", "range_pf", "ungm_pf", "beacons"])
def test_a_scenario_whose_targets_are_measured_at_every_step_has_no_note(name):
    assert notes.of_setup(build(load(name))) == []


def test_a_deployment_that_fails_is_a_note():
    setup = build(load("pso_mhpf", ["deploy.nodes=60", "deploy.draws=1"]))
    (note,) = notes.of_setup(setup)
    assert note.startswith("run 0 cannot start: deploy: none of 1 sampled deployments")


def test_the_summary_of_a_run_without_an_estimate_says_why(tmp_path):
    report = run_of(tmp_path, HOPELESS)
    text, figures = summary_text.text(report, {}), summary.as_json(report, {})
    assert "nan" not in text and "RMSE unknown (of 0 of 24 steps)" in [
        " ".join(line.split()) for line in text.splitlines()
    ]
    assert "  note: no step has an estimate: there is no error" in text.splitlines()
    assert figures["notes"][1].startswith("run 0: target 0 is never within the sensing range")
    assert figures["unknown"]["rmse"] == figures["unknown"]["column_rmse"] == "no step has an estimate"
    assert figures["unknown"]["rmse_low"] == "no step has an estimate"
    assert figures["unknown"]["tracked_low"] == "an interval needs 5 runs"
    assert figures["unknown"]["packet_delivery_ratio"] == "no frame was sent to a node in range"


def test_a_particle_filter_that_degenerates_is_named_in_the_summary_and_in_a_comparison(tmp_path):
    few = ["duration=4 s", "tracker={kind: pf, particles: 4}", "lost={window: 1 s, limit: 4 m}"]
    report = run_of(tmp_path, few)
    figures = summary.as_json(report, {})
    assert figures["ever_lost"] == 1.0 and figures["nees_median"] > 100.0
    (said,) = [note for note in figures["notes"] if "degenerated" in note]
    assert said.startswith("pf: its 4 particles may have degenerated (median NEES ")
    found = wsnsim.compare(
        load("pso_mhpf", few), trackers=["ekf", "pf:particles=4"], replicates=2, workers=0, out=tmp_path / "c"
    )
    (hint,) = [line for line in str(found).splitlines() if "degenerated" in line]
    assert hint.startswith("- hint: pf:particles=4: its 4 particles may")


@pytest.mark.thorough
def test_the_summary_says_at_how_many_steps_no_node_could_measure_the_target(tmp_path):
    """An extended Kalman filter goes on predicting: its steps have estimates that rest on no measurement."""
    figures = summary.as_json(run_of(tmp_path, LEAVES, replicates=2), {})
    assert figures["without_estimate"] == 0.0 and math.isfinite(figures["rmse"])
    assert figures["notes"][0].startswith("mean of the 2 runs with steps not tracked: target 0 is not within")


@pytest.mark.thorough
def test_the_summary_says_how_many_steps_have_no_estimate(tmp_path):
    figures = summary.as_json(run_of(tmp_path, ["duration=20 s"], "ris"), {})
    missing, steps = figures["without_estimate"], figures["steps"]
    assert 0 < missing < steps and figures["notes"] == [
        f"{missing:.4g} of {steps} steps have no estimate (mean of the runs); errors are over the others"
    ]


@pytest.mark.thorough(fast=["ungm_pf-overrides2"])
@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("pso_mhpf", ["duration=0.4 s", "tracker.kind=ekf"]),
        ("pso_mhpf", HOPELESS),
        ("ungm_pf", []),
        ("ris", ["duration=8 s"]),
    ],
)
def test_every_figure_without_a_value_has_a_reason_of_its_own(tmp_path, name, overrides):
    report = run_of(tmp_path, overrides, name)
    figures = summary.as_json(report, {}, summary.bounds_of_report(report))
    unknown = {key for key, value in figures.items() if isinstance(value, float) and math.isnan(value)}
    unknown |= {key for key in ("column_rmse", "column_rmse_median") if any(map(math.isnan, figures[key].values()))}
    assert figures["unknown"].keys() == unknown
    assert notes.UNKNOWN not in figures["unknown"].values(), figures["unknown"]
    assert json.loads(json.dumps(figures["notes"])) == figures["notes"]
