"""Every tracker of the catalogue runs in a network: with handovers, lost packets and a ledger that closes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.tracker_kinds import trackers_of_one_target
from wsnsim import experiment, scenario
from wsnsim.base.tables import KIND, Memory
from wsnsim.network.clusters.collection import Collection

OTHERS = {"grid", "trilateration", "gmtt", "tsstp", "cluster", "ris"}  # one column, or distances: not on this field
PLANE = [row.kind for row in trackers_of_one_target() if row.kind not in OTHERS]
GAUSSIAN = ("ekf", "ukf", "ckf", "imm", "rkf", "imsf", "information_driven")
LINE = [kind for kind in PLANE if kind != "ipf"] + ["grid"]


def simulated(name: str, *changes: str) -> tuple[Memory, experiment.Summary]:
    memory = Memory()
    return memory, experiment.simulate_run(scenario.load(name, changes), 0, memory)


def assert_valid_run(memory: Memory, summary: experiment.Summary) -> None:
    """Assert that the ledger closes, that operations were computed, and that estimates are finite."""
    run, nodes = summary.run, memory.table("nodes")
    spent = nodes["energy_initial"] - nodes["energy_left"]
    assert run["energy"] == pytest.approx(spent.sum(), rel=1e-9)
    assert run["energy"] == pytest.approx(sum(summary.joules.values()), rel=1e-9)
    assert summary.joules["cpu"] > 0 and run["cycles"] > 0
    assert run["frames_lost"] > 0 and run["handovers"] > 0
    estimates = memory.table("estimates")
    known = np.isfinite(estimates["issued"])
    assert known.mean() > 0.5 and np.isfinite(estimates["error"][known]).all()


@pytest.mark.parametrize(
    ("name", "kind"),
    [*(("jiang_field", kind) for kind in PLANE), *((kind, kind) for kind in ("gmtt", "tsstp", "cluster", "ris")),
     ("ungm_grid", "grid"), ("range_anchors", "trilateration")],
)  # fmt: skip
def test_in_a_few_steps_estimates_are_finite_and_the_ledger_closes(name: str, kind: str) -> None:
    few = ["tracker.particles=20"] if name == "jiang_field" and kind not in GAUSSIAN else []
    step = scenario.load(name).step
    memory, summary = simulated(name, f"tracker.kind={kind}", f"duration={11 * step} s", *few)
    error = memory.table("estimates")["error"]
    assert len(error) and np.isfinite(error).any() and not np.isinf(error).any()
    if summary.joules:
        nodes = memory.table("nodes")
        spent = (nodes["energy_initial"] - nodes["energy_left"]).sum()
        assert sum(summary.joules.values()) == pytest.approx(spent, rel=1e-9) == summary.run["energy"]


@pytest.mark.thorough
@pytest.mark.parametrize("kind", PLANE)
def test_on_jiangs_field_with_a_lossy_radio(kind: str) -> None:
    fewer = [] if kind in GAUSSIAN else ["tracker.particles=60"]
    changes = f"tracker.kind={kind}", "duration=6 s", "link.loss=0.2", *fewer
    assert_valid_run(*simulated("jiang_field", *changes))


@pytest.mark.thorough
@pytest.mark.parametrize("deadline", [0.0, 0.006])
@pytest.mark.parametrize("kind", PLANE)
def test_with_heads_that_go_on_before_everything_has_arrived(kind: str, deadline: float, monkeypatch) -> None:
    gather = Collection.gather
    monkeypatch.setattr(Collection, "gather", lambda one, nodes, parcels, _: gather(one, nodes, parcels, deadline))
    fewer = [] if kind in GAUSSIAN else ["tracker.particles=10"]
    memory, summary = simulated("ekf_real", f"tracker={{kind: {kind}}}", "mac={kind: csma}", "duration=2 s", *fewer)
    estimates = memory.table("estimates")
    known = np.isfinite(estimates["issued"])
    assert known.any() and np.isfinite(estimates["error"][known]).all()
    assert np.nanmax(estimates["readings"]) <= (1 if deadline == 0.0 and kind in GAUSSIAN else np.inf)
    assert summary.run["frames_sent"] > 50


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["pso_mhpf", "ipf", "ppf"])
def test_in_an_open_cluster_whose_particles_travel_over_lossy_relays(kind: str) -> None:
    changes = f"tracker.kind={kind}", "tracker.particles=60", "clusters.kind=central", "duration=6 s", "link.loss=0.2"
    memory, _ = simulated("jiang_field", *changes)
    estimates = memory.table("estimates")
    known = np.isfinite(estimates["issued"])
    assert known.mean() > 0.5 and np.isfinite(estimates["error"][known]).all()
    assert (memory.table("events")["kind"] == KIND["relay"]).any()


@pytest.mark.thorough(fast=["central_pf"])
@pytest.mark.parametrize("kind", [kind for kind in LINE if kind != "grid"])
def test_along_a_line_whose_state_has_one_position_and_three_columns(kind: str) -> None:
    fewer = [] if kind in GAUSSIAN else ["tracker.particles=60"]
    moving = "motion.start=[1, 4, 0]", "prior.sd=[1, 1, 0.01]", "duration=100 s"
    memory, summary = simulated("liu_network", f"tracker.kind={kind}", "link.loss=0.1", *moving, *fewer)
    assert_valid_run(memory, summary)
    assert "sd_y" not in memory.table("estimates") and "ax" in memory.table("truth")


@pytest.mark.thorough
def test_the_same_truth_and_network_whatever_the_tracker() -> None:
    runs = [simulated("jiang_field", f"tracker.kind={kind}", "duration=1 s")[0] for kind in ("ekf", "imsf", "gpf")]
    for table, column in (("truth", "px"), ("nodes", "gain")):
        assert all(np.array_equal(run.table(table)[column], runs[0].table(table)[column]) for run in runs[1:])
