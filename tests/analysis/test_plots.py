"""Pictures show what the tables hold, in every layout of the states; their files are whole, and the same each time."""

from __future__ import annotations

import functools
import json
import re
import xml.etree.ElementTree as ElementTree
from typing import NamedTuple

import numpy as np
import pytest
from matplotlib import style
from matplotlib.figure import Figure
from PIL import Image

from wsnsim.analysis import figure_style, figures, plot_data, plots
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.base.tables import CAUSE, CAUSES, TABLES, columns_of
from wsnsim.cli.exporting import PLOTS
from wsnsim.recording import ResultFile, read_table

DT = 0.5


class Layout(NamedTuple):
    states: tuple[tuple[str, str], ...]
    position: tuple[int, ...]


PLANE = Layout((("px", "m"), ("vx", "m/s"), ("py", "m"), ("vy", "m/s")), (0, 2))
SWAPPED = Layout((("vx", "m/s"), ("vy", "m/s"), ("px", "m"), ("py", "m")), (2, 3))
LINE = Layout((("px", "m"), ("vx", "m/s"), ("ax", "m/s2")), (0,))
BARE = Layout((("x", ""),), (0,))
LAYOUTS = pytest.mark.parametrize("layout", [PLANE, SWAPPED, LINE, BARE], ids=["plane", "swapped", "line", "bare"])


@pytest.fixture(scope="module")
def write(tmp_path_factory):
    """write(layout, ...): a result of invented tracks, with particles at steps 2 and 4, and energy with a network."""

    made = {}

    def write_once(layout=PLANE, **said):
        key = (layout, *said.items())
        if key not in made:
            made[key] = _write_file(tmp_path_factory.mktemp("made") / "x.h5", layout, **said)
        return made[key]

    return write_once


def _write_file(path, layout, runs=3, targets=1, steps=8, network=False, gaps=(), without=(), scenario=True, woken=0):
    rng = np.random.default_rng(5)
    wanted = dict.fromkeys(TABLES, True) | dict.fromkeys(without, False)
    with ResultFile(path, layout.states, wanted, position=layout.position) as file:
        for run in range(runs):
            for target in range(targets):
                _write_track(file, layout, {"replicate": run, "target": target}, steps, gaps, rng)
            charge = {"energy_initial": 2.0 if network else np.nan, "energy_left": 1.0, "died_at": np.nan}
            places = {"node": np.arange(5), "x": rng.normal(0, 9, 5), "y": rng.normal(0, 9, 5), "gain": 1.0}
            places |= {f"{axis}_assumed": places[axis] for axis in "xy"}
            file.write("nodes", {"replicate": run, **places, **charge})
            row = dict.fromkeys((column.name for column in columns_of("runs")), 0)
            file.write(
                "runs",
                row
                | {
                    "replicate": run,
                    "lost": run == 1,
                    "losses": int(run in (1, 3)),
                    "lost_window": 4.0,
                    "lost_limit": 20.0,
                },
            )
            if network:
                _write_energy(file, run, steps, rng)
            if woken:
                row = dict.fromkeys((column.name for column in columns_of("wakeups")), 1)
                regions = {"x": rng.normal(0, 9, woken), "y": rng.normal(0, 9, woken)}
                file.write("wakeups", row | {"replicate": run, "target": 0, **regions})
        if scenario:
            file.set_text("scenario/resolved_json", json.dumps({"name": "invented", "seed": 11}))
    return path


