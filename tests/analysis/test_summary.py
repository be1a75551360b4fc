"""The summary's figures are those that a hand would compute from the tables, in the position's own unit."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import statistics
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.stats import chi2

import wsnsim
from wsnsim import experiment, scenario
from wsnsim.analysis import comparison_text, error_bounds, plots, result_info, summary, summary_text
from wsnsim.analysis.comparison import compare
from wsnsim.analysis.quantities import BOUND_NAMES, QUANTITIES, bound_name, interval
from wsnsim.base import metrics
from wsnsim.experiment import Report, Summary
from wsnsim.recording import ResultFile, read_table
from wsnsim.recording.folder import Folder
from wsnsim.report import page_sections

PLANE = (("px", "m"), ("vx", "m/s"), ("py", "m"), ("vy", "m/s"))
NAN = float("nan")


def run_row(errors, network=True, **said):
    """A row of the table `runs` for errors (targets, steps)."""
    known = errors[np.isfinite(errors)]
    return {
        "replicate": 0,
        "steps": errors.shape[1],
        "rmse": math.sqrt(np.mean(known**2)) if known.size else NAN,
        "lost": 0,
        "losses": 0,
        "time_lost": 0.0,
        "lost_share": 0.0,
        "energy": 1.5 if network else NAN,
        "handovers": 4 if network else 0,
        "frames_sent": 30,
        "frames_lost": 2 if network else 0,
        "packets_sent": 50,
        "in_range": 30,
        "delivered": 27,
        "collided": 0,
        "access_failures": 0,
        "retries": 0,
        "cycles": 2_000.0,
        "tracked": 1.0,
        "tracked_three": 0.5,
        "awake": 1.0 if network else NAN,
        "alive": 9,
        "first_death": NAN,
        "half_dead": NAN,
        "coverage": 1.0 if network else NAN,
        "cpu_seconds": 0.1,
        "fingerprint": 7,
        "event_fingerprint": 8,
    } | said


def track_row(errors, **said):
    """A row of the table `tracks` for errors (steps,)."""
    reports = int(np.isfinite(errors).sum())
    return {
        "lost": 0, "lost_at": NAN, "reacquired": 0, "late": len(errors) - reports, "reports": reports, "delay": 0.0,
        "received": 0, "report_delay": NAN, "due": 0, "in_time": NAN, "tracked": 1.0, "tracked_three": 0.5,
        "mean_error": 1.0, "mean_error_three": 1.0, "median_error_three": 1.0, "rmse_three": 1.0, "woken": 0,
        "called": 0, "dismissed": 0,
        "ineffective": 0, "ineffective_twenty": 0,
    } | said  # fmt: skip


def report_of(errors, column_rmse, states=PLANE, position=(0, 2), name="pso_mhpf", **said):
    """A report of replicates with errors (replicates, targets, steps) and column RMSE (replicates, targets, D)."""
    loaded = scenario.load(name)
    network = loaded.network is None
    summaries = tuple(
        Summary(
            run_row(e, network, **said), tuple(map(track_row, e)), e, c, {"rx": 1.5} if network else {}, 3 * network
        )
        for e, c in zip(np.asarray(errors, dtype=float), np.asarray(column_rmse, dtype=float), strict=True)
    )
    return Report(loaded, summaries, Path("x.h5"), 1.0, states, position)


def rows(report, published=None):
    """The text's rows by their first words: name -> the rest of the line."""
    lines = [line for line in summary_text.text(report, published or {}).splitlines() if line.startswith("  ")][1:-1]
    return {name.strip(): rest.strip() for name, _, rest in (line.strip().partition("  ") for line in lines)}


ERRORS = np.arange(1.0, 13.0).reshape(3, 2, 2)  # three replicates, two targets, two steps
COLUMNS = np.arange(1.0, 25.0).reshape(3, 2, 4)


def test_the_rmse_of_a_column_is_the_root_of_the_mean_square_over_replicates_and_targets():
    figures = summary.as_json(report_of(ERRORS, COLUMNS), {})
    for i, (name, _) in enumerate(PLANE):
        squares = [COLUMNS[r, t, i] ** 2 for r in range(3) for t in range(2)]
        assert figures["column_rmse"][name] == pytest.approx(math.sqrt(sum(squares) / 6))
        each = [math.sqrt((COLUMNS[r, 0, i] ** 2 + COLUMNS[r, 1, i] ** 2) / 2) for r in range(3)]
        assert figures["column_rmse_median"][name] == pytest.approx(statistics.median(each))


