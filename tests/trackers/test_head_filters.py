"""Filters that live in the head, against the Kalman filter and by the packet."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tests.helpers.linear_cluster import Cluster, LinearMotion, against_kalman, sent
from tests.helpers.losses import losing
from wsnsim.base.requests import all_arrived
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.offline.loopback import silent
from wsnsim.trackers.bootstrap_pf import CentralPf
from wsnsim.trackers.information_pf import InformationPf

EVERY = [
    CentralPf(particles=40),
    InformationPf(particles=40),
    InformationPf(particles=40, proposal="local"),
    InformationPf(particles=40, proposal="cloud"),
]


@pytest.mark.thorough(fast=["cloud"])
@pytest.mark.parametrize(
    ("tracker", "noise_scale", "tolerance"),
    [
        (CentralPf(particles=2000), 1.0, 0.4),
        (InformationPf(particles=1000, proposal="local"), 1.0, 0.3),
        (InformationPf(particles=1000, proposal="cloud"), 1.0, 0.1),
        (InformationPf(particles=3000), 30.0, 0.3),
    ],
    ids=["central", "local", "cloud", "per_particle"],
)
def test_on_a_linear_gaussian_model_the_filter_is_the_kalman_filter_but_for_its_particles(
    tracker, noise_scale, tolerance
) -> None:
    errors, ratios = against_kalman(tracker, noise_scale, seeds=8)
    assert np.sqrt(np.mean(errors**2)) < tolerance, "root mean square distance of the means, in the Kalman filter's sd"
    assert np.abs(errors.mean(axis=0)).max() < tolerance / 2, "a bias"
    assert np.median(ratios) == pytest.approx(1.0, abs=0.1)


@pytest.mark.thorough
def test_a_proposal_much_wider_than_the_process_noise_starves_the_filter() -> None:
    """The price of weights p(x | x_prev) / q(x) where the noise is small: seen here, and in the paper's set-up."""
    errors, _ = against_kalman(InformationPf(particles=1000), seeds=4)
    local, _ = against_kalman(InformationPf(particles=1000, proposal="local"), seeds=4)
    assert np.sqrt(np.mean(errors**2)) > 3.0 * np.sqrt(np.mean(local**2))


def test_particles_drawn_from_one_gaussian_have_equal_weights_where_that_gaussian_is_the_posterior() -> None:
    """Linear and Gaussian: p(z | x) N(x; m, P) / q(x) is a constant, whatever the particles were before the step."""
    tracker, cluster = InformationPf(particles=400, proposal="cloud"), Cluster(5)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    for step in range(1, 21):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        assert tracker.estimate(belief).effective == pytest.approx(400.0, rel=1e-9)


def cloud_weights_by_hand(belief, cloud, scene, readings) -> np.ndarray:
    """Normalised p(z | x) N(x; m, P) / q(x) of particles, with SciPy's densities and a joint Kalman update."""
    motion, place = scene.motion, list(scene.motion.position)
    weights = np.exp(belief.pool.log_weights - belief.pool.log_weights.max())
    mean = np.average(belief.pool.cloud, weights=weights, axis=1)
    cov = np.cov(belief.pool.cloud, aweights=weights, bias=True)
    slope, noise = motion.matrices(mean[:, None], scene.dt, scene.previous)
    mean, cov = motion.advance(mean[:, None], scene.dt, scene.previous)[:, 0], slope[0] @ cov @ slope[0].T + noise
    expected, gradients, variances = scene.sensor.linearise(mean[place, None], scene.positions, scene.traits)
    gradient = np.zeros((len(readings), mean.size))
    gradient[:, place] = gradients[:, :, 0]
    gain = cov @ gradient.T @ np.linalg.inv(gradient @ cov @ gradient.T + np.diag(variances[:, 0]))
    proposal = multivariate_normal(mean + gain @ (readings - expected[:, 0]), cov - gain @ gradient @ cov)
    fitness = scene.sensor.log_likelihood(cloud[place], readings, scene.positions, scene.traits)
    log_weights = fitness + multivariate_normal(mean, cov).logpdf(cloud.T) - proposal.logpdf(cloud.T)
    weights = np.exp(log_weights - log_weights.max())
    return weights / weights.sum()