def _write_track(file, layout, key, steps, gaps, rng):
    names = [name for name, _ in layout.states]
    place = list(layout.position)
    truth = np.cumsum(rng.normal(0, 3, (steps + 1, len(names))), axis=0)
    guess = truth[1:] + rng.normal(0, 1, (steps, len(names)))
    guess[[step - 1 for step in gaps]] = np.nan
    numbers = np.arange(steps + 1)
    file.write("truth", {**key, "step": numbers, "time": numbers * DT, **dict(zip(names, truth.T, strict=True))})
    claimed = np.where(np.isnan(guess[:, place]), np.nan, np.array([1.5, 2.5])[: len(place)])
    beside = dict.fromkeys(("received", "effective_particles", "nis"), np.nan) | dict.fromkeys(
        ("active", "members", "readings", "late", "woken", "ineffective"), 1
    )
    beside |= {"nis_dof": 0, "gaussian": 0} | ({"cov_xy": 0.0} if len(place) > 1 else {})
    beside["nees"] = (((guess - truth[1:])[:, place] / claimed) ** 2).sum(axis=1)
    file.write("estimates", {
        **key, "step": numbers[1:], "time": numbers[1:] * DT, "issued": numbers[1:] * DT,
        **dict(zip(names, guess.T, strict=True)), **dict(zip(("sd_x", "sd_y"), claimed.T, strict=False)),
        "error": np.sqrt(((guess - truth[1:])[:, place] ** 2).sum(axis=1)),
        "head": np.where(numbers[1:] <= steps // 2, 3, 1), **beside,
    })  # fmt: skip
    for step in (2, 4):
        cloud = truth[step] + rng.normal(0, 1, (40, len(names)))
        weights = rng.random(40) * (np.arange(40) < 30)
        columns = {**dict(zip(names, cloud.T, strict=True)), "weight": weights / weights.sum()}
        file.write("particles", {**key, "step": step, "node": 3, **columns})


def _write_energy(file, run, steps, rng):
    for step in range(1, steps + 1 - run):  # later runs end earlier
        for cause in ("rx", "cpu", "tx_amplifier"):
            row = {"step": step, "time": step * DT, "cause": CAUSE[cause], "joules": rng.random()}
            file.write("energy_steps", {"replicate": run, **row})


def axes_of():
    return Figure().subplots()


def line(axes, label):
    (found,) = [drawn for drawn in axes.get_lines() if drawn.get_label() == label]
    return found.get_xydata()


def labels(axes):
    return axes.get_legend_handles_labels()[1]


def rows(path, table, replicate=0, target=0):
    held = read_table(path, table)
    chosen = (held["replicate"] == replicate) & (held["target"] == target)
    return {name: values[chosen] for name, values in held.items()}


def equal(drawn, *columns):
    np.testing.assert_array_equal(drawn, np.stack(columns, axis=1))


# the panels


@pytest.mark.thorough(fast=["bare"])
@LAYOUTS
def test_each_state_is_drawn_as_the_tables_hold_it(write, layout):
    path = write(layout, targets=2)
    for number, (name, unit) in enumerate(layout.states):
        axes = axes_of()
        assert plots.states(axes, path, name, replicate=2, target=1) is axes
        truth, guess = rows(path, "truth", 2, 1), rows(path, "estimates", 2, 1)
        equal(line(axes, "ground truth"), truth["time"], truth[name])
        equal(line(axes, "estimate"), guess["time"], guess[name])
        assert axes.get_ylabel() == (f"{name} [{unit}]" if unit else name)
        assert axes.get_xlabel() == "time [s]"
        assert "replicate 2, target 1" in axes.get_title(loc="left")
        assert ("estimated ±2σ" in labels(axes)) == (number in layout.position)


@pytest.mark.thorough
@pytest.mark.parametrize(("column", "half"), [("px", 3.0), ("py", 5.0)])
def test_the_band_is_twice_the_sd_that_the_filter_claims_for_this_column(write, column, half):
    path = write(SWAPPED)
    axes = plots.states(axes_of(), path, column)
    (band,) = axes.collections
    guess = rows(path, "estimates")
    corners = band.get_paths()[0].vertices
    for time, middle in zip(guess["time"], guess[column], strict=True):
        heights = corners[corners[:, 0] == time, 1]
        assert (heights.min(), heights.max()) == pytest.approx((middle - half, middle + half))


@pytest.mark.thorough
@pytest.mark.parametrize("layout", [PLANE, SWAPPED])
def test_a_track_in_the_plane_shows_ground_truth_estimates_nodes_and_the_cluster_heads_in_order(write, layout):
    path = write(layout, network=True)
    axes = plots.track(axes_of(), path, replicate=1)
    truth, guess, nodes = rows(path, "truth", 1), rows(path, "estimates", 1), read_table(path, "nodes")
    equal(line(axes, "ground truth"), truth["px"], truth["py"])
    equal(line(axes, "estimate"), guess["px"], guess["py"])
    mine = nodes["replicate"] == 1
    equal(axes.collections[0].get_offsets(), nodes["x"][mine], nodes["y"][mine])
    equal(line(axes, "2 cluster heads"), nodes["x"][mine][[3, 1]], nodes["y"][mine][[3, 1]])
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("px [m]", "py [m]", 1.0)
    assert "5 nodes" in labels(axes)


@pytest.mark.thorough
def test_the_regions_in_which_nodes_were_woken_are_marked_by_their_centres(write):
    path = write(network=True, woken=4, targets=2, gaps=(3, 4))
    axes, regions = plots.track(axes_of(), path, replicate=1), rows(path, "wakeups", 1)
    equal(line(axes, "4 wake-up regions"), regions["x"], regions["y"])
    assert not [said for said in labels(plots.track(axes_of(), path, target=1)) if "wake-up" in said]


def test_without_a_network_a_track_shows_nodes_and_no_cluster_heads(write):
    assert labels(plots.track(axes_of(), write())) == ["5 nodes", "ground truth", "estimate"]


@pytest.mark.thorough
@pytest.mark.parametrize("layout", [LINE, BARE])
def test_a_track_on_a_line_is_the_position_over_time_with_the_nodes_at_the_edge(write, layout):
    path = write(layout)
    axes = plots.track(axes_of(), path)
    name = layout.states[0][0]
    truth = rows(path, "truth")
    equal(line(axes, "ground truth"), truth["time"], truth[name])
    equal(line(axes, "5 nodes"), np.ones(5), read_table(path, "nodes")["x"][:5])
    assert "estimated ±2σ" in labels(axes)


def test_nodes_that_were_not_recorded_are_not_drawn(write):
    assert labels(plots.track(axes_of(), write(without=("nodes",)))) == ["ground truth", "estimate"]


@pytest.mark.thorough
@LAYOUTS
def test_the_error_at_each_step_is_the_rmse_and_the_quartiles_over_the_runs(write, layout):
    path = write(layout, runs=7)
    axes = plots.error(axes_of(), path)
    errors = read_table(path, "estimates")["error"].reshape(7, 8)
    np.testing.assert_allclose(line(axes, "RMSE")[:, 1], np.sqrt((errors**2).mean(axis=0)))
    np.testing.assert_allclose(line(axes, "median")[:, 1], np.sort(errors, axis=0)[3])
    np.testing.assert_array_equal(line(axes, "RMSE")[:, 0], DT * np.arange(1, 9))
    assert "quartiles of 7 runs" in labels(axes)
    assert axes.get_title(loc="left") == (
        "position error, 2 of 7 runs lost (1 at the end)\nlost: error above "
        f"{f'20 {layout.states[layout.position[0]][1]}'.rstrip()} or no estimate for 4 s"
    )
    assert axes.get_ylabel() == ("position error [m]" if layout.states[layout.position[0]][1] else "position error")
    corners = axes.collections[0].get_paths()[0].vertices
    for time, column in zip(DT * np.arange(1, 9), errors.T, strict=True):
        heights = corners[corners[:, 0] == time, 1]
        ordered = np.sort(column)  # of seven, the quartiles lie midway between the second and third, fifth and sixth
        expected = ordered[1:3].mean(), ordered[4:6].mean()
        assert (heights.min(), heights.max()) == pytest.approx(expected)


def test_one_run_has_its_error_and_no_band(write):
    axes = plots.error(axes_of(), write(runs=1))
    assert labels(axes) == ["error of 1 run"]


def test_several_targets_are_said_beside_the_runs(write):
    assert "quartiles of 3 runs × 2 targets" in labels(plots.error(axes_of(), write(targets=2)))


def test_errors_over_decades_are_drawn_on_a_logarithmic_axis():
    for largest, scale in ((50.0, "linear"), (500.0, "log")):
        axes = axes_of()
        plots._scaled(axes, np.array([np.nan, 0.0, 1.0, largest]))
        assert axes.get_yscale() == scale


def test_energy_is_cumulative_by_cause_over_all_runs_and_ends_at_what_was_spent(write):
    path = write(network=True)
    axes = plots.energy(axes_of(), path)
    table = read_table(path, "energy_steps")
    words = [cause for cause in CAUSES if cause in ("rx", "cpu", "tx_amplifier")]
    spent = {word: table["joules"][table["cause"] == CAUSE[word]].sum() for word in words}
    shares = {word: f"{100 * joules / sum(spent.values()):.1f} %" for word, joules in spent.items()}
    assert labels(axes) == [f"{word.replace('_', ' ')} {shares[word]}" for word in words]
    below = np.zeros(8)
    for word, area in zip(words, axes.collections, strict=True):
        mine = table["cause"] == CAUSE[word]
        a_step = [table["joules"][mine & (table["step"] == step)].sum() / 3 for step in range(1, 9)]
        below = below + np.cumsum(a_step)
        corners = area.get_paths()[0].vertices
        tops = [corners[corners[:, 0] == step * DT, 1].max() for step in range(1, 9)]
        np.testing.assert_allclose(tops, below)
    assert below[-1] == pytest.approx(table["joules"].sum() / 3)
    assert axes.get_ylabel() == "energy spent [J]"
    assert "mean of 3 runs" in axes.get_title(loc="left")


@pytest.mark.parametrize("layout", [PLANE, SWAPPED])
def test_a_cloud_shows_the_weighted_particles_and_the_ground_truth(write, layout):
    path = write(layout)
    axes = plots.particles(axes_of(), path, 4, replicate=2)
    held, truth = rows(path, "particles", 2), rows(path, "truth", 2)
    drawn = (held["step"] == 4) & (held["weight"] > 0)
    (dots,) = axes.collections
    equal(dots.get_offsets(), held["px"][drawn], held["py"][drawn])
    sizes, weights = dots.get_sizes(), held["weight"][drawn]
    np.testing.assert_allclose((sizes - 4.0) / (sizes.max() - 4.0), weights / weights.max())
    equal(line(axes, "ground truth"), truth["px"][[4]], truth["py"][[4]])
    assert labels(axes)[0] == "30 of 40 particles"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("layout", "column", "density"),
    [(PLANE, "vx", "probability density [1/(m/s)]"), (LINE, None, "probability density [1/m]"),
     (BARE, None, "probability density")],
)  # fmt: skip
def test_a_histogram_is_a_density_with_the_mean_of_the_weighted_particles(write, layout, column, density):
    path = write(layout)
    axes = plots.particles(axes_of(), path, 2, column)
    held, truth, name = rows(path, "particles"), rows(path, "truth"), column or layout.states[0][0]
    (stairs,) = axes.patches
    heights, edges, _ = stairs.get_data()
    widths, middles = np.diff(edges), (edges[1:] + edges[:-1]) / 2
    assert (heights * widths).sum() == pytest.approx(1.0)
    mine = held["step"] == 2
    mean = (held["weight"] * held[name])[mine].sum()
    assert (heights * widths * middles).sum() == pytest.approx(mean, abs=widths[0] / 2)
    assert set(line(axes, "ground truth")[:, 0]) == {truth[name][2]}
    assert axes.get_ylabel() == density


