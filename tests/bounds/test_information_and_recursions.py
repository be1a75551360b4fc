"""Recursions and Fisher information against closed forms, sampled scores and dense matrices."""

import numpy as np
import pytest

from wsnsim.bounds import covariances
from wsnsim.bounds.covariances import UnknownConstants
from wsnsim.bounds.information import (
    UsedReadings,
    _members,
    along_trajectories,
    in_range,
    information,
    over_trajectories,
)
from wsnsim.models.bearing import Bearing, RangeBearing
from wsnsim.models.ranging import Range
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.models.ungm import Squared, Ungm

PLANE = [0, 2]


def spread(rng, size, rank=None):
    root = rng.normal(size=(size, size if rank is None else rank))
    return root @ root.T


def kalman(law, prior, told, place):
    """A Kalman filter in Joseph form, with one scalar reading per eigenvector of the information."""
    cov, result = prior, []
    for (slope, noise), now in zip(law, told, strict=True):
        cov = slope @ cov @ slope.T + noise
        for value, vector in zip(*np.linalg.eigh(now), strict=True):
            row = np.zeros(len(cov))
            row[place] = vector
            if value > 1e-12:
                gain = cov @ row / (row @ cov @ row + 1.0 / value)
                left = np.eye(len(cov)) - np.outer(gain, row)
                cov = left @ cov @ left.T + np.outer(gain, gain) / value
        result.append(cov)
    return np.array(result)


@pytest.mark.parametrize("rank", [0, 1, 2, 4])
def test_in_a_linear_model_both_kinds_are_the_covariance_of_the_kalman_filter(rank):
    rng = np.random.default_rng(rank)
    slope, noise, prior = rng.normal(size=(4, 4)), spread(rng, 4, rank), spread(rng, 4, 3)
    told = np.array([spread(rng, 2, 1 + step % 2) for step in range(8)])
    law = [(np.repeat(slope[None], 3, axis=0), noise)] * 8
    expected = kalman([(slope, noise)] * 8, prior, told, PLANE)
    several = np.repeat(told[:, None], 3, axis=1)
    priors = np.repeat(prior[None], 3, axis=0)
    along = along_trajectories(law, priors, several, PLANE)
    over = over_trajectories(law, priors, several, PLANE)
    scale = np.abs(expected).max(axis=(1, 2))[:, None, None]
    assert np.abs((over - expected) / scale).max() < 1e-9
    assert np.abs((along - expected[:, None]) / scale[:, None]).max() < 1e-9


def test_for_a_target_at_rest_the_bound_is_the_inverse_fisher_information_of_its_ranges():
    rng = np.random.default_rng(5)
    sensor, point = Range(sd=2.0, reach=70.0), np.array([3.0, -4.0])
    places = rng.uniform(-60, 60, (12, 2))
    apart = point - places
    distances = np.linalg.norm(apart, axis=1)
    near = distances <= 70
    assert 3 <= near.sum() < 12
    expected = sum(np.outer(a, a) / d**2 / 4.0 for a, d in zip(apart[near], distances[near], strict=True))
    points, nothing = np.repeat(point[None], 61, axis=0), np.empty((12, 0))
    used = in_range(sensor, points, places)
    told = information(sensor, points, places, nothing, used)
    assert told == pytest.approx(np.repeat(expected[None], 61, axis=0), rel=1e-12)
    still = [(np.eye(2)[None], np.zeros((2, 2)))] * 61
    found = along_trajectories(still, 1e9 * np.eye(2)[None], told[:, None], [0, 1])[:, 0]
    assert found == pytest.approx(np.linalg.inv(expected) / np.arange(1, 62)[:, None, None], rel=1e-6)


