"""Trackers on duty-cycled radios: the points, the best interval, and the answers on tables that are made up."""

from __future__ import annotations

import functools
import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tests.campaign.inline_engine import InlineEngine
from tests.papers.studies import module
from wsnsim import scenario
from wsnsim.experiment import simulate_run
from wsnsim.papers import reproduce
from wsnsim.papers.study import study

figures = module("duty_cycles")
hypotheses = module("duty_cycles", "hypotheses")
points = module("duty_cycles", "points")
_points = module("duty_cycles", "points")
best = _points.best
_study = module("duty_cycles")
DAY, MEASURES, best_lines, best_points = _study.DAY, _study.MEASURES, _study.best_lines, _study.best_points

PAPER = study("duty_cycles")
REGISTERED = PAPER.registered
LI, JIANG, FOUND, EXACT, WAITING, LI_AGAIN, FOUND_AGAIN, JIANG_AGAIN = PAPER.experiments
SPREAD = 1.0 + 0.01 * np.linspace(-1.0, 1.0, 10)
"""How ten runs vary around a level."""


@functools.cache
def scenarios_of(name):
    """{variant: resolved scenario} of an experiment."""
    (experiment,) = (one for one in PAPER.experiments if one.name == name)
    plan = reproduce.plan("duty_cycles", experiment, full=True)
    return {point.settings["variant"]: json.loads(point.resolved) for point in plan.points}


def test_what_was_registered_before_the_first_run_is_unchanged():
    assert REGISTERED == {
        "usable": {"in_time": 0.9, "error": 1.5},
        "spread": {"csma": {"below": 1.2}, "xmac 125": {"above": 1.2}, "contikimac 125": {"above": 1.2},
                   "xmac 500": {"above": 1.5}},
        "order": {"csma": "tsstp", "xmac 500": "gmtt"}, "in_time": 0.9, "error": 1.25, "tenth": 0.1,
        "radio_on": {"xmac 125": 0.02, "contikimac 125": 0.01}, "lifetime": {"days": 200.0, "busiest": 0.5},
        "latency": {"head": 3.0, "sink": 2.0}, "delivered": 0.9, "follows": {"energy": 1.1},
        "found": {"energy": 1.2, "delivered": 0.8},
        "slow": {"spread": {"csma": {"below": 1.01}, "xmac 125": {"above": 1.2}}, "expert": 0.95},
        "later": {"usable": {"in_time": 0.9, "error": 1.5, "delivered": 0.9}},
    }  # fmt: skip


@pytest.mark.thorough(fast=["found"])
@pytest.mark.parametrize(
    "experiment", [LI, JIANG, FOUND, LI_AGAIN, JIANG_AGAIN, FOUND_AGAIN], ids=lambda each: each.name
)
def test_all_points_of_a_field_are_of_one_world_and_say_what_is_run(experiment):
    plan = reproduce.plan("duty_cycles", experiment)
    assert len({point.world for point in plan.points}) == 1
    for name, one in scenarios_of(experiment.name).items():
        assert one["tracker"]["kind"] == points.tracker_of(name)
        assert one["mac"]["kind"] == points.mac_of(name).partition(" ")[0].removesuffix(",")
        assert one["duration"] == 100.0 + one["step"], "100 s after the step of the start"


@pytest.mark.thorough
def test_the_reference_on_lis_field_is_the_shipped_scenario_and_gives_its_results():
    reference = scenarios_of("li")
    for name in ("gmtt", "tsstp", "cluster", "ris"):
        mine, shipped = reference[f"{name}, csma"], scenario.resolved(scenario.load(name))
        assert {key for key in shipped if mine[key] != shipped[key]} <= {"record", "clusters", "duration", "clock"}
        assert {key for key in shipped["clusters"] if mine["clusters"][key] != shipped["clusters"][key]} == {
            "quiet",
            "cap",
        }
    waits = ({}, {"clusters.quiet": "null", "clusters.cap": "null"})
    sets = [["duration=10 s", *(f"{key}={value}" for key, value in one.items())] for one in waits]
    one, other = (simulate_run(scenario.load("ris", each)).run["fingerprint"] for each in sets)
    assert one == other