def test_particles_that_are_all_one_still_have_a_histogram():
    axes = axes_of()
    values = np.full(20, 1e9)
    plots._histogram(axes, plot_data.StateLayout({"x": ""}, ("x",)), "x", values, np.full(20, 0.05), "20 particles")
    heights, edges, _ = axes.patches[0].get_data()
    assert (heights * np.diff(edges)).sum() == pytest.approx(1.0)
    assert edges[0] < 1e9 < edges[-1]


# what is missing


@pytest.mark.thorough
@pytest.mark.parametrize("layout", [PLANE, BARE])
def test_gaps_stay_gaps_and_an_estimate_between_two_of_them_is_a_dot(write, layout):
    path = write(layout, gaps=(1, 2, 4, 7))
    name = layout.states[layout.position[0]][0]
    axes = plots.states(axes_of(), path, name)
    drawn = line(axes, "estimate")[:, 1]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(drawn)), [0, 1, 3, 6])
    (estimate,) = [drawn for drawn in axes.get_lines() if drawn.get_label() == "estimate"]
    assert (estimate.get_marker(), estimate.get_markevery()) == (".", [2, 7])
    shown = plots.error(axes_of(), path)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(line(shown, "median")[:, 1])), [0, 1, 3, 6])


@pytest.mark.thorough
@pytest.mark.parametrize(("layout", "runs"), [(PLANE, 3), (LINE, 1), (BARE, 3)])
def test_a_result_without_any_estimate_is_drawn_all_the_same(write, layout, runs):
    path = write(layout, runs=runs, gaps=range(1, 9), without=("particles",))
    panels = [panel for what in ("track", "error") for panel in _drawn_panels(path, what)]
    figure = figure_style.figure_of([*panels, lambda axes: plots.states(axes, path, layout.states[0][0])])
    figure.draw_without_rendering()
    for axes in figure.axes:
        assert np.isfinite([*axes.get_xlim(), *axes.get_ylim()]).all()
        guess = [drawn for drawn in axes.get_lines() if drawn.get_label() in ("estimate", "median")]
        assert all(np.isnan(drawn.get_ydata()).all() for drawn in guess)


