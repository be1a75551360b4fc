"""The answer of a result is a true sentence: of shipped scenarios, and of tables with every kind of outcome."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wsnsim
from wsnsim import experiment
from wsnsim.analysis import result_info, summary
from wsnsim.analysis.answer import answer, energy_clause, lifetime_clause, percent, sentence, sink_clause
from wsnsim.analysis.result_facts import RecordedErrors, ResultFacts, facts_of_file
from wsnsim.bounds import bound_of_run
from wsnsim.scenario import load

NAN = float("nan")
BOUND = "a time-averaged RMSE of # m, # times the trajectory-conditional CRLB of # m"
ERROR = "a time-averaged RMSE of # m"
SHOWN_RULE = "(error above # m or no estimate for # s)"
RULE = "(error above 20 m or no estimate for 4 s)"
OF_FILTER = "no network is simulated, so no energy is spent."
SINK = "# % of the estimates due at the sink arrived, after # ms (median)"
SHIPPED = [
    ("pso_mhpf", 2, ["duration=2 s", "tracker.particles=40"],
     f"The target was followed in both runs, with {BOUND};"
     " the network spent # mJ a run, of which # mJ is transmission."),
    ("ekf_real", 2, ["duration=2 s"],
     f"The target was followed in both runs (tracked at # % of the steps), with {BOUND}; {SINK};"
     " the network spent # J a run, of which # J is idle listening."),
    ("two_targets", 1, ["duration=1 s", "tracker.particles=40"],
     f"Both targets were followed throughout the run, with {BOUND};"
     " the network spent # mJ, of which # mJ is transmission."),
    ("lifetime", 1, ["duration=2 s", "tracker.particles=40", "energy.battery=0.002 J", "lost.window=0.2 s"],
     f"The target was lost {SHOWN_RULE} and not found again (for # % of the steps), with {BOUND};"
     " the network spent # mJ, of which # mJ is transmission;"
     " the first node died after # s, and # are alive at the end."),
    ("li_xmac", 1, ["duration=32 s"],
     f"The target was followed throughout the run, with {ERROR}; {SINK};"
     " the network spent # J, of which # J is idle listening."),
    ("gmtt", 2, ["duration=32 s"],
     f"The target was followed in both runs, with {ERROR}; {SINK};"
     " the network spent # J a run, of which # J is idle listening."),
    ("information_driven_asleep", 1, ["duration=4 s"],
     "The target was never located: no step of the run has an estimate;"
     " the network spent # mJ, of which # mJ is idle listening."),
    ("ungm_pf", 5, [],
     "Over # runs the filter has a time-averaged RMSE of #, # times the trajectory-conditional CRLB of #; "
     + OF_FILTER),
    ("indoor_pf", 5, [],
     f"The target was lost {SHOWN_RULE} in # of # runs; the other # have {ERROR} (# m over all runs), # times the"
     f" trajectory-conditional CRLB of # m; {OF_FILTER}"),
    ("range_pf", 4, [],
     f"The target was lost {SHOWN_RULE} in all # runs (and found again in # of these), with {BOUND}; {OF_FILTER}"),
    ("recorded_pf", 1, ["duration=20 s"],
     f"The target was followed throughout the run (tracked at # % of the steps), with {ERROR}; {OF_FILTER}"),
    ("beacons", 1, ["duration=2 s"],
     "# % of the intended receptions of beacons succeeded (# % were lost in collisions);"
     " the network spent # mJ, of which # mJ is transmission."),
    ("collection", 1, ["duration=45 s", "deploy.nodes=30"],
     "# % of the reports reached one of # sinks, after # ms (median) over # hops (mean);"
     " the network spent # J, of which # J is idle listening."),
    ("time_sync", 1, ["duration=65 s"],
     "All intended receptions of beacons succeeded; the network spent # J, of which # J is idle listening."),
]  # fmt: skip
"""(scenario, number of runs, changes, the answer with # for every number)."""


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "runs", "changes", "expected"), SHIPPED, ids=[case[0] for case in SHIPPED])
def test_a_shipped_scenario_is_answered_alike_from_the_run_and_from_its_file(tmp_path, name, runs, changes, expected):
    report = experiment.run(load(name, changes), replicates=runs, out=tmp_path / "x.h5")
    said = answer(report)
    assert re.sub(r"\d+(,\d{3})*(\.\d+)?", "#", said) == expected
    assert answer(report.out) == said == result_info.info(report.out)["answer"]


