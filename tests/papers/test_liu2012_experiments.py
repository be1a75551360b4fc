import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import wsnsim
from tests.campaign.inline_engine import InlineEngine
from tests.papers.studies import module
from tests.papers.tables_of_runs import TablesOfRuns
from wsnsim.base.errors import ResultError
from wsnsim.papers import measures, reproduce
from wsnsim.papers.study import study
from wsnsim.trackers.sensor_chains import RelayKalman

liu2012_measures = module("liu2012")
_study = module("liu2012")
MEASURES = _study.MEASURES

EXPERIMENTS = study("liu2012").experiments
TRACKING, READ_OTHERWISE = EXPERIMENTS
PRINTED = {"rkf": 47.7304, "imsf": 68.6893}
"""Published run times (s)."""
CLAIMS = [(experiment, claim) for experiment in EXPERIMENTS for claim in experiment.claims]


def test_the_two_as_printed_are_those_of_the_paper_whatever_stands_beside_them():
    points = {p.settings["variant"]: json.loads(p.resolved) for p in reproduce.plan("liu2012", TRACKING).points}
    assert points["rkf"]["tracker"] | {"spread": False} == points["rkf"]["tracker"]
    assert points["imsf"]["tracker"]["mixing"] == "corrected"
    assert points["imsf, mixing as printed"]["tracker"]["mixing"] == "printed"
    assert points["ekf, nearest sensor"]["tracker"]["readings"] == "nearest"
    assert {one["motion"]["q"] for one in points.values()} == {1e-6}
    assert {one["sensor"]["reach"] for one in points.values()} == {400.0}


def test_what_is_published_is_what_the_page_says():
    figures = [claim for _, claim in CLAIMS if not claim.other and claim.published is not None]
    assert {c.variant: c.published for c in figures if c.quantity == "run time of 50 runs, s"} == PRINTED
    ratios = [c for c in figures if c.measure.endswith(("seconds_over_rkf", "operations_over_rkf"))]
    assert [c.published for c in ratios] == [pytest.approx(1.44, abs=0.005)] * 2
    assert {c.published for c in figures if "velocity" in c.measure} == {1.0}
    orders = {(c.variant, c.other, c.where) for c in TRACKING.claims if c.other}
    assert {("imsf", "rkf", "figure 1"), ("rkf", "imsf", "figures 3 and 4"), ("rkf", "imsf", "table 1")} <= orders


def test_seconds_are_not_judged_and_what_is_no_printed_number_is_marked_as_read():
    figures = [claim for _, claim in CLAIMS if not claim.other and claim.published is not None]
    assert {c.measure.rpartition(":")[2] for c in figures if not c.judged} == {"seconds_over_rkf", "seconds_of_50"}
    assert {c.read for c in figures if c.published == 1.0} == {True}
    assert {c.read for c in figures if c.published != 1.0} == {False}
    assert {c.fraction for c in figures if "share" in c.quantity} == {True}


def test_repairs_and_other_readings_are_not_counted():
    assert TRACKING.literal and not READ_OTHERWISE.literal
    orders = {(c.variant, c.other): c.literal for c in TRACKING.claims if c.other and c.measure == "rmse"}
    assert {pair for pair, counted in orders.items() if counted} == {("imsf", "rkf")}
    assert len(orders) == 3


def relayed(chances, places):
    """The data of one run with these probabilities (steps, sensors), its target at these positions from step 1 on."""
    steps, sensors = np.indices(np.shape(chances))
    state = {"replicate": 4, "step": steps.ravel() + 1, "name": "probability", "index": sensors.ravel(),
             "value": np.ravel(chances)}  # fmt: skip
    tables = {
        "truth": pd.DataFrame({"replicate": 4, "step": range(len(places) + 1), "px": [0.0, *places]}),
        "tracker_state": pd.DataFrame(state).sample(frac=1.0, random_state=1),
    }
    return SimpleNamespace(of=lambda variant, table: tables[table])


def test_a_sensor_takes_part_where_it_is_probable_enough():
    data = relayed([[0.9, 0.1, 0.0], [0.04, 0.96, 0.0], [0.0, 0.05, 0.95]], [1.0, 2.0, 3.0])
    assert liu2012_measures.taking_part(data, "x").to_dict() == {4: pytest.approx(5 / 3)}


def test_sensors_are_in_their_turn_if_each_is_believed_farther_on_than_the_one_before():
    chances = [[0.9, 0.1, 0.0, 0.0], [0.1, 0.2, 0.7, 0.0], [0.0, 0.8, 0.2, 0.0]]
    data = relayed(chances, [10.0, 20.0, 30.0])
    assert liu2012_measures.in_turn(data, "x").to_dict() == {4: 0.5}
    assert liu2012_measures.to_neighbours(data, "x").to_dict() == {4: 0.5}


