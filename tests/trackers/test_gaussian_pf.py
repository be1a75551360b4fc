"""The Gaussian particle filters: against the Kalman filter, their moves by hand, and where little is left to go on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.helpers.linear_cluster import Cluster, LinearMotion, LinearSensor, against_kalman, kalman, sent
from tests.helpers.thorough import thorough
from tests.kernels.test_gravity import attract_twin
from wsnsim.base.rng import uniforms
from wsnsim.models.linear import ConstantAcceleration, ConstantVelocity
from wsnsim.models.ranging import Range, Rssi
from wsnsim.testing import check_tracker
from wsnsim.trackers.gaussian_pf import (
    GaussianPf,
    GravitationalGaussianPf,
    SwarmGaussianPf,
    elite_size,
)
from wsnsim.trackers.shared.heads import GaussianBelief, keys_of
from wsnsim.trackers.shared.stacks import MOVE

VARIANTS = [
    (GaussianPf, {}),
    (SwarmGaussianPf, {}),
    (SwarmGaussianPf, {"move": "all"}),
    (GravitationalGaussianPf, {}),
    (GravitationalGaussianPf, {"acceptance": "greedy"}),
    (GravitationalGaussianPf, {"move": "all"}),
    (GravitationalGaussianPf, {"move": "all", "acceptance": "greedy", "G0": 1.0}),
]
NAMES = ["-".join([kind.__name__, *map(str, given.values())]) for kind, given in VARIANTS]
EVERY = pytest.mark.parametrize(("kind", "given"), VARIANTS, ids=NAMES)


def hill(cloud: np.ndarray) -> np.ndarray:
    """A log-likelihood whose top is at the origin of the position."""
    return -0.5 * (cloud[0] ** 2 + cloud[2] ** 2)


def swarm(count: int, seed: int = 3) -> np.ndarray:
    return np.random.default_rng(seed).normal(2.0, 1.0, (4, count))


def stepped(tracker: Any, cluster: Cluster, belief: GaussianBelief | None = None, **changes: Any) -> Any:
    """The belief after one step from the prior, or from `belief`, in a scene with `changes`."""
    if belief is None:
        belief = GaussianBelief(cluster.prior.mean, cluster.prior.cov, cluster.head)
    return cluster.drive(tracker.step(belief, replace(cluster.scene(1), **changes)))[0]


def test_over_many_draws_the_gpf_is_the_kalman_filter_on_average() -> None:
    """One step, the same readings, 120 keys: within four standard errors and the 2 / N_eff of normalised weights."""
    cluster, tracker = Cluster(4), GaussianPf(particles=1000)
    beliefs = [stepped(tracker, cluster, key=key) for key in range(120)]
    mean, cov = kalman(cluster.prior.mean, cluster.prior.cov, cluster.motion.noise, *cluster.readings())
    sd = np.sqrt(np.diag(cov))
    errors = np.array([(belief.mean - mean) / sd for belief in beliefs])
    ratios = np.array([np.diag(belief.cov) / sd**2 for belief in beliefs])
    slack = 2.0 / np.mean([belief.effective for belief in beliefs])
    for sample in (errors, ratios - 1.0):
        spread = sample.std(axis=0, ddof=1)
        assert spread.max() < 0.25, "each single one is near"
        assert np.all(np.abs(sample.mean(axis=0)) < 4.0 * spread / np.sqrt(len(sample)) + slack)


@pytest.mark.thorough
def test_from_step_to_step_the_gpf_stays_with_the_kalman_filter() -> None:
    errors, ratios = against_kalman(GaussianPf(particles=2000), seeds=8)
    assert np.sqrt(np.mean(errors**2)) < 0.25, "root mean square distance of the means, in the Kalman filter's sd"
    assert np.abs(errors.mean(axis=0)).max() < 0.1, "a bias"
    assert np.median(ratios) == pytest.approx(1.0, abs=0.05)


def test_steps_that_were_missed_are_all_predicted() -> None:
    cluster, tracker = Cluster(4), GaussianPf(particles=20_000)
    belief = GaussianBelief(cluster.prior.mean, cluster.prior.cov, cluster.head)
    after, _ = cluster.drive(tracker.step(belief, cluster.scene(2, steps=2)))
    motion = cluster.motion
    once = motion.advance(cluster.prior.mean[:, None], 1.0)[:, 0]
    transition = motion.matrices(np.zeros((4, 1)), 1.0)[0][0]
    mean, cov = kalman(once, transition @ cluster.prior.cov @ transition.T + motion.noise, motion.noise,
                       *cluster.readings())  # fmt: skip
    assert (after.mean - mean) / np.sqrt(np.diag(cov)) == pytest.approx(np.zeros(4), abs=0.1)
    assert np.diag(after.cov) == pytest.approx(np.diag(cov), rel=0.1)


@pytest.mark.parametrize(
    "still",
    [SwarmGaussianPf(particles=50, iterations=0), GravitationalGaussianPf(particles=50, iterations=0),
     GravitationalGaussianPf(particles=50, G0=0.0), SwarmGaussianPf(particles=50, c1=0.0, c2=0.0)],
)  # fmt: skip
def test_without_a_move_all_three_are_the_gpf(still) -> None:
    found, expected = stepped(still, Cluster(5)), stepped(GaussianPf(particles=50), Cluster(5))
    assert np.array_equal(found.mean, expected.mean) and np.array_equal(found.cov, expected.cov)


@pytest.mark.parametrize(("move", "rows"), [("position", [0, 2]), ("all", [0, 1, 2, 3])])
def test_the_swarm_flies_as_written_out_and_is_weighed_where_it_ends(move, rows) -> None:
    tracker = SwarmGaussianPf(particles=3, iterations=4, inertia=0.7, c1=1.5, c2=1.2, move=move)
    scene, start = Cluster(3).scene(1), swarm(3)
    keys = keys_of(scene, 3, MOVE)
    x, v = start.copy(), np.zeros((4, 3))
    best = [start[:, j] for j in range(3)]
    for iteration in range(4):
        swarms_best = max(best, key=lambda state: hill(state[:, None])[0])
        for j in range(3):
            for place, d in enumerate(rows):
                draw = 2 * len(rows) * iteration + 2 * place
                r1, r2 = uniforms(keys[j : j + 1], draw)[0], uniforms(keys[j : j + 1], draw + 1)[0]
                v[d, j] = 0.7 * v[d, j] + 1.5 * r1 * (best[j][d] - x[d, j]) + 1.2 * r2 * (swarms_best[d] - x[d, j])
        x = x + v
        best = [max(best[j], x[:, j].copy(), key=lambda state: hill(state[:, None])[0]) for j in range(3)]
    cloud, fitness = tracker.moved(start, hill, scene)
    assert cloud == pytest.approx(x, rel=1e-12) and fitness == pytest.approx(hill(x), rel=1e-12)
    assert np.any(fitness < [hill(state[:, None])[0] for state in best]), "where they are, not where they were best"


@pytest.mark.parametrize(("move", "rows"), [("position", [0, 2]), ("all", [0, 1, 2, 3])])
@pytest.mark.parametrize("acceptance", ["always", "greedy"])
def test_the_attraction_falls_and_the_elite_shrinks_from_move_to_move(move, rows, acceptance) -> None:
    tracker = GravitationalGaussianPf(particles=5, iterations=3, G0=9.0, alpha=2.0, move=move, acceptance=acceptance)
    scene, start = Cluster(3).scene(1), swarm(5)
    keys, x, v = keys_of(scene, 5, MOVE), start.copy(), np.zeros((len(rows), 5))
    places = np.array([rows.index(0), rows.index(2)])
    for t, elite in ((1, 5), (2, 3), (3, 1)):
        after = x.copy()
        after[rows] = attract_twin(
            x[rows], v, hill(x), places, keys, (t - 1) * 6, 9.0 * np.exp(-2.0 * t / 3.0), elite, 1e-6
        )
        x = after if acceptance == "always" else np.where(hill(after) > hill(x), after, x)
    cloud, fitness = tracker.moved(start, hill, scene)
    assert cloud == pytest.approx(x, rel=1e-9) and fitness == pytest.approx(hill(x), rel=1e-9)
    assert not np.array_equal(x[rows], start[rows])


def test_a_particle_perceives_others_up_to_the_threshold_and_without_one_all_of_them() -> None:
    scene = Cluster(3).scene(1)
    start = swarm(9)
    start[0] += np.repeat([0.0, 100.0, 200.0], 3)

    def moved(threshold: float | None) -> np.ndarray:
        return GravitationalGaussianPf(particles=9, iterations=1, threshold=threshold).moved(start, hill, scene)[0]

    assert np.array_equal(moved(None), moved(1e9)) and not np.array_equal(moved(None), moved(50.0))
    assert np.array_equal(moved(1e-9), start), "none is as near as that"
    best = hill(start)
    assert np.array_equal(moved(50.0)[:, best < best.max() - 800.0], start[:, best < best.max() - 800.0])


@pytest.mark.parametrize("tracker", [SwarmGaussianPf(particles=9), GravitationalGaussianPf(particles=9)])
def test_what_moves_is_the_position_alone(tracker) -> None:
    start = swarm(9)
    cloud, _ = tracker.moved(start, hill, Cluster(3).scene(1))
    assert np.array_equal(cloud[[1, 3]], start[[1, 3]]) and np.all(cloud[[0, 2]] != start[[0, 2]])
    assert np.array_equal(start, swarm(9)), "what was given is left as it was"


def test_the_elite_goes_from_all_to_one() -> None:
    assert [elite_size(100, t, 10) for t in range(1, 11)] == [100, 89, 78, 67, 56, 45, 34, 23, 12, 1]
    assert [elite_size(4, t, 3) for t in (1, 2, 3)] == [4, 3, 1], "2.5 is rounded up"
    assert [elite_size(1, t, 5) for t in range(1, 6)] == [1] * 5
    assert elite_size(7, 1, 1) == 7, "T_c - 1 = 0 divides nothing"


@pytest.mark.parametrize("move", ["position", "all"])
@pytest.mark.parametrize("gravity", [0.1, 1.0, 100.0, 1e9])
def test_a_greedy_move_never_lowers_a_fitness(move, gravity) -> None:
    tracker = GravitationalGaussianPf(particles=30, G0=gravity, acceptance="greedy", move=move)
    for seed in range(5):
        start = swarm(30, seed)
        cloud, fitness = tracker.moved(start, hill, Cluster(3).scene(seed))
        assert np.all(fitness >= hill(start)) and np.array_equal(fitness, hill(cloud))


def test_the_papers_constant_throws_a_cloud_of_a_metre_apart_and_a_greedy_one_keeps_it() -> None:
    """The literal form's failure, kept as the default: G0 = 100 moves a particle by up to 13.5 m at first."""
    start = swarm(100)

    def width(**given: Any) -> float:
        cloud, _ = GravitationalGaussianPf(**given).moved(start, hill, Cluster(3).scene(1))
        return float(cloud[[0, 2]].std())

    assert width() > 3.0 * start[[0, 2]].std()
    assert width(acceptance="greedy") < 1.5 * start[[0, 2]].std()


