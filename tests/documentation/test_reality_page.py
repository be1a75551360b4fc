"""docs/reality.md holds what docs/reality.json says, and that is what the simulator gives."""

from __future__ import annotations

import json

import pytest

import wsnsim
from tests.bench.page import spliced
from tests.papers import reality_page as page
from tests.papers.studies import module
from wsnsim.papers.study import study

_recording = module("reality", "recording")
recording, SHIPPED = _recording.recording, module("reality").SHIPPED
heard_share, track_residuals = _recording.heard_share, _recording.track_residuals

ROWS = json.loads(page.ROWS.read_text(encoding="utf-8"))
TEXT = page.PAGE.read_text(encoding="utf-8")


def test_the_page_is_made_from_its_rows():
    for name, block in page.blocks(ROWS).items():
        assert spliced(TEXT, name, block) == TEXT, "python -m tests.papers.reality_page writes it"
    made = page.files(ROWS)
    assert {name: (page.PAGE.parent / name).read_text(encoding="utf-8") for name in made} == made
    assert all(f"]({name})" in TEXT for name in made)


def test_the_page_shows_every_figure_of_the_experiments():
    for experiment in study("reality").experiments:
        for figure in experiment.figures:
            assert f"](reality_{figure.name}.png)" in TEXT
            assert (page.PAGE.parent / f"reality_{figure.name}.png").stat().st_size > 20_000


def test_its_answers_are_those_of_the_registered_seeds_and_thresholds():
    registered = study("reality").registered
    assert ROWS["runs"][0] == registered["seeds"] and len(ROWS["answers"]) == 3
    for threshold, answer in zip(
        (registered[key] for key in ("factor", "recovered", "nees")), ROWS["answers"], strict=True
    ):
        assert f"{threshold:g}" in answer["words"]


def test_its_figures_of_the_readings_are_those_of_the_shipped_tracks():
    found = recording(SHIPPED)
    name = found.tracks[0].name
    these, row = track_residuals(found, name), ROWS["residuals"][name]
    assert row["sd"] == pytest.approx(these.sd, rel=1e-3) and row["scatter"] == pytest.approx(these.scatter, rel=1e-9)
    assert row["correlation"] == pytest.approx(these.correlation, rel=1e-2)
    assert row["heard"] == pytest.approx(heard_share(found, name, 0.5), rel=1e-9)


def test_a_row_of_its_table_is_what_the_variants_of_the_experiment_give(tmp_path):
    name, kind = "straight_04", "ekf"
    experiment = study("reality").experiments[0]
    rmse = {}
    for state in ("recorded", "simulated"):
        variant = experiment.variants[f"{name}, {state}, {kind}"]
        text = wsnsim.load(variant.scenario, [*experiment.sets, *variant.sets])
        wsnsim.run(text, replicates=experiment.full, out=tmp_path / f"{state}.h5")
        rmse[state] = wsnsim.read(tmp_path / f"{state}.h5", "runs")["rmse"].median()
    (gap,) = (gap for gap in ROWS["gaps"] if gap["tracker"] == kind)
    assert gap["tracks"][name][0] == pytest.approx(rmse["recorded"] / rmse["simulated"], rel=1e-4)


def test_its_run_through_the_network_is_that_of_the_shipped_scenario():
    for word, row in page.network().items():
        assert row["taken"] == ROWS["network"][word]["taken"] and row["used"] == ROWS["network"][word]["used"]
        assert row["rmse"] == pytest.approx(ROWS["network"][word]["rmse"], rel=1e-6)
