"""The YAML file of every paper: its experiments run, its measures and figures exist, and issues have a place."""

from __future__ import annotations

import functools
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from tests.helpers.thorough import thorough
from wsnsim import scenario
from wsnsim.base.errors import ScenarioError
from wsnsim.papers import reproduce
from wsnsim.papers.measures import computing
from wsnsim.papers.reproduction import BASES, ClaimRow, rendered
from wsnsim.papers.study import PAGES, study
from wsnsim.papers.verdicts import Judgement
from wsnsim.scenario.texts import shipped_studies

NAMES = [(name, raw.name) for name in PAGES for raw in study(name)._document.content.experiments]
"""(paper, experiment); experiments are computed in tests, because that of recorded tracks is dear."""
TABLES = {"rmse": {"estimates"}, "rmse_of_kept": {"estimates"}, "over": {"estimates"}, "less_than": {"estimates"},
          "column": {"estimates", "truth"}, "column_of_kept": {"estimates", "truth"},
          "per_run_rmse": {"estimates", "truth"}}  # fmt: skip
OWN = {
    "clusters": {"clusters"}, "least_level": {"clusters", "energy_steps"},
    "largest_level": {"clusters", "energy_steps"},
    "on_level": {"clusters", "energy_steps"}, "above_level": {"clusters", "energy_steps"},
    "step_energy": {"clusters", "energy_steps"}, "velocity_over_rkf": {"estimates", "truth"},
    "in_turn": {"truth", "tracker_state"}, "to_neighbours": {"tracker_state"}, "taking_part": {"tracker_state"},
    "distinct": {"particles"}, "spread": {"particles"}, "vx": {"estimates", "truth"}, "vy": {"estimates", "truth"},
    "growth": {"estimates"}, "end": {"truth"}, "mean_error": {"estimates"}, "median_error": {"estimates"},
    "later_mean": {"estimates"}, "later_median": {"estimates"}, "start_excess": {"estimates"}, "ranges": {"estimates"},
    "least_delay": {"estimates"}, "greatest_delay": {"estimates"}, "least_report_delay": {"estimates"},
    "greatest_report_delay": {"estimates"}, "fix_bound": {"truth", "nodes"},
    "over_bound": {"estimates"}, "over_bound_settled": {"estimates"}, "rmse_settled": {"estimates"},
    "nees_away": {"estimates", "truth"}, "nees_near_walls": {"estimates", "truth"},
    "state_nees_away": {"estimates", "truth", "covariances"},
    "state_nees_near_walls": {"estimates", "truth", "covariances"},
}  # fmt: skip
"""Tables that the papers' own measures read in addition to `runs` and `tracks`, by name without a final number."""


whole_paper = functools.cache(study)


def experiment_of(pair):
    name, wanted = pair
    return next(one for one in whole_paper(name).experiments if one.name == wanted)


@pytest.mark.thorough(fast=["wei2022 table_2_noisy_truth-False"])
@pytest.mark.parametrize("full", [False, *thorough([True])])
@pytest.mark.parametrize("pair", NAMES, ids=" ".join)
def test_every_experiment_is_a_campaign_of_scenarios_that_load(pair, full):
    name, experiment = pair[0], experiment_of(pair)
    if name == "reality":  # every track has the same variants
        track = next(iter(experiment.variants)).partition(", ")[0]
        few = {key: variant for key, variant in experiment.variants.items() if key.startswith(f"{track}, ")}
        experiment = replace(experiment, variants=few)
    elif experiment.name.startswith("settings_"):  # the same strategies at hundreds of settings
        experiment = replace(experiment, variants=dict([*experiment.variants.items()][::13]))
    plan = reproduce.plan(name, experiment, full)
    assert [point.settings["variant"] for point in plan.points] == list(experiment.variants)
    assert plan.replicates == (experiment.full if full else experiment.quick) >= 5
    for point in plan.points:
        scenario.build(scenario.load(json.loads(point.resolved)))


