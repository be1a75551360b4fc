import json
from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from tests.campaign.inline_engine import InlineEngine
from tests.papers.studies import module
from tests.papers.tables_of_runs import TablesOfRuns
from wsnsim.papers import measures, reproduce
from wsnsim.papers.study import study

ruan2020_measures = module("ruan2020")

EXPERIMENTS = study("ruan2020").experiments
TABLE_1_RUNS, *OPEN, INDOOR_RUNS = EXPERIMENTS
READINGS = [experiment for experiment in EXPERIMENTS if experiment.reading]
PAGE = {
    "pf": (1.2539, 0.7443, 0.6356),
    "gpf": (0.6094, 0.5006, 0.3836),
    "pso_gpf": (0.5374, 0.4515, 0.3503),
    "gsa_gpf": (0.4502, 0.3599, 0.3119),
}
"""Table 1 as printed, at 50, 100 and 200 particles."""
CLAIMS = [(experiment, claim) for experiment in EXPERIMENTS for claim in experiment.claims]


def small(experiment, tmp_path_factory, monkeypatch, **sets):
    """An experiment with two runs of a few steps, and the folder of its campaign."""
    where = tmp_path_factory.mktemp("ruan2020")
    monkeypatch.setattr(reproduce, "LocalEngine", InlineEngine)
    few = replace(experiment, quick=2, **sets)
    assert reproduce.resume(reproduce.begin("ruan2020", few, where), 1).complete
    return few, reproduce.folder_of(where, "ruan2020", few)


def test_table_1_is_claimed_as_printed_wherever_it_is_run_again():
    for experiment in (TABLE_1_RUNS, *OPEN):
        claimed = {
            claim.variant: claim.published
            for claim in experiment.claims
            if not claim.other and claim.where == "table 1"
        }
        assert claimed == {
            f"{kind}, {count}": figure
            for kind, row in PAGE.items()
            for count, figure in zip((50, 100, 200), row, strict=True)
        }


def test_what_the_text_says_of_50_particles_is_what_table_1_says():
    shares = {
        claim.measure.removeprefix("less_than:"): claim.published
        for claim in TABLE_1_RUNS.claims
        if not claim.other and claim.where == "section 3.1"
    }
    assert shares == {"pso_gpf, 50": 0.1623, "gpf, 50": 0.2612, "pf, 50": 0.641}
    for other, share in shares.items():
        assert share == pytest.approx(1.0 - PAGE["gsa_gpf"][0] / PAGE[other.split(",")[0]][0], abs=1e-4)


def test_pf_is_claimed_to_depend_most_on_the_number_of_particles_and_the_gravitational_search_least():
    saved = {kind: 1.0 - row[2] / row[0] for kind, row in PAGE.items()}
    assert max(saved, key=saved.get) == "pf" and min(saved, key=saved.get) == "gsa_gpf"
    orders = {(c.variant, c.other) for c in TABLE_1_RUNS.claims if c.other and c.measure == "median:saved"}
    less = {("gsa_gpf", kind) for kind in PAGE if kind != "gsa_gpf"} | {(kind, "pf") for kind in PAGE if kind != "pf"}
    assert orders == {(f"{one}, 200", f"{other}, 200") for one, other in less}


def test_each_reading_of_the_noise_and_of_the_length_has_every_printed_number_and_order_with_200_runs():
    keys = [{(c.where, c.id, c.key) for c in one.claims if c.where in ("table 1", "section 3.1")} for one in READINGS]
    assert len(READINGS) == 9 and len({one.reading for one in READINGS}) == 9
    assert all(these == keys[0] for these in keys) and len(keys[0]) == 12 + 18 + 4 + 3 + 5
    assert all(one.full == 200 for one in READINGS)


def test_repairs_and_other_truths_are_not_counted():
    counted = {experiment.name for experiment in EXPERIMENTS if experiment.literal}
    assert counted == {*(one.name for one in READINGS), "figures_4_and_5"} - {"direct"}
    for experiment, claim in CLAIMS:
        repaired = "greedy" in claim.variant or "G0" in claim.variant
        assert claim.literal != repaired, claim
        assert repaired == ("repaired" in claim.where) or not claim.other, claim
        if experiment is INDOOR_RUNS and (claim.other or claim.reason):
            assert claim.reason.startswith("of a surrogate")


def test_every_filter_of_table_1_is_claimed_to_be_better_than_all_worse_ones_at_every_number_of_particles():
    found = [claim for claim in TABLE_1_RUNS.claims if claim.other and claim.id == "rmse"]
    more = {(f"{kind}, 200", f"{kind}, 50") for kind in PAGE}
    assert more <= {(claim.variant, claim.other) for claim in found if claim.where == "section 3.1"}
    found = [claim for claim in found if (claim.variant, claim.other) not in more]
    orders = {(claim.variant, claim.other) for claim in found}
    in_words = {(claim.variant, claim.other) for claim in found if claim.where == "section 3.1"}
    wanted = set()
    for row, count in enumerate((50, 100, 200)):
        ranked = sorted(PAGE, key=lambda kind: PAGE[kind][row])
        wanted |= {(f"{one}, {count}", f"{other}, {count}") for one, other in combinations(ranked, 2)}
    assert orders == wanted and len(orders) == 18
    assert in_words == {pair for pair in wanted if pair[0].startswith("gsa_gpf")}
    assert {claim.measure for claim in found} == {"rmse"}, "eq. 10, which the table prints"