@pytest.mark.parametrize(
    ("draws", "message"),
    [
        (lambda axes, path: plots.states(axes, path, "pxx"), "no state column 'pxx' (did you mean 'px'?)"),
        (lambda axes, path: plots.particles(axes, path, 2, "head"), "no state column 'head' (known: px, py, vx, vy)"),
        (lambda axes, path: plots.track(axes, path, 3), "table truth has no replicate 3; it has 0, 1, 2"),
        (lambda axes, path: plots.states(axes, path, "px", 0, 1), "table truth has no target 1; it has 0"),
        (lambda axes, path: plots.particles(axes, path, 3), "table particles has no step 3; it has 2, 4"),
        (lambda axes, path: plots.particles(axes, path, 9), "table truth has no step 9; it has 0 … 8"),
    ],
)
def test_what_the_file_does_not_have_is_named_with_what_it_has(write, draws, message):
    with pytest.raises(UsageError, match=re.escape(message)):
        draws(axes_of(), write())


@pytest.mark.thorough(fast=["estimates-<lambda>1"])
@pytest.mark.parametrize(
    ("table", "draws"),
    [
        ("truth", lambda axes, path: plots.track(axes, path)),
        ("estimates", lambda axes, path: plots.states(axes, path, "px")),
        ("estimates", lambda axes, path: plots.error(axes, path)),
        ("energy_steps", lambda axes, path: plots.energy(axes, path)),
        ("particles", lambda axes, path: plots.particles(axes, path, 2)),
    ],
)
def test_a_table_that_was_not_recorded_is_named_with_the_key_that_records_it(write, table, draws):
    with pytest.raises(ResultError, match=f"table {table} was not recorded.*record.{table}=true"):
        draws(axes_of(), write(without=(table,)))


