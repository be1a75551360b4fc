"""Consistency: covariances in a result, NEES and NIS against χ² and against independent recursions."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import stats

import wsnsim
from wsnsim.analysis import figure_style, figures, plots, summary_text
from wsnsim.analysis.consistency import state_nees, step_consistency
from wsnsim.analysis.quantities import QUANTITIES
from wsnsim.base import metrics
from wsnsim.base.arrays import Estimate
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import METRICS, Memory, columns_of, product_unit
from wsnsim.experiment import replicate_of
from wsnsim.models.sensing import Coordinate
from wsnsim.report.svg_figures import svg_figures
from wsnsim.scenario import build, load

STEPS, SEEDS, SENSORS, VARIANCE = 3, 1000, 3, 4.0
LINEAR: dict[str, Any] = {
    "name": "linear", "seed": 17, "network": "none", "step": "1 s", "duration": f"{STEPS + 1} s",
    "prior": {"sd": [3, 1, 3, 1]},
    "deploy": {"kind": "anchors", "places": [[0, 0], [100, 0], [0, 100]]},
    "motion": {"kind": "constant_velocity", "variances": [0.5]},
    "sensor": {"kind": "coordinate", "sd": VARIANCE**0.5},
    "tracker": {"kind": "ekf"},
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class ScaledPrior:
    """The prior of a scenario, with the same mean and a covariance times a factor."""

    prior: Any
    factor: float

    def draw(self, start, rng):
        drawn = self.prior.draw(start, rng)
        return Estimate(drawn.mean, self.factor * drawn.cov)


def linear_setup(r: float = 1.0, q: float = 1.0, p: float = 1.0) -> TrackingSetup:
    """The linear scenario with a filter that assumes R, Q and P0 times these factors; the world stays."""
    setup = build(load(LINEAR))
    assert isinstance(setup, TrackingSetup)
    return dataclasses.replace(
        setup,
        filter_sensor=Coordinate(sd=(r * VARIANCE) ** 0.5),
        filter_motions=(setup.filter_motions[0].assumed(q),),
        prior=ScaledPrior(setup.prior, p),
    )


def estimates_of(setup: TrackingSetup, seeds: int) -> dict[str, np.ndarray]:
    """Columns (seeds, STEPS) of the table `estimates`."""
    memory = Memory({"estimates": True})
    for seed in range(seeds):
        replicate_of(setup, seed, memory)
    return {name: values.reshape(seeds, STEPS) for name, values in memory.table("estimates").items()}


@pytest.fixture(scope="module")
def tracked() -> dict[str, np.ndarray]:
    return estimates_of(linear_setup(), SEEDS)


def inside(values: np.ndarray, dof: int) -> np.ndarray:
    """(STEPS,) share of the seeds in the 95 % interval of χ²."""
    low, high = stats.chi2.ppf([0.025, 0.975], dof)
    return ((low <= values) & (values <= high)).mean(axis=0)


@pytest.mark.thorough
def test_a_linear_gaussian_filter_is_in_the_one_step_interval_of_chi_squared_in_95_percent_of_1000_seeds(tracked):
    for shares in (inside(tracked["nees"], 2), inside(tracked["nis"], SENSORS)):
        assert (shares >= 0.93).all() and (shares <= 0.97).all(), shares
    assert (tracked["nis_dof"] == SENSORS).all() and (tracked["gaussian"] == 1).all()


@pytest.mark.thorough
def test_doubling_r_q_and_p0_leaves_the_estimates_and_halves_nees_and_nis(tracked):
    seeds = 20
    doubled = estimates_of(linear_setup(2.0, 2.0, 2.0), seeds)
    for name in ("px", "vx", "py", "vy", "error"):
        assert np.allclose(doubled[name], tracked[name][:seeds], rtol=1e-9)
    for name, factor in (("nees", 0.5), ("nis", 0.5), ("cov_xy", 2.0)):
        assert np.allclose(doubled[name], factor * tracked[name][:seeds], rtol=1e-9)


@pytest.mark.thorough
def test_with_a_wrong_r_alone_the_mean_nis_is_that_of_the_mismatched_lyapunov_recursion():
    seeds, factor = 300, 4.0
    found = estimates_of(linear_setup(r=factor), seeds)
    expected, spread = mismatched_nis(seeds, factor)
    assert (np.abs(expected - 1.0) > 0.3).all()
    error = np.sqrt(spread / seeds)
    assert (np.abs((found["nis"] / SENSORS).mean(axis=0) - expected) < 4.0 * error).all()


def mismatched_nis(seeds: int, factor: float) -> tuple[np.ndarray, np.ndarray]:
    """tr(S'⁻¹ C) / m and the variance of the NIS per measurement at each step, mean over the seeds' axes.

    A filter that assumes R' = factor R has the gain K' and the covariance S' of its own recursion, while the true
    covariance of the errors follows E⁺ = (I - K' H) (F E Fᵀ + Q) (I - K' H)ᵀ + K' R K'ᵀ, and C = H E⁻ Hᵀ + R.
    """
    setup = linear_setup()
    motion = setup.motions[0]
    transitions, q = motion.matrices(np.zeros((4, 1)), 1.0, 0.0)
    f, eye, noise = transitions[0], np.eye(4), VARIANCE * np.eye(SENSORS)
    means, variances = np.zeros((seeds, STEPS)), np.zeros((seeds, STEPS))
    for seed in range(seeds):
        theta = sample_initial_conditions(setup, seed).traits[:, 0]
        h = np.zeros((SENSORS, 4))
        h[:, 0], h[:, 2] = np.cos(theta), np.sin(theta)
        believed = true = np.diag([9.0, 1.0, 9.0, 1.0])
        for step in range(STEPS):
            believed, true = f @ believed @ f.T + q, f @ true @ f.T + q
            claimed, actual = h @ believed @ h.T + factor * noise, h @ true @ h.T + noise
            ratio = np.linalg.solve(claimed, actual)
            means[seed, step] = np.trace(ratio) / SENSORS
            variances[seed, step] = 2.0 * np.trace(ratio @ ratio) / SENSORS**2
            gain = np.linalg.solve(claimed, h @ believed).T
            rest = eye - gain @ h
            believed = rest @ believed @ rest.T + factor * gain @ noise @ gain.T
            true = rest @ true @ rest.T + gain @ noise @ gain.T
    return means.mean(axis=0), variances.mean(axis=0) + means.var(axis=0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("linear") / "linear.h5"
    wsnsim.run(load({**LINEAR, "record": {"covariances": True}}), replicates=6, out=out)
    return out


def test_nees_is_that_of_the_recorded_truth_means_and_covariances(recorded):
    truth, found = wsnsim.read(recorded, "truth"), wsnsim.read(recorded, "estimates")
    truth = truth[truth["step"] > 0]
    error = found[["px", "py"]].to_numpy() - truth[["px", "py"]].to_numpy()
    xx, yy, xy = (found[name].to_numpy() for name in ("sd_x", "sd_y", "cov_xy"))
    covs = np.array([[xx**2, xy], [xy, yy**2]]).transpose(2, 0, 1)
    assert np.allclose(found["nees"], np.einsum("ni,nij,nj->n", error, np.linalg.inv(covs), error))
    runs = wsnsim.read(recorded, "runs")
    assert np.allclose(runs["nees"], found.groupby("replicate")["nees"].mean() / 2)
    assert np.allclose(runs["nis"], found.groupby("replicate")["nis"].mean() / SENSORS)
    assert {"nees", "nis"} <= set(METRICS)


def test_the_table_covariances_holds_the_upper_triangle_of_the_state_on_request(recorded):
    found, covs = wsnsim.read(recorded, "estimates"), wsnsim.read(recorded, "covariances")
    assert list(covs.columns[3:7]) == ["cov_px_px", "cov_px_vx", "cov_px_py", "cov_px_vy"] and covs.shape[1] == 13
    assert np.allclose(np.sqrt(covs["cov_px_px"]), found["sd_x"]) and (covs["cov_px_py"] == found["cov_xy"]).all()
    assert "covariances" not in Memory()._pieces and not Memory().wants("covariances")


def test_units_of_covariances_follow_those_of_the_state():
    states = (("px", "m"), ("vx", "m/s"), ("x", ""))
    units = {column.name: column.units for column in columns_of("covariances", states)[3:]}
    assert units["cov_px_px"] == "m2" and units["cov_px_vx"] == "m m/s" and units["cov_px_x"] == "m"
    assert product_unit("m/s", "m/s") == "m/s m/s" and product_unit("", "") == ""
    plane = columns_of("estimates", (("a", "km"), ("b", "km")), (0, 1))
    assert {column.name: column.units for column in plane}["cov_xy"] == "km2"
    line = columns_of("estimates", (("a", "km"),), (0,))
    assert not {"sd_y", "cov_xy"} & {column.name for column in line}


def test_a_covariance_without_an_inverse_has_no_nees():
    covs = np.array([np.eye(2), np.ones((2, 2)), np.zeros((2, 2)), [[1.0, 2.0], [2.0, 1.0]], np.full((2, 2), np.nan)])
    found = metrics.normalised_squares(np.tile([3.0, 4.0], (5, 1)), covs)
    assert found[0] == 25.0 and np.isnan(found[1:]).all()
    assert metrics.normalised_squares(np.array([[2.0]]), np.array([[[4.0]]])).tolist() == [1.0]


@pytest.mark.parametrize(("change", "gaussian", "dof"), (
    ({"sensor": {"kind": "range", "reach": ".inf"}}, 0, SENSORS),
    ({"tracker": {"kind": "pf", "particles": 20}}, 0, 0),
    ({"tracker": {"kind": "ekf", "readings": "nearest"}}, 1, 1),
))  # fmt: skip
def test_only_exact_filters_of_linear_models_are_gaussian_and_only_those_with_innovations_have_a_nis(
    change, gaussian, dof
):
    setup = build(load({**LINEAR, **change}))
    assert isinstance(setup, TrackingSetup)
    found = estimates_of(setup, 1)
    assert (found["gaussian"] == gaussian).all() and (found["nis_dof"] == dof).all()
    assert np.isfinite(found["nis"]).all() == (dof > 0)


def test_the_consistency_of_a_file_is_its_nees_per_step_with_chi_squared_intervals_and_a_bootstrap_over_runs(recorded):
    estimates, runs = wsnsim.read(recorded, "estimates"), wsnsim.read(recorded, "runs")
    for of, size in (("nees", 2), ("nis", SENSORS)):
        found = step_consistency(recorded, of)
        assert np.allclose(found.values, estimates.groupby("step")[of].mean() / size) and found.gaussian
        assert np.allclose(found.low, stats.chi2.ppf(0.025, 6 * size) / (6 * size))
        assert np.allclose(found.high, stats.chi2.ppf(0.975, 6 * size) / (6 * size))
        assert np.isclose(found.average, runs[of].mean()) and found.average_low < found.average < found.average_high
        assert (found.average_low, found.average_high) == metrics.bootstrap_interval(
            runs[of].to_numpy(), metrics.mean_error
        )
        assert found.steps.tolist() == [1, 2, 3]


def test_the_nees_of_the_state_is_read_from_its_recorded_covariance(recorded):
    found = step_consistency(recorded, "state")
    table = state_nees(recorded)
    assert np.allclose(found.values, table.groupby("step")["nees"].mean() / 4)
    truth, means = wsnsim.read(recorded, "truth"), wsnsim.read(recorded, "estimates")
    covs, names = wsnsim.read(recorded, "covariances"), ["px", "vx", "py", "vy"]
    error = (means[names].to_numpy() - truth[truth["step"] > 0][names].to_numpy())[5]
    cov = np.array([[covs[f"cov_{min(a, b, key=names.index)}_{max(a, b, key=names.index)}"][5] for a in names]
                    for b in names])  # fmt: skip
    assert np.isclose(table["nees"][5], error @ np.linalg.solve(cov, error))


def test_without_a_gaussian_posterior_the_interval_of_a_step_is_a_bootstrap_about_the_value(tmp_path):
    text = {**LINEAR, "sensor": {"kind": "range", "reach": ".inf"}}
    found = step_consistency(wsnsim.experiment.run(load(text), replicates=8, out=tmp_path / "range.h5").out)
    assert not found.gaussian
    assert (found.low < found.values).all() and (found.values < found.high).all()
    few = step_consistency(wsnsim.experiment.run(load(text), replicates=4, out=tmp_path / "few.h5").out)
    assert np.isfinite(few.values).all() and np.isnan(few.low).all() and np.isnan(few.average_low)


@pytest.mark.thorough
def test_a_bootstrap_over_runs_covers_the_time_average_of_correlated_values_and_a_naive_interval_does_not():
    """A scalar Kalman filter over 100 steps whose errors forget slowly: P is constant, e⁺ = (1 - K) (e + w) - K v."""
    groups, runs, steps, q = 100, 40, 100, 0.01
    rng = np.random.default_rng(5)
    predicted = (q + np.sqrt(q * q + 4.0 * q)) / 2.0  # of the Riccati equation with R = 1
    gain = predicted / (predicted + 1.0)
    error = np.sqrt(predicted - q) * rng.standard_normal((groups, runs))
    total = np.zeros((groups, runs))
    for _ in range(steps):
        w, v = np.sqrt(q) * rng.standard_normal((groups, runs)), rng.standard_normal((groups, runs))
        error = (1.0 - gain) * (error + w) - gain * v
        total += error**2 / (predicted - q)
    low, high = stats.chi2.ppf([0.025, 0.975], steps)
    assert ((low < total) & (total < high)).mean() < 0.7
    intervals = np.array([metrics.bootstrap_interval(group / steps, metrics.mean_error) for group in total])
    covered = (intervals[:, 0] < 1.0) & (intervals[:, 1] > 1.0)
    assert covered.mean() > 0.87


@pytest.mark.thorough
def test_the_plot_the_summary_and_compare_show_the_same_average(recorded, tmp_path):
    drawn = figures.draw(recorded, tmp_path / "x.svg", "consistency")
    assert drawn.shown == ("consistency",)
    found = step_consistency(recorded, "nees")
    axes = Figure().subplots()
    plots.consistency(axes, recorded)
    assert f"NEES {found.average:.3g} [" in axes.get_title(loc="left")
    assert {"NEES", "NIS", "NEES, 95 % χ²", "NIS, 95 % χ²", "consistent"} == set(axes.get_legend_handles_labels()[1])
    figure = figure_style.figure_of([lambda axes: plots.consistency(axes, recorded)])
    figure.draw_without_rendering()
    assert figure.axes[0].get_legend().get_window_extent().x1 <= figure.bbox.x1
    report = wsnsim.experiment.run(load(LINEAR), replicates=6, out=tmp_path / "again.h5")
    row = next(line for line in summary_text.text(report, {}).splitlines() if "average NEES" in line)
    assert QUANTITIES["nees"].text(found.average, "") in row and "[" in row
    assert "consistency" in [figure.name for figure in svg_figures(recorded, 0)[0]]
