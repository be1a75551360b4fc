import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from tests.campaign.inline_engine import InlineEngine
from tests.papers.studies import module
from tests.papers.tables_of_runs import TablesOfRuns
from wsnsim import scenario
from wsnsim.papers import measures, reproduce
from wsnsim.papers.study import study

figures = module("frontier", "figures")
frontier_strategies = module("frontier", "strategies")
_study = module("frontier")
MEASURES, arrived = _study.MEASURES, _study.arrived
_settings = module("frontier", "settings")
stored = _settings.stored
_strategies = module("frontier", "strategies")
Strategy = _strategies.Strategy
CHOSEN, twin = _settings.CHOSEN, _settings.twin

EXPERIMENT = study("frontier").experiments[0]
VARIANTS = EXPERIMENT.variants
SMALL = ("ideal: ekf", "ideal: ekf, nearest", "slots: ekf", "10 % awake: ekf")


def resolved(plan):
    return {point.settings["variant"]: json.loads(point.resolved) for point in plan.points}


@pytest.fixture(scope="module")
def quick():
    return reproduce.plan("frontier", EXPERIMENT)


@pytest.mark.thorough
def test_every_variant_is_a_scenario_that_builds_and_all_are_of_one_world(quick):
    assert [point.settings["variant"] for point in quick.points] == list(EXPERIMENT.variants)
    assert quick.replicates == EXPERIMENT.quick >= 5
    assert len({point.world for point in quick.points}) == 1
    for one in resolved(quick).values():
        scenario.build(scenario.load(one))


@pytest.mark.thorough
def test_a_full_run_is_as_long_as_a_run_of_the_paper_and_a_quick_one_half_as_long(quick):
    few = replace(EXPERIMENT, variants={name: EXPERIMENT.variants[name] for name in SMALL})
    full = reproduce.plan("frontier", few, full=True)
    assert full.replicates == EXPERIMENT.full > EXPERIMENT.quick
    assert {one["duration"] for one in resolved(full).values()} == {28.04}
    assert {one["duration"] for one in resolved(quick).values()} == {14.04}


def test_a_name_says_what_is_run(quick):
    for name, one in resolved(quick).items():
        air, _, strategy = name.partition(": ")
        kind, *words = strategy.split(", ")
        tracker = one["tracker"]
        assert tracker["kind"] == kind
        assert one["mac"]["kind"] == ("ideal" if air == "ideal" else "csma" if air.startswith("CSMA") else "tdma")
        assert one["sleep"]["kind"] == ("ris" if air.endswith("awake") else "event_wake")
        assert one["sink"]["kind"] == "none"
        if kind in ("pso_mhpf", "ppf"):
            usual = "own" if kind == "pso_mhpf" else "all"
            said = {"own readings": "own", "all readings": "all"}
            assert tracker["measurements"] == next((said[word] for word in words if word in said), usual)
        if kind == "ekf":
            assert (tracker["readings"] == "nearest") == ("nearest" in words)
            assert (tracker["iterations"] > 1) == ("iterated" in words)
        if not set(words) & set(CHOSEN):
            assert tracker["assumes"]["noise_scale"] == 1.0
            if "particles" in tracker:
                assert tracker["particles"] == (100 if kind == "gsa_gpf" else 400)
            if "handover" in tracker:
                assert (tracker["handover"] == "gaussian") == ("Gaussian handover" in words)


def test_every_strategy_that_was_swept_runs_at_its_fair_setting_on_the_frontier():
    for radio, sweep in stored().items():
        usual = [f"{radio}: {name}" for name in sweep.choices]
        assert [name for name in usual if not {name, f"{name}, fair"} & set(VARIANTS)] == []


@pytest.mark.thorough
def test_a_strategy_at_its_fair_setting_is_what_the_sweep_ran_but_for_seed_and_length(quick):
    sweeps = {one.name: one for one in study("frontier").experiments if one.name.startswith("settings_")}
    known = resolved(quick)
    for radio, sweep in stored().items():
        for strategy, choice in sweep.choices.items():
            for word, name in zip(CHOSEN, choice, strict=True):
                mine = known.get(f"{radio}: {strategy}, {word}")
                if mine is not None:
                    variant = sweeps[f"settings_{radio}"].variants[name]
                    other = scenario.resolved(scenario.load(variant.scenario, [*variant.sets, "record.events=false"]))
                    assert {key: mine[key] for key in ("tracker", "clusters")} == {
                        key: other[key] for key in ("tracker", "clusters")
                    }