def test_the_posterior_bound_is_the_inverse_of_the_covariance_of_sampled_scores():
    """Of the joint state of the growth model over all steps so far, after each of two steps; start N(0.5, 0.25)."""
    count, some, q, r = 400_000, 50_000, 50.0, 2000.0
    motion, sensor, rng = Ungm(q=q), Squared(variance=r), np.random.default_rng(11)
    noise, error = rng.standard_normal((2, 2, count))
    x, score = np.empty((3, count)), np.zeros((3, count))
    x[0] = 0.5 + 0.5 * rng.standard_normal(count)
    score[0] = -(x[0] - 0.5) / 0.25
    expected = []
    for step in (0, 1):
        slope = 0.5 + 25.0 * (1.0 - x[step] ** 2) / (1.0 + x[step] ** 2) ** 2
        mean = x[step] / 2.0 + 25.0 * x[step] / (1.0 + x[step] ** 2) + 8.0 * np.cos(1.2 * step)
        x[step + 1] = mean + np.sqrt(q) * noise[step]
        score[step] += slope * noise[step] / np.sqrt(q)
        score[step + 1] += x[step + 1] / 10.0 * error[step] / np.sqrt(r) - noise[step] / np.sqrt(q)
        seen = score[: step + 2]
        expected.append(np.linalg.inv(seen @ seen.T / count)[-1, -1])
    told = np.stack([sensor.information(x[[k], :some], np.zeros((1, 2)), np.empty((1, 0)))[0].T for k in (1, 2)])
    law = [motion.matrices(x[[k], :some], 1.0, float(k)) for k in (0, 1)]
    prior = np.full((some, 1, 1), 0.25)
    assert over_trajectories(law, prior, told, [0])[:, 0, 0] == pytest.approx(expected, rel=0.02)
    alike = [(np.broadcast_to(slopes.mean(axis=0), slopes.shape), noise) for slopes, noise in law]
    careless = over_trajectories(alike, prior, told, [0])[0, 0, 0]
    assert careless > 1.1 * expected[0], "that slopes differ carries information, too"


def test_the_information_about_position_and_gain_is_the_covariance_of_the_score():
    sensor, rng = AcousticEnergy(samples=40), np.random.default_rng(2)
    point, place, gain = np.array([[12.0, -9.0]] * 2), np.array([[30.0, 4.0]]), np.array([[0.85]])
    used, unknown = UsedReadings(np.array([1]), np.array([0])), UnknownConstants(gain=0.03)
    told, rows = covariances.linearised_readings(sensor, point, place, gain, used, unknown)
    assert (rows.steps.tolist(), rows.nodes.tolist()) == ([1], [0])
    theta = np.vstack([told.slopes.T, told.constant_slopes.T])[:, 0]
    readings = sensor.measure(
        np.repeat(point[:1], 200_000, axis=0), np.repeat(place, 200_000, axis=0), np.repeat(gain, 200_000, axis=0),
        rng.standard_normal(200_000),
    )  # fmt: skip

    def log_law(x, y, g):
        mean = sensor.noise + g * sensor.intensity * np.hypot(x - 30.0, y - 4.0) ** -sensor.decay
        variance = 2.0 * sensor.nonlinearity / sensor.samples * mean**2
        return -0.5 * np.log(variance) - (readings - mean) ** 2 / (2.0 * variance)

    at, h = np.array([12.0, -9.0, 0.85]), 1e-5
    scores = np.array([(log_law(*(at + h * axis)) - log_law(*(at - h * axis))) / (2.0 * h) for axis in np.eye(3)])
    found = told.weights[0] * np.outer(theta, theta)
    assert found == pytest.approx(scores @ scores.T / 200_000, rel=0.02)


@pytest.mark.parametrize(
    "sensor", [AcousticEnergy(samples=40), Range(sd=2.0), Bearing(sd=0.1), RangeBearing()], ids=repr
)
def test_the_information_about_target_and_node_is_the_covariance_of_the_score(sensor):
    """A node that stands elsewhere sees what a target sees that moved the other way; each row is a number."""
    rng, count, components = np.random.default_rng(3), 40_000, len(getattr(sensor, "components", ("one",)))
    at, gain = np.array([-12.0, -1.0, 30.0, 4.0]), np.full((1, len(sensor.trait_names)), 0.9)
    used, unknown = UsedReadings(np.array([1]), np.array([0])), UnknownConstants(place=2.0)
    points = np.array([at[:2]] * 2)
    told, rows = covariances.linearised_readings(sensor, points, at[None, 2:], gain, used, unknown)
    assert len(rows.steps) == components and told.constant_slopes == pytest.approx(-told.slopes, rel=1e-5)
    noise = rng.standard_normal((count, components))
    where = np.tile(at[:2], (count, 1)), np.tile(at[2:], (count, 1)), np.tile(gain, (count, 1))
    readings = sensor.measure(*where, noise if components > 1 else noise[:, 0])

    def log_law(moved):
        owners, point = np.arange(count), np.repeat(moved[:2, None], count, axis=1)
        return sensor.log_likelihood(point, readings, np.tile(moved[2:], (count, 1)), where[2], owners)

    scores = np.array([(log_law(at + 1e-4 * axis) - log_law(at - 1e-4 * axis)) / 2e-4 for axis in np.eye(4)])
    theta = np.hstack([told.slopes, told.constant_slopes])
    expected = (theta * told.weights[:, None]).T @ theta
    assert scores @ scores.T / count == pytest.approx(expected, abs=0.03 * np.trace(expected))


