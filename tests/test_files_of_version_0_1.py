"""Result files written before `runs.event_fingerprint` existed are still read, plotted, compared and verified."""

from __future__ import annotations

import gzip
import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

import wsnsim
from wsnsim.analysis import figures, result_info
from wsnsim.verification import verify

DATA = Path(__file__).parent / "data"


@pytest.fixture(params=("network", "offline"))
def path(request, tmp_path: Path) -> Path:
    """A file of version 0.1: pso_mhpf for 0.4 s (two runs), or rkf without a network for 10 s."""
    found = tmp_path / f"{request.param}.h5"
    found.write_bytes(gzip.decompress((DATA / f"version_0_1_{request.param}.h5.gz").read_bytes()))
    return found


@pytest.mark.thorough
def test_its_tables_are_read(path):
    runs, estimates = wsnsim.read(path, "runs"), wsnsim.read(path, "estimates")
    assert "event_fingerprint" not in runs
    assert np.isfinite(estimates["error"]).all() and len(estimates) == 10 * len(runs)
    assert result_info.info(path)["fingerprints"] == [f"{value:016x}" for value in runs["fingerprint"]]


@pytest.mark.thorough
def test_its_figures_are_drawn(path, tmp_path):
    drawn = figures.draw(path, tmp_path / "figures.svg")
    assert (tmp_path / "figures.svg").stat().st_size > 10_000
    assert "track" not in drawn.left_out


FORMER_RULES = {"prior_fit": "unweighted", "ranking": "likelihood"}
"""What PSO-MHPF did in version 0.1, which the file does not say: its defaults have changed since."""


def name_former_rules(path: Path) -> None:
    """Write the rules of version 0.1 into the scenario of a file."""
    with h5py.File(path, "r+") as file:
        scenario = json.loads(file["scenario/resolved_json"][()])
        if scenario["tracker"]["kind"] == "pso_mhpf":
            scenario["tracker"] |= FORMER_RULES
        del file["scenario/resolved_json"]
        file["scenario/resolved_json"] = json.dumps(scenario)


@pytest.mark.thorough
def test_it_is_verified_and_a_changed_fingerprint_is_noticed(path):
    name_former_rules(path)
    answer = verify(path)
    assert answer.ok and all(row["close"] for row in answer.rows)
    with h5py.File(path, "r+") as file:
        file["runs/fingerprint"][0] += 1
    assert not verify(path).rows[0]["equal"]


def test_it_can_be_read_together_with_a_new_file(path, tmp_path):
    folder = tmp_path / "both"
    folder.mkdir()
    shutil.copy(path, folder / "a.h5")
    wsnsim.run(wsnsim.load("rkf", ["duration=10 s"]), replicates=1, out=folder / "b.h5")
    joined = wsnsim.read(folder / "*.h5", "runs", ["replicate", "rmse"])
    assert len(joined) >= 2 and joined["rmse"].notna().all()


def test_its_scenario_is_that_of_a_run_of_today_which_is_a_step_longer(path):
    with h5py.File(path) as file:
        held = json.loads(file["scenario/resolved_json"][()])
    assert wsnsim.load(path).duration == pytest.approx(held["duration"] + held["step"])
    fresh = wsnsim.run(path, replicates=1, out=path.with_name("fresh.h5")).out
    assert wsnsim.load(fresh).duration == wsnsim.load(path).duration, "which is read as it is"