def test_the_names_of_shipped_scenarios_stand_for_them():
    shipped = {
        "ideal: pso_mhpf": "pso_mhpf",
        "ideal: ipf": "ipf",
        "ideal: ppf": "ppf",
        "ideal: central_pf": "central_pf",
        "ideal: information_driven": "information_driven",
        "slots: information_driven": "information_driven_real",
        "CSMA: pso_mhpf": "pso_mhpf_real",
        "CSMA packed: pso_mhpf, Gaussian handover": "pso_mhpf_packed",
    }
    for name, other in shipped.items():
        one = EXPERIMENT.variants[name]
        slots = ["mac.idle_slots=skipped"] if name.startswith("slots") else []
        mine, theirs = (
            scenario.resolved(scenario.load(*which)) for which in ((one.scenario, one.sets), (other, slots))
        )
        for which in (mine, theirs):
            del which["name"]
        assert mine == theirs


def test_the_variants_on_a_radio_differ_in_how_members_get_the_channel_alone():
    found = {one.name: one.variants for one in study("frontier").experiments if one.name.startswith("on_a_radio")}
    assert {name: len(variants) for name, variants in found.items()} == {
        "on_a_radio": 2, "on_a_radio_again": 4, "on_a_radio_contending": 1
    }  # fmt: skip
    resolved = []
    for name, one in (item for variants in found.values() for item in variants.items()):
        mine = scenario.resolved(scenario.load(one.scenario, one.sets))
        mac = mine.pop("mac")
        kept = None if name.startswith("CSMA") else "kept" if "idle slots kept" in name else "skipped"
        assert (mac["kind"], mac.get("idle_slots")) == ("tdma" if kept else "csma", kept)
        assert mine.pop("seed") == int(name[-8:])
        resolved.append({key: value for key, value in mine.items() if key != "name"})
    assert resolved == [resolved[0]] * 7


def test_every_strategy_on_the_real_radio_keeps_its_slots_on_every_seed_at_a_margin_that_was_swept():
    found = {one.name: one for one in study("frontier").experiments}
    given = study("frontier").published["real_radio"]
    assert len(found["real_radio"].variants) == len(given["strategies"]) * len(given["seeds"]) == 15
    assert set(given["chosen"].values()) <= set(given["margins"])
    assert [*given["chosen"]] == [*given["strategies"]] and found["real_radio"].full == 60
    for name in ("real_radio", "margins"):
        for variant, one in found[name].variants.items():
            whole = scenario.resolved(scenario.load(one.scenario, one.sets))
            tracker, margin, *seed = variant.removeprefix("kept: ").split(", ")
            assert whole["mac"]["idle_slots"] == "kept" and whole["tracker"]["kind"] == tracker
            assert f"margin {whole['clusters']['margin']:g} m" == margin and whole["clusters"]["kind"] == "appointed"
            assert [f"seed {whole['seed']}"] == (seed or [f"seed {whole['seed']}"])


def test_nothing_is_published_and_each_variant_whose_twin_is_run_is_compared_with_it():
    assert all(not claim.other and claim.published is None for claim in EXPERIMENT.claims)
    for measure in ("median:rmse_over_twin", "median:energy_over_twin"):
        compared = [claim.variant for claim in EXPERIMENT.claims if claim.measure == measure]
        assert compared == [name for name in VARIANTS if twin(name) in VARIANTS]
    for claim in EXPERIMENT.claims:
        if claim.measure == "median:arrived":
            needs = {f"record.{table}=true" for table in ("events", "estimates", "clusters")}
            assert needs <= set(VARIANTS[claim.variant].sets)


def test_a_twin_lacks_the_last_word():
    assert twin("ideal: pso_mhpf, all readings, fair") == "ideal: pso_mhpf, all readings"
    assert twin("ideal: ekf") == ""


def test_ratios_are_taken_run_by_run_to_the_twin():
    runs = {
        "ideal: ekf": pd.DataFrame({"replicate": [0, 1], "rmse": [2.0, 4.0], "energy": [1.0, 1.0]}),
        "ideal: ekf, nearest": pd.DataFrame({"replicate": [1, 0], "rmse": [2.0, 4.0], "energy": [3.0, 2.0]}),
    }
    data = TablesOfRuns(runs)
    assert MEASURES["rmse_over_twin"](data, "ideal: ekf, nearest").to_dict() == {0: 2.0, 1: 0.5}
    assert MEASURES["energy_over_twin"](data, "ideal: ekf, nearest").to_dict() == {0: 2.0, 1: 3.0}


