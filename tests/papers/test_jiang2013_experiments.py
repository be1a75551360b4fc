import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from tests.campaign.inline_engine import InlineEngine
from tests.papers.studies import module
from wsnsim import scenario
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.tables import Memory
from wsnsim.experiment import simulate_run
from wsnsim.papers import measures, reproduce
from wsnsim.papers.study import study

figures = module("jiang2013")
jiang2013_measures = module("jiang2013")

EXPERIMENTS = study("jiang2013").experiments

PRINTED = {
    "rmse": {"pso_mhpf": 2.5347, "ipf": 3.3710, "ppf": 4.5519},
    "mean:energy": {"pso_mhpf": 1.82, "ipf": 2.33, "ppf": 2.45},
    "clusters": {"pso_mhpf": 16.0},
    "least_level": {"pso_mhpf": 2.364e-3},
    "largest_level": {"pso_mhpf": 3.378e-3},
    "on_level": {"pso_mhpf": 1.0},
}
"""The published values of section 5, by measure and tracker."""


def short(measure):
    name = measure.partition(":")[2]
    return name if name in study("jiang2013").measures else measure


def claims():
    return [(experiment, claim) for experiment in EXPERIMENTS for claim in experiment.claims]


def test_published_figures_are_those_of_the_page_and_every_one_of_them_is_claimed():
    seen = set()
    for experiment, claim in claims():
        if claim.other or claim.published is None or experiment.name == "figure_3":
            continue
        tracker, name = claim.variant.split(",")[0], short(claim.measure)
        if claim.measure.startswith("over:"):
            other, _, name = claim.measure.removeprefix("over:").partition("; ")
            assert claim.published == PRINTED[name or "rmse"][tracker] / PRINTED[name or "rmse"][other]
            continue
        assert claim.published == PRINTED[name][tracker]
        seen.add((name, tracker)) if claim.variant == tracker else None
    assert seen == {(name, tracker) for name, row in PRINTED.items() for tracker in row}


def test_every_order_of_the_three_trackers_that_is_published_is_claimed():
    orders = {(claim.measure, claim.variant, claim.other) for _, claim in claims() if claim.other}
    for measure in ("rmse", "mean:energy"):
        printed = sorted(figures.PRINTED, key=PRINTED[measure].__getitem__)
        for i, one in enumerate(printed):
            for other in printed[i + 1 :]:
                assert (measure, one, other) in orders


@pytest.mark.thorough
def test_figure_3_is_run_on_the_first_cluster_of_the_network_that_figure_2_shows():
    (convergence,) = (each for each in EXPERIMENTS if each.name == "figure_3")
    first = reproduce.plan("jiang2013", convergence).points[0]
    anchors = json.loads(first.resolved)["deploy"]["places"]
    draw = sample_initial_conditions(scenario.build(scenario.load("pso_mhpf")), 0)
    target, places = draw.truths[0][0][[0, 2]], draw.positions
    memory = Memory({"clusters": True})
    simulate_run(scenario.load("pso_mhpf", ["duration=0.08 s"]), 0, memory)
    first = {name: column[0] for name, column in memory.table("clusters").items()}
    head = int(first["head"])
    near = np.hypot(*(places - target).T) <= 60.0
    heard = np.hypot(*(places - places[head]).T) <= 75.0
    members = np.flatnonzero(near & heard)
    assert first["members"] == len(members) == len(anchors)
    wanted = np.round(places[[head, *members[members != head]]], 2)
    np.testing.assert_allclose(wanted, anchors, atol=1e-9)


def test_the_intensity_that_the_paper_does_not_give_is_swept_over_four_decades_and_all_else_is_the_same():
    (swept,) = (each for each in EXPERIMENTS if each.name == "intensity")
    points = [json.loads(point.resolved) for point in reproduce.plan("jiang2013", swept).points]
    found = {(one["tracker"]["kind"], one["sensor"].pop("intensity")) for one in points}
    assert found == {(kind, 10.0**k) for kind in ("pso_mhpf", "ipf", "ppf") for k in range(2, 7)}
    assert len({json.dumps({**one, "tracker": 0, "name": 0}) for one in points}) == 1
    assert not any(claim.literal and swept.literal for claim in swept.claims)