@pytest.mark.parametrize("variances", [[0.03], [2.0, 2.0], [0.03, 2.0, 2.0]])
def test_constants_of_nodes_give_the_bound_of_the_joint_information_matrix_of_all_unknowns(variances):
    rng, each = np.random.default_rng(7), len(variances)
    steps, size, nodes = 9, 4, 6
    slope, noise, prior = np.eye(4) + 0.3 * rng.normal(size=(4, 4)), spread(rng, 4), spread(rng, 4)
    pairs = [(k, node) for k in range(steps + 1) for node in range(nodes) if (k + 2 * node) % 5 < 2 and k != 4]
    used = UsedReadings(*np.array(pairs).T)
    told = covariances.LinearisedReadings(
        rng.normal(size=(len(pairs), 2)), rng.normal(size=(len(pairs), each)), rng.uniform(0, 2, len(pairs))
    )
    motions = [(slope[None], noise)] * steps
    found = covariances.along_trajectory(motions, prior, told, used, PLANE, np.array(variances))
    assert covariances.node_slots(used)[1] <= nodes
    whole = np.zeros((size * (steps + 1) + nodes * each,) * 2)
    whole[:size, :size] = np.linalg.inv(prior)
    whole[-nodes * each :, -nodes * each :] = np.diag(1.0 / np.tile(variances, nodes))
    for k in range(steps + 1):
        here = slice(size * k, size * (k + 1))
        if k:
            link = np.zeros((size, len(whole)))
            link[:, size * (k - 1) : size * k], link[:, here] = -slope, np.eye(size)
            whole += link.T @ np.linalg.inv(noise) @ link
            for row, (step, node) in enumerate(pairs):
                reading = np.zeros(len(whole))
                reading[size * k + np.array(PLANE)] = told.slopes[row]
                reading[(node - nodes) * each + np.arange(each)] = told.constant_slopes[row]
                whole += (step == k) * told.weights[row] * np.outer(reading, reading)
            known = [*range(size * (k + 1)), *range(len(whole) - nodes * each, len(whole))]
            assert found[k - 1] == pytest.approx(np.linalg.inv(whole[np.ix_(known, known)])[here, here], rel=1e-7)


def test_a_slot_is_reused_only_after_the_last_reading_of_its_node():
    rng = np.random.default_rng(4)
    pairs = sorted({(int(k), int(n)) for k, n in zip(rng.integers(0, 60, 200), rng.integers(0, 40, 200), strict=True)})
    used = UsedReadings(*np.array(pairs).T)
    slots, count = covariances.node_slots(used)
    spans = [(used.steps[used.nodes == n][[0, -1]], set(slots[used.nodes == n])) for n in set(used.nodes.tolist())]
    assert all(len(own) == 1 for _, own in spans)
    for i, ((begin, end), own) in enumerate(spans):
        assert all(own != other or end < b or e < begin for (b, e), other in spans[i + 1 :])
    assert count == slots.max() + 1 < 40


def test_without_readings_the_covariance_grows_by_the_motion_model():
    rng = np.random.default_rng(1)
    slope, noise, prior = rng.normal(size=(4, 4)), spread(rng, 4, 1), spread(rng, 4)
    for recurse in (along_trajectories, over_trajectories):
        found = recurse([(slope[None], noise)] * 4, prior[None], np.zeros((4, 1, 2, 2)), PLANE).reshape(4, 4, 4)
        cov = prior
        for now in found:
            cov = slope @ cov @ slope.T + noise
            assert now == pytest.approx(cov, rel=1e-13)


def test_a_node_that_leads_twice_has_the_members_that_joined_it_each_time():
    clusters = {"head": np.array([7, 3, 7]), "formed": np.array([0.0, 1.0, 2.0])}
    joined = {"peer": np.array([7, 7, 3, 7]), "node": np.array([1, 2, 1, 5]), "time": np.array([0.0, 0.0, 0.9, 2.0])}
    ends = [0.5, 1.5, 2.5]
    assert [_members(clusters, joined, *each) for each in enumerate(ends)] == [{7, 1, 2}, {3, 1}, {7, 5}]


def test_a_node_that_joins_a_cluster_after_it_formed_is_a_member_from_then_on():
    clusters = {"head": np.array([7, 3]), "formed": np.array([0.0, 2.0])}
    joined = {"peer": np.array([7, 7, 3]), "node": np.array([1, 2, 4]), "time": np.array([0.0, 0.7, 2.0])}
    assert [_members(clusters, joined, 0, end) for end in (0.5, 0.7, 1.9)] == [{7, 1}, {7, 1, 2}, {7, 1, 2}]