@pytest.mark.parametrize("pair", NAMES, ids=" ".join)
def test_what_a_claim_measures_is_recorded(pair):
    experiment = experiment_of(pair)
    for claim in experiment.claims:
        family, _, rest = (claim.measure.partition("; ")[2] or claim.measure).partition(":")  # of a ratio: its terms
        own = rest if rest in OWN else re.sub(r"_\d+$", "", rest)
        needed = TABLES.get(family, OWN.get(own, set()))
        recorded = {*experiment.record, *(["events", "estimates", "clusters"] if rest == "arrived" else ())}
        assert needed <= recorded, claim


@pytest.mark.parametrize("pair", NAMES, ids=" ".join)
def test_every_verdict_has_its_reason_in_a_line(pair):
    for claim in experiment_of(pair).claims:
        assert "\n" not in claim.reason
        if claim.shown and (claim.other or claim.published is not None):
            assert claim.reason, claim


@pytest.mark.parametrize("name", PAGES)
def test_every_figure_has_its_function_and_every_function_a_figure(name):
    drawn = {figure.draw or figure.name for experiment in study(name).experiments for figure in experiment.figures}
    assert drawn == set(study(name).code.functions("FIGURES"))


@pytest.mark.parametrize("name", PAGES)
def test_every_measure_of_a_paper_is_claimed_and_every_row_that_is_not_shown_is_used_by_a_reason(name):
    claims = [claim for experiment in study(name).experiments for claim in experiment.claims]
    used = {part for claim in claims for part in (claim.measure, getattr(claim, "bound", "")) if ":" in part}
    tested = {test["measure"] for test in study(name).registered.get("tests", ())}
    assert set(study(name).measures) <= {part.partition(":")[2] for part in used} | tested
    reasons = " ".join(claim.reason for claim in claims)
    hidden = {claim.id for claim in claims if not claim.shown}
    assert all(f"{{{one}[" in reasons for one in hidden), hidden


def test_a_number_in_a_reason_is_that_of_the_row_it_names():
    nan = float("nan")
    one = ClaimRow("RMSE", "pf, 50", 1.0, 0.25, nan, nan, 50, 0.3, nan, "", Judgement("reproduces"),
                   "{rmse[gpf: 5 %].measured:.2f} m, {row.lost:.0f} of {row.replicates} lost")  # fmt: skip
    other = replace(one, variant="gpf: 5 %", measured=1.234)
    assert rendered(one.reason, one, {"rmse": {"gpf: 5 %": other}}) == "1.23 m, 15 of 50 lost"


