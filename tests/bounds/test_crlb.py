"""Bounds on the tracking error: which exist, and that no tracker of the catalogue is below."""

import dataclasses

import numpy as np
import pytest

from tests.helpers.thorough import thorough
from wsnsim import bounds, read
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.bounds import GAINS, KINDS, PLACES, READINGS, bound, bound_of_run
from wsnsim.bounds.information import RecordedReadings
from wsnsim.experiment import run, simulate_run
from wsnsim.scenario import build, load, resolved, shipped

ON_THE_LINE = {
    "name": "line", "seed": 3, "network": "none", "step": 0.5, "duration": 20.5,
    "prior": {"sd": [2.0, 1.0, 0.1]},
    "deploy": {"kind": "anchors", "places": [[-1000, 0], [2000, 0]]},
    "motion": {"kind": "constant_acceleration", "q": 1e-3, "start": [1, 0.5, 0.01]},
    "sensor": {"kind": "range", "sd": 0.7, "reach": ".inf"},
    "tracker": {"kind": "ekf"},
}  # fmt: skip
RECEIVERS = {
    "name": "receivers", "seed": 3, "network": "none", "step": 1, "duration": 21,
    "prior": {"sd": [1.0, 0.5, 1.0, 0.5]},
    "deploy": {"kind": "anchors", "places": [[0, 0], [20, 0], [0, 20], [20, 20], [10, 10]]},
    "motion": {"kind": "constant_velocity", "noise_input": "diagonal", "variances": [0.02], "start": [4, 0.5, 5, 0.4]},
    "sensor": {"kind": "rssi", "sd": 3, "gain_spread": 4},
    "tracker": {"kind": "ekf"},
}  # fmt: skip
JIANG = {"extends": "scenarios/central_pf.yaml", "duration": "2 s"}


@pytest.mark.thorough
def test_on_a_line_the_bound_is_what_the_kalman_filter_claims_at_every_step(tmp_path):
    result = run(ON_THE_LINE, replicates=3, out=tmp_path / "x.h5").out
    claimed = read(result, "estimates").sd_x.to_numpy().reshape(3, 40)
    for kind in KINDS:
        assert bound(ON_THE_LINE, range(3), kind).rmse == pytest.approx(claimed[0], rel=1e-9)
        assert bound_of_run(result, "arrived", kind).columns[:, 0] == pytest.approx(claimed[2], rel=1e-9)


def test_a_tracker_that_does_not_know_the_gains_has_the_bound_for_unknown_ones():
    blind = {**JIANG, "tracker": {"kind": "ekf", "gains": "unknown"}}
    assert bound(blind, range(2), "per_trajectory").query.gains == "unknown"
    assert np.array_equal(
        bound(blind, range(2), "per_trajectory").each, bound(JIANG, range(2), "per_trajectory", "unknown").each
    )
    assert bound(JIANG, range(2), "per_trajectory").query.gains == "known"


@pytest.mark.thorough
def test_unknown_gains_never_lower_the_bound_and_matter_where_they_differ():
    known, unknown = (bound(JIANG, range(3), "per_trajectory", gains) for gains in GAINS)
    assert np.all(unknown.each >= known.each * (1 - 1e-9)) and unknown.time_mean > 1.05 * known.time_mean
    alike = {**JIANG, "sensor": {"gain_spread": 1e-9}}
    same = [bound(alike, range(2), "per_trajectory", gains).each for gains in GAINS]
    assert same[0] == pytest.approx(same[1], rel=1e-6)
    loose = [bound(JIANG, range(3), gains=gains).rmse for gains in GAINS]
    assert np.array_equal(*loose), "the posterior bound is that for known gains"


@pytest.mark.thorough
def test_errors_of_node_positions_raise_the_bound_of_those_who_do_not_know_them():
    wrong = {**JIANG, "deploy": {"position_error": "2 m"}}
    known, unknown = (bound(wrong, range(3), "per_trajectory", places=places) for places in PLACES)
    assert np.all(unknown.each >= known.each * (1 - 1e-9)) and unknown.time_mean > 1.2 * known.time_mean
    assert np.array_equal(known.each, bound(JIANG, range(3), "per_trajectory").each), "nodes stand where they stand"
    assert bound(wrong, range(3), "per_trajectory").query.places == "unknown"
    assert "node positions" in " ".join(known.cautions) and not unknown.cautions
    both = bound(wrong, range(3), "per_trajectory", "unknown", "unknown")
    assert np.all(both.each >= unknown.each * (1 - 1e-9)) and both.time_mean > 1.01 * unknown.time_mean
    slight = {**JIANG, "deploy": {"position_error": "0.01 mm"}}
    assert bound(slight, range(3), "per_trajectory").each == pytest.approx(known.each, rel=1e-6)
    loose = [bound(wrong, range(3), places=places) for places in PLACES]
    assert np.array_equal(loose[0].rmse, loose[1].rmse) and "node positions" in " ".join(loose[1].cautions)