def test_rows_with_pso_gpf_or_with_simulated_measurements_in_place_of_recorded_ones_are_reconstructions():
    for experiment, claim in CLAIMS:
        rebuilt = "pso_gpf" in f"{claim.variant} {claim.other} {claim.measure}" or experiment is INDOOR_RUNS
        assert claim.basis == ("reconstruction" if rebuilt else "evidence"), claim


def test_what_is_drawn_of_the_surrogate_says_so():
    drawn = [figure for experiment in EXPERIMENTS for figure in experiment.figures]
    assert [figure.name for figure in drawn] == ["figure_1", "figure_2", "figure_4", "figure_5"]
    assert all(("surrogate" in figure.caption) == (figure.name in ("figure_4", "figure_5")) for figure in drawn)


@pytest.mark.thorough
def test_the_surrogate_differs_from_the_simulation_by_what_section_3_2_says():
    plans = {name: reproduce.plan("ruan2020", experiment) for name, experiment in
             (("room", TABLE_1_RUNS), ("indoor", INDOOR_RUNS))}  # fmt: skip
    found = {
        name: json.loads(next(p.resolved for p in plan.points if p.settings["variant"] == "gpf, 100"))
        for name, plan in plans.items()
    }
    differing = {role for role in found["room"] if found["room"][role] != found["indoor"].get(role)} - {"name"}
    assert differing == {"deploy", "motion", "prior", "sensor"}
    assert found["room"]["tracker"] == found["indoor"]["tracker"]
    assert found["indoor"]["sensor"]["sd"] ** 2 == pytest.approx(3.0)


def fake(errors):
    """Data of variants with these errors (runs, steps)."""
    runs = {name: pd.DataFrame({"replicate": range(len(rows)), "lost": 0}) for name, rows in errors.items()}
    return SimpleNamespace(
        errors=errors.__getitem__,
        of=lambda variant, table: runs[variant],
        lost=lambda variant: np.zeros(len(errors[variant])),
    )


def test_growth_is_the_last_third_against_the_first():
    rows = np.concatenate(
        [np.full((2, 10), 3.0), np.full((2, 10), 99.0), np.array([[3.0], [7.0]]) * np.ones(10)], axis=1
    )
    assert ruan2020_measures.growth(fake({"x": rows}), "x").tolist() == pytest.approx([0.0, 4.0])


def test_a_truth_is_outside_if_it_is_beyond_the_slack_once():
    truth = pd.DataFrame({"replicate": [0, 0, 1, 1], "px": [0.0, 10.4, 0.0, 4.0], "py": [-0.4, 3.0, -0.6, 5.0]})
    data = SimpleNamespace(
        of=lambda variant, table: truth, scenario=lambda variant: {"deploy": {"width": 10.0, "height": 10.0}}
    )
    assert ruan2020_measures.outside(data, "x").to_dict() == {0: 0.0, 1: 1.0}


def test_what_is_saved_is_of_the_same_run():
    runs = {
        "pf, 50": pd.DataFrame({"replicate": [0, 1], "rmse": [2.0, 4.0]}),
        "pf, 200": pd.DataFrame({"replicate": [1, 0], "rmse": [1.0, 1.0]}),
    }
    data = TablesOfRuns(runs)
    assert ruan2020_measures.saved(data, "pf, 200").to_dict() == {0: 0.5, 1: 0.75}


def test_a_share_is_of_the_time_means_and_its_interval_resamples_the_runs_of_both_together():
    rng = np.random.default_rng(1)
    other = rng.uniform(1.0, 3.0, (8, 5))
    data = fake({"one": 0.75 * other, "other": other})
    found = measures.measured(data, "one", "less_than:other")
    assert found[:3] == pytest.approx((0.25, 0.25, 0.25))
    assert found.replicates == 8


@pytest.mark.thorough
def test_a_small_run_gives_a_row_a_claim_and_a_picture_a_figure(tmp_path_factory, tmp_path, monkeypatch):
    few, folder = small(INDOOR_RUNS, tmp_path_factory, monkeypatch, sets=("duration=2 s",))
    rows = [row for row in reproduce.rows("ruan2020", few, folder) if not row.paired]
    assert len(rows) == len(few.claims)
    means = [row for row in rows if row.quantity.startswith("RMSE, m") and row.id == "rmse"]
    assert all(0.0 < row.measured < 10.0 and row.replicates == 2 and row.bound > 0.0 for row in means)
    files = reproduce.draw("ruan2020", few, folder, tmp_path)
    assert [file.name for file in files] == ["ruan2020_figure_4.png", "ruan2020_figure_5.png"]
    assert all(file.stat().st_size > 10_000 for file in files)


def test_errors_can_be_drawn_with_what_table_1_prints(tmp_path_factory, tmp_path, monkeypatch):
    drawn = {name: TABLE_1_RUNS.variants[name] for name in TABLE_1_RUNS.variants if "100" in name or "5000" in name}
    drawn = {name: one for name, one in drawn.items() if not any(word in name for word in ("columns", "G0", "r ="))}
    variants = {**drawn, "ekf": TABLE_1_RUNS.variants["ekf"]}
    few, folder = small(
        TABLE_1_RUNS, tmp_path_factory, monkeypatch, sets=("duration=2 s",), variants=variants, claims=()
    )
    files = reproduce.draw("ruan2020", few, folder, tmp_path)
    assert [file.name for file in files] == ["ruan2020_figure_1.png", "ruan2020_figure_2.png"]