@pytest.mark.thorough
@pytest.mark.parametrize(("first", "again"), [(LI, LI_AGAIN), (JIANG, JIANG_AGAIN), (FOUND, FOUND_AGAIN)],
                         ids=lambda each: each.name)  # fmt: skip
def test_the_replication_has_the_points_of_the_first_study_on_another_seed(first, again):
    before, after = scenarios_of(first.name), scenarios_of(again.name)
    seed = {"li": 20261123, "found": 20261123, "jiang": 20261124}[first.name]
    assert {name: {**one, "seed": seed} for name, one in before.items()} == {name: after[name] for name in before}
    assert {one["seed"] for one in after.values()} == {seed} and seed not in {one["seed"] for one in before.values()}
    assert again.full == (10 if first is LI else first.full)
    assert hypotheses.OF_EXPERIMENT[again.name] is hypotheses.OF_EXPERIMENT[first.name]


@pytest.mark.thorough
def test_the_replication_explores_more_points_on_jiangs_field():
    more = scenarios_of("jiang_again").keys() - scenarios_of("jiang").keys()
    macs = {"contikimac 250", "tsch 11", "tsch 31, shared 4", "tsch 11, shared 4"}
    assert {points.mac_of(name) for name in more} == macs and len(more) == 16


def test_jiangs_field_in_slow_motion_has_the_papers_positions_at_its_steps():
    slow, fast = (scenario.build(scenario.load(which)) for which in (scenarios_of("jiang")["ekf, csma"], "ekf_real"))
    walks = [each.motions[0].truth(200, each.dt, np.random.default_rng(3)) for each in (slow, fast)]
    assert (slow.dt, fast.dt) == (1.0, 0.04)
    np.testing.assert_allclose(walks[0][:, [0, 2]], walks[1][:, [0, 2]], rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(25.0 * walks[0][:, [1, 3]], walks[1][:, [1, 3]], rtol=1e-4, atol=1e-3)


class Runs:
    """Data of ten runs of each variant, with columns of `runs` and `tracks` around the levels given."""

    def __init__(self, levels, name="li"):
        self.levels, self.variants = levels, tuple(levels)
        self.registered, self.own = REGISTERED, MEASURES
        self.manifest = type("Manifest", (), {"name": f"duty_cycles_{name}"})
        usual = {"energy": 10.0, "median_error": 1.0, "tracked": 1.0, "tracked_three": 0.9, "awake": 0.3,
                 "radio_on": 0.005, "losses": 0.0}  # fmt: skip
        self.runs = {name: {**usual, **level} for name, level in levels.items()}

    def of(self, variant, table):
        count = self.levels[variant].get("count", 10)
        spread, level = SPREAD[:count], self.runs[variant]
        if table == "nodes":
            joules = [level.get("sink", 9.0), level.get("busiest", 5.0), level.get("idlest", 1.0)]
            rows = [(run, 0.0, float(node), 20.0, 20.0 - joules[node]) for run in range(count) for node in range(3)]
            return pd.DataFrame(rows, columns=["replicate", "x", "y", "energy_initial", "energy_left"])
        if table == "tracks":
            level = {"delay": 0.03, "report_delay": 0.05, "received": 90.0, **level}
            columns = {key: level[key] * spread for key in ("delay", "report_delay")}
            return pd.DataFrame({"replicate": range(count), "received": level["received"], "due": 100.0, **columns})
        columns = {key: level[key] * spread for key in ("energy", "median_error", "tracked", "tracked_three")}
        return pd.DataFrame({"replicate": range(count), "awake": level["awake"], "radio_on": level["radio_on"],
                             "losses": 0, **columns})  # fmt: skip

    def of_runs(self, variant, column):
        return self.of(variant, "runs").set_index("replicate")[column].astype(np.float64)

    def scenario(self, variant):
        return {"sink": {"x": 0.0, "y": 0.0}, "energy": {"battery": 20.0}, "duration": DAY}


def curve(tracker, energies, kind="xmac", **levels):
    """Points of a tracker on CSMA and at these {number in the name: energy}."""
    usual = {f"{tracker}, csma": {"energy": 1000.0}}
    return usual | {f"{tracker}, {kind} {size}": {"energy": joules, **levels.get(f"at{size}", {})}
                    for size, joules in energies.items()}  # fmt: skip


def test_the_best_interval_spends_least_of_those_in_time_with_an_error_near_the_least():
    data = Runs(curve("gmtt", {125: 30.0, 250: 20.0, 500: 15.0, 1000: 12.0}, at500={"median_error": 1.6},
                      at1000={"tracked": 0.8}))  # fmt: skip
    found = best(data, "gmtt", "xmac")
    assert found.interval == (0.25, 0.25, 0.25) and found.usable == (0.125, 0.25)
    assert found.energies[0] == pytest.approx(20.0)
    (line,) = best_lines(data)
    assert line.startswith("gmtt on xmac: best interval 0.25 s [0.25, 0.25], 20.00 [19.9")
    assert line.endswith(" J, best of 4 points")


def test_an_interval_that_loses_reports_is_not_usable_but_answers_what_was_registered_before():
    data = Runs(curve("gmtt", {125: 30.0, 250: 20.0}, at250={"received": 80.0}))  # of 90 on CSMA
    assert best(data, "gmtt", "xmac").usable == (0.125,)
    assert best(data, "gmtt", "xmac", points.usable_as_first_registered).usable == (0.125, 0.25)
    assert best_points(data) == [{"tracker": "gmtt", "mac": "xmac", "csma": "gmtt, csma", "point": "gmtt, xmac 125"}]


def test_errors_are_usable_by_those_on_csma_not_by_the_least():
    data = Runs(curve("gmtt", {125: 30.0, 250: 20.0}, at125={"median_error": 0.5}))
    assert best(data, "gmtt", "xmac").usable == (0.125, 0.25)
    assert best(data, "gmtt", "xmac", points.usable_as_first_registered).usable == (0.125,)


def test_clocks_drift_in_every_experiment_but_the_one_that_shows_what_drift_costs():
    clocks = {
        one.name: {each["clock"]["kind"] for each in scenarios_of(one.name).values()} for one in PAPER.experiments
    }
    assert clocks.pop("exact_clocks") == {"perfect"} and set.union(*clocks.values()) == {"drift"}


def test_no_interval_is_best_where_none_is_usable():
    data = Runs(curve("gmtt", {125: 30.0, 250: 20.0}, at125={"tracked": 0.5}, at250={"median_error": 2.0}))
    found = best(data, "gmtt", "xmac")
    assert np.isnan(found.interval.value) and found.usable == () and np.isnan(found.energies).all()
    assert best_lines(data) == ["gmtt on xmac: best interval none, none of 2 points is usable"]


def test_a_kind_of_mac_with_one_point_leaves_no_choice():
    assert best_lines(Runs(curve("gmtt", {125: 30.0})))[0].endswith(" J, the only point: no choice")
    lost = Runs(curve("gmtt", {125: 30.0}, at125={"tracked": 0.5}))
    assert best_lines(lost) == ["gmtt on xmac: best interval none, the only point is not usable"]


def test_the_range_of_a_best_interval_has_those_that_resamples_choose():
    uneven = 20.1 + 2.0 * (-1.0) ** np.arange(10)
    assert best(Runs(curve("gmtt", {125: uneven, 250: 20.0})), "gmtt", "xmac").interval == (0.25, 0.125, 0.25)


def test_resamples_without_a_usable_interval_are_left_out_and_counted():
    uneven = np.where(np.arange(10) < 6, 1.0, 3.0)
    data = Runs(curve("gmtt", {125: 30.0}, at125={"median_error": uneven}))
    found = best(data, "gmtt", "xmac")
    assert 0.05 < found.without < 0.5 and np.isnan(found.energies).mean() == pytest.approx(found.without, abs=0.01)
    (line,) = best_lines(data)
    assert re.search(r"30\.00 \[2\d\.\d+, 30\.\d+\] J \(\d+% of the resamples have none\)", line)
    answer = next(each for each in hypotheses.li(data) if each.words.startswith("6"))
    assert answer.answer == "yes" and np.isfinite(answer.found[0]).all()


def test_points_are_compared_over_the_runs_that_all_of_them_have():
    data = Runs({"gmtt, csma": {}, "gmtt, xmac 125": {"count": 6}, "gmtt, xmac 250": {"count": 0}})
    assert points.run(data) == ("gmtt, csma", "gmtt, xmac 125")
    assert points.common_runs(data).tolist() == [0, 1, 2, 3, 4, 5]
    assert points.ratio(data, "gmtt, csma", "gmtt, xmac 125", "mean:energy")[0] == pytest.approx(1.0)


def test_a_mac_is_told_from_its_twin_with_another_word():
    names = ["gmtt, csma", "gmtt, xmac 62.5", "gmtt, xmac 500", "gmtt, xmac 500, near 125", "gmtt, tsch 11"]
    data = Runs({name: {} for name in names})
    assert points.intervals(data, "gmtt", "xmac") == {0.0625: names[1], 0.5: names[2]}
    assert points.intervals(data, "gmtt", "tsch") == {0.11: names[4]}
    assert points.kinds(data) == ["xmac", "tsch"] and points.trackers(data) == ["gmtt"]


def test_slotframes_with_more_shared_cells_are_a_kind_of_their_own():
    names = ["ekf, csma", "ekf, tsch 31", "ekf, tsch 31, shared 4", "ekf, tsch 11, shared 4"]
    data = Runs({name: {} for name in names})
    assert points.intervals(data, "ekf", "tsch") == {0.31: names[1]}
    assert points.intervals(data, "ekf", "tsch, shared 4") == {0.11: names[3], 0.31: names[2]}
    assert points.kinds(data) == ["tsch", "tsch, shared 4"]


def test_lifetimes_and_reports_are_those_of_the_runs():
    data = Runs({"gmtt, csma": {"sink": 10.0, "busiest": 5.0, "idlest": 3.0}, "gmtt, xmac 125": {"received": 80.0}})
    assert MEASURES["days"](data, "gmtt, csma").tolist() == pytest.approx([20.0 / 6.0] * 10)
    assert MEASURES["days_busiest"](data, "gmtt, csma").tolist() == pytest.approx([20.0 / 5.0] * 10)
    assert MEASURES["delivered"](data, "gmtt, xmac 125").tolist() == pytest.approx([0.8] * 10)


def test_a_radio_that_always_listens_is_on_while_its_node_is_awake():
    data = Runs({"gmtt, csma": {"radio_on": float("nan")}, "gmtt, xmac 125": {}})
    assert MEASURES["radio_on"](data, "gmtt, csma").tolist() == [0.3] * 10
    assert MEASURES["radio_on"](data, "gmtt, xmac 125").tolist() == [0.005] * 10


TRACKERS = ("gmtt", "tsstp", "cluster", "ris")


def field(**changes):
    """Li's field on which every hypothesis holds, but for `changes` of points ('gmtt, xmac 125' as gmtt__xmac_125)."""
    at = {"csma": (1100.0, 1200.0, 1100.0, 1050.0), "xmac 125": (30.0, 34.0, 30.0, 26.0),
          "xmac 500": (40.0, 30.0, 38.0, 20.0), "xmac 1000": (30.0, 30.0, 30.0, 30.0),
          "contikimac 125": (20.0, 22.0, 20.0, 15.0), "contikimac 500": (20.0, 20.0, 20.0, 15.0)}  # fmt: skip
    levels = {f"{tracker}, {mac}": {"energy": joules} for mac, row in at.items()
              for tracker, joules in zip(TRACKERS, row, strict=True)}  # fmt: skip
    for tracker in TRACKERS:
        levels[f"{tracker}, csma"] |= {"radio_on": float("nan")}
        levels[f"{tracker}, xmac 125"] |= {"delay": 0.2, "busiest": 5.0}
        levels[f"{tracker}, xmac 500"] |= {"tracked_three": 0.5}
        levels[f"{tracker}, xmac 1000"] |= {"tracked": 0.5}
        levels[f"{tracker}, contikimac 125"] |= {"busiest": 0.05, "idlest": 0.002, "sink": 0.003}
    levels["gmtt, xmac 125"] |= {"median_error": 0.5}  # so that its best interval is 125 ms
    levels |= {f"{tracker}, xmac 500, near 125": {"energy": 40.0 if tracker == "gmtt" else 31.0}
               for tracker in ("gmtt", "tsstp")}  # fmt: skip
    levels |= {"gmtt, tsch 11": {}, "gmtt, tsch 101": {"tracked": 0.5}}  # fmt: skip
    for name, change in changes.items():
        levels[name.replace("__", ", ").replace("_", " ")] |= change
    return Runs(levels)


def given(answers):
    """{number of a hypothesis: its answers}."""
    found: dict[int, list[str]] = {}
    for each in answers:
        found.setdefault(int(each.words.partition(":")[0]), []).append(each.answer)
    return found


@pytest.mark.thorough
def test_the_answers_on_lis_field_follow_from_the_rows():
    found = given(hypotheses.li(field()))
    assert sorted(found) == [*range(1, 13), 14]
    assert [number for number, answers in found.items() if {*answers} != {"yes"}] == []
    assert all(line.startswith("registered ") for line in hypotheses.lines(field()))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("number", "changes", "answer"),
    [
        (1, {"ris__csma": {"energy": 700.0}}, "no"),
        (1, {"ris__xmac_125": {"energy": 30.0}}, "no"),
        (2, {"gmtt__xmac_500": {"energy": 25.0}}, "no"),
        (3, {"ris__contikimac_125": {"tracked": 0.8}}, "no"),
        (3, {"cluster__xmac_500": {"tracked_three": 0.9}}, "no"),
        (4, {"tsstp__xmac_125": {"median_error": 1.5}}, "no"),
        (4, {"tsstp__xmac_125": {"median_error": 1.25}}, "undecided"),
        (5, {"ris__contikimac_500": {"energy": 30.0}}, "no"),
        (6, {f"ris__xmac_{size}": {"energy": 200.0} for size in (125, 500, 1000)}, "no"),
        (6, {f"ris__xmac_{size}": {"tracked": 0.1} for size in (125, 500, 1000)}, "no"),
        (7, {"tsstp__xmac_500": {"energy": 50.0}, "ris__xmac_500": {"energy": 50.0}}, "no"),
        (8, {"ris__xmac_125": {"radio_on": 0.05}}, "no"),
        (9, {"gmtt__contikimac_125": {"idlest": 1.0}}, "no"),
        (10, {"gmtt__xmac_125": {"delay": 0.05}}, "no"),
        (10, {"gmtt__xmac_125": {"report_delay": 3.0}}, "no"),
        (11, {"cluster__xmac_125": {"received": 50.0}}, "no"),
        (12, {"gmtt__xmac_500__near_125": {"energy": 60.0}}, "no"),
        (14, {"gmtt__tsch_101": {"tracked": 1.0}}, "no"),
    ],
)  # fmt: skip
def test_a_point_that_is_otherwise_changes_the_answer(number, changes, answer):
    assert answer in given(hypotheses.li(field(**changes)))[number]