@pytest.mark.parametrize("tracker", [SwarmGaussianPf(particles=40), GravitationalGaussianPf(particles=40, G0=5.0)])
def test_a_move_takes_the_particles_to_where_the_likelihood_is(tracker) -> None:
    start = swarm(40)
    _, fitness = tracker.moved(start, hill, Cluster(3).scene(1))
    assert np.median(fitness) > np.median(hill(start)) + 1.0


@EVERY
def test_likelihoods_are_counted_as_they_are_asked_for(kind, given) -> None:
    tracker, asked = kind(particles=10, **given), []

    def score(cloud: np.ndarray) -> np.ndarray:
        asked.append(cloud.shape[1])
        return hill(cloud)

    tracker.moved(swarm(10), score, Cluster(3).scene(1))
    assert asked == [10] * tracker.evaluations


@pytest.mark.parametrize(
    ("tracker", "cycles"),
    [
        (GaussianPf(particles=20), 20 * (80 + 30 * 6)),
        (SwarmGaussianPf(particles=20, iterations=3), 20 * (80 + 30 * 6 * 4 + 50 * 3)),
        (GravitationalGaussianPf(particles=20, iterations=3), 20 * (80 + 30 * 6 * 4 + 20 * (20 + 11 + 1))),
    ],
)
def test_a_step_sends_readings_and_costs_what_is_counted_for_it(tracker, cycles) -> None:
    cluster = Cluster(6)
    belief, heard = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    assert heard.packets == [] and heard.cycles == {}
    belief, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
    assert sent(heard, cluster.head) == {"^reading": 5} and heard.cycles == {cluster.head: cycles}
    after, heard = cluster.drive(tracker.hand_over(belief, cluster.scene(1), 7))
    assert [packet[1:] for packet in heard.packets] == [(7, "handover", 4)]
    assert after.head == 7 and np.array_equal(after.cov, belief.cov)


