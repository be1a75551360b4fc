"""What is said of a result whose readings name no target is what its tables hold, assigned afterwards."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import wsnsim
from tests.helpers import unlabelled
from tests.helpers.recordings import recording
from wsnsim.analysis.answer import sentence
from wsnsim.analysis.multi_target import followed_runs, gospa_table, is_unlabelled, least_localisation, swaps
from wsnsim.analysis.quantities import worth_showing
from wsnsim.analysis.result_facts import ResultFacts, facts_of_file
from wsnsim.analysis.result_info import info_text
from wsnsim.analysis.trace import as_json, text, trace
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.base.multi_target import gospa
from wsnsim.base.tables import UNLABELLED
from wsnsim.recording import read_table
from wsnsim.verification import verify


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return unlabelled.write_result(tmp_path_factory.mktemp("made") / "x.h5")


def test_the_tracks_of_a_file_follow_its_targets_as_the_run_itself_found(path):
    for run in followed_runs(path):
        truth = unlabelled.truth_of(run.replicate, 2)
        np.testing.assert_array_equal(run.truth, truth)
        tracks = unlabelled.rows_of(truth, run.replicate)
        assert all(np.array_equal(a, b) for a, b in zip(run.tracks, tracks, strict=True))
        assert run.rule == (unlabelled.LIMIT, 4, unlabelled.DT)
        assert run.switches.tolist() == [[8, 0, 3, 5], [8, 1, 5, 3]]
        assert np.isfinite(run.errors).sum() == 12 + 10
    assert [run.replicate for run in followed_runs(path, [1])] == [1]


def test_gospa_of_several_cutoffs_is_that_of_each(path):
    found = gospa_table(path, [1.0, 4.0, 50.0])
    assert len(found) == 2 * 3 * unlabelled.STEPS
    run = next(followed_runs(path))
    for i, c in enumerate((1.0, 4.0, 50.0)):
        own = found[(found.replicate == 0) & (found.cutoff == c)]
        expected = gospa(run.truth, run.tracks, [1.0, 4.0, 50.0])
        np.testing.assert_array_equal(own.gospa, expected.distance[i])
        np.testing.assert_array_equal(own.gospa_false, expected.false[i])
        assert own.step.tolist() == list(range(1, 13)) and own.time.iloc[-1] == 6.0
    by_default = gospa_table(path)
    own = by_default[by_default.replicate == 0]
    recorded = read_table(path, "runs")
    for name in ("gospa", "gospa_localisation", "gospa_missed", "gospa_false"):
        assert np.sqrt((own[name] ** 2).mean()) == pytest.approx(recorded[name][0])


@pytest.mark.parametrize(("cutoffs", "order"), [([0.0], 2.0), ([4.0, -1.0], 2.0), ([np.nan], 2.0), ([4.0], 0.5)])
def test_a_wrong_cutoff_or_order_is_named(path, cutoffs, order):
    with pytest.raises(UsageError, match=r"cutoffs: expected positive numbers|order: expected a number from 1 on"):
        gospa_table(path, cutoffs, order)


def test_a_labelled_result_has_no_tracks_to_assign():
    labelled = recording("pso_mhpf")
    assert not is_unlabelled(labelled)
    with pytest.raises(ResultError, match="readings name their targets"):
        gospa_table(labelled)


def test_a_result_without_the_truth_has_no_gospa_over_time_but_what_its_runs_say(tmp_path):
    path = unlabelled.write_result(tmp_path / "x.h5", without=("truth",))
    with pytest.raises(ResultError, match="truth"):
        gospa_table(path)
    assert "followed at" in sentence(facts_of_file(path))


def test_the_sentence_says_what_the_tables_hold(path):
    facts, runs = facts_of_file(path), read_table(path, "runs")
    assert sentence(facts) == (
        f"The 2 targets were followed at 100 % of their steps in both runs, with a GOSPA of {runs['gospa'].mean():.3g}"
        f" m (c = 4 m; missed targets 0 m, false tracks {runs['gospa_false'].mean():.3g} m, localisation"
        f" {runs['gospa_localisation'].mean():.3g} m), 2 identity switches a run and 600 false tracks an hour;"
        " no network is simulated, so no energy is spent."
    )
    assert (
        f"localisation {runs['gospa_localisation'].mean():.3g} m, which is"
        f" {runs['gospa_localisation'].mean() / 0.5:.2f} times the trajectory-conditional CRLB with known association"
        " of 0.5 m)" in sentence(facts, 0.5)
    )


def test_the_sentence_of_an_empty_field_counts_false_tracks(tmp_path):
    path = unlabelled.write_result(tmp_path / "x.h5", runs=1, targets=0)
    assert sentence(facts_of_file(path)).startswith(
        "No target existed in the run, and there were 600 false tracks an hour; "
    )


def test_every_column_about_tracks_is_shown_where_readings_name_no_target_and_only_there(path):
    assert {*UNLABELLED} <= worth_showing(facts_of_file(path)).keys()
    assert "GOSPA, missed targets" in info_text(path) and "OSPA(2)" in info_text(path)
    assert not {*UNLABELLED} & worth_showing(facts_of_file(recording("pso_mhpf"))).keys()


def test_the_least_localisation_counts_only_targets_that_a_track_follows():
    least = np.full((1, 2, 2), 3.0)
    errors = np.array([[[1.0, np.nan], [1.0, 1.0]]])
    assert least_localisation(least, errors) == pytest.approx(np.sqrt((9.0 + 9.0 + 9.0) / 2))
    assert np.isnan(least_localisation(least, np.full((1, 2, 2), np.nan)))


def test_errors_of_facts_are_those_of_the_tracks_that_follow(path):
    facts = facts_of_file(path)
    runs = list(followed_runs(path))
    np.testing.assert_array_equal(facts.recorded.errors, np.stack([run.errors for run in runs]))
    assert isinstance(facts, ResultFacts) and facts.unlabelled


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Two short runs of a network with two targets whose motion has a bound."""
    motion = {"kind": "constant_velocity", "variances": [0.05, 0.05], "start_sd": [3, 1, 3, 1]}
    targets = [motion | {"start": [-9, 1, -9, 1]}, motion | {"start": [9, -1, 9, 1]}]
    small = {"deploy": {"kind": "jittered_grid", "nodes": 9, "width": 90, "height": 90}, "duration": 6, "name": "small"}
    scenario = {"extends": "scans_crossing", "targets": targets, **small}
    return wsnsim.run(scenario, replicates=2, out=tmp_path_factory.mktemp("run") / "small.h5")


