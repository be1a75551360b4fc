"""The posterior by quadrature against a fine grid of our own, which knows neither its search nor its points."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.scenes import make_scene
from wsnsim.base.sensing import informations
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.ranging import Range, Rssi
from wsnsim.models.sensing import AcousticEnergy, Coordinate
from wsnsim.models.ungm import Squared, Ungm
from wsnsim.trackers.shared.posteriors import updated
from wsnsim.trackers.shared.readings import Evidence

PLACE = [0, 2]


def geometry(sensor, seed, nodes, sd):
    """A prior of four columns, and readings of a target drawn from it by nodes 8 m or more from its mean."""
    rng = np.random.default_rng(seed)
    around = rng.uniform(0.0, 2.0 * np.pi, nodes)
    positions = rng.uniform(8.0 + 2.0 * sd, 50.0, (nodes, 1)) * np.column_stack([np.cos(around), np.sin(around)])
    traits = sensor.draw_traits(nodes, rng)
    mixing = np.eye(4) + 0.3 * rng.normal(size=(4, 4))
    cov = mixing @ np.diag([sd**2, 9.0, sd**2, 9.0]) @ mixing.T
    mean = rng.normal(size=4)
    target = mean + np.linalg.cholesky(cov) @ rng.normal(size=4)
    readings = sensor.measure(np.tile(target[PLACE], (nodes, 1)), positions, traits, rng.normal(size=nodes))
    seen = Evidence(tuple(range(nodes)), readings, positions, traits)
    return mean, cov, seen, make_scene(1, seen.ids, positions, traits, BoundedVelocity(), sensor)


def on_a_grid(mean, cov, seen, sensor, centre, width, cells=161):
    """Mean (4,), covariance (4, 4) and evidence by a sum over a fine grid of positions, the rest by regression."""
    axes = [np.linspace(c - width, c + width, cells) for c in centre]
    x, y = (each.ravel() for each in np.meshgrid(*axes))
    points = np.stack([x, y])
    prior = cov[np.ix_(PLACE, PLACE)]
    away = points - mean[PLACE][:, None]
    logs = -0.5 * (away * np.linalg.solve(prior, away)).sum(axis=0) - 0.5 * np.linalg.slogdet(2 * np.pi * prior)[1]
    logs = logs + sensor.log_likelihood(points, seen.readings, seen.positions, seen.traits)
    weights = np.exp(logs - logs.max())
    evidence = logs.max() + np.log(weights.sum() * (axes[0][1] - axes[0][0]) * (axes[1][1] - axes[1][0]))
    weights /= weights.sum()
    middle = points @ weights
    spread = ((points - middle[:, None]) * weights) @ (points - middle[:, None]).T
    slope = cov[:, PLACE] @ np.linalg.inv(prior)
    return mean + slope @ (middle - mean[PLACE]), cov + slope @ (spread - prior) @ slope.T, evidence


@pytest.mark.parametrize("sd", [0.1, 2.0])
@pytest.mark.parametrize("sensor", [AcousticEnergy(), Range()], ids=["energy", "range"])
@pytest.mark.parametrize("seed", range(5))
def test_mean_covariance_and_evidence_are_those_of_a_fine_grid(sensor, sd, seed) -> None:
    mean, cov, seen, scene = geometry(sensor, seed, 3 + 2 * seed, sd)
    found = updated(mean, cov, seen, scene)
    width = 7.0 * np.sqrt(np.diag(found.cov)[PLACE].max())
    true_mean, true_cov, evidence = on_a_grid(mean, cov, seen, sensor, found.mean[PLACE], width)
    deviations = np.sqrt(np.diag(true_cov))
    assert np.abs((found.mean - true_mean) / deviations).max() < 3e-3
    assert np.abs((found.cov - true_cov) / np.outer(deviations, deviations)).max() < 5e-3
    assert found.log_evidence == pytest.approx(evidence, abs=2e-3)


def test_with_a_linear_sensor_it_is_the_kalman_filter() -> None:
    sensor = Coordinate(sd=0.7)
    mean, cov, seen, scene = geometry(sensor, 3, 6, 2.0)
    found = updated(mean, cov, seen, scene)
    slopes = np.zeros((6, 4))
    slopes[:, PLACE] = np.column_stack([np.cos(seen.traits[:, 0]), np.sin(seen.traits[:, 0])])
    within = slopes @ cov @ slopes.T + 0.49 * np.eye(6)
    gain = cov @ slopes.T @ np.linalg.inv(within)
    away = seen.readings - slopes @ mean
    assert found.mean == pytest.approx(mean + gain @ away, rel=1e-6, abs=1e-6)
    assert found.cov == pytest.approx(cov - gain @ slopes @ cov, rel=1e-6, abs=1e-6)
    density = -0.5 * away @ np.linalg.solve(within, away) - 0.5 * np.linalg.slogdet(2 * np.pi * within)[1]
    assert found.log_evidence == pytest.approx(density, abs=1e-6)


def test_a_state_of_one_column_has_its_moments_from_one_axis() -> None:
    motion, sensor, positions = Ungm(), Squared(), np.zeros((1, 2))
    seen = Evidence((0,), np.array([5.0]), positions, np.zeros((1, 0)))
    found = updated(
        np.array([9.0]), np.array([[2.0]]), seen, make_scene(1, (0,), positions, seen.traits, motion, sensor)
    )
    points = np.linspace(0.0, 20.0, 20001)
    weights = np.exp(-0.25 * (points - 9.0) ** 2 - 0.5 * (5.0 - points**2 / 20.0) ** 2)
    weights /= weights.sum()
    assert found.mean[0] == pytest.approx(weights @ points, rel=1e-4)
    assert found.cov[0, 0] == pytest.approx(weights @ (points - weights @ points) ** 2, rel=5e-3)


def test_where_no_point_explains_the_readings_the_prior_stays() -> None:
    mean, cov, seen, scene = geometry(AcousticEnergy(), 1, 4, 0.1)
    seen.readings[2] = np.nan
    found = updated(mean, cov, seen, scene)
    assert found.log_evidence == -np.inf
    assert np.array_equal(found.mean, mean) and np.array_equal(found.cov, cov)


class Unsaid:
    """An AcousticEnergy that does not say what its readings tell."""

    def __init__(self) -> None:
        self.linearise = AcousticEnergy().linearise


def test_without_a_statement_of_the_sensor_the_information_is_that_of_the_mean_alone() -> None:
    _, _, seen, scene = geometry(AcousticEnergy(), 5, 6, 2.0)
    point = np.array([[1.0], [-2.0]])
    mean_alone = informations(Unsaid(), point, seen.positions, seen.traits)[..., 0]
    whole = informations(scene.sensor, point, seen.positions, seen.traits)[..., 0]
    extra = np.linalg.eigvalsh(whole - mean_alone)
    assert mean_alone.shape == whole.shape == (6, 2, 2)
    assert (extra > -1e-12).all() and extra[:, 1].min() > 0.0


@pytest.mark.parametrize("sd", [1e-9, 1e-6])
@pytest.mark.parametrize("seed", range(15))
def test_readings_of_next_to_no_noise_leave_a_variance_that_is_not_negative(sd, seed) -> None:
    mean, cov, seen, scene = geometry(Rssi(sd=sd, reach=1e5), seed, 1 + seed % 6, 20.0)
    found = updated(mean, cov, seen, scene)
    assert np.isfinite(found.mean).all() and np.linalg.eigvalsh(found.cov[np.ix_(PLACE, PLACE)])[0] > -1e-20
    assert (np.diag(found.cov) > 0.0).all()
