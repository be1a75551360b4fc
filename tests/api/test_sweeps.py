"""Sweeps and comparisons from Python take components and mappings, and show themselves."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import wsnsim
from wsnsim.base.errors import ResultError, RunError, ScenarioError, UsageError
from wsnsim.base.part import part
from wsnsim.trackers import Ekf, Pf, Rkf

FEW = {"replicates": 2, "duration": 4, "workers": 0}


@part
class Failing(Rkf):
    """A tracker whose first step fails."""

    def step(self, belief, scene):
        raise KeyError("nothing")


def test_a_sweep_takes_axes_as_a_mapping_and_shows_its_points(tmp_path):
    found = wsnsim.sweep("rkf", {"tracker": [Rkf(), Pf(particles=20)]}, out=tmp_path / "s", keep=["estimates"], **FEW)
    assert found.complete
    assert list(found.runs.groupby("tracker.kind", observed=True).size()) == [2, 2]
    assert len(found.table("estimates")) == 2 * 2 * 3
    assert found.compare().table["tracker.kind"].tolist() == ["rkf", "pf"]
    assert repr(found) == f"<Sweep: 4 runs, {tmp_path / 's'}>"
    assert found._repr_html_().count("<tr>") == 3
    again = wsnsim.sweep("rkf", {"tracker": [Rkf(), Pf(particles=20)]}, out=tmp_path / "s", keep=["estimates"], **FEW)
    assert (again.outcome.done, again.outcome.found) == (0, 4), "it is resumed"
    with pytest.raises(AttributeError, match="did you mean 'runs'"):
        found.rns  # noqa: B018


def test_a_sweep_and_runs_of_its_points_are_the_same():
    found = wsnsim.sweep("rkf", {"duration": [4, 5]}, replicates=2, workers=0, tracker=Pf(particles=20), seed=7)
    alone = wsnsim.run("rkf", replicates=2, duration=5, tracker=Pf(particles=20), seed=7)
    assert found.runs.fingerprint[2:].tolist() == alone.runs.fingerprint.tolist()


@pytest.mark.thorough
def test_a_temporary_sweep_goes_with_its_result():
    found = wsnsim.sweep({"extends": "rkf", "name": "mine"}, ["seed=1,2"], **FEW)
    folder = found.out
    assert folder.is_dir() and found.compare().name == "mine"
    del found
    assert not folder.exists()


def test_trackers_are_compared_by_name_by_component_and_under_names_of_ones_own(tmp_path):
    found = wsnsim.compare("rkf", trackers=["rkf", Pf(particles=20), {"kind": "pf", "particles": 30}], **FEW)
    assert found.table["tracker"].tolist() == ["rkf", "pf:particles=20", "pf:particles=30"]
    assert found.baseline == "rkf"
    assert "\nrkf: 3 points, 2 runs each\n" in str(found)
    assert repr(found) == "<Comparison rkf: rmse of 3 points>"
    assert found._repr_html_().count("<li>") == 2
    named = wsnsim.compare(
        wsnsim.load("rkf"), trackers={"few": Pf(particles=20), "many": "pf:particles=40"}, out=tmp_path / "c", **FEW
    )
    assert named.table["tracker"].tolist() == ["few", "many"]
    again = wsnsim.compare(tmp_path / "c", "median_error", baseline="many")
    assert (again.metric, again.baseline) == ("median_error", "many")


@pytest.mark.thorough
def test_a_component_has_all_of_its_values_in_a_comparison():
    base = {"extends": "rkf", "name": "mine", "tracker": {"kind": "pf", "particles": 20}}
    usual = Pf().particles
    found = wsnsim.compare(base, trackers={"as it is": "pf", "default": Pf()}, **{**FEW, "replicates": 1})
    assert len(found.table) == 2 and usual != 20


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "'rkf' is not the folder of a campaign; a scenario needs trackers"),
        ({"replicates": 3}, r"runs a scenario only with trackers"),
        ({"trackers": ["efk"]}, "unknown tracker 'efk' .did you mean 'ekf'"),
        ({"trackers": [Ekf]}, r"trackers.0: error: is the class ExtendedKalman"),
        ({"trackers": [Rkf(), 3]}, r"trackers.1: error: expected a tracker: .* got int"),
        ({"trackers": []}, r"trackers: expected a list such as .* got \[\]"),
        ({"trackers": 5}, "trackers: expected a list such as .* got 5"),
        ({"trackers": ["rkf"]}, r"trackers: expected at least two to compare, .* got \['rkf'\]"),
        ({"trackers": "rkf,"}, "error: expected a tracker, such as trackers 'pf"),
        ({"trackers": ["rkf", "pf"], "replicates": True}, "replicates: expected a number of runs from 1, got True"),
        ({"trackers": ["rkf"], "traker": "ekf"}, r"compare\(\) has no argument 'traker' .did you mean"),
        ({"trackers": [Failing(), "rkf"], **FEW}, "the comparison is not complete: .*KeyError: 'nothing'"),
    ],
)
def test_what_cannot_be_compared_is_refused(arguments, message):
    with pytest.raises((UsageError, ScenarioError, RunError), match=message):
        wsnsim.compare("rkf", **arguments)


def test_runs_that_fail_are_part_of_a_sweep():
    found = wsnsim.sweep("rkf", tracker=Failing(), **FEW)
    assert [why.endswith("the others were not tried") for why in found.failed.values()] == [True] and not found.complete
    assert [*found.missing.values()] == [[0, 1]] and "1 failed" in repr(found)
    with pytest.raises(ResultError):
        found.compare()


@pytest.mark.thorough
def test_a_script_without_a_main_guard_compares_in_its_own_process(tmp_path):
    script = tmp_path / "plain.py"
    script.write_text("import wsnsim\nprint(wsnsim.compare('rkf', trackers=['rkf', 'pf'], replicates=1, duration=2))\n")
    here = {**os.environ, "PYTHONPATH": str(Path(wsnsim.__file__).parents[1])}
    command = [sys.executable, script.name]
    done = subprocess.run(command, cwd=tmp_path, env=here, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "\nrkf: 2 points, 1 run each\n" in done.stdout


def test_a_range_is_an_axis_and_other_objects_are_refused():
    found = wsnsim.sweep("rkf", {"tracker": [Pf(particles=20)], "seed": range(1, 3)}, **{**FEW, "replicates": 1})
    assert sorted(found.runs["seed"].unique()) == [1, 2]
    with pytest.raises(UsageError, match=r"vary: expected a mapping such as .* got \[1, 2\]"):
        wsnsim.sweep("rkf", [1, 2])
    with pytest.raises(UsageError, match=r"scenario: expected .* got None"):
        wsnsim.sweep(None, {"seed": [1, 2]})