@EVERY
def test_without_a_reading_the_belief_is_the_models_prediction(kind, given) -> None:
    cluster, tracker = Cluster(4), kind(particles=10, **given)
    belief = stepped(tracker, cluster)
    after, heard = cluster.drive(tracker.step(belief, cluster.scene(3, (), steps=2)))
    motion = LinearMotion()
    assert after.mean == pytest.approx(motion.advance(motion.advance(belief.mean[:, None], 1.0), 1.0)[:, 0])
    assert np.all(np.diag(after.cov) > np.diag(belief.cov)) and heard.packets == []
    assert list(tracker.snapshot(after, [])) == [], "nothing is drawn"


@EVERY
def test_a_snapshot_shows_the_particles_whose_moments_the_belief_is(kind, given) -> None:
    cluster, tracker = Cluster(4), kind(particles=30, **given)
    belief = stepped(tracker, cluster)
    ((node, cloud, weights),) = tracker.snapshot(belief, [])
    assert node == cluster.head and cloud.shape == (4, 30) and weights.sum() == pytest.approx(1.0)
    assert belief.mean == pytest.approx(cloud @ weights)
    assert belief.cov == pytest.approx(np.cov(cloud, aweights=weights, ddof=0))
    assert tracker.estimate(belief).effective == pytest.approx(1.0 / np.sum(weights**2))