def test_one_sensor_alone_has_no_turn_and_no_neighbour():
    data = relayed([[1.0, 0.0], [0.99, 0.01]], [10.0, 20.0])
    assert np.isnan(liu2012_measures.in_turn(data, "x")[4])
    assert np.isnan(liu2012_measures.to_neighbours(data, "x")[4])


def test_velocities_times_and_operations_are_held_against_rkf_run_by_run():
    runs = {
        "rkf, a": pd.DataFrame({"replicate": [0, 1], "cpu_seconds": [1.0, 2.0], "cycles": [10.0, 10.0]}),
        "imsf, a": pd.DataFrame({"replicate": [1, 0], "cpu_seconds": [3.0, 4.0], "cycles": [40.0, 30.0]}),
    }
    off = {"rkf, a": np.array([[1.0, -1.0], [2.0, 2.0]]), "imsf, a": np.array([[3.0, 3.0], [-1.0, 1.0]])}
    data = TablesOfRuns(runs)
    data.column_errors = lambda variant, column: off[variant]
    found = {name: MEASURES[name](data, "imsf, a").to_dict() for name in MEASURES if name.endswith("over_rkf")}
    assert found["velocity_over_rkf"] == {0: 3.0, 1: 0.5}
    assert found["seconds_over_rkf"] == {0: 4.0, 1: 1.5}
    assert found["operations_over_rkf"] == {0: 3.0, 1: 4.0}
    assert MEASURES["seconds_of_50"](data, "rkf, a").to_dict() == {0: 50.0, 1: 100.0}


def test_probabilities_are_those_of_the_run_itself(monkeypatch, tmp_path):
    seen, own = [], RelayKalman.estimate
    monkeypatch.setattr(
        RelayKalman, "estimate", lambda self, belief: seen.append(belief.probabilities) or own(self, belief)
    )
    wsnsim.run(
        wsnsim.load("rkf", ["duration=6 s", "replicates=1", "record.tracker_state=true"]), out=tmp_path / "run.h5"
    )
    table = wsnsim.read(tmp_path / "run.h5", "tracker_state")
    found = liu2012_measures.probabilities(SimpleNamespace(of=lambda variant, name: table), "rkf")
    assert list(found) == [0] and found[0].shape == (5, 8)
    np.testing.assert_array_equal(found[0], np.array(seen))


def test_a_run_without_recorded_probabilities_is_named():
    empty = pd.DataFrame({"replicate": [], "step": [], "name": [], "index": [], "value": []})
    data = SimpleNamespace(of=lambda variant, table: empty, folder=SimpleNamespace(path="some/folder"))
    with pytest.raises(ResultError, match="some/folder: 'rkf' has no probabilities"):
        liu2012_measures.probabilities(data, "rkf")


@pytest.mark.thorough
def test_a_small_run_gives_a_row_a_claim_and_a_picture_a_figure(tmp_path_factory, tmp_path, monkeypatch):
    monkeypatch.setattr(reproduce, "LocalEngine", InlineEngine)
    where = tmp_path_factory.mktemp("liu2012")
    few = replace(TRACKING, quick=2, sets=("duration=20 s",))
    assert reproduce.resume(reproduce.begin("liu2012", few, where), 1).complete
    folder = reproduce.folder_of(where, "liu2012", few)
    rows = [row for row in reproduce.rows("liu2012", few, folder) if not row.paired]
    assert len(rows) == len(few.claims)
    position = next(row for row in rows if row.quantity == "position RMSE, m (figure 1)" and row.variant == "imsf")
    assert 0.0 < position.measured < 5.0 and position.bound > 0.0 and position.replicates == 2
    files = reproduce.draw("liu2012", few, folder, tmp_path)
    assert [file.name for file in files] == [f"liu2012_figure_{number}.png" for number in range(1, 5)]
    assert all(file.stat().st_size > 10_000 for file in files)


@pytest.mark.thorough
def test_with_its_own_cell_each_sensor_is_alone_and_both_filters_are_one(monkeypatch, tmp_path_factory):
    monkeypatch.setattr(reproduce, "LocalEngine", InlineEngine)
    where = tmp_path_factory.mktemp("liu2012")
    variants = {name: one for name, one in READ_OTHERWISE.variants.items() if "own cell" in name}
    few = replace(READ_OTHERWISE, quick=2, sets=("duration=20 s",), variants=variants, claims=())
    assert reproduce.resume(reproduce.begin("liu2012", few, where), 1).complete
    data = measures.Data(reproduce.Folder(reproduce.folder_of(where, "liu2012", few)))
    one, two = (data.errors(f"{kind}, own cell") for kind in ("rkf", "imsf"))
    np.testing.assert_allclose(one, two, rtol=0, atol=1e-9)