def test_the_energy_of_every_proposal_of_ipf_is_compared_and_only_the_default_is_read_as_the_papers():
    found = {claim.other: claim.literal for _, claim in claims() if claim.other and claim.measure == "mean:energy"
             and claim.variant == "pso_mhpf"}  # fmt: skip
    assert found == {"ipf": True, "ppf": True, "ipf, one proposal from Q": False, "ipf, one proposal for all": False}


def fake(**tables):
    """Data with these tables for any variant."""
    return SimpleNamespace(of=lambda variant, table: tables[table])


def stepped(levels, handovers):
    """Energy by step and cause, from step 0 on; steps with a handover cost ten times as much."""
    joules = np.array(levels)
    joules[handovers] *= 10.0
    steps = np.arange(len(joules))
    rows = [
        pd.DataFrame({"replicate": 0, "step": steps, "time": 0.04 * steps, "cause": cause, "joules": share * joules})
        for cause, share in (("rx", 0.25), ("cpu", 0.75))
    ]
    return pd.concat(rows)


def test_the_level_of_a_cluster_is_what_its_steps_cost_and_a_handover_is_not_on_it():
    levels = [9.0] + [2.0] * 10 + [3.0] * 10
    spent = stepped(levels, handovers=[10])
    formed = pd.DataFrame({"replicate": 0, "cluster": [0.0, 1.0], "formed": [0.0, 0.44]})
    data = fake(energy_steps=spent, clusters=formed)
    assert jiang2013_measures.clusters(data, "x").tolist() == [2]
    assert jiang2013_measures.least_level(data, "x").tolist() == pytest.approx([2.0])
    assert jiang2013_measures.largest_level(data, "x").tolist() == pytest.approx([3.0])
    assert jiang2013_measures.on_level(data, "x").tolist() == pytest.approx([19 / 20])


@pytest.mark.thorough
def test_members_that_a_map_shows_are_as_many_as_the_cluster_counted(tracked):
    data, _ = tracked
    frame = data.of("pso_mhpf", "clusters")
    nodes = data.of("pso_mhpf", "nodes")
    places = nodes[nodes["replicate"] == 0][["x", "y"]].to_numpy()
    rows = list(frame[frame["replicate"] == 0].itertuples())
    assert len(rows) >= 2
    for row in rows:
        assert len(figures._members_of(data, places, row)) + 1 == row.members


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """Two runs of 60 steps of the variants that figures show, as data; the experiment and its folder."""
    where, whole = tmp_path_factory.mktemp("jiang2013"), EXPERIMENTS[0]
    variants = {name: whole.variants[name] for name in (*figures.PRINTED, *figures.REPAIRED)}
    claims = tuple(
        replace(claim, reason="")
        for claim in whole.claims
        if claim.shown and claim.variant in figures.PRINTED and (claim.other or claim.variant) in variants
    )
    small = replace(whole, quick=2, sets=("duration=2.4 s",), variants=variants, claims=claims)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduce, "LocalEngine", InlineEngine)
        assert reproduce.resume(reproduce.begin("jiang2013", small, where), 1).complete
    folder = reproduce.folder_of(where, "jiang2013", small)
    return measures.Data(reproduce.Folder(folder)), (small, folder)


@pytest.mark.thorough
def test_a_small_run_gives_a_row_a_claim_and_a_picture_a_figure(tracked, tmp_path):
    _, (small, folder) = tracked
    rows = [row for row in reproduce.rows("jiang2013", small, folder) if not row.paired]
    assert len(rows) == len(small.claims)
    energy = next(row for row in rows if row.quantity.startswith("network energy") and row.variant == "pso_mhpf")
    assert 0.0 < energy.measured < 1.82 and energy.published == 1.82 and energy.replicates == 2
    files = reproduce.draw("jiang2013", small, folder, tmp_path)
    assert [file.name for file in files] == [f"jiang2013_{figure.name}.png" for figure in small.figures]
    assert all(file.stat().st_size > 10_000 for file in files)