class Offset(LinearSensor):
    """The same likelihoods but for a common factor, which may be too small for any float."""

    def __init__(self, shift: float) -> None:
        self.shift = shift

    def log_likelihood(self, points, readings, positions, traits, owners=None):
        return super().log_likelihood(points, readings, positions, traits, owners) + self.shift


@EVERY
def test_likelihoods_too_small_for_any_number_weigh_as_their_ratios_do(kind, given) -> None:
    tracker = kind(particles=30, **given)
    plain, tiny = (stepped(tracker, Cluster(5, sensor=Offset(shift))) for shift in (0.0, -(2.0**20)))
    assert tiny.mean == pytest.approx(plain.mean, rel=1e-5) and tiny.cov == pytest.approx(plain.cov, rel=1e-4, abs=1e-6)


@EVERY
def test_where_nothing_is_likely_all_particles_weigh_the_same(kind, given) -> None:
    belief = stepped(kind(particles=30, **given), Cluster(5, sensor=Offset(-np.inf)))
    assert belief.mean == pytest.approx(belief.pool.cloud.mean(axis=1)) and belief.effective == 0.0
    assert belief.cov == pytest.approx(np.cov(belief.pool.cloud, ddof=0))


@EVERY
@pytest.mark.parametrize("cov", [np.zeros((4, 4)), np.ones((4, 4)), np.diag([1.0, 0.0, 1e-30, 4.0])])
def test_a_covariance_without_full_rank_is_drawn_from_all_the_same(kind, given, cov) -> None:
    cluster, tracker = Cluster(4), kind(particles=50, **given)
    belief = stepped(tracker, cluster, GaussianBelief(cluster.prior.mean, cov, cluster.head))
    assert np.all(np.isfinite(belief.mean))
    assert np.linalg.eigvalsh(belief.cov)[0] >= -1e-9 * np.trace(belief.cov)


@pytest.mark.thorough
@EVERY
@pytest.mark.parametrize("particles", [1, 25, *thorough((2, 3))])
def test_the_rules_of_the_seam_are_kept(kind, given, particles) -> None:
    check_tracker(kind(particles=particles, **given))


@pytest.mark.thorough
@EVERY
def test_a_target_on_a_line_and_one_in_a_room_are_tracked_by_the_same_rules(kind, given) -> None:
    tracker = kind(particles=10, **given)
    check_tracker(tracker, ConstantAcceleration(), Range())
    check_tracker(tracker, ConstantVelocity(noise_input="diagonal"), Rssi())


@pytest.mark.parametrize(
    "tracker",
    [SwarmGaussianPf(particles=5, c1=1000.0, c2=1000.0, inertia=1.0, iterations=1000, move="all"),
     GravitationalGaussianPf(particles=5, G0=1e9, alpha=0.0, softening=1e-12, iterations=1000, move="all")],
)  # fmt: skip
def test_a_move_with_the_largest_numbers_allowed_ends_somewhere(tracker) -> None:
    belief = stepped(tracker, Cluster(3))
    assert np.all(np.isfinite(belief.mean)) and np.all(np.isfinite(belief.cov))