@pytest.fixture
def edited(tmp_path):
    """A function that gives the paper of Liu (2012), copied to a folder, with a text of its file replaced."""
    folder = Path(shutil.copytree(shipped_studies()["liu2012"], tmp_path / "copy"))

    def edit(before, after):
        text = (folder / "study.yaml").read_text(encoding="utf-8")
        assert before in text
        (folder / "study.yaml").write_text(text.replace(before, after, 1), encoding="utf-8")
        return study(str(folder))

    yield edit
    study.cache_clear()


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("quick: 20", "quik: 20", r"experiments.0.runs.quik: unknown key, did you mean 'quick'"),
        ("quick: 20", "quick: many", r"experiments.0.runs.quick"),
        ("quick: 20", "quick: 0", r"experiments.0.runs: quick, full and block must be at least 1"),
        ("of: imsf < rkf,", "of: imsf < rfk,", r"'rfk'.*did you mean 'rkf'"),
        ("of: imsf < rkf, ", "", r"needs 'of': a variant, an order"),
        ("of: [rkf, imsf],", "of: [rkf, imfs],", r"'imfs'.*did you mean 'imsf'"),
        ("measure: rmse_of_kept", "measure: rmse_of_kep", r"did you mean 'rmse_of_kept'"),
        (", measure: rmse_of_kept", "", r"needs 'measure'"),
        ("mean:in_turn", "mean:inturn", r"did you mean 'in_turn'"),
        ("published: {rkf: 47.7304", "published: {rfk: 47.7304", r"published: the claim is not of 'rfk' .*'rkf'"),
        ("median_rmse[imsf].measured", "median_rmse[imfs].measured", r"'median_rmse\[imfs\]'"),
        ("median_rmse[imsf].measured", "median_rms[imsf].measured", r"did you mean 'median_rmse'"),
        ("median_rmse[imsf].measured", "median_rmse[imsf].mesured", r"did you mean 'measured'"),
        ("{median_rmse[imsf].measured", "{1 + 1", r"is not of the form"),
        ("name: figure_1,", "name: figure_9,", r"experiments.0.figures: FIGURES has no 'figure_9' .*'figure_4'"),
        ("record: [truth, estimates, nodes, tracker", "summary: x\n    record: [tracker", r"SUMMARIES has no 'x'"),
        ("  - name: readings", "  - name: figures_1_to_4", r"a second experiment is 'figures_1_to_4'"),
        ("    claims:", "    repairs: [rkv]\n    claims:", r"repairs: no variant is 'rkv' .*'rkf'"),
        ("rows:\n", "where: x\n        rows:\n", r"beside 'rows' stands 'of' alone, not 'where'"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_studys_file_is_said_with_its_place_and_the_nearest_name(edited, before, after, words):
    with pytest.raises(ScenarioError, match=r"(?s)copy/study.yaml:\d+:\d+: error: .*" + words):
        edited(before, after).experiments  # noqa: B018


def test_a_variant_whose_scenario_is_wrong_is_said_with_its_place_before_anything_runs(edited):
    found = edited("[rkf, tracker.spread=true]", "[rkf, tracker.spraed=true]")
    words = r"(?s)study.yaml:15:\d+: error: experiments.0.variants.rkf, spread: .*did you mean 'spread'"
    with pytest.raises(ScenarioError, match=words):
        reproduce.plan(str(found.folder), found.experiments[0])
    study.cache_clear()
    found = edited("[rkf, tracker.spraed=true]", "rkf")
    with pytest.raises(ScenarioError, match=r"rkf, spread: is the same scenario as 'rkf'"):
        reproduce.plan(str(found.folder), found.experiments[0])


def test_computing_takes_the_operations_of_an_estimate_at_the_rate_of_the_processor():
    tables = {
        "runs": pd.DataFrame({"replicate": [3, 4], "cycles": [4e6, 8e6], "steps": [10, 10]}),
        "tracks": pd.DataFrame({"replicate": [4, 3], "reports": [4, 2]}),
    }
    data = SimpleNamespace(
        of=lambda variant, table: tables[table],
        of_runs=lambda variant, column: tables["runs"].set_index("replicate")[column],
        scenario=lambda variant: {"cpu": {"rate": 8e6, "cycles_per_flop": 2.0}},
    )
    assert computing(data, "pf").to_dict() == {3: 500.0, 4: 500.0}


def test_the_basis_of_a_claim_is_its_own_or_that_of_a_variant_or_that_of_the_experiment(edited):
    experiment = "    record: [truth, estimates, nodes, tracker_state]\n"
    bases = "    bases: {reconstruction: [imsf], construction: ['rkf, spread']}\n"
    changed = edited(experiment, f"{experiment}    basis: our constant\n{bases}").experiments[0]
    found = {claim.key: claim.basis for claim in changed.claims}
    assert found["imsf < rkf, spread"] == found["imsf"] == "reconstruction"
    assert (found["rkf, spread"], found["rkf"]) == ("construction", "our constant")
    study.cache_clear()
    own = edited("id: order, ", "id: order, basis: our constant, ").experiments[0].claims
    assert [claim.basis for claim in own if claim.id == "order"] == ["our constant"]


def test_every_published_value_has_a_number_of_runs_and_every_basis_is_known(edited):
    for experiment in map(experiment_of, NAMES):
        assert all(claim.basis in BASES for claim in experiment.claims)
        assert all(claim.published_runs > 0 for claim in experiment.claims if claim.published is not None)
    with pytest.raises(ScenarioError, match=r"basis: 'reconstructed' .did you mean 'reconstruction'"):
        edited("id: order, ", "id: order, basis: reconstructed, ").experiments  # noqa: B018


def test_operations_that_we_count_beside_printed_seconds_are_no_evidence():
    found = [
        claim
        for experiment in map(experiment_of, NAMES)
        for claim in experiment.claims
        if "operations_over" in claim.measure and claim.published is not None
    ]
    assert len({claim.variant for claim in found}) >= 3
    assert {claim.basis for claim in found} == {"our constant"}
