import math
from dataclasses import replace
from types import SimpleNamespace

import pandas as pd
import pytest

from tests.campaign.inline_engine import InlineEngine
from tests.helpers.thorough import thorough
from tests.papers.studies import module
from tests.papers.tables_of_runs import TablesOfRuns
from wsnsim import scenario
from wsnsim.papers import published, reproduce
from wsnsim.papers.reproduction import Claim, Experiment

_study = module("wei2022")
MEASURES = _study.MEASURES

EXPERIMENTS = {experiment.name: experiment for experiment in reproduce.experiments("wei2022")}


def values(experiment: Experiment) -> list[Claim]:
    return [claim for claim in experiment.claims if not claim.other]


def test_table_1_is_as_printed_and_stands_beside_the_papers_set_up():
    printed = {30: (6.0001, 4.3138, 4.0062), 60: (5.1002, 4.0031, 3.6275), 100: (4.7011, 4.0132, 3.1075)}
    kinds = ("pf", "cs_pf", "ics_pf")
    found = {
        c.variant: c.published
        for c in values(EXPERIMENTS["table_1"])
        if c.published is not None and c.where == "table 1" and c.id == "rmse"
    }
    wanted = {f"{kind}, {n}": x for n, row in printed.items() for kind, x in zip(kinds, row, strict=True)}
    assert found == wanted
    for name, figure in wanted.items():
        variant = EXPERIMENTS["table_1"].variants[name]
        resolved = scenario.resolved(scenario.load(variant.scenario, variant.sets))
        assert published(resolved)[:2] == ({"rmse_x": figure}, "Wei 2022")


@pytest.mark.parametrize("name", ["table_2", "table_2_start_drawn", "table_2_noisy_truth"])
def test_table_2_is_as_printed(name):
    printed = {
        "pf": (1.2301, 0.2132, 1.2218, 0.2428),
        "cs_pf": (1.1406, 0.0615, 1.0103, 0.0608),
        "ics_pf": (0.0306, 0.0213, 0.0253, 0.0102),
    }
    columns = ("px", "vx", "py", "vy")
    found = {
        (c.variant, c.measure): c.published
        for c in values(EXPERIMENTS[name])
        if c.published is not None and c.where == "table 2" and c.measure.startswith("column:")
    }
    assert found == {
        (kind, f"column:{column}"): figure
        for kind, row in printed.items()
        for column, figure in zip(columns, row, strict=True)
    }


def test_every_pair_of_filters_of_a_table_is_compared_by_the_statistic_that_the_table_prints():
    """Table 1 is the RMSE of a run (eq. 17) averaged over runs, table 2 the RMSE over runs and steps."""
    pairs = {("cs_pf", "pf"), ("ics_pf", "pf"), ("ics_pf", "cs_pf")}
    found = {(c.variant, c.other, c.measure) for c in EXPERIMENTS["table_1"].claims
             if c.other and c.where in ("table 1", "figures 1 to 4")}  # fmt: skip
    assert found == {(f"{one}, {n}", f"{other}, {n}", "per_run_rmse:x") for one, other in pairs for n in (30, 60, 100)}
    assert {c.measure for c in values(EXPERIMENTS["table_1"]) if c.id == "rmse"} == {"per_run_rmse:x"}
    stated = pairs - {("ics_pf", "pf")}  # which follows from the others
    for name in ("table_2", "table_2_r_0_01", "table_2_r_0_1", "table_2_r_10"):
        for columns, where, those in (
            (("px", "py"), "section 4.2", stated), (("vx", "vy"), "figures 9 and 10", stated),
            (("px", "py", "vx", "vy"), "table 2", pairs - stated),
        ):  # fmt: skip
            found = {(c.variant, c.other, c.measure) for c in EXPERIMENTS[name].claims if c.other and c.where == where}
            assert found == {(one, other, f"column:{column}") for one, other in those for column in columns}


def test_the_ratios_of_ics_pf_to_its_rivals_are_those_of_the_tables_and_judged_by_their_statistics():
    (one, two), tables = (EXPERIMENTS["table_1"], EXPERIMENTS["table_2"]), {}
    for experiment in (one, two):
        printed = {c.variant: {} for c in values(experiment)}
        for c in values(experiment):
            if c.where.startswith("table") and c.published is not None and not c.measure.startswith("over:"):
                printed[c.variant][c.measure] = c.published
        found = [c for c in values(experiment) if c.measure.startswith("over:")]
        for c in found:
            other, _, measure = c.measure.removeprefix("over:").partition("; ")
            assert c.published == pytest.approx(printed[c.variant][measure] / printed[other][measure]), c
        tables[experiment.name] = len(found)
    assert tables == {"table_1": 6, "table_2": 8}


def test_what_is_true_by_construction_or_set_by_the_number_of_generations_is_not_counted():
    for experiment in EXPERIMENTS.values():
        for claim in experiment.claims:
            name = claim.measure.partition(":")[2]
            wanted = {"distinct": "construction", "operations": "our constant"}.get(name.partition("_")[0], "evidence")
            assert claim.basis == (wanted if claim.other or claim.published is not None else "evidence"), claim
            assert claim.deterministic == (wanted == "our constant"), claim


