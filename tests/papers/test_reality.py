"""`wsnsim reproduce reality`: recordings, laws of the other tracks, and answers that follow from the rows alone."""

from __future__ import annotations

import csv
import gzip
import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from tests.campaign.inline_engine import InlineEngine
from tests.papers.studies import module
from tests.papers.tables_of_runs import TablesOfRuns
from wsnsim import scenario
from wsnsim.base.errors import UsageError
from wsnsim.papers import reproduce
from wsnsim.papers.study import study

measures = module("reality", "answers")
_recording = module("reality", "recording")
WalkedTrack, recording = _recording.WalkedTrack, _recording.recording
heard_share, scatter, track_residuals = _recording.heard_share, _recording.scatter, _recording.track_residuals

RUNS = 30
GAINS = {"a": 4.0, "b": -4.0, "c": 0.0}


def write(folder, name, laps, seed, compressed=True):
    """A track of 0.5 m/s around a square of 8 m, `laps` times, heard by three receivers twice a second."""
    rng, rows = np.random.default_rng(seed), []
    corners = np.array([[1.0, 1.0], [9.0, 1.0], [9.0, 9.0], [1.0, 9.0], [1.0, 1.0]])
    for time in np.arange(0.0, laps * 64.0, 0.5):
        x, y = (np.interp(time % 64.0, np.arange(5) * 16.0, axis) for axis in corners.T)
        for node, (at_x, at_y) in {"a": (0.0, 5.0), "b": (10.0, 5.0), "c": (5.0, 0.0)}.items():
            distance = max(math.hypot(x - at_x, y - at_y), 0.1)
            reading = -60.0 - 18.0 * math.log10(distance) + GAINS[node] + 2.0 * rng.standard_normal()
            rows.append([f"{time + 0.01 * len(rows) % 0.03:.3f}", node, f"{reading:.2f}", f"{x:.3f}", f"{y:.3f}"])
    path = folder / (f"{name}.csv.gz" if compressed else f"{name}.csv")
    with gzip.open(path, "wt", newline="") if compressed else path.open("w", newline="") as file:
        csv.writer(file).writerows([["time", "receiver", "rssi", "x", "y"], *rows])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two closed tracks and an open one, the receivers, and a file that is no track."""
    where = tmp_path_factory.mktemp("tracks")
    write(where, "one", 1.0, 1)
    write(where, "two", 1.0, 2, compressed=False)
    write(where, "open", 0.5, 3)
    (where / "receivers.csv").write_text("receiver,x,y\na,0,5\nb,10,5\nc,5,0\n")
    (where / "fingerprints.csv").write_text("set,x,y,receiver,mean_rssi\ns,1,1,a,-60\n")
    return where


def test_a_folder_holds_the_tracks_whose_header_names_readings_and_places(folder):
    found = recording(folder)
    assert [track.name for track in found.tracks] == ["one", "open", "two"]
    assert [track.rectangular for track in found.tracks] == [True, False, True]
    assert found.tracks[0].seconds == pytest.approx(63.5, abs=0.1)
    assert found.tracks[1].metres == pytest.approx(16.0, abs=0.3)


def test_the_laws_of_a_track_are_fitted_to_the_others_and_find_the_gains(folder):
    found = recording(folder)
    for track in found.tracks:
        fit, laws = found.fits[track.name], found.laws(track.name)
        assert {file.path for file in fit.sample.files} == {str(t.path) for t in found.tracks} - {str(track.path)}
        assert laws.gains["gains"] == pytest.approx(list(GAINS.values()), abs=0.6)
        assert laws.gains["sd"] == pytest.approx(2.0, abs=0.2) and "gains" not in laws.plain
        assert laws.plain["sd"] > 3.0 and laws.spread == pytest.approx(math.sqrt(32.0 / 3.0), abs=0.4)
        assert laws.gains["eta"] == pytest.approx(1.8, abs=0.15)
        assert not {"shadowing", "noise", "dof"} & {*laws.plain, *laws.gains}


def test_residuals_scatter_and_share_heard_are_those_of_the_track_itself(folder):
    found = recording(folder)
    these = track_residuals(found, "one")
    assert these.sd[0] > 3.0 and these.sd[1] == pytest.approx(2.0, abs=0.2)
    assert these.sd[1] == pytest.approx(math.sqrt((these.gains**2).mean()))
    assert math.isnan(scatter(found, "one")), "readings of one receiver are half a second apart"
    assert heard_share(found, "one", 0.5) == pytest.approx(1.0, abs=0.03)
    assert heard_share(found, "one", 0.25) == pytest.approx(0.5, abs=0.02)


def test_a_folder_that_cannot_be_used_is_said_in_a_sentence(folder, tmp_path):
    with pytest.raises(UsageError, match=r"needs receivers.csv with receiver, x and y"):
        recording(tmp_path)
    (tmp_path / "receivers.csv").write_bytes((folder / "receivers.csv").read_bytes())
    write(tmp_path, "alone", 0.2, 1)
    with pytest.raises(UsageError, match=r"at least two tracks .* has 1: the law of a track is fitted to the others"):
        recording(tmp_path)


@pytest.mark.parametrize(
    ("name", "rows", "said"),
    [
        ("part.csv", slice(-1), r"one\.csv\.gz and .*part\.csv share 100\.0% of their readings"),
        ("one.csv", slice(None), r"one\.csv and .*one\.csv\.gz are both track 'one'"),
        ("one, two.csv", slice(1), r"one, two\.csv: the name of a track must not contain ', '"),
    ],
)
def test_two_files_of_one_track_and_a_name_of_several_words_are_refused(folder, tmp_path, name, rows, said):
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    head, *lines = gzip.decompress((folder / "one.csv.gz").read_bytes()).decode().splitlines()
    (tmp_path / name).write_text("\n".join([head, *lines[rows]]))
    with pytest.raises(UsageError, match=said):
        recording(tmp_path)


@pytest.mark.thorough
def test_experiments_on_a_folder_are_named_after_it_and_build_with_the_laws_of_the_other_tracks(folder):
    pairs = reproduce.on_data(("reality",), folder)
    assert [experiment.name for _, experiment in pairs] == [f"{folder.name}_tracks", f"{folder.name}_trackers"]
    for name, experiment in pairs:
        kept = {key: value for key, value in experiment.variants.items() if key.startswith("two, ")}
        plan = reproduce.plan(name, replace(experiment, variants=kept))
        for point in plan.points:
            setup = scenario.build(scenario.load(json.loads(point.resolved)))
            words = point.settings["variant"]
            assert (setup.recorded is not None) == (", recorded" in words), words
            assert json.loads(point.resolved)["sensor"].get("path", str(folder / "two.csv")) == str(folder / "two.csv")


@pytest.mark.thorough
def test_a_campaign_on_a_folder_gives_answers_lines_and_figures(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(reproduce, "LocalEngine", InlineEngine)
    (name, experiment), _ = reproduce.on_data(("reality",), folder)
    states = ("recorded", "simulated", "recorded, gains")
    wanted = {
        f"{track}, {state}, {kind}" for track in ("one", "open", "two") for state in states for kind in ("pf", "ekf")
    }
    few = {key: value for key, value in experiment.variants.items() if key in wanted}
    small = replace(experiment, variants=few, quick=5, sets=(*experiment.sets, "tracker.assumes.noise_scale=1"))
    assert reproduce.resume(reproduce.begin(name, small, tmp_path), 1).complete
    where = reproduce.folder_of(tmp_path, name, small)
    monkeypatch.setattr(measures, "MEMORYLESS", "ekf")
    lines = reproduce.summary(name, small, where)
    assert [line.partition(":")[0] for line in lines[:3]] == [f"registered {number}" for number in (1, 2, 3)]
    assert "(one, two)" in lines[0] and "gains of the receivers: -" in "\n".join(lines)
    files = reproduce.draw(name, small, where, tmp_path / "figures")
    assert [file.name for file in files] == ["reality_tracks.png", "reality_residuals.png", "reality_gap.png"]
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in files)


@pytest.mark.parametrize("papers", [(), ("ruan2020",), ("reality", "frontier")])
def test_data_are_for_one_study_that_takes_data(papers, folder):
    with pytest.raises(UsageError, match="--data is for one study that takes data"):
        reproduce.on_data(papers, folder)


def test_what_was_registered_before_the_first_run_is_unchanged():
    assert study("reality").registered == {
        "tracker": "pf", "step": 0.5, "particles": 400, "seeds": 30, "factor": 1.5, "recovered": 0.25, "nees": 3.0,
    }  # fmt: skip


def fake(monkeypatch, levels, rectangular=("loop",)):
    """Data in which the RMSE and NEES of a variant's runs are spread by ±1 % around the levels given."""
    spread = 1.0 + 0.01 * np.linspace(-1.0, 1.0, RUNS)
    tables = {
        name: pd.DataFrame({"replicate": range(RUNS), "rmse": rmse * spread, "nees": nees * spread})
        for name, (rmse, nees) in levels.items()
    }
    data = TablesOfRuns(tables)
    data.own, data.registered, data.variants = {}, study("reality").registered, tuple(tables)
    names = dict.fromkeys(name.partition(",")[0] for name in tables)
    tracks = [WalkedTrack(name, None, 1.0, 1.0, name in rectangular) for name in names]
    monkeypatch.setattr(measures, "tracks_of", lambda data: SimpleNamespace(tracks=tracks))
    return data