def test_the_median_over_replicates_is_not_moved_by_a_lost_track():
    errors = np.full((9, 1, 5), 2.0) + 0.1 * np.arange(9)[:, None, None]
    before = summary.as_json(report_of(errors, np.ones((9, 1, 4))), {})
    errors[8] = 1e4
    after = summary.as_json(report_of(errors, np.ones((9, 1, 4))), {})
    assert before["rmse_median"] == after["rmse_median"] == pytest.approx(2.4)
    assert after["rmse"] > 1e3
    assert after["rmse_median_low"] < 2.4 < after["rmse_median_high"] < 3.0


@pytest.mark.thorough
def test_the_interval_of_the_median_covers_the_true_median_as_often_as_it_says():
    """40 draws of 25 runs from an exponential: a 95 % interval misses ln 2 in 2 of them, in 7 at most (3.6 sigma)."""
    rng = np.random.default_rng(3)
    missed = 0
    for _ in range(40):
        low, high = interval(rng.exponential(size=25), metrics.median_error)
        missed += not low <= math.log(2.0) <= high
    assert missed <= 7


def test_fewer_than_five_replicates_have_no_interval():
    figures = summary.as_json(report_of(ERRORS, COLUMNS), {})
    assert math.isnan(figures["rmse_median_low"]) and math.isnan(figures["rmse_low"])
    assert rows(report_of(ERRORS, COLUMNS))["median per-run RMSE"] == f"{figures['rmse_median']:.4f} m"


def test_targets_of_one_replicate_are_drawn_together():
    """Six replicates of two targets whose errors are equal are as certain as six, not as twelve."""
    errors = np.linspace(1.0, 6.0, 6)[:, None, None] * np.ones((6, 2, 3))
    twice = summary.as_json(report_of(errors, np.ones((6, 2, 4))), {})
    once = summary.as_json(report_of(errors[:, :1], np.ones((6, 1, 4))), {})
    assert (twice["rmse_low"], twice["rmse_high"]) == pytest.approx((once["rmse_low"], once["rmse_high"]), rel=1e-12)


def test_every_accuracy_carries_the_positions_own_unit():
    for unit, expected in (("m", "2.0000 m"), ("km", "2.0000 km"), ("", "2.0000")):
        states = (("x", unit), ("v", "m/s"))
        told = rows(report_of(np.full((2, 1, 3), 2.0), np.full((2, 1, 2), 2.0), states, (0,)))
        for name in ("time-averaged RMSE", "median per-run RMSE", "median position error"):
            assert told[name] == expected
        assert told["RMSE of x, v"] == f"2{' ' * bool(unit)}{unit}, 2 m/s"


def test_the_unit_is_that_of_the_position_not_of_the_first_column():
    states = (("v", "m/s"), ("x", "mm"))
    told = rows(report_of(np.ones((2, 1, 3)), np.ones((2, 1, 2)), states, (1,)))
    assert told["median position error"] == "1.0000 mm"


def test_what_the_paper_prints_of_a_column_stands_beside_it():
    report = report_of(ERRORS, COLUMNS)
    published = {"rmse": 2.5, "rmse_px": 0.71, "rmse_vx": 0.4, "rmse_unheard_of": 1.0}
    told = rows(report, published)
    figures = summary.as_json(report, published)["column_rmse"]
    assert told["RMSE of px"].split("  ") == [f"{figures['px']:.4g} m", "0.71 m"]
    assert told["RMSE of vx"].split("  ") == [f"{figures['vx']:.4g} m/s", "0.4 m/s"]
    assert told["RMSE of py"] == f"{figures['py']:.4g} m"
    assert told["time-averaged RMSE"].endswith("2.5000 m")
    assert "unheard" not in summary_text.text(report, published)


