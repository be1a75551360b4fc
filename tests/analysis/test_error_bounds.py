"""Bounds beside the errors of a campaign are kept, but not once something that they depend on has changed."""

from __future__ import annotations

import json

import pytest

import wsnsim
from wsnsim.analysis import error_bounds
from wsnsim.analysis.comparison import compare
from wsnsim.analysis.comparison_text import text
from wsnsim.analysis.error_bounds import PointBounds
from wsnsim.recording.folder import Folder
from wsnsim.recording.kept import KeptAnswers
from wsnsim.scenario import Plugins, load, resolved


@pytest.fixture
def found(tmp_path, monkeypatch):
    """found(scenario, answer): the kept bounds of two runs, or else those with this answer."""
    place = tmp_path / "kept" / "bounds.json"

    def bounds_of(scenario, answer):
        monkeypatch.setattr(error_bounds, "_point_bounds", lambda *_: PointBounds(answer, answer, ""))
        return error_bounds._kept_bounds(KeptAnswers(place), scenario, (0, 1), Plugins.NONE).each

    return bounds_of


def test_bounds_are_kept_for_the_same_scenario_only(found):
    one, other = (resolved(load("ungm_pf", [f"duration={seconds} s"])) for seconds in (3, 4))
    assert [found(one, 1.0), found(one, 2.0), found(other, 3.0), found(one, 4.0)] == [1.0, 1.0, 3.0, 1.0]


def test_bounds_are_worked_out_again_if_a_file_of_the_scenario_changed(found, tmp_path):
    places = tmp_path / "places.csv"
    places.write_text("x,y\n0,0\n5,5\n")
    scenario = resolved(load("central_pf", [f"deploy={{kind: file, path: {places}}}"]))
    assert [found(scenario, 1.0), found(scenario, 2.0)] == [1.0, 1.0]
    places.write_text("x,y\n0,0\n5,6\n")
    assert found(scenario, 3.0) == 3.0
    places.unlink()
    assert found(scenario, 4.0) == 4.0


def test_bounds_that_depend_on_a_plug_in_are_not_kept(found, monkeypatch):
    scenario = resolved(load("ungm_pf", ["duration=3 s"]))
    monkeypatch.setattr(error_bounds, "plugins", lambda _: ("sensor mine",))
    assert [found(scenario, 1.0), found(scenario, 2.0)] == [1.0, 2.0]


@pytest.mark.thorough
def test_what_a_bound_takes_of_the_readings_is_kept_with_it_and_noted(tmp_path):
    scenario = {
        "name": "receivers", "seed": 3, "network": "none", "step": 1, "duration": 4,
        "prior": {"sd": [1.0, 0.5, 1.0, 0.5]},
        "deploy": {"kind": "anchors", "places": [[0, 0], [20, 0], [0, 20]]},
        "motion": {"kind": "constant_velocity", "noise_input": "diagonal", "variances": [0.02],
                   "start": [4, 0.5, 5, 0.4]},
        "sensor": {"kind": "rssi", "sd": 3, "gain_spread": 4, "shadowing": 3},
        "tracker": {"kind": "ekf", "gains": "unknown"},
    }  # fmt: skip
    kept = KeptAnswers(tmp_path / "bounds.json")
    for _ in range(2):
        about = error_bounds._kept_bounds(kept, resolved(load(scenario)), (0,), Plugins.NONE).about
        assert "takes them as independent" in about[0] and "takes gains as known" in about[1]
    (tmp_path / "receivers.yaml").write_text(json.dumps(scenario))
    sweep = {"scenario": str(tmp_path / "receivers.yaml"), "grid": {"tracker.kind": ["ekf", "pf"]}, "replicates": 2}
    wsnsim.sweep(sweep, out=tmp_path / "receivers", workers=1)
    found = error_bounds.with_bounds(compare(tmp_path / "receivers"), Folder(tmp_path / "receivers"))
    assert found.of_bounds == "; ".join(about) and f"of the bound: {found.of_bounds}" in " ".join(text(found).split())
