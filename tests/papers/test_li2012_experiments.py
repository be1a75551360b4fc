import dataclasses
import json

import numpy as np
import pandas as pd
import pytest

from tests.campaign.inline_engine import InlineEngine
from tests.helpers.thorough import thorough
from tests.papers.studies import module
from wsnsim.papers import reproduce
from wsnsim.papers.study import study

li2012_measures = module("li2012")

EXPERIMENTS = {experiment.name: experiment for experiment in study("li2012").experiments}
CLAIMS = [(experiment, claim) for experiment in EXPERIMENTS.values() for claim in experiment.claims if claim.shown]


@pytest.mark.thorough(fast=["left_open-False"])
@pytest.mark.parametrize("full", [False, *thorough([True])])
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_is_a_campaign_of_scenarios_that_load(name, full):
    experiment = EXPERIMENTS[name]
    points = [json.loads(point.resolved) for point in reproduce.plan("li2012", experiment, full).points]
    assert len(points) == len(experiment.variants)
    assert (experiment.full if full else experiment.quick) >= 5
    found = {(one["step"], one["duration"]) for one in points}
    once_a_report = {(10.0, 1010.0 if full else 210.0)}
    steps = {"every_10_s": once_a_report, "straight_motion": {(2.0, 14.0), (10.0, 70.0)}}
    assert found == steps.get(name, {(2.0, 202.0)})
    assert {one["sink"]["every"] for one in points} == {10.0}


def test_gmtt_has_three_forms_each_by_its_own_name_that_differ_by_nothing_else():
    names = ("gmtt, literal, 300", "gmtt, repaired, 300", "gmtt, linear, 300")
    for name in ("figures_3_6", "every_10_s"):
        few = dataclasses.replace(EXPERIMENTS[name], variants={one: EXPERIMENTS[name].variants[one] for one in names})
        printed, ours, line = (json.loads(point.resolved)["tracker"] for point in reproduce.plan("li2012", few).points)
        differing = {key: (printed[key], ours[key]) for key in ours if ours[key] != printed[key]}
        assert differing == {"shift": (0.0, 500.0), "correction": ("literal", "tail")}
        assert {key for key in line if line[key] != ours[key]} == {"predictor"} and line["predictor"] == "linear"


def test_of_what_is_left_open_all_is_of_the_repaired_form_with_one_thing_otherwise():
    whole = EXPERIMENTS["left_open"]
    chosen = {name: variant for name, variant in whole.variants.items() if "calibrated" not in name}
    few = dataclasses.replace(whole, variants=chosen)
    base, *others = (json.loads(point.resolved)["tracker"] for point in reproduce.plan("li2012", few).points)
    assert (base["shift"], base["correction"], base["report"]) == (500.0, "tail", "fix")
    assert [[key for key in base if one[key] != base[key]] for one in others] == [
        ["shift"], ["correction"], ["correction"], ["report"]]  # fmt: skip
    assert all(name.startswith("gmtt, repaired") for name in few.variants)


def test_what_counts_is_as_printed_once_a_report_at_the_middle_levels():
    assert {name: experiment.literal for name, experiment in EXPERIMENTS.items()} == {
        "figures_3_6": False, "every_10_s": True, "left_open": False, "straight_motion": False}  # fmt: skip
    for _, claim in (pair for pair in CLAIMS if pair[0].name in ("figures_3_6", "every_10_s")):
        names = f"{claim.variant}, {getattr(claim, 'other', '')}"
        ours = (
            any(mark in names for mark in ("repaired", "linear", "low", "high", "ris")) or "efficiency" in claim.where
        )
        assert claim.literal != ours, claim


def test_only_shares_near_to_one_are_read_from_words_and_are_judged_as_shares():
    for _, claim in CLAIMS:
        if not claim.other and claim.published is not None:
            near = claim.where == "figure 3"
            assert (claim.read, claim.fraction) == (near, near), claim


def test_both_forms_of_gmtt_are_asked_for_the_same():
    for name in ("figures_3_6", "every_10_s"):
        asked: dict[bool, list[tuple[str, ...]]] = {True: [], False: []}
        for _, claim in (pair for pair in CLAIMS if pair[0].name == name):
            names = (claim.variant, claim.other)
            if "linear" in claim.variant or claim.quantity.startswith("Cramér"):
                continue
            if any(one.startswith("gmtt") for one in names):
                said = tuple(one.replace("gmtt, repaired", "gmtt, literal") for one in names)
                asked[any("repaired" in one for one in names)].append((claim.quantity, claim.measure, *said))
        assert asked[True] and sorted(asked[True]) == sorted(asked[False])