def test_without_a_network_there_are_only_the_packets_and_operations_it_would_have_had_to_carry():
    report = report_of(np.ones((4, 1, 10)), np.ones((4, 1, 1)), (("x", ""),), (0,), "ungm_pf", packets_sent=25)
    told = rows(report)
    assert told["load on a network, per step"] == "2.5 packets, 200 operations"
    assert not {"energy spent", "clusters", "bursts sent", "packets sent", "packet delivery ratio"} & set(told)
    assert "nan" not in summary_text.text(report, {})


def test_without_a_network_the_keys_are_the_same_and_null_where_nothing_exists():
    bench = summary.as_json(report_of(np.ones((4, 1, 3)), np.ones((4, 1, 1)), (("x", ""),), (0,), "ungm_pf"), {})
    network = summary.as_json(report_of(ERRORS, COLUMNS), {})
    assert list(bench) == list(network)
    for name in ("energy", "clusters", "handovers", "frames_lost", "coverage"):
        assert math.isnan(bench[name]) and math.isfinite(network[name])
    assert (bench["joules"], bench["packets_sent"], bench["cycles"]) == ({}, 50.0, 2000.0)


def test_with_a_network_its_rows_are_there():
    told = rows(report_of(ERRORS, COLUMNS))
    assert told["energy spent"] == "1.5 J" and told["packet delivery ratio"] == "90.00%"
    assert [told[name] for name in ("clusters", "bursts sent", "bursts lost", "operations computed")] == [
        "3",
        "30",
        "2",
        "2,000",
    ]


def test_runs_without_any_estimate_are_passed_over_and_none_at_all_is_nan():
    errors, columns = np.ones((6, 1, 3)), np.ones((6, 1, 4))
    errors[0], columns[0] = NAN, NAN
    figures = summary.as_json(report_of(errors, columns), {})
    assert (figures["rmse_median"], figures["column_rmse"]["px"], figures["column_rmse_median"]["vy"]) == (1, 1, 1)
    nothing = summary.as_json(report_of(errors * NAN, columns * NAN), {})
    assert math.isnan(nothing["rmse_median"]) and math.isnan(nothing["rmse_low"])
    assert math.isnan(nothing["column_rmse"]["px"])
    assert "RMSE" in summary_text.text(report_of(errors * NAN, columns * NAN), {})


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """A short run of the bench, and its file."""
    path = tmp_path_factory.mktemp("ran") / "x.h5"
    loaded = scenario.load("rkf", ["duration=21 s", "tracker.kind=ekf", "sensor.beyond=silent"])
    return experiment.run(loaded, replicates=6, out=path), path


@pytest.mark.thorough
def test_a_real_runs_figures_are_those_of_its_tables(ran):
    report, path = ran
    figures = summary.as_json(report, {})
    truth, guess, runs = (read_table(path, name) for name in ("truth", "estimates", "runs"))
    after = truth["step"] > 0
    for name in ("px", "vx", "ax"):
        off = guess[name] - truth[name][after]
        assert figures["column_rmse"][name] == pytest.approx(math.sqrt(np.mean(off**2)), rel=1e-12)
        each = np.sqrt(np.mean(off.reshape(6, 20) ** 2, axis=1))
        assert figures["column_rmse_median"][name] == pytest.approx(statistics.median(each), rel=1e-12)
    np.testing.assert_allclose(guess["error"], np.abs(guess["px"] - truth["px"][after]))
    a_step = np.sqrt(np.mean(guess["error"].reshape(6, 20) ** 2, axis=0))
    assert figures["rmse"] == pytest.approx(a_step.mean(), rel=1e-12)
    assert figures["rmse_median"] == pytest.approx(statistics.median(runs["rmse"]), rel=1e-12)
    assert figures["cycles"] == pytest.approx(runs["cycles"].mean())
    assert json.loads(json.dumps(figures))["column_rmse"] == figures["column_rmse"]


@pytest.mark.thorough
def test_info_of_a_bench_has_neither_energy_nor_handovers_and_its_errors_a_unit(ran):
    about, text = result_info.info(ran[1]), result_info.info_text(ran[1])
    assert not {"energy", "handovers", "frames_lost", "alive"} & set(about["figures"])
    assert about["position_unit"] == "m"
    assert "nan" not in text
    assert ["time-averaged", "RMSE", f"{about['figures']['rmse']:.4f}", "m"] in [
        line.split() for line in text.splitlines()
    ]


