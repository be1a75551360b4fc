"""The view of a campaign reads what is in its folder, while others write there."""

from __future__ import annotations

import json
import os
import shutil
import sys
import threading
import time

import pytest

from wsnsim.base.errors import ResultError, UsageError
from wsnsim.cli import main
from wsnsim.recording.folder import Folder
from wsnsim.watch import campaign_view
from wsnsim.watch.campaign_view import CampaignView, campaign_state

SWEEP = [
    "sweep",
    "rkf",
    "--vary",
    "tracker.stay=0.9,0.95",
    "--set",
    "duration=5 s",
    "--replicates",
    "6",
    "-q",
    "-j",
    "1",
]


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    """A complete campaign of two points with six runs each."""
    folder, before = tmp_path_factory.mktemp("campaign") / "c", (list(sys.path), os.environ.copy())
    assert main([*SWEEP, "-o", str(folder)]) == 0
    sys.path[:] = before[0]
    return folder


@pytest.fixture
def folder(complete, tmp_path):
    return Folder(shutil.copytree(complete, tmp_path / "c"))


def without_point(folder, number):
    """Take away the results of a point; returns what puts them back."""
    point = folder.manifest().points[number].id
    taken = [(batch.path, batch.path.read_bytes()) for batch in folder.batches(point)]
    for path, _ in taken:
        path.unlink()
    return lambda: [path.write_bytes(content) for path, content in taken]


@pytest.mark.thorough
def test_runs_appear_with_their_curves(folder, ask):
    put_back = without_point(folder, 1)
    with CampaignView(folder) as view:
        first = json.loads(ask(view.url, "state")[2])
        assert (first["done"], first["total"], first["complete"]) == (6, 12, False)
        assert [point[1:4] for point in first["points"]] == [[6, 0, 6], [0, 0, 6]]
        assert first["points"][0][4] > 0 and first["points"][1][4] is None
        put_back()
        view.look()
        then = json.loads(ask(view.url, "state")[2])
        assert (then["done"], then["complete"]) == (12, True) and then["version"] == first["version"] + 1
        for name, title in then["curves"]:
            status, headers, svg = ask(view.url, f"{name}.svg?version=2")
            assert (status, headers["Content-Type"]) == (200, "image/svg+xml") and b"<svg" in svg and title
        assert {name for name, _ in then["curves"]} >= {"median", "lost"}
        for name in ("campaign.json", "../c/campaign.json", "none.svg", ".svg"):
            assert ask(view.url, name)[0] == 404


@pytest.mark.thorough
def test_a_campaign_that_this_process_runs_is_followed_in_a_thread(folder, ask):
    put_back = without_point(folder, 1)
    with CampaignView(folder) as view:
        assert json.loads(ask(view.url, "state")[2])["computes"] is False
        with view.following():
            put_back()
            until = time.monotonic() + 60
            while (state := json.loads(ask(view.url, "state")[2]))["done"] < 12:
                assert time.monotonic() < until
        assert state["computes"] is True
        assert json.loads(ask(view.url, "state")[2])["computes"] is False
    assert not any(thread.name == "watch campaign" for thread in threading.enumerate())


@pytest.mark.thorough
def test_what_cannot_be_shown_of_a_campaign_is_said_and_does_not_disturb_it(folder, ask, monkeypatch):
    with CampaignView(folder) as view:
        monkeypatch.setattr(campaign_view, "campaign_state", lambda folder: 1 / 0)
        with view.following():
            until = time.monotonic() + 60
            while "ZeroDivisionError" not in json.loads(ask(view.url, "state")[2])["why"]:
                assert time.monotonic() < until


@pytest.mark.thorough
def test_nothing_in_the_folder_changes_but_what_reading_keeps(folder):
    before = folder.state()
    with CampaignView(folder) as view:
        view.look()
    assert folder.state() == before


@pytest.mark.thorough
def test_failures_and_running_tasks_are_counted(folder):
    without_point(folder, 1)
    point = folder.manifest().points[1].id
    folder.write_failure(f"{point}.r00000-00000", "took too long\nand more")
    marker = folder.marker("s", f"{point}.r00001-00001")
    marker.parent.mkdir(exist_ok=True)
    marker.touch()
    state = campaign_state(folder)
    assert (state.done, state.failed, state.running) == (6, 1, 1)
    assert list(state.failures.values()) == ["took too long"]
    assert state.total == 12 and not state.complete
    with CampaignView(folder) as view:
        assert view.state() == "6 of 12 runs done, 1 failed, at 2 points"


def test_a_campaign_that_has_just_begun_says_so(folder, ask):
    for number in (0, 1):
        without_point(folder, number)
    shutil.rmtree(folder.path / "consolidated", ignore_errors=True)
    with CampaignView(folder) as view:
        view.look()
        state = json.loads(ask(view.url, "state")[2])
    assert (state["done"], state["curves"], state["why"]) == (0, [], "There are no results yet.")


def test_wrong_metrics_keys_and_folders_are_refused(folder, tmp_path):
    for given in ({"metric": "rmsee"}, {"column": "tracker.stayy"}):
        with pytest.raises(UsageError, match="did you mean"):
            CampaignView(folder, **given)
    with pytest.raises(ResultError, match="holds no campaign"):
        CampaignView(Folder(tmp_path))


def test_the_command_follows_a_campaign_until_it_is_complete(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder.path.parent)
    assert main(["watch", "c", "--exit", "--no-browser"]) == 0
    assert "c: 12 of 12 runs done, at 2 points" in capsys.readouterr().err
    for words, message in (
        (["c", "--replicates", "3"], "--replicates has no meaning for a campaign"),
        (["c", "--metric", "rmsee"], "did you mean 'rmse'"),
    ):
        assert main(["watch", *words]) == 2
        assert message in capsys.readouterr().err