def test_what_is_published_is_what_the_paper_prints():
    printed = {"figure 3": {1.0}, "figure 4": {2.0, 2.5, 4.0}, "figure 5": {0.02, 0.06, 0.04, 0.09, 0.2, 0.3}}
    for name in ("figures_3_6", "every_10_s"):
        found: dict[str, set[float]] = {}
        for _, claim in (pair for pair in CLAIMS if pair[0].name == name):
            if not claim.other and claim.published is not None:
                found.setdefault(claim.where, set()).add(claim.published)
        assert found == printed


@pytest.mark.parametrize(("tracker", "error", "least", "greatest"), [
    ("cluster", 2.0, 0.2, 0.3), ("gmtt, literal", 2.5, 0.04, 0.09), ("tsstp", 4.0, 0.02, 0.06)])  # fmt: skip
def test_each_tracker_has_its_own_figures(tracker, error, least, greatest):
    own = [c for c in EXPERIMENTS["figures_3_6"].claims if not c.other and c.variant == f"{tracker}, 300"]
    assert {c.published for c in own if c.where == "figure 4"} == {error}
    for end, figure in (("least", least), ("greatest", greatest)):
        assert {c.published for c in own if c.quantity.startswith(end)} == {figure}


def test_every_published_order_is_asked_for_the_right_way_round():
    found = {(c.variant, c.other) for c in EXPERIMENTS["figures_3_6"].claims
             if c.other and c.quantity.startswith("share")}  # fmt: skip
    assert {("tsstp, 200", "gmtt, literal, 200"), ("tsstp, 200", "cluster, 200")} <= found
    assert all(variant.startswith("tsstp") for variant, _ in found)
    of_delay = [(c.variant, c.other) for c in EXPERIMENTS["every_10_s"].claims
                if c.other and "delay" in c.quantity]  # fmt: skip
    gmtt, repaired = "gmtt, literal, 300", "gmtt, repaired, 300"
    assert of_delay == 2 * [("tsstp, 300", gmtt), ("tsstp, 300", repaired), ("tsstp, 300", "cluster, 300"),
                            (gmtt, "cluster, 300"), (repaired, "cluster, 300")]  # fmt: skip
    of_error = {(c.variant, c.other) for c in EXPERIMENTS["every_10_s"].claims
                if c.other and c.quantity.startswith("mean error")}  # fmt: skip
    assert {("cluster, 300", gmtt), (gmtt, "tsstp, 300"), ("cluster, 300", "tsstp, 300")} <= of_error
    assert not {(two, one) for one, two in of_error} & of_error


def test_the_reasons_that_the_text_gives_are_asked_for_too():
    found = {(c.quantity, c.variant, c.other) for c in EXPERIMENTS["every_10_s"].claims
             if c.other and c.where.startswith("text of")}  # fmt: skip
    assert {
        ("re-acquisitions a run", "gmtt, literal, 200", "tsstp, 200"),
        ("ranges a step, of steps 1 to 20", "tsstp, 300", "gmtt, literal, 300"),
        ("operations a run", "gmtt, literal, 300", "cluster, 300"),
        ("operations a run", "tsstp, 300", "cluster, 300"),
        ("unnecessary wake-ups in 20 steps, more at 400 nodes than at 200", "gmtt, literal, 400", "tsstp, 400"),
    } <= found


class Held:
    """Tables in memory, as measures read them."""

    def __init__(self, **tables):
        self.tables = {name: pd.DataFrame(columns) for name, columns in tables.items()}

    def of(self, variant, table):
        return self.tables[table]

    def scenario(self, variant):
        return {"sensor": {"reach": 40.0, "sd": 2.0}, "sink": {"every": 10.0}, "step": 2.0}


def test_the_figures_of_a_run_are_of_its_first_20_steps_or_of_its_first_20_reports():
    steps = np.arange(1, 121)
    delay = np.where(steps == 3, 0.01, np.where(steps == 25, 9.0, 0.5))
    data = Held(estimates={
        "replicate": 7, "step": steps, "time": 2.0 * steps, "issued": 2.0 * steps + delay,
        "received": np.where(steps % 5 == 0, 2.0 * steps + steps / 100.0, np.nan),
        "readings": np.where(steps <= 20, steps % 2, 1000),
        "error": np.where(steps <= 5, 10.0, np.where(steps <= 20, steps - 5.0, 1e6)),
    })  # fmt: skip
    found = {name: getattr(li2012_measures, name)(data, "").loc[7] for name in (
        "mean_error", "later_mean", "later_median", "start_excess", "least_delay", "greatest_delay",
        "least_report_delay", "greatest_report_delay", "ranges")}  # fmt: skip
    assert found == pytest.approx({
        "mean_error": (5 * 10.0 + 120.0) / 20, "later_mean": 8.0, "later_median": 8.0, "start_excess": 2.0,
        "least_delay": 0.01, "greatest_delay": 0.5, "least_report_delay": 0.05, "greatest_report_delay": 1.0,
        "ranges": 0.5,
    })  # fmt: skip