def test_info_gives_errors_without_a_unit_where_the_position_has_none(tmp_path, rows_of):
    with ResultFile(tmp_path / "x.h5", [("x", "")], {"runs": True}, position=(0,)) as file:
        file.write("runs", rows_of("runs", 1) | {"rmse": 3.25, "energy": NAN})
    assert result_info.info(tmp_path / "x.h5")["position_unit"] == ""
    lines = result_info.info_text(tmp_path / "x.h5").splitlines()
    assert ["median", "per-run", "RMSE", "3.2500"] in [line.split() for line in lines]


def test_late_estimates_reports_to_the_sink_and_what_the_air_lost_have_their_rows():
    report = report_of(ERRORS, COLUMNS, collided=12, retries=3, access_failures=1)
    late = track_row(np.ones(2), late=1, delay=0.0625, received=2, due=3, report_delay=1.5)
    report = Report(
        report.scenario,
        tuple(Summary(s.run, (late, late), s.errors, s.column_rmse, s.joules, 3) for s in report.summaries),
        Path("x.h5"),
        1.0,
        PLANE,
        (0, 2),
    )
    said = rows(report)
    assert said["late estimates"] == "2" and said["latency at the cluster head, median"] == "62.5 ms"
    assert said["estimates received at the sink"] == "4 of 6" and said["end-to-end latency, median"] == "1.5 s"
    assert "steps without an estimate" not in said
    assert said["collided receptions"] == "12" and said["retransmissions"] == "3"
    assert said["channel-access failures"] == "1"


def test_an_undisturbed_air_has_no_rows_of_what_it_lost():
    said = rows(report_of(ERRORS, COLUMNS))
    assert not {"collided receptions", "retransmissions", "channel-access failures"} & set(said)


def with_tracks(report, rows):
    """The report with other rows of `tracks`, one a summary."""
    made = [
        Summary(one.run, (row,), one.errors, one.column_rmse, one.joules, 3)
        for one, row in zip(report.summaries, rows, strict=True)
    ]
    return Report(report.scenario, tuple(made), Path("x.h5"), 1.0, PLANE, (0, 2))


TRACKING = ("steps tracked", "mean position error", "awake time of nodes", "nodes woken, unnecessary wake-ups")


def test_where_nobody_sleeps_and_every_step_is_tracked_nothing_is_said_of_it():
    assert not set(TRACKING) & set(rows(report_of(ERRORS, COLUMNS)))


def test_a_network_that_sleeps_has_its_tracking_probability_with_an_interval_and_who_was_woken():
    """Seven replicates of ten steps: tracked in 4, 5 ... 10 of them, each with its own figures of three readings."""
    report = report_of(np.full((7, 1, 10), 2.0), np.ones((7, 1, 4)), awake=0.25)
    runs = [s.run | {"tracked": (4 + i) / 10, "tracked_three": i / 10} for i, s in enumerate(report.summaries)]
    report = Report(
        report.scenario,
        tuple(Summary(run, *(getattr(s, n) for n in ("tracks", "errors", "column_rmse", "joules", "clusters")))
              for run, s in zip(runs, report.summaries, strict=True)),
        Path("x.h5"), 1.0, PLANE, (0, 2),
    )  # fmt: skip
    three = [
        track_row(np.full(10, 2.0), mean_error_three=i, rmse_three=2.0 * i, median_error_three=3.0 * i, delay=0.03,
                  woken=40 + i, ineffective=5 + i, ineffective_twenty=i, called=20, dismissed=5)
        for i in range(7)
    ]  # fmt: skip
    report = with_tracks(report, three)
    figures, said = summary.as_json(report, {}), rows(report)
    assert figures["tracked"] == pytest.approx(0.7) and figures["tracked_three"] == pytest.approx(0.3)
    assert 0.4 < figures["tracked_low"] < 0.7 < figures["tracked_high"] < 1.0
    assert said["steps tracked"].startswith("70.0%  [")
    assert said["at a run's steps with three readings"] == "RMSE 6.0000 m, mean 3.0000 m, median 9.0000 m"
    assert said["awake time of nodes"] == "25.0%"
    assert said["nodes woken, unnecessary wake-ups"] == "4.3 per step, 0.8 per step"
    assert said["nodes called, dismissed"] == "2 per step, 0.5 per step"
    assert said["unnecessary in the first 20 steps"] == "3"
    assert said["latency at the cluster head, median"] == "30 ms" and said["mean position error"] == "2.0000 m"