def test_the_process_noise_that_a_filter_assumes_changes_no_bound():
    assumes = {**JIANG, "tracker": {"kind": "ekf", "assumes": {"noise_scale": 10}}}
    for kind in KINDS:
        assert np.array_equal(bound(assumes, range(2), kind).each, bound(JIANG, range(2), kind).each)


@pytest.mark.thorough
@pytest.mark.parametrize("sensor", [{"kind": "bearing", "sd": 0.02}, {"kind": "range_bearing"}])
def test_directions_have_both_bounds_and_a_filter_comes_near_them(sensor):
    scenario = {
        "extends": "scenarios/bearing.yaml", "duration": "3 s", "sensor": sensor,
        "tracker": {"kind": "ekf", "assumes": {"noise_scale": 1}},
    }  # fmt: skip
    along, over = (bound(scenario, range(8), kind) for kind in reversed(KINDS))
    errors = np.array([simulate_run(scenario, run).errors[0] for run in range(8)])
    assert not along.reason and not over.reason and over.time_mean <= along.time_mean * 1.05
    ratio = np.median(np.sqrt((errors**2).mean(axis=1))) / np.median(along.of_replicates)
    assert 0.8 < ratio < 2.5
    blind = bound({**scenario, "deploy": {"position_error": "1 m"}}, range(3), "per_trajectory")
    assert blind.time_mean > 1.1 * along.time_mean


def test_gains_of_received_power_count_as_unknown_whether_filters_ignore_or_estimate_them():
    known, unknown = (bound(RECEIVERS, range(3), "per_trajectory", gains) for gains in GAINS)
    assert np.all(unknown.each >= known.each * (1 - 1e-9)) and unknown.time_mean > 1.05 * known.time_mean
    for assumed in ("estimated", "unknown"):
        queried = bound({**RECEIVERS, "tracker": {"kind": "ekf", "gains": assumed}}, range(3), "per_trajectory")
        assert queried.query.gains == "unknown" and np.array_equal(queried.each, unknown.each)


def test_more_sensors_never_raise_the_bound_and_fewer_readings_never_lower_it():
    some = [[-1000, 0]]
    before = np.inf
    for more in ([2000, 5], [50, 30], [0, 1]):
        scenario = {**ON_THE_LINE, "deploy": {"kind": "anchors", "places": some}}
        now = bound(scenario, range(2)).rmse
        assert np.all(now <= before)
        before, some = now, [*some, more]
    missing = {**JIANG, "detection": {"kind": "imperfect", "missed": 0.5}}
    for kind in KINDS:
        assert np.all(bound(missing, range(2), kind).rmse > bound(JIANG, range(2), kind).rmse)


@pytest.mark.thorough
def test_the_posterior_bound_is_below_the_mean_over_trajectories():
    for scenario in ({**JIANG, "duration": "12 s"}, "scenarios/ungm_grid.yaml", "scenarios/liu_network.yaml"):
        over, along = (bound(scenario, range(6), kind) for kind in KINDS)
        assert np.all(over.rmse <= along.rmse * (1 + 1e-9)) and over.time_mean < 0.999 * along.time_mean
        assert along.of_replicates.shape == (6,) and along.each.shape == (6, 1, over.rmse.size)


@pytest.mark.parametrize(
    ("scenario", "kinds", "words"),
    [
        ("scenarios/gmtt.yaml", KINDS, "no probability density"),
        ("scenarios/beacons.yaml", KINDS, "no target"),
        ("scenarios/indoor_pf.yaml", ("unconditional",), "room"),
        ({"extends": "scenarios/indoor_pf.yaml", "motion": {"course": "turn"}}, ("unconditional",), "turn"),
        ({**JIANG, "duration": "12 s", "motion": {"noise": "g_only"}}, ("unconditional",), "singular"),
    ],
)
def test_a_bound_that_does_not_exist_gives_its_reason(scenario, kinds, words):
    for kind in KINDS:
        found = bound(scenario, range(2), kind)
        assert (words in found.reason) == (kind in kinds)
        assert np.isnan(found.time_mean) == (found.rmse.size == 0) == bool(found.reason)


