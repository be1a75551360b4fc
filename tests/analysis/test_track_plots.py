"""Pictures of results whose readings name no target show what the tables hold, and others say what they lack."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.helpers import unlabelled
from tests.helpers.recordings import recording
from wsnsim.analysis import figures, plot_data, plots
from wsnsim.analysis.multi_target import followed_runs, gospa_table
from wsnsim.analysis.track_plots import places_of_detections
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.report.svg_figures import svg_figures


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return unlabelled.write_result(tmp_path_factory.mktemp("made") / "x.h5")


def _lines(axes, label):
    return [line.get_xydata() for line in axes.get_lines() if line.get_label() == label]


def test_all_tracks_of_a_run_are_drawn_with_targets_detections_clutter_and_switches(path):
    axes = plots.track(Figure().subplots(), path, replicate=1)
    assert axes.get_legend_handles_labels()[1] == [
        "2 nodes", "ground truth", "tracks", "tentative tracks", "2 identity switches",
    ]  # fmt: skip
    run = next(followed_runs(path, [1]))
    np.testing.assert_array_equal(_lines(axes, "tracks")[0], run.tracks.position[run.tracks.track == 3])
    np.testing.assert_array_equal(_lines(axes, "2 identity switches")[0], run.truth[:, 8])
    assert len({line.get_color() for line in axes.get_lines() if len(line.get_xydata()) > 1}) > 3
    assert {"detections", "clutter"} <= {*plots.track(Figure().subplots(), path).get_legend_handles_labels()[1]}
    with pytest.raises(UsageError, match="no replicate 7"):
        plots.track(Figure().subplots(), path, replicate=7)


def test_a_range_is_drawn_in_the_direction_of_its_target_and_clutter_anywhere_at_its_range(path):
    run = next(followed_runs(path))
    marks = places_of_detections(path, run)
    assert marks["clutter"].tolist() == [False, True] * 2
    away = np.hypot(marks["x"], marks["y"])
    assert away == pytest.approx([2.0, 7.0] * 2), "node 0 stands at the origin"
    assert marks["y"][0] / marks["x"][0] == pytest.approx(run.truth[0, 2, 1] / run.truth[0, 2, 0])


@pytest.mark.parametrize(
    ("sensor", "places"),
    [
        ({"kind": "bearing", "heading": "common"}, [(np.cos(2.0) * 2.0, np.sin(2.0) * 2.0)]),
        ({"kind": "bearing", "heading": "own"}, []),
        ({"kind": "recorded", "law": {"kind": "range"}}, [(2.0, 0.0)]),
        ({"kind": "rssi"}, []),
    ],
    ids=["bearing", "own axis", "recorded", "neither"],
)
def test_a_bearing_is_drawn_in_the_distance_of_its_target(tmp_path, monkeypatch, sensor, places):
    path = unlabelled.write_result(tmp_path / "x.h5", runs=1)
    monkeypatch.setattr(plot_data, "stored_json", lambda *_: {"sensor": sensor})
    marks = places_of_detections(path, next(followed_runs(path)))
    if not places:
        assert marks == {}
    else:
        assert (marks["x"][0], marks["y"][0]) == pytest.approx(places[0]), "target 0 is 2 m away at step 2"


def test_gospa_is_drawn_as_the_root_mean_square_over_the_runs(path):
    axes, table = plots.gospa(Figure().subplots(), path), gospa_table(path)
    drawn = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
    assert [*drawn] == ["GOSPA", "localisation", "missed targets", "false tracks"], "no bound of an invented scenario"
    for label, name in zip(drawn, ("gospa", "gospa_localisation", "gospa_missed", "gospa_false"), strict=True):
        expected = np.sqrt((table[name] ** 2).groupby(table.step).mean())
        assert drawn[label] == pytest.approx(expected.to_numpy())
    assert "2 runs (c = 4, p = 2" in axes.get_title(loc="left")


def test_errors_over_time_are_of_the_tracks_that_follow(path):
    errors, steps, times = plot_data.errors(path)
    np.testing.assert_array_equal(errors, np.stack([run.errors for run in followed_runs(path)]))
    assert steps[-1] * unlabelled.DT == times[-1] == 6.0
    assert "2 runs × 2 targets" in plots.error(Figure().subplots(), path).get_legend_handles_labels()[1][0]


def test_what_cannot_be_drawn_says_why(path, tmp_path):
    for what in ("states", "consistency", "particles"):
        assert "readings name no target" in plot_data.lacking(path, what)
    assert "readings name their targets" in plot_data.lacking(recording("pso_mhpf"), "gospa")
    bare = unlabelled.write_result(tmp_path / "x.h5", without=("truth",))
    for what in ("track", "gospa", "error"):
        with pytest.raises(ResultError, match="table truth was not recorded"):
            getattr(plots, what)(Figure().subplots(), bare)


def test_a_figure_and_a_page_show_all_that_there_is(path, tmp_path):
    written = figures.draw(path, tmp_path / "x.svg")
    assert written.shown == ("track", "gospa", "error")
    shown, _ = svg_figures(path, 0)
    assert [figure.name for figure in shown] == ["track", "gospa", "error"]
    assert json.dumps(shown[0].label).isascii()