@pytest.mark.thorough
def test_the_interval_of_the_tracking_probability_covers_it_as_often_as_it_says():
    """40 draws of 25 runs of 100 steps at p = 0.8: a 95 % interval misses p in 2 of them, in 7 at most (3.6 sigma)."""
    rng = np.random.default_rng(5)
    missed = 0
    for _ in range(40):
        low, high = interval(rng.binomial(100, 0.8, 25) / 100, metrics.mean_error)
        missed += not low <= 0.8 <= high
    assert missed <= 7


def test_a_target_that_was_never_seen_has_no_figures_and_no_word_for_them():
    nothing = report_of(np.full((6, 1, 3), NAN), np.full((6, 1, 4), NAN), tracked=0.0, tracked_three=0.0, awake=0.3)
    blind = {"mean_error_three": NAN, "rmse_three": NAN, "median_error_three": NAN, "delay": NAN, "due": 3}
    said = rows(with_tracks(nothing, [track_row(np.full(3, NAN), **blind)] * 6))
    assert said["steps tracked"] == "0.0%  [0.0%, 0.0%]"
    assert not {
        "mean position error",
        "at a run's steps with three readings",
        "latency at the cluster head, median",
    } & set(said)
    assert said["estimates received at the sink"] == "0 of 3"


@pytest.mark.thorough
def test_bounds_stand_beside_the_error_of_all_readings_of_members_and_of_those_that_arrived(tmp_path):
    loaded = scenario.load("pso_mhpf", ["duration=2 s"])
    report = experiment.run(loaded, replicates=2, out=tmp_path / "x.h5")
    limit = summary.bounds_of_report(report, every=True)
    assert limit.kind == "per_trajectory" and not limit.reason
    assert 0 < limit.rmse < limit.active <= limit.arrived * (1 + 1e-9)
    text = summary_text.text(report, {}, limits=limit)
    for words, value in zip(BOUND_NAMES.values(), (limit.rmse, limit.active, limit.arrived), strict=True):
        assert f"  {words}" in text and f"{value:.4f} m" in text
    figures = summary.as_json(report, {}, limit)
    assert (figures["bound"], figures["bound_arrived"]) == (limit.rmse, limit.arrived)


@pytest.mark.thorough
def test_without_events_there_is_the_bound_of_all_readings_alone_and_without_any_a_reason(tmp_path, ran):
    quiet = experiment.run(
        scenario.load("pso_mhpf", ["duration=1 s", "record.events=false"]), replicates=1, out=tmp_path / "x.h5"
    )
    for report in (quiet, ran[0]):
        limit = summary.bounds_of_report(report, every=True)
        assert limit.rmse > 0 and math.isnan(limit.active) and math.isnan(limit.arrived)
    waypoints = experiment.run(scenario.load("gmtt", ["duration=10 s"]), replicates=1, out=tmp_path / "y.h5")
    assert "no probability density" in summary.bounds_of_report(waypoints).reason
    told = summary_text.text(waypoints, {}, limits=summary.bounds_of_report(waypoints))
    assert "no bound: a motion along given waypoints" in told and "CRLB" not in told


def test_a_run_astray_in_the_middle_is_said_although_it_came_back():
    """One run lost its track twice and found it again, another lost it for good."""
    report = report_of(ERRORS, COLUMNS)
    told = [(2, 3.0, 0.25, 0), (0, 0.0, 0.0, 0), (1, 6.0, 0.5, 1)]
    summaries = tuple(
        dataclasses.replace(s, run=dict(s.run) | {"losses": n, "time_lost": time, "lost_share": share, "lost": end})
        for s, (n, time, share, end) in zip(report.summaries, told, strict=True)
    )
    report = dataclasses.replace(report, summaries=summaries)
    figures, text = summary.as_json(report, {}), rows(report)
    assert (figures["ever_lost"], figures["lost_fraction"]) == pytest.approx((2 / 3, 1 / 3))
    assert (figures["losses"], figures["time_lost"], figures["lost_share"]) == pytest.approx((1.0, 3.0, 0.25))
    assert text["lost at any time"] == "66.7% (2 of 3 runs)"
    assert text["lost at the end"] == "33.3% (1 of 3 runs)"
    assert text["losses of a run, time lost"] == "1, 3 s (25.0% of the steps)"
    assert "losses of a run, time lost" not in rows(report_of(ERRORS, COLUMNS))