def test_the_weights_of_the_cloud_proposal_are_those_of_its_predictive_density_by_hand() -> None:
    tracker = InformationPf(particles=400, proposal="cloud", threshold=0.0)
    cluster = Cluster(17, BoundedVelocity(start=(-45.0, -5.0, -50.0, -8.0)), AcousticEnergy())
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    for step in range(1, 4):
        scene = cluster.scene(step)
        after, _ = cluster.drive(tracker.step(belief, scene))
        found = np.exp(after.pool.log_weights - after.pool.log_weights.max())
        expected = cloud_weights_by_hand(belief, after.pool.cloud, scene, cluster.readings()[0])
        assert found / found.sum() == pytest.approx(expected, rel=1e-6, abs=1e-12)
        belief = after


@pytest.mark.thorough
def test_the_cloud_proposal_follows_the_papers_target_with_nearly_all_of_its_particles() -> None:
    """In the third case the extended Kalman filter diverges at its first step, and so must its update as a proposal."""
    tracker, errors, effective = InformationPf(proposal="cloud"), [], []
    for seed in range(5):
        cluster = Cluster(17, BoundedVelocity(start=(-45.0, -5.0, -50.0, -8.0)), AcousticEnergy(), seed=seed)
        belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
        estimates = []
        for step in range(1, 61):
            belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
            estimates.append(tracker.estimate(belief))
        apart = np.array([estimate.mean for estimate in estimates]) - cluster.truth[1:61]
        errors.append(np.sqrt((apart[:, [0, 2]] ** 2).sum(axis=1).mean()))
        effective.append(np.median([estimate.effective for estimate in estimates]))
    assert np.median(errors) < 0.5, "m; 4.7 m where particles were paired with unrelated ancestors"
    assert np.median(effective) > 350.0, "of 400; 3 where they were paired"


@pytest.mark.parametrize("tracker", EVERY, ids=lambda tracker: getattr(tracker, "proposal", "central"))
def test_a_step_sends_one_reading_per_active_member_but_the_head(tracker) -> None:
    cluster = Cluster(6)
    belief, heard = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    assert heard.packets == []
    belief, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
    assert sent(heard, cluster.head) == {"^reading": 5}
    belief, heard = cluster.drive(tracker.step(belief, cluster.scene(2, cluster.ids[1:4])))
    assert sent(heard, cluster.head) == {"^reading": 3}
    belief, heard = cluster.drive(tracker.step(belief, cluster.scene(3, ())))
    assert heard.packets == []


@pytest.mark.parametrize(
    ("tracker", "packets"),
    [
        (CentralPf(particles=402), 402 + 101 + 4),
        (InformationPf(particles=402), 4 * 402 + 101 + 4),
        (InformationPf(particles=402, proposal="local"), 402 + 101 + 4),
        (InformationPf(particles=402, proposal="cloud"), 402 + 101 + 4),
        (InformationPf(particles=402, handover="gaussian"), 4),
        (CentralPf(particles=402, handover="gaussian"), 4),
    ],
)
def test_a_handover_sends_particles_weights_moments_and_each_particles_covariance(tracker, packets) -> None:
    cluster = Cluster(3)
    scene = cluster.scene(0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, scene))
    after, heard = cluster.drive(tracker.hand_over(belief, scene, 7))
    assert [packet[1:] for packet in heard.packets] == [(7, "handover", packets)]
    assert after.head == 7
    assert np.array_equal(tracker.estimate(after).mean, tracker.estimate(belief).mean)


@pytest.mark.parametrize(
    ("tracker", "cycles"),
    [
        (CentralPf(particles=40), 40 * (40 + 30 * 6)),
        (InformationPf(particles=40), 40 * (300 + 110 * 6)),
        (InformationPf(particles=40, proposal="cloud"), 400 + 70 * 6 + 40 * (100 + 40 * 6)),
    ],
)
def test_a_step_costs_the_operations_that_are_counted_for_it(tracker, cycles) -> None:
    cluster = Cluster(6)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    _, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
    assert heard.cycles == {cluster.head: cycles}


@pytest.mark.parametrize("tracker", EVERY, ids=lambda tracker: getattr(tracker, "proposal", "central"))
def test_a_silent_handover_loses_the_track(tracker) -> None:
    cluster = Cluster(3)
    scene = cluster.scene(0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, scene))
    assert cluster.drive(tracker.hand_over(belief, scene, 7), silent)[0] is None


