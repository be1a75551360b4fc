"""Received signal strength with gains, heights and heavy tails, against closed forms, SciPy and Monte Carlo."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest, norm, t

import wsnsim
from wsnsim.base.errors import RunError, ScenarioError
from wsnsim.models.node_constants import AssumedDistance
from wsnsim.models.ranging import Rssi

NODES = np.array([[0.0, 0.0], [9.0, 1.0], [4.0, 12.0]])
TRAITS = np.array([[3.0, 1.2], [-5.0, 2.3], [0.5, 0.0]])
POINTS = np.random.default_rng(1).uniform(0.0, 10.0, (2, 40))
FULL: dict[str, Any] = {"sd": 3.0, "gain_spread": 4.0, "target_height": 1.8}


def expected(points: np.ndarray, target_height: float = 1.8, gains: bool = True) -> np.ndarray:
    """(3, N) the law by hand: eq. 4 with the distance in space, and the gain of each node."""
    apart = points[None, :, :] - NODES[:, :, None]
    d = np.sqrt((apart**2).sum(axis=1) + (TRAITS[:, 1:] - target_height) ** 2)
    found: np.ndarray = -37.8 - 23.0 * np.log10(d) + (TRAITS[:, :1] if gains else 0.0)
    return found


def test_without_gains_and_heights_nodes_have_no_traits_and_draw_nothing() -> None:
    rng = np.random.default_rng(3)
    assert Rssi().trait_names == () and Rssi().draw_traits(4, rng).shape == (4, 0)
    assert rng.random() == np.random.default_rng(3).random()
    assert Rssi().assumed("unknown", True) == Rssi()
    assert Rssi(gain_spread=1.0).trait_names == ("gain_db",)
    assert Rssi(target_height=0.0).trait_names == ("gain_db", "height")


def test_a_reading_is_the_law_with_gain_and_height_of_the_node() -> None:
    sensor, normals = Rssi(**FULL), np.random.default_rng(2).standard_normal(40)
    for s in range(3):
        places, traits = np.tile(NODES[s], (40, 1)), np.tile(TRAITS[s], (40, 1))
        found = sensor.measure(POINTS.T, places, traits, normals)
        assert found == pytest.approx(expected(POINTS)[s] + 3.0 * normals, rel=1e-12)
        in_space = np.column_stack([POINTS.T, np.full(40, 0.4)])
        truth = expected(POINTS, target_height=0.4)[s]
        assert sensor.measure(in_space, places, traits, np.zeros(40)) == pytest.approx(truth, rel=1e-12)


def test_filters_that_know_gains_and_heights_have_the_density_of_the_readings() -> None:
    sensor, readings = Rssi(**FULL), np.array([-60.0, -55.0, -71.0])
    truth = norm.logpdf(readings[:, None], expected(POINTS), 3.0)
    assert sensor.log_likelihood(POINTS, readings, NODES, TRAITS) == pytest.approx(truth.sum(axis=0), rel=1e-9)
    owners = np.arange(40) % 3
    own = sensor.log_likelihood(POINTS, readings, NODES, TRAITS, owners)
    assert own == pytest.approx(truth[owners, np.arange(40)], rel=1e-9)


@pytest.mark.parametrize("inflate", [False, True])
def test_filters_that_do_not_know_the_gains_take_them_as_zero_and_may_widen_the_variance(inflate: bool) -> None:
    sensor, readings = Rssi(**FULL).assumed("unknown", inflate), np.array([-60.0, -55.0, -71.0])
    sd = np.sqrt(9.0 + 16.0 * inflate)
    truth = norm.logpdf(readings[:, None], expected(POINTS, gains=False), sd).sum(axis=0)
    assert sensor.log_likelihood(POINTS, readings, NODES, TRAITS) == pytest.approx(truth, rel=1e-9)
    assert np.all(sensor.linearise(POINTS, NODES, TRAITS)[2] == pytest.approx(sd**2))
    assert sensor.assumed("known", False) == Rssi(**FULL)


def test_listed_gains_are_those_of_the_nodes_and_their_mean_square_is_the_variance_filters_assume() -> None:
    sensor = Rssi(gains=(3.0, -4.0, 0.0))
    assert sensor.draw_traits(3, np.random.default_rng(1)).tolist() == [[3.0], [-4.0], [0.0]]
    assert sensor.gain_variance == pytest.approx(25.0 / 3.0)
    assert Rssi(gains=(3.0,), gain_spread=2.0).gain_variance == 4.0
    estimating = sensor.assumed("estimated", True)
    assert isinstance(estimating, AssumedDistance) and estimating.gain_prior == sensor.gain_variance
    assert np.all(estimating.linearise(POINTS, NODES, TRAITS)[2] == 0.25)
    with pytest.raises(RunError, match="3 gains for 2 nodes: list one for each node"):
        sensor.draw_traits(2, np.random.default_rng(1))


def test_drawn_gains_are_normal() -> None:
    gains = Rssi(gain_spread=4.0).draw_traits(4000, np.random.default_rng(1))[:, 0]
    assert kstest(gains, norm(0.0, 4.0).cdf).pvalue > 0.01


def test_ranges_are_those_in_the_plane_without_the_gain() -> None:
    sensor, means = Rssi(**FULL), expected(POINTS)
    for point, column in zip(POINTS.T, means.T, strict=True):
        planar = np.hypot(*(point - NODES).T)
        assert sensor.ranges_in_plane(column, TRAITS) == pytest.approx(planar, rel=1e-6)
        unknown = sensor.assumed("unknown", False).ranges_in_plane(column - TRAITS[:, 0], TRAITS)  # type: ignore[union-attr]
        assert unknown == pytest.approx(planar, rel=1e-6)
    above = sensor.ranges_in_plane(np.full(3, 50.0), TRAITS)
    assert above[1] == 0.0  # a reading that is too strong for the difference in height


def test_noise_of_students_t_has_the_standard_deviation_and_the_density_it_says() -> None:
    sensor, readings = Rssi(**FULL, noise="student_t", dof=5.0), np.array([-60.0, -55.0, -90.0])
    scale = 3.0 * np.sqrt(3.0 / 5.0)
    truth = t.logpdf(readings[:, None], 5.0, expected(POINTS), scale)
    assert sensor.log_likelihood(POINTS, readings, NODES, TRAITS) == pytest.approx(truth.sum(axis=0), rel=1e-9)
    owners = np.arange(40) % 3
    own = sensor.log_likelihood(POINTS, readings, NODES, TRAITS, owners)
    assert own == pytest.approx(truth[owners, np.arange(40)], rel=1e-9)
    normals = np.random.default_rng(2).standard_normal(4000)
    point, traits = np.tile(POINTS[:, :1].T, (4000, 1)), np.tile(TRAITS[:1], (4000, 1))
    errors = sensor.measure(point, np.tile(NODES[:1], (4000, 1)), traits, normals) - expected(POINTS)[0, 0]
    assert kstest(errors, t(5.0, 0.0, scale).cdf).pvalue > 0.01
    assert np.array_equal(np.sign(errors), np.sign(normals))
    assert not np.isfinite(sensor.log_likelihood(np.full((2, 1), np.nan), readings, NODES, TRAITS)).any()
    assert np.isneginf(sensor.log_likelihood(POINTS, np.full(3, np.nan), NODES, TRAITS)).all()
    assert not sensor.log_likelihood(POINTS, np.empty(0), NODES[:0], TRAITS[:0]).any()


@pytest.mark.parametrize("dof", [2.5, 5.0, 40.0])
def test_information_of_students_t_is_the_mean_square_of_the_score(dof: float) -> None:
    """By quadrature over the density: the slope of the log density by the reading is minus that by the mean."""
    sensor = Rssi(sd=3.0, noise="student_t", dof=dof)
    point, node = np.array([[3.0], [4.0]]), np.zeros((1, 2))
    scale = 3.0 * np.sqrt((dof - 2.0) / dof)
    z = np.sinh(np.linspace(-9.0, 9.0, 20_001)) * scale / 10.0
    score = (dof + 1.0) * z / (dof * scale**2 + z**2)
    information = np.trapezoid(score**2 * t.pdf(z, dof, 0.0, scale), z)
    slope = 23.0 / (np.log(10.0) * 5.0)
    found = sensor.information(point, node, np.empty((1, 0)))[0, :, :, 0]
    assert found == pytest.approx(information * slope**2 * np.outer([0.6, 0.8], [0.6, 0.8]), rel=1e-6)


def scenario(**sensor: Any) -> dict[str, Any]:
    """Four anchors around a slow target, without a network."""
    return {
        "name": "gains", "network": "none", "seed": 1, "duration": "3 s", "step": "1 s",
        "prior": {"sd": [2, 1, 2, 1]},
        "deploy": {"kind": "anchors", "places": [[0, 0], [20, 0], [0, 20], [20, 20]]},
        "motion": {"kind": "constant_velocity", "noise_input": "diagonal", "variances": [0.05],
                   "start": [7, 0.5, 2, 0.8]},
        "sensor": {"kind": "rssi", "sd": 3, **sensor},
        "tracker": {"kind": "pf", "particles": 50, "assumes": {"gains": "unknown"}},
    }  # fmt: skip


def test_the_table_nodes_holds_gains_as_factors(tmp_path: Any) -> None:
    listed = [0.0, 10.0, -10.0, 3.0]
    path = wsnsim.experiment.run(wsnsim.load(scenario(gains=listed)), out=tmp_path / "gains.h5").out
    assert wsnsim.read(path, "nodes")["gain"].tolist() == pytest.approx([1.0, 10.0, 0.1, 10**0.3])


def test_too_few_listed_gains_are_an_issue_of_the_scenario() -> None:
    with pytest.raises(ScenarioError, match="3 gains for 4 nodes: list one for each node, in the order"):
        wsnsim.experiment.simulate_run(wsnsim.load(scenario(gains=[1, 2, 3])))


def test_a_law_with_heights_is_refused_where_the_deployment_knows_none() -> None:
    with pytest.raises(ScenarioError, match="error: deploy: the sensor's law needs the heights of the nodes"):
        wsnsim.experiment.simulate_run(wsnsim.load("indoor_pf", ["sensor.target_height=1.5"]))