@pytest.mark.thorough
def test_terminal_page_info_and_json_have_the_same_names_and_values(tmp_path):
    """Of every quantity that the page shows, in a network with collisions, for one result."""
    loaded = scenario.load("ekf_real", ["duration=2 s"])
    report = experiment.run(loaded, replicates=5, out=tmp_path / "x.h5")
    figures = summary.as_json(report, {}, summary.bounds_of_report(report, every=True))
    about, info_text = result_info.info(report.out), result_info.info_text(report.out)
    terminal = rows(report)
    page = dict(
        re.findall(
            r'<th scope="row"><span [^>]*>([^<]*)</span></th><td>([^<]*)',
            page_sections.summary_table([report.out], ["x"], bounds=True),
        )
    )
    shown = [key for key, quantity in QUANTITIES.items() if quantity.name in page]
    assert {"rmse", "rmse_median", "median_error", "energy", "packet_delivery_ratio"} <= set(shown)
    json_keys = {"lost": "lost_fraction"}
    for key in shown:
        quantity, value = QUANTITIES[key], about["figures"][key]
        assert page[quantity.name].strip() == quantity.text(value, "m")
        cells = [*quantity.name.split(), *quantity.text(value, "m").split()]
        assert cells in [x.split()[: len(cells)] for x in info_text.splitlines()]
        if key != "cpu_seconds":
            assert figures[json_keys.get(key, key)] == pytest.approx(value, rel=1e-12), key
        if quantity.name in terminal:
            assert terminal[quantity.name].startswith(quantity.text(value, "m"))
    assert {QUANTITIES[key].name for key in ("rmse", "rmse_median", "median_error", "energy")} <= set(terminal)
    for readings, key in (("in_range", "bound"), ("active", "bound_active"), ("arrived", "bound_arrived")):
        assert page[BOUND_NAMES[readings]] == f"{figures[key]:.4f} m"


def test_bounds_do_not_need_the_table_of_runs(tmp_path):
    made = scenario.load("ungm_pf", ["duration=3 s", "record.runs=false"])
    report = experiment.run(made, replicates=range(4, 6), out=tmp_path / "x.h5")
    whole = experiment.run(scenario.load("ungm_pf", ["duration=3 s"]), replicates=range(4, 6), out=tmp_path / "y.h5")
    assert summary.bounds_of_report(report) == summary.bounds_of_report(whole)
    assert math.isfinite(summary.bounds_of_report(report).rmse)


def test_where_one_run_decides_a_mean_the_median_stands_beside_it():
    """The NEES of a cloud that collapsed in one run of three, and the joules of one; not where runs are alike."""
    report = report_of(ERRORS, COLUMNS)
    told = [(4.6e75, 0.7, 3, 2.0), (1.2, 0.5, 0, 2.5), (0.8, 0.9, 0, 60.0)]
    summaries = tuple(
        dataclasses.replace(s, run=dict(s.run) | {"nees": n, "nees_median": m, "singular": count, "energy": joules})
        for s, (n, m, count, joules) in zip(report.summaries, told, strict=True)
    )
    figures = summary.as_json(report := dataclasses.replace(report, summaries=summaries), {})
    assert figures["medians"] == {"nees": 1.2, "energy": 2.5}
    assert (figures["nees_median"], figures["nees_median_consistent"], figures["singular"]) == (0.7, 0.6931, 1.0)
    text = rows(report)
    assert text["average NEES of the position"] == "1.53e+75  median over runs: 1.2"
    assert text["median NEES of the position"] == "0.7  consistent: 0.69"
    assert text["singular covariances"] == "1" and text["energy spent"] == "21.5 J  median over runs: 2.5 J"
    assert "singular covariances" not in rows(report_of(ERRORS, COLUMNS))