LEVELS = {
    "loop, recorded, pf": (4.0, 5.0), "loop, simulated, pf": (2.0, 1.0), "loop, recorded, gains, pf": (3.0, 2.0),
    "line, recorded, pf": (3.0, 9.0), "line, simulated, pf": (2.0, 1.0), "line, recorded, gains, pf": (2.5, 2.0),
}  # fmt: skip


def test_answers_follow_from_the_rows(monkeypatch):
    gap, recovered, consistency = measures.answers(fake(monkeypatch, LEVELS))
    assert gap.answer == "yes" and gap.found[0].value == pytest.approx(2.0, rel=0.02), "of the closed track alone"
    assert recovered.answer == "yes" and recovered.found[0].value == pytest.approx(1.5 / 3.0, rel=0.03)
    assert consistency.answer == "yes" and [each.value for each in consistency.found] == pytest.approx([7.0, 2.0])


@pytest.mark.thorough(fast=["changes1-wanted1"])
@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"loop, recorded, pf": (2.4, 5.0)}, ("no", None, "yes")),
        ({"loop, recorded, pf": (3.0, 5.0)}, ("undecided", None, "yes")),
        ({"loop, recorded, gains, pf": (4.2, 2.0), "line, recorded, gains, pf": (2.9, 2.0)}, ("yes", "no", "yes")),
        ({"line, recorded, pf": (3.0, 0.8)}, ("yes", "yes", "no")),
        ({"line, recorded, gains, pf": (2.5, 4.1)}, ("yes", "yes", "no")),
        ({"line, recorded, gains, pf": (2.5, 4.0)}, ("yes", "yes", "undecided")),
    ],
)
def test_another_row_is_another_answer(monkeypatch, changes, wanted):
    found = [each.answer for each in measures.answers(fake(monkeypatch, LEVELS | changes))]
    assert all(word in (None, answer) for word, answer in zip(wanted, found, strict=True)), found


def test_without_a_closed_track_the_first_question_stays_open(monkeypatch):
    answer = measures.answers(fake(monkeypatch, LEVELS, ()))[0]
    assert answer.answer == "undecided" and not answer.found and "no track is rectangular" in answer.words


def test_gaps_are_ratios_of_medians_by_tracker_and_track(monkeypatch):
    more = {
        f"{track}, {word}, ekf": (level, 1.0)
        for track in ("loop", "line")
        for word, level in (("recorded", 6.0), ("simulated", 2.0))
    }
    first, second = measures.gaps(fake(monkeypatch, LEVELS | more))
    assert (first.tracker, first.median) == ("ekf", pytest.approx(3.0, rel=0.02))
    assert (second.tracker, second.median) == ("pf", pytest.approx(1.75, rel=0.02))
    assert second.tracks["line"].value == pytest.approx(1.5, rel=0.02)