def test_what_arrives_of_a_handover_is_what_its_packets_carry() -> None:
    cluster, tracker = Cluster(3), InformationPf(particles=40)
    scene = cluster.scene(0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, scene))
    covariances = np.arange(40.0)[:, None, None] * np.eye(4)
    log_weights = np.log(np.arange(1.0, 41.0))
    belief = replace(belief, covariances=covariances, pool=replace(belief.pool, log_weights=log_weights))
    lost = [0, 7, 40 + 2, 40 + 10 + 4 + 3 * 9 + 1]  # particles 0 and 7, weights 8-11, a third of covariance 9

    after, _ = cluster.drive(tracker.hand_over(belief, scene, 7), losing(lost))
    kept = [j for j in range(40) if j not in (0, 7)]
    assert np.array_equal(after.pool.cloud, belief.pool.cloud[:, kept])
    weights = np.arange(1.0, 41.0)
    weights[8:12] = np.nan
    weights = weights[kept]
    weights[np.isnan(weights)] = np.nanmean(weights)
    assert np.exp(after.pool.log_weights) == pytest.approx(weights)
    expected = covariances.copy()
    expected[9] = covariances[[j for j in range(40) if j != 9]].mean(axis=0)
    assert after.covariances == pytest.approx(expected[kept])
    assert np.array_equal(after.mean, belief.mean)


def test_a_new_head_makes_do_with_the_particles_if_the_moments_are_lost_and_restores_their_number() -> None:
    cluster, tracker = Cluster(3), CentralPf(particles=40)
    scene = cluster.scene(0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, scene))

    after, _ = cluster.drive(tracker.hand_over(belief, scene, 7), losing(slice(25, None)))
    assert after.mean == pytest.approx(belief.pool.cloud[:, :25].mean(axis=1))
    assert after.pool.cloud.shape == (4, 25)
    again, _ = cluster.drive(tracker.step(after, cluster.scene(1)))
    assert again.pool.cloud.shape == (4, 40)


@pytest.mark.parametrize("tracker", EVERY, ids=lambda tracker: getattr(tracker, "proposal", "central"))
def test_without_a_reading_the_belief_is_the_models_prediction(tracker) -> None:
    cluster = Cluster(4)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    before = tracker.estimate(belief)
    after = tracker.estimate(cluster.drive(tracker.step(belief, cluster.scene(2, (), steps=2)))[0])
    motion = LinearMotion()
    assert after.mean == pytest.approx(motion.advance(motion.advance(before.mean[:, None], 1.0), 1.0)[:, 0])
    assert np.all(np.diag(after.cov) > np.diag(before.cov))


def test_the_ipf_refuses_a_process_noise_without_a_density() -> None:
    def parts(noise: str, targets: int = 1) -> SimpleNamespace:
        return SimpleNamespace(filter_motions=(BoundedVelocity(noise=noise),) * targets, dt=0.04)

    tracker = InformationPf()
    assert list(tracker.check(parts("both"))) == [] and list(tracker.check(parts("q_only"))) == []
    (issue,) = tracker.check(parts("g_only"))
    assert issue.path == ("motion",) and "singular" in issue.message
    assert [issue.path for issue in tracker.check(parts("g_only", 2))] == [
        ("targets", 0),
        ("targets", 1),
    ]


def test_a_reading_that_is_no_number_is_left_out() -> None:
    cluster, tracker = Cluster(4), CentralPf(particles=40)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    scene = cluster.scene(1)
    cluster.members[102].reading = float("nan")
    broken, heard = cluster.drive(tracker.step(belief, scene))
    assert sent(heard, cluster.head) == {"^reading": 2}

    def without_102(source, to, parcel):
        return all_arrived(parcel.packets) if source != 102 else np.zeros(parcel.packets, dtype=bool)

    cluster.sensing = cluster.ids
    same, _ = cluster.drive(tracker.step(belief, cluster.scene(1)), without_102)
    assert np.array_equal(broken.mean, same.mean)


@pytest.mark.parametrize("tracker", EVERY, ids=lambda tracker: getattr(tracker, "proposal", "central"))
def test_a_snapshot_shows_all_particles_with_weights_that_sum_to_one(tracker) -> None:
    cluster = Cluster(4)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)))
    ((node, cloud, weights),) = tracker.snapshot(belief, list(cluster.members.values()))
    assert node == cluster.head and cloud.shape == (4, 40) and weights.sum() == pytest.approx(1.0)


def test_members_that_only_send_readings_are_said_to_process_nothing() -> None:
    assert CentralPf().member_cycles == InformationPf().member_cycles == 0.0