def test_without_a_network_there_is_no_energy_and_a_sentence_says_so(write):
    with pytest.raises(ResultError, match=r"cannot plot energy: no energy was spent \(there is no network"):
        plots.energy(axes_of(), write())


# the whole figure


@pytest.fixture
def unsaved(monkeypatch):
    """The figures that would have been written."""
    kept = []
    monkeypatch.setattr(figures, "save", lambda figure, out: kept.append(figure))
    return kept


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("layout", "shown"),
    [
        (PLANE, "track, state px, state vx, state py, state vy, error, consistency, energy, particles"),
        (LINE, "track, state px, state vx, state ax, error, consistency, energy, particles"),
        (BARE, "track, error, consistency, energy, particles"),
    ],
)
def test_all_is_every_panel_that_exists(write, tmp_path, unsaved, layout, shown):
    drawn = figures.draw(write(layout, network=True), tmp_path / "x.svg")
    assert (", ".join(drawn.shown), drawn.left_out) == (shown, {})
    (figure,) = unsaved
    titles = [axes.get_title(loc="left").split()[0].rstrip(",") for axes in figure.axes]
    assert titles == [{"error": "position"}.get(name, name.removeprefix("state ")) for name in drawn.shown]
    assert figure.get_suptitle() == "invented, seed 11"