def test_a_hypothesis_on_a_point_that_has_not_been_run_is_undecided():
    only = {"gmtt, csma": {}, "tsstp, csma": {"energy": 13.0}}
    answers = hypotheses.li(Runs(only))
    known = [each for each in answers if "(not run)" not in each.words]
    assert {each.answer for each in answers if "(not run)" in each.words} == {"undecided"}
    assert [each.words.partition(":")[0] for each in known] == ["1", "2"]


def test_the_answer_on_found_routes_follows_from_the_rows():
    levels = {"gmtt, xmac 250": {}, "gmtt, xmac 250, ctp": {"energy": 15.0}}
    assert given(hypotheses.found_routes(Runs(levels, "found"))) == {13: ["yes", "yes"]}
    levels["gmtt, xmac 250, ctp"] |= {"received": 60.0, "energy": 11.0}
    assert given(hypotheses.found_routes(Runs(levels, "found"))) == {13: ["no", "no"]}


def test_the_answers_on_jiangs_field_follow_from_the_rows():
    names = ("ekf", "gpf", "pso_mhpf", "information_driven")
    levels = {f"{name}, csma": {"energy": 3190.0} for name in names}
    levels |= {f"{name}, xmac 125": {"energy": joules} for name, joules in zip(names, (60, 61, 80, 40), strict=True)}
    levels |= {"ekf, xmac 250": {"tracked_three": 0.5}, "information_driven, xmac 250": {"tracked_three": 0.8}}
    assert given(hypotheses.jiang(Runs(levels, "jiang"))) == {15: ["yes"] * 2, 16: ["yes"] * 3, 17: ["yes"]}
    levels["ekf, xmac 125"]["energy"] = 40
    assert given(hypotheses.jiang(Runs(levels, "jiang")))[16] == ["no", "yes", "yes"]