@pytest.mark.thorough
def test_the_numbers_of_the_answer_are_those_of_the_tables(tmp_path):
    report = experiment.run(
        load("pso_mhpf", ["duration=2 s", "tracker.particles=40"]), replicates=3, out=tmp_path / "x.h5"
    )
    runs, tracked, energy = (wsnsim.read(report.out, name) for name in ("runs", "estimates", "energy"))
    rmse = tracked.assign(square=tracked["error"] ** 2).groupby("step")["square"].mean().pow(0.5).mean()
    bound = bound_of_run(report.out, "in_range").time_mean
    sent = energy[energy["cause"].isin(["tx_electronics", "tx_amplifier"])]["joules"].sum() / 3
    assert answer(report) == (
        f"The target was followed in all 3 runs, with a time-averaged RMSE of {rmse:.3g} m, {rmse / bound:,.0f} times"
        f" the trajectory-conditional CRLB of {bound:.3g} m; the network spent {1e3 * runs['energy'].mean():.3g} mJ"
        f" a run, of which {1e3 * sent:.3g} mJ is transmission."
    )
    assert summary.as_json(report, {}, summary.bounds_of_report(report))["answer"] == answer(report)
    assert answer(report.out) == answer(report)


def facts(errors=None, joules=None, tracks=None, limit=20.0, workload="tracking", **columns):
    """Facts of runs with errors (runs, targets, steps) and columns of `runs`."""
    count = len(next(iter(columns.values())))
    runs = {"replicate": np.arange(count), "losses": np.zeros(count), "lost": np.zeros(count)}
    runs |= {"energy": np.full(count, NAN), "tracked": np.ones(count)}
    runs |= {"lost_window": np.full(count, 4.0), "lost_limit": np.full(count, limit)}
    runs |= {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    errors = np.ones((count, 1, 4)) if errors is None else np.asarray(errors, dtype=float)
    recorded = RecordedErrors(np.arange(count), np.arange(1, errors.shape[-1] + 1), errors)
    return ResultFacts(runs, tracks or {}, {}, recorded, joules or {}, "m", workload)


def test_errors_of_runs_with_a_loss_are_left_out_and_the_losses_counted():
    errors = np.ones((5, 1, 4))
    errors[:2] = 1e3
    some = facts(errors, losses=[1, 2, 0, 0, 0], lost=[0, 1, 0, 0, 0])
    assert sentence(some, 0.5) == (
        f"The target was lost {RULE} in 2 of 5 runs (and found again in 1 of these); the other 3 have a time-averaged"
        " RMSE of 1 m (632 m over all runs), 2.0 times the trajectory-conditional CRLB of 0.5 m; " + OF_FILTER
    )
    most = facts(errors, losses=[1, 2, 1, 0, 0], lost=[0, 1, 0, 0, 0])
    assert "the other 2 have a time-averaged RMSE of 1 m (632 m over all runs); " in sentence(most, 0.5)
    every = facts(np.full((2, 1, 4), 3.0), losses=[1, 1], lost=[1, 1])
    assert sentence(every).startswith(f"The target was lost {RULE} in both runs, with a time-averaged RMSE of 3 m; ")


@pytest.mark.parametrize(("lost", "expected"), [
    ({"losses": [0]}, "The target was followed throughout the run, with"),
    ({"losses": [2], "lost_share": [0.4]}, f"The target was lost {RULE} but found again (for 40 % of the steps), with"),
    ({"losses": [1], "lost": [1]}, f"The target was lost {RULE} and not found again, with"),
    ({"losses": [0, 0, 0], "tracked": [0.5, 0.7, 0.6]}, "The target was followed in all 3 runs (tracked at 60 % of"),
])  # fmt: skip
def test_losses_are_told_of_one_run_as_of_many(lost, expected):
    assert sentence(facts(**lost)).startswith(expected)


def test_an_error_above_half_of_the_limit_is_not_called_following():
    assert sentence(facts(np.full((2, 1, 4), 11.0), losses=[0, 0])) == (
        f"The target was never lost in both runs {RULE}, but with a time-averaged RMSE of 11 m; " + OF_FILTER
    )


def test_where_few_runs_decide_the_error_the_median_run_stands_beside_it():
    errors = np.ones((4, 1, 4))
    errors[3] = 19.0
    assert sentence(facts(errors, losses=[0] * 4, rmse=[1.0, 1.0, 1.0, 19.0]), 0.5).startswith(
        "The target was followed in all 4 runs, with a time-averaged RMSE of 9.54 m, 19 times the"
        " trajectory-conditional CRLB of 0.5 m (few runs decide this mean: the median per-run RMSE is 1 m,"
        " 2.0 times the CRLB); "
    )


def test_several_targets_are_counted_and_a_loss_is_of_one_of_them():
    three = {"target": np.array([0.0, 1.0, 2.0])}
    assert sentence(facts(np.ones((1, 3, 4)), tracks=three, losses=[0])).startswith("All 3 targets were followed")
    assert sentence(facts(np.ones((1, 3, 4)), tracks=three, losses=[1])).startswith(f"A target was lost {RULE} but")
    nothing = facts(np.full((1, 3, 4), NAN), tracks=three, losses=[1])
    assert sentence(nothing).startswith("The targets were never located: no step of the run has an estimate;")


@pytest.mark.parametrize(("present", "said"), [
    ([[10.0]], "The target was followed while present in the run, with a time-averaged RMSE of 1 m; no network"),
    ([[10.0, 0.0]], "The target that existed was followed while present in the run, with a time-averaged RMSE of 1 m; "
                    "target 1 never existed in the run; "),
    ([[10.0, 0.0], [0.0, 3.0]], "Both targets were followed while present in both runs, with"),
    ([[0.0, 0.0, 5.0, 5.0]], "The 2 targets that existed were followed while present in the run, with"),
    ([[0.0, 0.0]], "No target existed: none is present at any step of the run; no network"),
])  # fmt: skip
def test_targets_are_followed_while_present_and_those_that_never_exist_are_named(present, said):
    there = np.array(present)
    errors = np.where(there[:, :, None] > 0.0, np.ones(4), NAN)
    tracks = {"time_present": there, "target": np.tile(np.arange(there.shape[1], dtype=float), (len(there), 1))}
    assert sentence(facts(errors, tracks=tracks, losses=[0] * len(there))).startswith(said)


def test_without_recorded_errors_the_median_over_the_runs_stands_in():
    bare = facts(np.empty((0, 0, 0)), rmse=[1.0, 3.0, 900.0], losses=[0, 0, 1])
    assert "the other 2 have a median per-run RMSE of 2 m (3 m over all runs);" in sentence(bare, 0.5).replace(
        ", 4.0 times", ";"
    )


def test_idle_listening_of_radios_that_are_always_on_is_the_same_for_every_tracker():
    idle = {"idle": 559.0, "rx": 3.0, "tx_electronics": 1.0}
    always = facts(joules=idle, energy=[563.0, 563.0], awake=[1.0, 1.0])
    assert energy_clause(always) == (
        "the network spent 563 J a run, of which 559 J is idle listening: trackers hardly differ in energy here"
    )
    for other in ({"awake": [0.9, 1.0]}, {"awake": [1.0, 1.0], "radio_on": [0.1, 0.1]}):
        assert not energy_clause(facts(joules=idle, energy=[563.0, 563.0], **other)).endswith("here")


def test_energy_without_one_dominant_use_names_two_and_both_parts_of_transmission_count_as_one():
    spent = {"rx": 0.4, "tx_electronics": 0.2, "tx_amplifier": 0.1, "cpu": 0.3}
    assert energy_clause(facts(joules=spent, energy=[1.0])) == (
        "the network spent 1 J, of which 0.4 J is reception and 0.3 J is transmission"
    )
    assert energy_clause(facts(joules={"rx": 0.4}, energy=[1.0])) == "the network spent 1 J"
    assert energy_clause(facts(joules={"idle": 310.1, "rx": 0.2}, energy=[310.3])) == (
        "the network spent 310 J, nearly all of it idle listening"
    )
    assert energy_clause(facts(energy=[0.0])) == "the network spent no energy"


def test_deaths_are_told_with_their_median_only_if_half_of_the_runs_have_one():
    assert lifetime_clause(facts(first_death=[NAN, NAN])) == ""
    assert lifetime_clause(facts(first_death=[4.0, NAN, NAN], alive=[8, 9, 10])) == (
        "nodes died in 1 of 3 runs, and 9 are alive at the end (mean)"
    )
    assert lifetime_clause(facts(first_death=[4.0, 6.0], alive=[8, 9])) == (
        "nodes died in both runs, the first after 5 s (median), and 8.5 are alive at the end (mean)"
    )


def test_of_reports_that_never_reached_the_sink_there_is_no_latency():
    due = {"due": np.array([10.0, 10.0]), "received": np.zeros(2), "report_delay": np.full(2, NAN)}
    assert sink_clause(facts(tracks=due, energy=[1.0])) == "0 % of the estimates due at the sink arrived"
    assert sink_clause(facts(tracks={"due": np.zeros(2), "received": np.zeros(2)}, energy=[1.0])) == ""


def test_a_share_says_all_or_nothing_only_if_it_is():
    assert [percent(share) for share in (0.0, 0.001, 0.5, 0.999, 1.0)] == [
        "0 %", "less than 1 %", "50 %", "more than 99 %", "100 %",
    ]  # fmt: skip
    assert [percent(share, 1) for share in (0.9994, 0.9999)] == ["99.9 %", "more than 99.9 %"]


def test_without_a_finished_run_there_is_no_answer():
    assert sentence(ResultFacts({})) == ""


def test_the_energy_of_a_file_by_cause_is_that_of_its_table(real):
    spent, runs = wsnsim.read(real, "energy"), wsnsim.read(real, "runs")
    sums = spent.groupby("cause", observed=True)["joules"].sum() / len(runs)
    assert facts_of_file(real).joules == pytest.approx(sums.to_dict())


RUNS_OF_ANY_KIND = st.lists(
    st.fixed_dictionaries(
        {
            "losses": st.sampled_from([0, 0, 1, 3]),
            "lost": st.sampled_from([0, 0, 1]),
            "tracked": st.sampled_from([0.0, 0.3, 1.0, NAN]),
            "error": st.sampled_from([1.0, 9.0, 11.0, 25.0, NAN]),
        }
    ),
    min_size=1,
    max_size=3,
)


@settings(max_examples=20)
@given(RUNS_OF_ANY_KIND, st.sampled_from([20.0, float("inf")]))
def test_the_sentence_never_contradicts_the_table_below_it(rows, limit):
    columns = {name: [row[name] for row in rows] for name in ("losses", "lost", "tracked")}
    errors = np.array([row["error"] for row in rows])
    said = sentence(facts(np.repeat(errors, 4).reshape(-1, 1, 4), limit=limit, **columns))
    lost = np.array([max(row["losses"], row["lost"]) > 0 for row in rows])
    tracked = np.nan_to_num(np.array(columns["tracked"]), nan=1.0)
    assert "nan" not in said and " inf " not in said
    if "followed" in said:
        assert not lost.any() and tracked.all()
        assert np.nanmean(errors) <= limit / 2.0
    if "never lost" in said or "never measured" in said:
        assert not lost.any()
    if "never measured" in said:
        assert not tracked.any()
    if "never located" in said:
        assert np.isnan(errors).all()
    if found := re.search(r"was lost in (\d+ of \d|both|all)", said):
        count = int(found[1].split()[0]) if found[1][0].isdigit() else len(rows)
        assert count == lost.sum()


def test_a_target_whose_nodes_are_all_unknown_was_not_followed():
    assert sentence(facts(tracked=[0.0])) == (
        "The target was never measured in the run (all estimates are predictions), with a time-averaged RMSE of 1 m; "
        + OF_FILTER
    )
    said = sentence(facts(tracked=[0.0, 1.0]))
    assert said.startswith(
        "The target was never lost in both runs (error above 20 m or no estimate for 4 s) (tracked at 50 % of"
    )
