"""A component may hold a list of components of a role: their places in messages, their files, and plug-ins."""

from __future__ import annotations

from pathlib import Path

import pytest

from wsnsim import part, scenario
from wsnsim.base.errors import ScenarioError
from wsnsim.campaign.code_changes import _plugin_modules
from wsnsim.models.linear import ConstantVelocity
from wsnsim.scenario.build import plugins

WRITTEN = """\
extends: imm
name: mine
tracker:
  kind: imm
  models:
    - {kind: constant_velocity, variances: [0.1]}
    - {kind: %s}
"""


@part
class Slow(ConstantVelocity):
    """A motion model of a plug-in."""


def written(folder: Path, second: str) -> Path:
    path = folder / "mine.yaml"
    path.write_text(WRITTEN % second)
    return path


@pytest.mark.parametrize(
    ("second", "place", "message"),
    [
        ("waypoint", "mine.yaml:7:14: error: tracker.models.1.kind", "unknown motion 'waypoint'"),
        ("coordinated_turn, turnq: 1", "mine.yaml:7:32: error: tracker.models.1.turnq", "did you mean 'turn_q'?"),
        ("coordinated_turn, turn_q: -1", "error: tracker.models.1.turn_q", "must be at least 0, is -1"),
        ("constant_velocity, variances: [1, 2, 3]", "error: tracker.models.1", "variances: 3 values"),
    ],
)
def test_an_issue_of_an_item_is_named_with_its_place(tmp_path: Path, second: str, place: str, message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario.build(scenario.load(written(tmp_path, second)))
    assert place in str(caught.value) and message in str(caught.value)


def test_a_file_of_an_item_is_relative_to_the_folder_of_its_text(tmp_path: Path) -> None:
    (tmp_path / "track.csv").write_text("time,x,y\n0,0,0\n9,9,9\n")
    loaded = scenario.load(written(tmp_path, "recorded_track, path: track.csv"))
    second = scenario.resolved(loaded)["tracker"]["models"][1]
    assert second["path"] == str(tmp_path / "track.csv") and second["digest"]
    assert scenario.build(loaded).tracker.models[1].path == second["path"]


def test_an_item_may_be_a_plugin_which_provenance_and_campaigns_know(tmp_path: Path) -> None:
    loaded = scenario.load(written(tmp_path, f'"{__name__}:Slow"'))
    assert scenario.build(loaded).tracker.models[1] == Slow()
    assert plugins(loaded) == (f"motion {__name__}:Slow",)
    assert _plugin_modules(scenario.resolved(loaded)) == {__name__}


def test_an_empty_list_is_that_which_is_left_out(tmp_path: Path) -> None:
    changes = ("tracker={kind: imm, models: []}", "tracker={kind: imm}")
    one, other = (scenario.load("imm", [change]) for change in changes)
    assert one == other and scenario.build(one).tracker.models == ()