def test_a_trajectory_without_process_noise_has_the_bound_of_one():
    calm = {**ON_THE_LINE, "motion": {**ON_THE_LINE["motion"], "truth_noise": False}}
    slope = np.array([[1.0, 0.5, 0.125], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    cov, expected = np.diag([4.0, 1.0, 0.01]), []
    for _ in range(40):
        cov = slope @ cov @ slope.T
        cov = cov - np.outer(cov[0], cov[0]) / (cov[0, 0] + 0.7**2 / 2.0)
        expected.append(np.sqrt(cov[0, 0]))
    for kind in KINDS:
        assert bound(calm, range(2), kind).rmse == pytest.approx(expected, rel=1e-9)


def test_cautions_say_why_a_bound_is_not_strict():
    assert not bound("scenarios/range_anchors.yaml", range(2)).cautions
    assert "fixed prior" in bound("scenarios/range_pf.yaml", range(2)).cautions[0]
    assert "room" in " ".join(bound("scenarios/indoor_pf.yaml", range(2), "per_trajectory").cautions)
    assert "out of range read noise" in " ".join(bound({"extends": "scenarios/rkf.yaml", "duration": 9}, [0]).cautions)
    heard = {"extends": "scenarios/rkf.yaml", "duration": 9, "sensor": {"beyond": "silent"}, "tracker": {"kind": "ekf"}}
    assert not bound(heard, [0]).cautions
    assert "turns back" in bound({**JIANG, "duration": "12 s"}, range(2)).cautions[0] and not bound(JIANG, [0]).cautions


def test_two_targets_have_a_bound_each_and_both_enter_the_mean():
    two = {"extends": "scenarios/two_targets.yaml", "duration": "1.04 s"}
    for kind, count in zip(KINDS, (1, 2), strict=True):
        found = bound(two, range(2), kind)
        assert found.each.shape == (count, 2, 25) and found.columns.shape == (25, 4)
        assert found.rmse == pytest.approx(np.sqrt((found.each**2).mean(axis=(0, 1))))
        assert found.rmse**2 == pytest.approx((found.columns[:, [0, 2]] ** 2).sum(axis=1))


def test_a_wrong_word_and_no_replicates_are_usage_errors():
    for wrong in ({"kind": "uncoditional"}, {"gains": "some"}, {"places": "all"}, {"replicates": ()}):
        with pytest.raises(UsageError):
            bound(ON_THE_LINE, **wrong)


SMALL = {"duration": "2 s", "record": {"events": True}}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "scenario",
    [
        {"extends": "scenarios/pso_mhpf.yaml", **SMALL},
        {"extends": "scenarios/ekf_real.yaml", **SMALL},
        {"extends": "scenarios/central_pf.yaml", **SMALL, "tracker": {"kind": "ekf"}},
    ],
)
def test_as_many_readings_of_a_recorded_run_count_as_the_tracker_used(tmp_path, scenario):
    result = run(scenario, replicates=2, out=tmp_path / "x.h5").out
    estimates, recorded = read(result, "estimates"), RecordedReadings(result, build(load(scenario)))
    for replicate, rows in estimates[estimates.issued.notna()].groupby("replicate"):
        for readings, column in (("active", "active"), ("arrived", "readings")):
            steps = recorded.used(replicate, 0, readings).steps
            assert np.array_equal(np.bincount(steps, minlength=51)[rows.step], rows[column])
    every, active, arrived = (bound_of_run(result, readings).each for readings in READINGS)
    assert np.all(every <= active * (1 + 1e-9)) and np.all(active <= arrived * (1 + 1e-9))
    assert np.array_equal(every, bound(scenario, range(2), "per_trajectory").each)


@pytest.mark.thorough
def test_readings_that_were_lost_raise_the_bound_of_a_run(tmp_path):
    faulty = {"kind": "link_loss", "at": 0.5, "duration": 1.0, "loss": 0.7, "fraction": 1.0}
    scenario = {"extends": "scenarios/central_pf.yaml", **SMALL, "tracker": {"kind": "ekf"}, "faults": [faulty]}
    result = run(scenario, replicates=1, out=tmp_path / "x.h5").out
    active, arrived = (bound_of_run(result, readings).rmse for readings in ("active", "arrived"))
    assert arrived[:12] == pytest.approx(active[:12], rel=1e-12) and arrived[35] > 1.2 * active[35]


@pytest.mark.thorough
def test_a_run_without_events_or_with_other_trajectories_is_refused(tmp_path, monkeypatch):
    result = run(
        {**JIANG, "record": {"events": False}, "tracker": {"kind": "ekf"}}, replicates=1, out=tmp_path / "x.h5"
    ).out
    assert "needs the tables" in bound_of_run(result).reason and not bound_of_run(result, "in_range").reason
    sample = sample_initial_conditions
    monkeypatch.setattr(bounds, "sample_initial_conditions", lambda setup, replicate: sample(setup, replicate + 1))
    with pytest.raises(ResultError, match="another ground-truth"):
        bound_of_run(result, "in_range")


def test_steps_without_an_estimate_do_not_count_beside_a_tracker_that_skips_them():
    found = bound(ON_THE_LINE, range(2), "per_trajectory")
    errors = np.full((2, 1, 40), np.nan)
    errors[:, :, 10:12] = 1.0
    assert found.time_mean_at(errors) == pytest.approx(found.rmse[10:12].mean())
    assert found.time_mean_at(np.zeros((2, 1, 40))) == pytest.approx(found.time_mean)
    errors[1] = np.nan
    each = found.of_replicates_at(errors)
    assert each[0] == pytest.approx(np.sqrt((found.each[0, 0, 10:12] ** 2).mean())) and np.isnan(each[1])
    assert found.of_replicates_at(np.zeros((2, 1, 40))) == pytest.approx(found.of_replicates)


EKF, GRID = {"kind": "ekf"}, {"kind": "grid", "cells": 600}
SHIPPED = {
    "central_pf": ("4 s", EKF), "pso_mhpf": ("3 s", EKF), "pso_mhpf_packed": ("2 s", EKF), "two_targets": ("2 s", EKF),
    "rkf": ("40 s", {"kind": "pf"}), "liu_network": ("40 s", EKF), "range_pf": ("30 s", EKF),
    "range_anchors": ("30 s", EKF), "ungm_grid": ("30 s", GRID), "bearing": ("3 s", EKF),
    "event_triggered": ("5 s", EKF),
}  # fmt: skip


def bound_inputs(name):
    """The part of a scenario that determines its bound."""
    said = resolved(load(name))
    return repr([said.get(role) for role in ("prior", "motion", "targets", "sensor", "step")])


@pytest.mark.thorough
def test_every_shipped_scenario_is_compared_with_its_bound_or_has_none():
    compared = {bound_inputs(name) for name in SHIPPED}
    for name in shipped():
        if bound_inputs(name) not in compared:
            assert bound(name, range(1)).reason, name


def squares(scenario, count):
    """The mean square error of each run over targets and steps, (count,)."""
    return np.array([np.nanmean(simulate_run(scenario, replicate).errors ** 2) for replicate in range(count)])


LONGEST = ("central_pf", "pso_mhpf", "pso_mhpf_packed")


@pytest.mark.thorough(fast=["rkf"])
@pytest.mark.parametrize("name", [*thorough(LONGEST), *(name for name in SHIPPED if name not in LONGEST)])
def test_no_tracker_is_significantly_better_than_the_unconditional_bound(name):
    duration, tracker = SHIPPED[name]
    scenario = {"extends": f"scenarios/{name}.yaml", "duration": duration, "tracker": tracker}
    found, count = bound(scenario, range(8)), 8
    errors = squares(scenario, count)
    most = errors.mean() + 3.0 * errors.std(ddof=1) / np.sqrt(count)
    assert not found.reason and (found.rmse**2).mean() <= most


@pytest.mark.thorough
def test_the_comparison_would_notice_a_bound_that_is_too_high():
    scenario = {**ON_THE_LINE, "tracker": EKF}
    errors, low = squares(scenario, 20), bound(scenario, range(20))
    wrong = dataclasses.replace(low, covariances=2.0 * low.covariances)
    most = errors.mean() + 3.0 * errors.std(ddof=1) / np.sqrt(20)
    assert (low.rmse**2).mean() <= most < (wrong.rmse**2).mean()
