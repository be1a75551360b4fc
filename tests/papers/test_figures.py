"""The bands around curves of the RMSE over runs, and the titles that mention them."""

import matplotlib.colors
import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.papers.studies import module
from wsnsim.analysis import figure_style
from wsnsim.base import metrics
from wsnsim.papers.plotting import plain_numbers

liu2012 = module("liu2012")


def errors_of(runs, steps, seed=1):
    """(runs, steps) errors, some of them a hundred times as large as the others."""
    rng = np.random.default_rng(seed)
    return np.abs(rng.normal(size=(runs, steps))) * rng.choice([1.0, 100.0], p=[0.9, 0.1], size=(runs, steps))


def slow_interval(rows, taken):
    """The percentiles of the RMSE over bootstrap samples; `taken` counts how often each run is in each sample."""
    ends = np.full((2, rows.shape[1]), np.nan)
    for step, column in enumerate(rows.T):
        drawn = [metrics.rmse(np.repeat(column, times)) for times in taken]
        ends[:, step] = np.nanpercentile(drawn, [2.5, 97.5])
    return ends


def axes_of():
    axes = Figure().subplots()
    axes.set_yscale("log")
    return axes


def test_a_band_is_between_the_percentiles_of_a_slow_loop_over_the_same_draws():
    rows = errors_of(12, 7)
    rows[:5, 2] = np.nan
    taken = np.random.Generator(np.random.Philox(12)).multinomial(12, np.full(12, 1 / 12), size=50)
    np.testing.assert_allclose(figure_style.rmse_interval(rows, 50), slow_interval(rows, taken), rtol=1e-12)


@pytest.mark.thorough
def test_a_band_is_that_of_other_draws_of_whole_runs_but_for_their_noise():
    rows = np.abs(np.random.default_rng(2).normal(size=(40, 5)))
    picks = np.random.default_rng(3).integers(0, 40, (4000, 40))
    other = slow_interval(rows, np.array([np.bincount(pick, minlength=40) for pick in picks]))
    np.testing.assert_allclose(figure_style.rmse_interval(rows, 4000), other, rtol=0.02)


@pytest.mark.thorough
def test_the_band_of_many_runs_holds_the_true_rmse_at_95_percent_of_the_steps():
    low, high = figure_style.rmse_interval(np.random.default_rng(4).normal(scale=3.0, size=(200, 2000)))
    assert np.mean((low < 3.0) & (high > 3.0)) == pytest.approx(0.95, abs=0.03)


def test_one_run_has_a_curve_and_no_band():
    axes = figure_style.rmse_band(axes_of(), np.arange(1.0, 4.0), np.array([[1.0, 2.0, 3.0]]), "EKF", "#000000")
    (line,) = axes.get_lines()
    np.testing.assert_array_equal(line.get_ydata(), [1.0, 2.0, 3.0])
    assert not axes.collections
    assert [figure_style.runs_text(1), figure_style.runs_text(4)] == ["one run", "4 runs"]
    assert [figure_style.runs_text(5), figure_style.runs_text(20, "RKF")] == [
        "5 runs (bands: 95 % confidence)",
        "20 runs (bands of RKF: 95 % confidence)",
    ]


@pytest.mark.parametrize("missing", [np.nan, np.inf])
def test_a_step_that_few_runs_know_has_no_band_and_spoils_no_other(missing):
    rows = errors_of(8, 4)
    whole = np.array(figure_style.rmse_interval(rows))
    rows[:, 0], rows[4:, 1], rows[5:, 2] = missing, missing, missing
    low, high = figure_style.rmse_interval(rows)
    assert np.isnan([low[:2], high[:2]]).all()
    assert low[2] <= metrics.rmse(rows[:5, 2]) <= high[2]
    np.testing.assert_array_equal([low[3], high[3]], whole[:, 3])
    assert len(figure_style.rmse_band(axes_of(), np.arange(4.0), rows, "EKF", "#000000").collections) == 1


def test_what_a_band_has_beneath_all_curves_does_not_stretch_the_axes_and_what_it_has_above_does():
    x, rows = np.arange(1.0, 4.0), np.full((10, 3), 1e-6)
    rows[0] = 1.0, 2.0, 4.0
    low, high = figure_style.rmse_interval(rows)
    assert low.max() < 1e-5
    axes = figure_style.rmse_band(axes_of(), x, rows, "IPF", "#000000")
    bottom, top = axes.get_ylim()
    curve = metrics.per_step_rmse(rows)
    assert 0.5 * curve.min() < bottom < curve.min()
    assert high.max() < top < 2.0 * high.max()
    bare = figure_style.rmse_band(axes_of(), x, rows, "IPF", "#000000", banded=False)
    assert not bare.collections and bare.get_ylim()[1] < high.max()


class SyntheticData:
    """The errors of six variants and a bound, without a campaign."""

    def __init__(self, runs):
        self.rows = {name: errors_of(runs, 6, seed) for seed, name in enumerate(liu2012.PRINTED | liu2012.OTHERS)}
        self.runs = runs

    def errors(self, variant):
        return self.rows[variant]

    def scenario(self, variant):
        return {"step": 1.0}

    def lost(self, variant):
        return np.zeros(self.runs, dtype=bool)

    def bound(self, variant, kind):
        return type("Bound", (), {"rmse": np.full(6, 0.1)})


@pytest.mark.parametrize(
    ("runs", "said"), [(20, "RMSE over 20 runs (bands: 95 % confidence)"), (2, "RMSE over 2 runs")]
)
def test_a_title_tells_of_bands_where_each_curve_over_runs_has_one_in_its_colour(runs, said):
    figure = Figure()
    liu2012.FIGURES["figure_1"](figure, SyntheticData(runs))
    left = figure.axes[0]
    assert left.get_title(loc="left") == f"{said}, lost ones included"
    curves = [line for line in left.get_lines() if not line.get_label().startswith("bound")]
    shown = [matplotlib.colors.to_hex(band.get_facecolor()[0]) for band in left.collections]
    assert shown == ([line.get_color().lower() for line in curves] if "bands" in said else [])


@pytest.mark.parametrize(
    ("ends", "expected"), [((0.3, 3.0), "0.5 1 2"), ((0.009, 9.0), "0.01 0.02 0.05 0.1 0.2 0.5 1 2 5")]
)
def test_a_logarithmic_axis_of_errors_has_plain_numbers_at_three_places_a_decade(ends, expected):
    axes = axes_of()
    axes.set_ylim(*ends)
    plain_numbers(axes)
    axes.figure.draw_without_rendering()
    said = [label.get_text() for label in axes.get_yticklabels() if ends[0] <= label.get_position()[1] <= ends[1]]
    assert said == expected.split()