@pytest.mark.thorough
def test_all_leaves_out_what_is_not_there_and_says_why(write, tmp_path, unsaved):
    drawn = figures.draw(write(BARE, without=("particles",)), tmp_path / "x.svg")
    assert drawn.shown == ("track", "error", "consistency")
    assert list(drawn.left_out) == ["energy", "particles"]
    assert "record.particles=true" in drawn.left_out["particles"]


def test_the_particles_drawn_are_the_last_unless_a_step_is_named(write, tmp_path):
    path = write()
    panels = dict(figures.panels_of(path, "particles", figures.PlotSelection(), False))
    assert "step 4" in panels["particles"](axes_of()).get_title(loc="left")
    panels = dict(figures.panels_of(path, "particles", figures.PlotSelection(column="vy", step=2), False))
    axes = panels["particles"](axes_of())
    assert "step 2" in axes.get_title(loc="left") and axes.get_xlabel() == "vy [m/s]"


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
def test_the_same_result_gives_the_same_bytes_without_a_date(write, tmp_path, suffix):
    path = write()
    first, second = (figures.draw(path, tmp_path / f"{n}{suffix}", "error").out.read_bytes() for n in "ab")
    assert first == second
    assert first.startswith({".svg": b"<?xml", ".png": b"\x89PNG\r\n\x1a\n", ".pdf": b"%PDF"}[suffix])
    assert b"<dc:date>" not in first and b"/CreationDate" not in first
    if suffix == ".svg":
        assert ElementTree.fromstring(first).tag == "{http://www.w3.org/2000/svg}svg"


def test_a_figure_names_its_scenario_where_the_file_does(write):
    assert plot_data.heading(write()) == "invented, seed 11"
    assert plot_data.heading(write(scenario=False)) == ""


@pytest.mark.thorough
def test_no_display_and_no_pyplot_is_used(write, tmp_path, monkeypatch):
    import sys

    monkeypatch.delitem(sys.modules, "matplotlib.pyplot", raising=False)
    figures.draw(write(), tmp_path / "x.png", "error")
    assert "matplotlib.pyplot" not in sys.modules


def test_a_cause_that_dominates_the_energy_is_named_and_the_others_are_drawn(write, monkeypatch):
    spent = np.zeros((len(CAUSES), 3))
    spent[CAUSE["idle"]], spent[CAUSE["rx"]] = (3.0, 6.0, 9.0), (0.1, 0.5, 1.0)
    monkeypatch.setattr(plot_data, "spent", lambda path: (spent, np.arange(3.0), 2))
    axes = plots.energy(axes_of(), write(network=True))
    assert labels(axes) == ["rx 10.0 %"] and axes.dataLim.y1 == 1.0
    assert axes.get_title(loc="left").endswith("\nnot drawn: idle 90.0 % of 10 J")


@pytest.mark.parametrize("for_paper", [False, True])
@pytest.mark.parametrize(
    "names", [["a"], [f"cause {i}" for i in range(14)], ["short", "long " * 8, "in two\n" + 28 * "l"]]
)
def test_a_legend_and_its_title_are_inside_the_figure_and_above_the_data(names, for_paper):
    def draw(axes):
        for number, name in enumerate(names):
            axes.plot([0, 1], [number, number], label=name)
        return figure_style.titled(axes, "two lines\nof a title", "value")

    with style.context(["default", figure_style.STYLE]):
        figure = Figure(figsize=(4.0, 3.1), layout="constrained")
        if for_paper:
            figure = figure_style.figure_of([draw], figure_style.WIDTHS["column"])
        else:
            draw(figure.subplots())
        figure.draw_without_rendering()
    (axes,) = figure.axes
    box, legend, title = (part.get_window_extent() for part in (axes, axes.get_legend(), axes._left_title))
    assert legend.y0 >= box.y1 - 1.0 and legend.x1 <= figure.bbox.x1 and legend.y1 <= figure.bbox.y1
    assert for_paper or (title.y0 >= legend.y1 - 2.0 and title.y1 <= figure.bbox.y1)