def test_the_growth_of_unnecessary_wake_ups_compares_one_tracker_at_both_densities_run_by_run():
    class Told:
        def of(self, variant, table):
            assert table == "tracks"
            counts = {"gmtt, repaired, 200": [3, 50], "gmtt, repaired, 400": [10, 20]}[variant]
            return pd.DataFrame({"replicate": [4, 5], "ineffective_twenty": np.array(counts, dtype=np.uint32)})

    assert li2012_measures.vain_growth(Told(), "gmtt, repaired, 400").to_dict() == {4: 7.0, 5: -30.0}


def test_the_least_error_of_a_fix_is_that_of_the_nodes_in_reach_in_closed_form():
    far = np.array([[30.0, 0.0], [0.0, 30.0], [-30.0, 0.0], [50.0, 50.0]])
    data = Held(
        truth={"replicate": 0, "step": [0, 1, 2], "px": [0.0, 1.0, 900.0], "py": [0.0, 2.0, 900.0]},
        nodes={"replicate": 0, "node": range(4), "x": 1.0 + far[:, 0], "y": 2.0 + far[:, 1]},
    )
    # Directions east, north and west: the information is diag(2, 1) / 4, its inverse diag(2, 4). Step 2 has nobody.
    assert li2012_measures.fix_bound(data, "").loc[0] == pytest.approx(np.sqrt(6.0))


def test_no_least_squares_fix_is_better_than_that_on_average():
    rng = np.random.Generator(np.random.Philox(1))
    nodes = np.array([[30.0, 5.0], [-3.0, 30.0], [-25.0, -10.0], [10.0, -20.0]])
    data = Held(
        truth={"replicate": 0, "step": [1], "px": [0.0], "py": [0.0]},
        nodes={"replicate": 0, "node": range(4), "x": nodes[:, 0], "y": nodes[:, 1]},
    )
    ranges = np.linalg.norm(nodes, axis=1) + 2.0 * rng.standard_normal((4000, 4))
    places = np.zeros((4000, 2))
    for _ in range(10):
        offsets = places[:, None] - nodes
        away = np.linalg.norm(offsets, axis=2)
        units = offsets / away[..., None]
        normal = np.einsum("rni,rnj->rij", units, units)
        places += np.linalg.solve(normal, np.einsum("rni,rn->ri", units, ranges - away)[..., None])[..., 0]
    achieved = np.sqrt((places**2).sum(axis=1).mean())
    assert li2012_measures.fix_bound(data, "").loc[0] == pytest.approx(achieved, rel=0.05)
    median = np.median(np.linalg.norm(places, axis=1))
    assert li2012_measures.efficient_errors(data, "")[0] == pytest.approx(median, rel=0.1)


@pytest.mark.thorough
def test_a_tiny_run_gives_rows_and_pictures_and_is_not_run_again(tmp_path, monkeypatch):
    monkeypatch.setattr(reproduce, "LocalEngine", InlineEngine)
    whole = EXPERIMENTS["figures_3_6"]
    names = ("gmtt, literal, 300", "gmtt, repaired, 300", "tsstp, 300", "cluster, 300")
    shown = [dataclasses.replace(claim, reason="") for claim in whole.claims if claim.shown]
    kept = [claim for claim in shown if {claim.variant, claim.other or names[0]} <= set(names)]
    tiny = dataclasses.replace(whole, variants={name: whole.variants[name] for name in names}, claims=tuple(kept),
                               quick=2, quick_sets=("duration=22 s",))  # fmt: skip
    assert reproduce.resume(reproduce.begin("li2012", tiny, tmp_path), 1).complete
    folder = reproduce.folder_of(tmp_path, "li2012", tiny)
    found = [row for row in reproduce.rows("li2012", tiny, folder) if not row.paired]
    assert len(found) == len(kept)
    assert all(row.replicates == 2 for row in found)
    at_ten = next(row for row in found if row.quantity.startswith("RMS error") and row.variant == "gmtt, literal, 300")
    assert 0.1 < at_ten.measured < 100.0
    files = {file: file.stat().st_mtime_ns for file in folder.rglob("*.h5")}
    assert files and reproduce.resume(reproduce.begin("li2012", tiny, tmp_path), 1).complete
    assert {file: file.stat().st_mtime_ns for file in folder.rglob("*.h5")} == files
    drawn = reproduce.draw("li2012", tiny, folder, tmp_path / "figures")
    assert [picture.name for picture in drawn] == [f"li2012_figure_{number}.png" for number in (3, 4, 5, 6)]
    assert all(picture.stat().st_size > 10_000 for picture in drawn)