def strategy(variant, rmse, energy, lost=0.0, in_time=1.0):
    return Strategy(variant, rmse, rmse, rmse, energy, lost, in_time)


def test_the_cheapest_is_within_the_limit_follows_the_target_and_spends_least():
    found = [
        strategy("ideal: a", 0.14, 3.0),
        strategy("ideal: b", 0.15, 2.0),
        strategy("ideal: c", 0.16, 1.0),
        strategy("ideal: d", 0.10, 0.5, lost=0.2),
        strategy("ideal: e", 0.10, 0.4, in_time=0.8),
    ]
    assert frontier_strategies.cheapest(found, 0.15).variant == "ideal: b"
    assert frontier_strategies.cheapest(found, 0.13) is None
    assert frontier_strategies.front(found).tolist() == [True, True, True, False, False]


def test_named_are_ours_and_the_fronts_of_the_others_also_if_one_run_of_ten_may_be_lost():
    found = [
        strategy("ideal: information_driven, fair", 0.9, 9.0),
        strategy("ideal: a", 0.2, 2.0),
        strategy("ideal: b", 0.3, 3.0),
        strategy("ideal: c", 0.3, 1.0, lost=0.1),
        strategy("ideal: d", 0.4, 1.5, lost=0.1),
        strategy("ideal: e", 0.1, 0.1, lost=0.2),
    ]
    assert [one.variant[7:] for one in frontier_strategies.named(found)] == ["information_driven, fair", "a", "c"]
    lines = frontier_strategies.conclusions([*found, strategy("ideal: information_driven", 0.1, 1.0)], 0.1)
    assert "ideal: a" not in lines[1] and "ideal: information_driven, 0.1 m" in lines[1]
    assert "without information_driven: ideal: a, 0.2 m" in lines[2] and "ideal: b" not in lines[2]


def test_where_nobody_is_within_the_limit_a_line_says_so_and_who_is_nearest():
    line = frontier_strategies.concluded("ideal", [strategy("ideal: a", 0.3, 3.0), strategy("ideal: b", 0.2, 4.0)], 0.1)
    assert "none; nearest is ideal: b, 0.2 m" in line and "2.00 x" in line
    line = frontier_strategies.concluded(
        "ideal", [strategy("ideal: a", 0.12, 3.0), strategy("ideal: b", 0.14, 1.0)], 0.1
    )
    assert "none" not in line and "ideal: b, 0.14 m" in line
    assert "no strategy follows" in frontier_strategies.concluded(
        "ideal", [strategy("ideal: a", 0.1, 1.0, lost=1.0)], 0.1
    )


def test_an_error_of_too_few_runs_for_an_interval_is_printed_without_one():
    nearest = strategy("ideal: a", 0.2, 3.0)._replace(low=float("nan"), high=float("nan"))
    assert frontier_strategies.concluded("ideal", [nearest], 0.1).endswith("ideal: a, 0.2 m, 2.00 x, 3 J")


def test_labels_stand_apart_from_one_another_and_from_every_marker():
    rng = np.random.default_rng(3)
    points = [(float(x), float(y)) for x, y in np.concatenate([rng.normal(5.0, 0.05, (20, 2)), [[5.0, 5.0]] * 3])]
    figure = Figure(figsize=(9.0, 6.0))
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.set(xlim=(4.0, 6.0), ylim=(4.0, 6.0))
    figure.draw_without_rendering()
    words = [f"tracker {i} ×100" for i in range(24)]
    words[3] = ""
    written = figures.label(axes, [*points, (5.0, float("nan"))], words, ["black"] * 24, [4.9])
    assert {text.get_text() for text in written} == set(words[:-1]) - {""}
    figure.draw_without_rendering()
    extents = [Text.get_window_extent(text, figure.canvas.get_renderer()) for text in written]
    pixels = axes.transData.transform(points)
    for i, one in enumerate(extents):
        assert not any(one.overlaps(other) for other in extents[:i])
        assert not any(one.contains(*pixel) for pixel in pixels)
        assert not one.y0 <= axes.transData.transform((5.0, 4.9))[1] <= one.y1, "a name is on the line"


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """Two runs of 30 steps of a few variants, and their folder."""
    where = tmp_path_factory.mktemp("frontier")
    small = replace(
        EXPERIMENT,
        quick=2,
        variants={name: EXPERIMENT.variants[name] for name in SMALL},
        claims=tuple(replace(one, reason="") for one in EXPERIMENT.claims if one.shown and one.variant in SMALL),
        quick_sets=("duration=1.24 s",),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduce, "LocalEngine", InlineEngine)
        assert reproduce.resume(reproduce.begin("frontier", small, where), 1).complete
    folder = reproduce.folder_of(where, "frontier", small)
    return measures.Data(reproduce.Folder(folder)), small, folder