def test_a_cloud_that_collapses_is_said_wherever_its_nees_is(tmp_path):
    """A particle filter whose ranges are exact to a micrometre: all weight is on one particle."""
    made = scenario.load({
        "name": "collapsed", "seed": 1, "duration": 3.0, "step": 0.5, "network": "none", "replicates": 2,
        "prior": {"sd": [5, 1, 5, 1], "mean": [10, 1.7, 10, 1.7]},
        "motion": {"kind": "waypoints", "points": [[0, 10, 10], [6, 20, 20]]},
        "sensor": {"kind": "range", "sd": 1e-6, "reach": 100}, "tracker": {"kind": "pf", "particles": 50},
        "deploy": {"kind": "anchors", "places": [[0, 0], [40, 0], [0, 40]]},
    })  # fmt: skip
    report = experiment.run(made, out=tmp_path / "x.h5")
    figures, stored = summary.as_json(report, {}), read_table(report.out, "runs")
    estimates = read_table(report.out, "estimates")
    assert figures["singular"] == np.isnan(estimates["nees"]).sum() / 2 > 0.0 and (stored["singular"] > 0).all()
    assert "singular covariances" in rows(report)
    assert "singular covariances" in result_info.info_text(report.out)
    assert "singular covariances" in page_sections.summary_table([report.out], ["x"])


def test_the_median_of_a_consistent_nees_is_that_of_chi_square():
    for size, value in metrics.CONSISTENT_MEDIANS.items():
        assert value == pytest.approx(chi2.ppf(0.5, size) / size, abs=1e-4)


PLACES = ["terminal", "sentence", "sentence of a file", "page", "plot", "comparison"]


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """What each place says of two runs with a fault in which a track is lost, and of the same without the fault."""
    folder = tmp_path_factory.mktemp("faults")
    usual = {"network": "none", "duration": 3, "step": 0.2, "lost.window": 0.6, "lost.limit": 0.5}
    faults = [{"kind": "bias", "at": 0.5, "fraction": 1.0, "offset": 3}]
    return [said_of(folder / "faulty", usual | {"faults": faults}), said_of(folder / "right", usual)]


def said_of(folder, changes):
    folder.mkdir()
    report = experiment.run(scenario.load("ekf_real", changes), replicates=2, out=folder / "x.h5")
    limits = summary.bounds_of_report(report, every=True)
    said = {
        "terminal": summary_text.text(report, {}, limits=limits),
        "sentence": summary.as_json(report, {}, limits)["answer"],
        "sentence of a file": result_info.info(report.out)["answer"],
        "page": page_sections.summary_table([report.out], ["x"], bounds=True),
    }
    axes = plots.error(Figure().subplots(), report.out)
    said["plot"] = axes.get_title(loc="left") + str([text.get_text() for text in axes.get_legend().get_texts()])
    sweep = {"scenario": "ekf_real", "set": changes, "grid": {"tracker.kind": ["ekf", "ukf"]}, "replicates": 2}
    wsnsim.sweep(sweep, out=folder / "sweep", workers=1)
    found = error_bounds.with_bounds(compare(folder / "sweep"), Folder(folder / "sweep"))
    return said | {"comparison": comparison_text.text(found), "json": summary.as_json(report, {}, limits)}


@pytest.mark.parametrize("place", PLACES)
def test_a_bound_beside_runs_with_faults_is_named_as_one_without_faults(shown, place):
    faulty, right = (one[place] for one in shown)
    assert "CRLB" in faulty and "without faults" in faulty
    assert "CRLB" in right and "without faults" not in right


@pytest.mark.parametrize("place", PLACES)
def test_window_and_limit_stand_wherever_the_word_lost_is_printed(shown, place):
    said = shown[0][place]
    assert "lost" in said and re.search(r"\b0\.5 m\b", said) and re.search(r"\b0\.6 s\b", said)


def test_json_says_which_faults_the_bound_does_not_count_and_when_a_track_is_lost(shown):
    faulty, right = (one["json"] for one in shown)
    assert (faulty["faults"], right["faults"]) == (["bias"], [])
    assert (faulty["lost_window"], faulty["lost_limit"]) == pytest.approx((0.6, 0.5)) and faulty["ever_lost"] > 0
    assert bound_name("arrived", ["crash"]) == BOUND_NAMES["arrived"]
    assert bound_name("arrived", ["crash", "stuck"]).endswith(", without faults")