def test_a_run_of_a_network_has_the_metrics_of_its_own_tables(result):
    """What the summary has in memory, the file gives again; the errors in `tracks` are of the tracks that follow."""
    runs, table, found = list(followed_runs(result.out)), wsnsim.gospa(result.out), facts_of_file(result.out)
    for run, row in zip(runs, result.runs.itertuples(), strict=True):
        again = run.columns()
        assert {name: getattr(row, name) for name in UNLABELLED} == pytest.approx(again, nan_ok=True)
        own = result.table("tracks").query("replicate == @run.replicate")
        rmse = [np.sqrt(np.nanmean(errors**2)) if np.isfinite(errors).any() else np.nan for errors in run.errors]
        assert own["rmse"].to_numpy() == pytest.approx(rmse, nan_ok=True)
        assert np.sqrt(np.nanmean(run.errors**2)) == pytest.approx(row.rmse)
    pd.testing.assert_frame_equal(table, wsnsim.gospa(result))
    assert found.recorded.errors.shape == (2, 2, 5)


def test_a_run_of_a_network_says_its_localisation_beside_the_bound(result):
    figures = result.to_dict(bounds=True)
    assert {*UNLABELLED} <= figures.keys() and figures["bound_localisation"] > 0.0
    assert "the trajectory-conditional CRLB with known association of" in figures["answer"]
    said = result.summary(bounds=True)
    assert "least localisation, known association" in said and "it leaves out clutter" in said
    assert "GOSPA, localisation" in said and "false tracks an hour" in said
    assert not {*UNLABELLED} & wsnsim.simulate("rkf", duration=2).to_dict().keys()


def test_gospa_refuses_what_is_no_result():
    with pytest.raises(UsageError, match="result: expected what wsnsim"):
        wsnsim.gospa(3)


def test_a_stored_run_is_run_again_bit_by_bit_and_has_its_bound(result):
    """The scenario in a file has all defaults, those of the inner filter too."""
    assert verify(result.out).ok
    assert "CRLB with known association" in info_text(result.out)


def test_a_switched_identity_is_an_event_of_its_step_in_a_trace_and_of_no_other(path):
    found = swaps(path, 0)
    assert {(row["step"], row["target"], row["track"], row["before"]) for row in found} == {(8, 0, 5, 3), (8, 1, 3, 5)}
    step = trace(path, 8)
    assert as_json(step)["swaps"] == found
    assert [line.text for line in step.lines if "swap" in line.text] == [
        "swap: track 5 follows target 0, as track 3 did before",
        "swap: track 3 follows target 1, as track 5 did before",
    ]
    assert "swap: track 5 follows target 0" in text(step)
    assert [row["target"] for row in trace(path, 8, target=1).swaps] == [1]
    assert not trace(path, 7).swaps
