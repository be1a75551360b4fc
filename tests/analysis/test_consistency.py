"""Consistency: covariances in a result, NEES and NIS against χ² and against independent recursions."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import wsnsim
from wsnsim.base import metrics
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.ports import Estimate
from wsnsim.base.setups import TrackingSetup
from wsnsim.base.tables import METRICS, Memory, columns_of, product_unit
from wsnsim.experiment import replicate_of
from wsnsim.models.linear_sensing import Coordinate
from wsnsim.scenario import build, load

STEPS, SEEDS, SENSORS, VARIANCE = 3, 1000, 3, 4.0
LINEAR: dict[str, Any] = {
    "name": "linear", "seed": 17, "network": "none", "step": "1 s", "duration": f"{STEPS} s",
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


def test_a_linear_gaussian_filter_is_in_the_one_step_interval_of_chi_squared_in_95_percent_of_1000_seeds(tracked):
    for shares in (inside(tracked["nees"], 2), inside(tracked["nis"], SENSORS)):
        assert (shares >= 0.93).all() and (shares <= 0.97).all(), shares
    assert (tracked["nis_dof"] == SENSORS).all() and (tracked["gaussian"] == 1).all()


def test_doubling_r_q_and_p0_leaves_the_estimates_and_halves_nees_and_nis(tracked):
    seeds = 20
    doubled = estimates_of(linear_setup(2.0, 2.0, 2.0), seeds)
    for name in ("px", "vx", "py", "vy", "error"):
        assert np.allclose(doubled[name], tracked[name][:seeds], rtol=1e-9)
    for name, factor in (("nees", 0.5), ("nis", 0.5), ("cov_xy", 2.0)):
        assert np.allclose(doubled[name], factor * tracked[name][:seeds], rtol=1e-9)


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