@pytest.mark.thorough(fast=["reference alone-by_interval"])
@pytest.mark.parametrize("draw", [*figures.FIGURES])
@pytest.mark.parametrize("data", [field(), Runs({"gmtt, csma": {}})], ids=["all points", "reference alone"])
def test_a_figure_has_a_line_for_each_tracker(draw, data):
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    figures.FIGURES[draw](figure, data)
    (legend,) = figure.legends
    assert {*points.trackers(data)} <= {text.get_text() for text in legend.get_texts()}


def test_an_interval_with_lost_runs_does_not_set_the_axis_of_errors():
    lost = np.where(np.arange(10) < 5, 1.0, 1e4)
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    figures.against_joules(figure, Runs(curve("gmtt", {125: 30.0, 250: 20.0}, at125={"median_error": lost})))
    worst = points.value(
        Runs(curve("gmtt", {125: 30.0}, at125={"median_error": lost})), "gmtt, xmac 125", "median:error"
    )
    assert figure.axes[0].get_ylim()[1] <= 3.0 * worst.value < 3.0 * worst.high


def test_points_without_an_error_leave_the_axis_of_errors_to_the_others():
    unknown, lost = {"median_error": np.nan}, {"median_error": np.where(np.arange(10) < 5, 1.0, 1e4)}
    for at250 in (unknown, lost):
        data = Runs(curve("gmtt", {125: 30.0, 250: 20.0}, at125=unknown, at250=at250))
        data.runs["gmtt, csma"] |= unknown
        figure = Figure(figsize=(9.0, 6.0), layout="constrained")
        figures.against_joules(figure, data)
        FigureCanvasAgg(figure).draw()
        other = Figure(figsize=(9.0, 6.0), layout="constrained")
        figures.by_interval(other, data)
        FigureCanvasAgg(other).draw()
    assert figure.axes[0].get_ylim()[1] <= 3.0 * points.value(data, "gmtt, xmac 250", "median:error").value


@pytest.mark.thorough
@pytest.mark.parametrize("whole", [LI, JIANG], ids=["li", "jiang"])
def test_a_few_short_runs_give_rows_answers_and_figures(whole, tmp_path, monkeypatch):
    kept = [name for name in whole.variants if points.tracker_of(name) in ("gmtt", "ris", "ekf")]
    claims = tuple(one for one in whole.claims if one.variant in kept)
    small = replace(whole, quick=2, variants={name: whole.variants[name] for name in kept}, claims=claims,
                    quick_sets=("duration=10 s",))  # fmt: skip
    monkeypatch.setattr(reproduce, "LocalEngine", InlineEngine)
    assert reproduce.resume(reproduce.begin("duty_cycles", small, tmp_path), 1).complete
    folder = reproduce.folder_of(tmp_path, "duty_cycles", small)
    rows = reproduce.rows("duty_cycles", small, folder)
    assert len(rows) == len(claims) and {row.verdict for row in rows} == {"not published"}
    said = reproduce.summary("duty_cycles", small, folder)
    assert all(re.match(r"registered \d+: |\w+ on \w+: best interval ", line) for line in said)
    assert all(file.stat().st_size > 10_000 for file in reproduce.draw("duty_cycles", small, folder, tmp_path))