def test_run_times_are_as_printed_and_only_their_ratios_are_judged():
    found = [c for c in values(EXPERIMENTS["table_2"]) if c.where.removeprefix("from ") == "section 4.2"]
    assert {c.variant: c.published for c in found if not c.judged} == {"pf": 50.36, "cs_pf": 35.32, "ics_pf": 28.36}
    ratios = {(c.variant, c.measure.rpartition("_over_")[2]): c.published for c in found if c.judged}
    assert ratios == {
        ("cs_pf", "pf"): pytest.approx(0.7013, abs=1e-4),
        ("ics_pf", "pf"): pytest.approx(0.5631, abs=1e-4),
        ("ics_pf", "cs_pf"): pytest.approx(0.8029, abs=1e-4),
    }


def test_only_what_the_text_says_of_its_own_set_up_is_counted():
    readings = {"table_1_until_no_gain", "table_2_r_0_01", "table_2_r_0_1", "table_2_r_10"}
    assert {name for name, one in EXPERIMENTS.items() if one.literal} == {"table_1", "diversity", "table_2"} | readings
    table_1 = EXPERIMENTS["table_1"].claims
    assert not any(claim.literal for claim in table_1 if claim.where == "repaired")
    assert all(claim.literal for claim in table_1 if claim.where == "table 1")
    assert [
        claim.read for claim in values(EXPERIMENTS["table_1"]) if claim.id == "rmse" and claim.where == "table 1"
    ] == [False] * 9


def test_the_gain_is_over_the_cuckoo_search_with_as_many_particles_and_operations_are_of_the_named():
    runs = {
        "cs_pf, 30": pd.DataFrame({"replicate": [0, 1], "rmse": [5.0, 4.0], "cycles": [300.0, 300.0]}),
        "ics_pf, 30": pd.DataFrame({"replicate": [1, 0], "rmse": [1.0, 4.5], "cycles": [300.0, 300.0]}),
        "ics_pf, 20": pd.DataFrame({"replicate": [0, 1], "rmse": [9.0, 9.0], "cycles": [200.0, 150.0]}),
    }
    data = TablesOfRuns(runs)
    assert MEASURES["gain_over_cs_pf"](data, "ics_pf, 30").to_dict() == {0: 0.5, 1: 3.0}
    found = MEASURES["operations_over_cs_pf_30"](data, "ics_pf, 20").to_dict()
    assert found == {0: pytest.approx(2 / 3), 1: 0.5}


def test_what_the_searches_evaluate_is_what_the_reasons_say():
    """The searches evaluate 11 likelihoods for each particle and step, where PF evaluates 1."""
    variants = EXPERIMENTS["table_2"].variants
    trackers = {
        kind: scenario.build(scenario.load(variants[kind].scenario, variants[kind].sets)).tracker
        for kind in ("cs_pf", "ics_pf")
    }
    assert {tracker.evaluations for tracker in trackers.values()} == {11}
    assert (trackers["ics_pf"].f_max, trackers["cs_pf"].length) == (0.5, 0.01)


def few(experiment: Experiment) -> Experiment:
    """Two short runs with few particles and cells, and one claim of each kind and variant."""
    size = {"grid": "tracker.cells=240"}
    variants = {
        name: replace(
            variant, sets=(*variant.sets, size.get(variant.scenario.rpartition("_")[2], "tracker.particles=10"))
        )
        for name, variant in experiment.variants.items()
    }
    kinds = {(type(claim), claim.variant, claim.measure.rstrip("0123456789")): claim for claim in experiment.claims}
    short = () if experiment.name == "diversity" else ("duration=4 s",)
    return replace(
        experiment,
        quick=2,
        variants=variants,
        claims=tuple(replace(claim, reason="") for claim in kinds.values()),
        sets=(*experiment.sets, *short),
    )


@pytest.mark.thorough
@pytest.mark.parametrize("name", [*thorough(["diversity"]), "table_2_start_drawn"])
def test_a_small_run_gives_a_row_a_claim_and_its_pictures(tmp_path, monkeypatch, name):
    monkeypatch.setattr(reproduce, "LocalEngine", InlineEngine)
    small = few(EXPERIMENTS[name])
    assert reproduce.resume(reproduce.begin("wei2022", small, tmp_path)).complete
    folder = reproduce.folder_of(tmp_path, "wei2022", small)
    rows = [row for row in reproduce.rows("wei2022", small, folder) if not row.paired]
    assert [row.variant for row in rows] == [claim.variant for claim in small.claims]
    assert all(math.isfinite(row.measured) and row.replicates == 2 for row in rows)
    files = reproduce.draw("wei2022", small, folder, tmp_path)
    assert [file.name for file in files] == [f"wei2022_{figure.name}.png" for figure in small.figures]
    assert all(file.stat().st_size > 10_000 for file in files)


def cloud_of(data: dict) -> SimpleNamespace:
    frame = pd.DataFrame({"step": 10, **data})
    return SimpleNamespace(of=lambda variant, table: frame)


def test_equal_particles_count_once_in_their_own_run():
    data = cloud_of({"replicate": [0, 0, 0, 0, 1, 1], "x": [1.0, 1.0, 1.0, 2.0, 1.0, 2.0], "weight": 1.0})
    assert MEASURES["distinct_10"](data, "pf").to_dict() == {0: 0.5, 1: 1.0}


def test_the_spread_is_that_of_the_weights():
    data = cloud_of({"replicate": [0, 0], "x": [0.0, 4.0], "weight": [3.0, 1.0]})
    assert MEASURES["spread_10"](data, "pf")[0] == pytest.approx(math.sqrt(3.0))
