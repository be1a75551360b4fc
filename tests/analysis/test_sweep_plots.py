"""Pictures of a campaign show its table: which points make a line, where they stand, and what is drawn of them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from wsnsim import campaign
from wsnsim.analysis import figures, sweep_plots
from wsnsim.base.errors import ResultError, UsageError
from wsnsim.base.tables import columns_of
from wsnsim.cli import main
from wsnsim.recording import ResultFile
from wsnsim.scenario.sweep import load_sweep
from wsnsim.scenario.texts import shipped_sweeps

STATES = (("px", "m"), ("vx", "m/s"), ("py", "m"), ("vy", "m/s"))
RUNS = 8


@pytest.fixture
def made(tmp_path):
    """made(sweep, ...): the folder of a campaign with invented figures, none for the points `without`."""

    def make(said, runs=RUNS, energy=True, without=(), by=(), baseline=None):
        plan = load_sweep({"name": "invented", "replicates": runs, **said})
        folder = campaign.prepare(plan, tmp_path / "invented", by=by, baseline=baseline)
        for number, point in enumerate(plan.points):
            if number not in without:
                _write(folder.batch(point.id, 0, runs - 1), number, runs, energy)
        return folder

    return make


def _write(path, number, runs, energy):
    """Replicate r of point p has the error p + r / 10 and 2 p + 1 joules; every second lost its track for a while."""
    replicates = np.arange(runs)
    row = dict.fromkeys((column.name for column in columns_of("runs")), 0)
    with ResultFile(path, STATES, {"runs": True}, position=(0, 2)) as file:
        for r in replicates.tolist():
            joules = 2.0 * number + 1.0 if energy else np.nan
            file.write(
                "runs", row | {"replicate": r, "rmse": number + r / 10, "lost": 0, "losses": r % 2, "energy": joules}
            )


PARTICLES = {"scenario": "pso_mhpf", "grid": {"tracker.particles": [50, 100, 800]}}
THREE = {"scenario": ["pso_mhpf", "ipf", "ppf"], "grid": {"tracker.particles": [50, 100, 200, 800]}}
MIDDLE = (RUNS - 1) / 20


def axes_of():
    return Figure().subplots()


def drawn(axes):
    """{label: (places, values)} of the lines with a name."""
    return {line.get_label(): tuple(line.get_data()) for line in axes.get_lines() if line.get_marker() != "None"}


@pytest.mark.thorough
def test_a_single_key_makes_one_line_through_the_medians_with_a_band(made):
    lines = sweep_plots.lines_of(made(PARTICLES))
    axes = axes_of()
    assert sweep_plots.median(axes, lines) is axes
    ((places, values),) = drawn(axes).values()
    assert places.tolist() == [50, 100, 800]
    assert values == pytest.approx([MIDDLE, 1 + MIDDLE, 2 + MIDDLE])
    (band,) = [found for found in axes.collections if isinstance(found, PolyCollection)]
    heights = band.get_paths()[0].vertices[:, 1]
    table = lines.found.table
    assert heights.min() == pytest.approx(table["median_low"].min())
    assert heights.max() == pytest.approx(table["median_high"].max())


def test_axes_name_key_and_metric_with_their_units_and_the_title_the_number_of_runs(made):
    lines = sweep_plots.lines_of(made({"scenario": "pso_mhpf", "grid": {"link.reach": ["60 m", "75 m"]}}))
    axes = sweep_plots.median(axes_of(), lines)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("link.reach [m]", "per-run RMSE [m]")
    assert f"{RUNS} runs" in axes.get_title("left")
    axes = sweep_plots.energy(axes_of(), lines)
    assert axes.get_ylabel() == "energy spent [J]"


@pytest.mark.thorough
def test_several_scenarios_are_a_line_each_and_differences_are_from_the_first(made):
    lines = sweep_plots.lines_of(made(THREE))
    assert [line.label for line in lines.lines] == ["pso_mhpf", "ipf", "ppf"]
    assert [len(line.rows) for line in lines.lines] == [4, 4, 4]
    axes = sweep_plots.differences(axes_of(), lines)
    found = drawn(axes)
    assert np.isnan(found["pso_mhpf"][1]).all()
    assert found["ipf"][1] == pytest.approx([4.0] * 4) and found["ppf"][1] == pytest.approx([8.0] * 4)
    assert "from pso_mhpf" in axes.get_title("left")


@pytest.mark.thorough
def test_differences_along_a_single_line_are_from_its_first_point_as_it_was_written(made):
    said = {"scenario": "pso_mhpf", "grid": {"tracker.particles": [100, 50, 800]}}
    lines = sweep_plots.lines_of(made(said))
    axes = sweep_plots.differences(axes_of(), lines)
    (places, values), *_ = drawn(axes).values()
    assert places.tolist() == [50, 100, 800]
    assert values == pytest.approx([1.0, np.nan, 2.0], nan_ok=True)
    assert "from particles 100" in axes.get_title("left")


def test_the_baseline_of_a_comparison_is_kept(made):
    said = {"scenario": "pso_mhpf", "grid": {"tracker.kind": ["pso_mhpf", "ipf"], "tracker.particles": [50, 100]}}
    lines = sweep_plots.lines_of(made(said, by=("tracker.kind",), baseline="ipf"))
    assert (lines.key, lines.against) == ("tracker.particles", "ipf")
    found = drawn(sweep_plots.differences(axes_of(), lines))
    assert found["pso_mhpf"][1] == pytest.approx([-2.0, -2.0])


@pytest.mark.thorough
def test_keys_that_go_together_set_lines_apart_once_and_by_their_dashes(made):
    said = {
        "scenario": ["gmtt", "ris"],
        "grid": {"deploy.nodes": [200, 300, 400]},
        "zip": {"step": ["2 s", "10 s"], "duration": ["200 s", "1000 s"]},
    }
    lines = sweep_plots.lines_of(made(said))
    assert lines.key == "deploy.nodes"
    assert [(line.label, line.colour, line.dash) for line in lines.lines] == [
        ("gmtt, step 2 s", 0, 0), ("gmtt, step 10 s", 0, 1), ("ris, step 2 s", 1, 0), ("ris, step 10 s", 1, 1),
    ]  # fmt: skip
    differences = lines.found.table["difference"].to_numpy()
    assert differences[:6] == pytest.approx([np.nan] * 6, nan_ok=True) and differences[6:] == pytest.approx([6.0] * 6)


def test_a_key_that_only_follows_the_swept_one_sets_no_line_apart(made):
    said = {"scenario": "pso_mhpf", "zip": {"tracker.particles": [50, 100, 200], "link.reach": [60, 70, 80]}}
    lines = sweep_plots.lines_of(made(said))
    assert len(lines.lines) == 1 and lines.joined and len(lines.lines[0].rows) == 3


@pytest.mark.thorough
def test_points_drawn_at_random_are_not_joined(made):
    over = {"link.reach": {"range": [60, 100]}, "sensor.decay": {"range": [2, 3]}}
    lines = sweep_plots.lines_of(made({"scenario": "pso_mhpf", "random": {"points": 9, "over": over}}))
    assert not lines.joined
    axes = sweep_plots.median(axes_of(), lines)
    assert all(line.get_linestyle() == "None" for line in axes.get_lines() if line.get_marker() == "o")
    assert "bar" in axes.get_title("left")


def test_words_stand_side_by_side_in_their_order(made):
    said = {"scenario": "pso_mhpf", "grid": {"tracker.kind": ["pso_mhpf", "ekf", "ipf"]}}
    axes = sweep_plots.median(axes_of(), sweep_plots.lines_of(made(said, by=("tracker.kind",))))
    assert [label.get_text() for label in axes.get_xticklabels()] == ["pso_mhpf", "ekf", "ipf"]


@pytest.mark.thorough
def test_another_key_can_be_chosen_and_one_that_is_not_there_is_refused(made):
    folder = made(THREE)
    lines = sweep_plots.lines_of(folder, key="scenario")
    assert lines.words == ("pso_mhpf", "ipf", "ppf") and len(lines.lines) == 4
    with pytest.raises(UsageError, match=r"did you mean 'tracker\.particles'"):
        sweep_plots.lines_of(folder, key="tracker.particle")


@pytest.mark.thorough
def test_a_span_of_more_than_ten_times_is_logarithmic_with_the_values_as_ticks(made):
    axes = sweep_plots.median(axes_of(), sweep_plots.lines_of(made(PARTICLES)))
    assert axes.get_xscale() == "log"
    assert [label.get_text() for label in axes.get_xticklabels()] == ["50", "100", "800"]


def test_the_share_of_lost_runs_is_drawn_in_per_cent(made):
    axes = sweep_plots.lost(axes_of(), sweep_plots.lines_of(made(PARTICLES)))
    ((_, values),) = drawn(axes).values()
    assert values.tolist() == [50.0, 50.0, 50.0] and axes.get_ylabel().endswith("[%]")


def test_points_without_results_are_left_out_and_few_runs_have_no_band(made):
    lines = sweep_plots.lines_of(made(PARTICLES, runs=3, without=(1,)))
    axes = sweep_plots.median(axes_of(), lines)
    ((places, values),) = drawn(axes).values()
    assert places.tolist() == [50, 800] and values == pytest.approx([0.1, 2.1])
    assert lines.found.table["median_low"].isna().all()


@pytest.mark.thorough
def test_a_campaign_becomes_a_picture_of_all_its_figures(made, tmp_path):
    drawn_one = figures.draw_campaign(made(THREE), tmp_path / "x.png")
    assert drawn_one.shown == ("median", "energy", "differences", "lost") and not drawn_one.left_out
    assert drawn_one.out.read_bytes().startswith(b"\x89PNG")
    assert not list(tmp_path.glob("*.tmp"))


@pytest.mark.thorough
def test_the_same_campaign_gives_the_same_picture(made, tmp_path):
    folder = made(PARTICLES)
    first, again = (figures.draw_campaign(folder, tmp_path / f"{n}.svg").out.read_bytes() for n in "ab")
    assert first == again


@pytest.mark.thorough
def test_what_cannot_be_drawn_is_left_out_with_its_reason(made, tmp_path):
    said = {"scenario": "pso_mhpf", "grid": {"deploy.nodes": [256, 300]}}
    found = figures.draw_campaign(made(said, energy=False), tmp_path / "x.png")
    assert found.shown == ("median", "lost")
    assert "not paired" in found.left_out["differences"] and "energy" in found.left_out["energy"]


def test_a_campaign_without_results_is_refused(made, tmp_path):
    with pytest.raises(ResultError, match="no results yet"):
        figures.draw_campaign(made(PARTICLES, without=(0, 1, 2)), tmp_path / "x.png")


@pytest.mark.thorough
def test_many_values_have_shades_and_a_legend_that_names_some(made):
    said = {"scenario": "pso_mhpf", "grid": {"tracker.particles": list(range(50, 63)), "link.reach": [60, 75]}}
    lines = sweep_plots.lines_of(made(said, runs=1), key="link.reach")
    axes = sweep_plots.median(axes_of(), lines)
    assert len(lines.lines) == 13 and len(axes.get_legend_handles_labels()[1]) == 12
    assert len({line.get_color() for line in axes.get_lines()}) == 13


@pytest.mark.thorough
def test_wsnsim_plot_draws_a_folder_into_it(made, capsys):
    folder = made(PARTICLES)
    assert main(["plot", str(folder.path)]) == 0
    assert (folder.path / "figures.png").read_bytes().startswith(b"\x89PNG")
    assert "differences" in capsys.readouterr().out


@pytest.mark.thorough(fast=["wrong1"])
@pytest.mark.parametrize("wrong", [["--step", "2"], ["--what", "track"], ["--metric", "rmsd"], ["--out", "x.gif"]])
def test_wsnsim_plot_refuses_what_a_campaign_does_not_have(made, wrong, capsys):
    folder = made(PARTICLES)
    assert main(["plot", str(folder.path), *wrong]) == 2
    assert "Traceback" not in capsys.readouterr().err and not list(folder.path.glob("*.png"))


def test_wsnsim_list_names_each_shipped_sweep_with_its_question(capsys):
    assert main(["list", "sweeps", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["sweeps"]
    assert listed.keys() == shipped_sweeps().keys()
    assert all(len(question) > 20 for question in listed.values())


@pytest.mark.thorough(fast=["handover_fraction"])
@pytest.mark.parametrize("name", sorted(shipped_sweeps()))
def test_a_shipped_sweep_has_its_files_name_a_question_on_top_and_points_that_can_run(name):
    plan = load_sweep(name)
    assert plan.name == name
    assert shipped_sweeps()[name].read_text().startswith("# ")
    assert len(plan.points) > 3 and plan.replicates >= 10
