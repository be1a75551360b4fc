"""The table `tracker_state`: named quantities that a tracker reports after each step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wsnsim
from wsnsim.base.optional_ports import ReportsState
from wsnsim.base.tables import RECORDED_BY_DEFAULT, Memory
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.pso_mhpf import PsoMhpf
from wsnsim.trackers.sensor_chains import RelayKalman

IN_A_NETWORK = ("duration=41 s", "link.reach=2000", "sensor.reach=3000", "clusters.kind=central")


@wsnsim.part
class Growing(ExtendedKalman):
    """An EKF that reports its mean at every step, and its first row of covariances at some."""

    def report_state(self, belief: Any) -> dict[str, Any]:
        values = {"mean": belief.mean}
        return {**values, "spread of x": belief.cov[0]} if belief.mean[1] > 0.0 else values


@pytest.mark.thorough(fast=["extra0-rkf"])
@pytest.mark.parametrize("tracker", ["rkf", "imsf"])
@pytest.mark.parametrize("extra", [("network=none",), IN_A_NETWORK])
def test_sensor_probabilities_are_recorded_with_a_network_and_without(tmp_path, tracker, extra):
    source = wsnsim.load("liu_network", [f"tracker.kind={tracker}", *IN_A_NETWORK, *extra, "record.tracker_state=true"])
    report = wsnsim.experiment.run(source, replicates=2, out=tmp_path / "x.h5")
    table = wsnsim.read(report.out, "tracker_state")
    assert list(table) == ["replicate", "target", "step", "name", "index", "value"]
    assert set(table["name"]) == {"node", "probability"}
    shown = table[table["name"] == "probability"].groupby(["replicate", "step"])["value"]
    assert shown.sum().to_numpy() == pytest.approx(1.0) and (shown.size() == 8).all()
    assert sorted(set(table["step"])) == list(range(1, 41))
    nodes = table[(table["name"] == "node") & (table["step"] == 40) & (table["replicate"] == 1)]
    assert nodes["value"].tolist() == nodes["index"].tolist() == list(range(8))


def test_the_table_is_off_by_default_and_does_not_change_the_run():
    assert not RECORDED_BY_DEFAULT["tracker_state"]
    quiet, recorded = Memory(), Memory({**RECORDED_BY_DEFAULT, "tracker_state": True})
    prints = [
        wsnsim.experiment.simulate_run(wsnsim.load("rkf", ["duration=11 s"]), 0, memory).run["fingerprint"]
        for memory in (quiet, recorded)
    ]
    assert prints[0] == prints[1]
    assert not quiet.table("tracker_state") and recorded.table("tracker_state")["value"].size == 10 * 2 * 8
    assert recorded.state_names.all() == ("node", "probability")


@pytest.mark.thorough
def test_names_of_any_tracker_reach_the_file_and_a_tracker_that_has_nothing_to_report_writes_no_row(tmp_path):
    changes = ("duration=11 s", "record.tracker_state=true")
    source = wsnsim.load("rkf", [*changes, f"tracker.kind={__name__}:Growing"])
    table = wsnsim.read(wsnsim.experiment.run(source, replicates=1, out=tmp_path / "x.h5").out, "tracker_state")
    assert set(table["name"]) == {"mean", "spread_of_x"}
    mean = table[table["name"] == "mean"].pivot(index="step", columns="index", values="value")
    estimates = wsnsim.read(tmp_path / "x.h5", "estimates")
    assert np.array_equal(mean.to_numpy(), estimates[["px", "vx", "ax"]].to_numpy())
    ekf = wsnsim.load("rkf", [*changes, "tracker.kind=ekf"])
    assert wsnsim.read(wsnsim.experiment.run(ekf, replicates=1, out=tmp_path / "ekf.h5").out, "tracker_state").empty
    assert isinstance(RelayKalman(), ReportsState) and not isinstance(PsoMhpf(), ReportsState)