@pytest.mark.thorough
def test_legends_stand_above_the_data_and_titles_above_legends(write):
    panels = [
        panel for what in plot_data.plots_of(write(network=True)) for panel in _drawn_panels(write(network=True), what)
    ]
    figure = figure_style.figure_of(panels)
    figure.draw_without_rendering()
    for axes in figure.axes:
        box, legend = axes.get_window_extent(), axes.get_legend().get_window_extent()
        title = axes._left_title.get_window_extent()
        assert legend.y0 >= box.y1 - 1.0
        assert title.y0 >= legend.y1 - 2.0
        assert legend.x1 <= figure.bbox.x1


def _drawn_panels(path, what):
    return [panel for _, panel in figures.panels_of(path, what, figures.PlotSelection(), True)]


def test_a_figure_that_cannot_be_written_leaves_no_file(write, tmp_path, monkeypatch):
    path = write()

    def breaks(figure, file, **options):
        file.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    (tmp_path / "x.png").write_bytes(b"before")
    monkeypatch.setattr(Figure, "savefig", breaks)
    with pytest.raises(ResultError, match=r"x\.png: cannot be written: No space left on device"):
        figures.draw(path, tmp_path / "x.png", "error")
    assert (tmp_path / "x.png").read_bytes() == b"before"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["x.png"]


@pytest.mark.parametrize(("name", "hint"), [("x.pgn", "did you mean '.png'?"), ("x", "known: .png, .svg, .pdf")])
def test_a_wrong_suffix_is_answered_with_those_allowed(write, tmp_path, name, hint):
    with pytest.raises(UsageError, match=re.escape(hint)):
        figures.draw(write(), tmp_path / name)


def test_the_command_line_offers_what_can_be_drawn():
    assert tuple(figures.TAKES) == PLOTS
    assert {*PLOTS} == {"all", *plot_data.NEEDS}


def test_a_step_shows_what_was_there_by_then_and_by_default_the_largest_error_after_the_start(write):
    path = write(network=True, runs=1)
    held = rows(path, "estimates")
    worst = held["step"][len(held["step"]) // 10 :][held["error"][len(held["step"]) // 10 :].argmax()]
    assert plot_data.telling_step(path, 0, 0) == worst
    for step, shown in ((4, 4), (None, worst)):
        axes = plots.step(axes_of(), path, step)
        assert axes.get_title(loc="left") == f"step {shown} of replicate 0, {DT * shown:g} s"
        assert len(line(axes, "estimate")) == (held["step"] <= shown).sum()
        assert len(line(axes, "cluster head")) == 1
    with pytest.raises(UsageError, match=r"no step 99; it has 0 … 8"):
        plots.step(axes_of(), path, 99)
    with pytest.raises(UsageError, match="a step is drawn in the plane"):
        plots.step(axes_of(), write(LINE), 4)


def test_the_steps_of_a_run_are_an_animation_and_nothing_else_is(write, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "MOST_PICTURES", 3)
    path = write(network=True, runs=1)
    made = figures.draw(path, tmp_path / "x.gif", "step")
    assert made.shown == ("3 of 9 steps",)
    with Image.open(tmp_path / "x.gif") as picture:
        assert (picture.format, picture.n_frames) == ("GIF", 3)
    for what, choice in (("error", {}), ("step", {"step": 4})):
        with pytest.raises(UsageError, match="only the steps of a run can be a GIF"):
            figures.draw(path, tmp_path / "y.gif", what, figures.PlotSelection(**choice))
    assert not (tmp_path / "y.gif").exists()


@pytest.mark.parametrize(("width", "across"), [("column", 1), ("text", 2)])
def test_a_figure_for_a_paper_has_its_width_and_no_titles(write, width, across):
    inches = figure_style.WIDTHS[width]
    panels = [functools.partial(plots.states, path=write(), column=name) for name in ("px", "vx")]
    figure = figure_style.figure_of(panels, inches)
    assert figure.get_size_inches()[0] == inches
    assert len({axes.get_position().x0 for axes in figure.axes}) == across
    assert not any(axes.get_title(loc="left") for axes in figure.axes)
    assert all(axes.get_xlabel() and axes.get_ylabel() for axes in figure.axes)