@pytest.mark.thorough
def test_a_small_run_gives_a_row_a_claim_a_line_a_radio_and_a_picture(tracked, tmp_path):
    data, small, folder = tracked
    rows = [row for row in reproduce.rows("frontier", small, folder) if not row.paired]
    assert len(rows) == len(small.claims)
    assert {row.verdict for row in rows} == {"not published"}
    errors = [row for row in rows if row.quantity.startswith("RMSE of a run, median")]
    assert len({row.bound for row in errors}) == 1 and errors[0].bound > 0.0
    said = frontier_strategies.conclusions(frontier_strategies.strategies(data), frontier_strategies.limit(data))
    assert [line.partition(",")[0] for line in said] == ["ideal radio"] * 3 + ["realistic radio"] * 3
    for line, radio in zip(said[1::3], frontier_strategies.RADIOS, strict=True):
        these = [one for one in frontier_strategies.strategies(data) if one.radio == radio]
        best = [one.variant for one, on in zip(these, frontier_strategies.front(these), strict=True) if on]
        assert all(f"{name}, " in line for name in best) and (best or "none follows" in line)
    (file,) = reproduce.draw("frontier", small, folder, tmp_path)
    assert file.name == "frontier_frontier.png" and file.stat().st_size > 10_000


@pytest.mark.thorough
def test_the_bound_of_the_readings_that_arrived_is_no_smaller_than_that_of_all_in_range(tracked):
    data, _, _ = tracked
    whole = data.bound("ideal: ekf", "per_trajectory").of_replicates
    for name in ("ideal: ekf", "slots: ekf", "10 % awake: ekf"):
        found = arrived(data, name)
        assert found.index.tolist() == [0, 1]
        assert (found.to_numpy() >= whole * (1.0 - 1e-9)).all()


def test_a_strategy_that_strays_and_comes_back_in_one_run_of_ten_does_not_follow_the_target():
    runs = pd.DataFrame({"rmse": [0.3] * 10, "lost": 0, "losses": [0] * 9 + [2], "energy": 1.0, "tracked": 1.0})
    found = frontier_strategies._strategy("ideal: ekf", runs)
    assert found.lost == 0.1 and not found.follows
    assert frontier_strategies._strategy("ideal: ekf", runs.assign(losses=0)).follows


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["at_the_bound", "on_a_radio", "asleep", "robustness"])
def test_a_few_short_runs_of_every_other_experiment_give_rows_answers_and_figures(name, tmp_path, monkeypatch):
    (whole,) = (one for one in study("frontier").experiments if one.name == name)
    kept = [key for key in whole.variants if "gpf" not in key]
    claims = tuple(one for one in whole.claims if one.variant in kept)
    small = replace(whole, quick=2, variants={key: whole.variants[key] for key in kept}, claims=claims,
                    quick_sets=("duration=1.2 s",))  # fmt: skip
    monkeypatch.setattr(reproduce, "LocalEngine", InlineEngine)
    assert reproduce.resume(reproduce.begin("frontier", small, tmp_path), 1).complete
    folder = reproduce.folder_of(tmp_path, "frontier", small)
    rows = reproduce.rows("frontier", small, folder)
    assert len(rows) == len(claims) and {row.verdict for row in rows} == {"not published"}
    said = reproduce.summary("frontier", small, folder)
    assert said and all(re.match(r"registered \d+", line) for line in said)
    assert [file.stat().st_size > 10_000 for file in reproduce.draw("frontier", small, folder, tmp_path)] == [
        True for _ in small.figures
    ]
