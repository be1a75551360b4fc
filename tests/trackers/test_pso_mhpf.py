"""PSO-MHPF: the step by hand, the packets and operations of the paper's section 5, its variants and how they fail."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from tests.helpers.linear_cluster import VARIANCE, Cluster, sent
from tests.helpers.losses import losing
from wsnsim.base.rng import derive, uniforms
from wsnsim.models.motion import BoundedVelocity
from wsnsim.models.sensing import AcousticEnergy
from wsnsim.offline.loopback import silent
from wsnsim.trackers.pso_mhpf import PsoMhpf
from wsnsim.trackers.shared.stacks import CLOUD, LOG_WEIGHTS, MOVE, PREDICT, present


def acoustic(seed: int) -> Cluster:
    return Cluster(17, BoundedVelocity(start=(-45.0, -5.0, -50.0, -8.0)), AcousticEnergy(), seed=seed)


def started(tracker: PsoMhpf, cluster: Cluster):
    return cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))[0]


def keys_of(member, tag: int, count: int) -> np.ndarray:
    return np.array([derive(member.key, tag, j) for j in range(count)], np.uint64)


def filtered_by_hand(cloud, log_weights, member, scene, tracker):
    """One member's step with plain loops: its particles and weights afterwards, and whether the swarm moved."""
    count = cloud.shape[1]

    def chi(x: np.ndarray) -> float:
        return norm(member.traits @ x[[0, 2]], np.sqrt(VARIANCE)).logpdf(member.reading)

    x = scene.motion.propagate(cloud, scene.dt, keys_of(member, PREDICT, count))
    fitness = np.array([chi(x[:, j]) for j in range(count)])
    weights = np.exp(log_weights + fitness)
    weights *= count / weights.sum()
    if weights.sum() ** 2 / (weights**2).sum() >= tracker.threshold * count:
        return x, weights, False
    share = np.exp(log_weights) / np.exp(log_weights).sum() if tracker.prior_fit == "weighted" else None
    density = multivariate_normal(np.average(x, axis=1, weights=share), np.cov(x, aweights=share) + 1e-3 * np.eye(4))
    density = density.logpdf
    first = fitness.copy() if tracker.ranking == "likelihood" else np.log(weights / weights.sum())
    velocity, best, best_fitness, x = np.zeros_like(x), x.copy(), first, x.copy()
    keys = keys_of(member, MOVE, count)
    for t in range(tracker.iterations):
        leader = best[:, np.argmax(best_fitness)].copy()
        before = x.copy()
        for j in range(count):
            draws = [uniforms(keys[j : j + 1], 9 * t + k)[0] for k in range(9)]
            pull = 2.0 * np.array(draws[0:8:2]) * (best[:, j] - before[:, j])
            velocity[:, j] += pull + 2.0 * np.array(draws[1:8:2]) * (leader - before[:, j])
            proposal = before[:, j] + velocity[:, j]
            ratio = np.exp(chi(proposal) - chi(before[:, j]) + density(proposal) - density(before[:, j]))
            if draws[8] < min(ratio, 1.0):
                x[:, j] = proposal
        for j in range(count):
            if chi(x[:, j]) > best_fitness[j]:
                best[:, j], best_fitness[j] = x[:, j], chi(x[:, j])
    return x, np.ones(count), True


@pytest.mark.thorough
@pytest.mark.parametrize("prior_fit", ["unweighted", "weighted"])
@pytest.mark.parametrize("ranking", ["likelihood", "weight"])
def test_a_step_is_the_papers_by_hand_with_the_same_noise(prior_fit: str, ranking: str) -> None:
    tracker = PsoMhpf(particles=24, iterations=3, prior_fit=prior_fit, ranking=ranking)
    cluster, carried = Cluster(2, seed=4), []
    belief, outcomes = started(tracker, cluster), set()
    for step in range(1, 5):
        held = {node: present(member, 4) for node, member in cluster.members.items()}
        scene = cluster.scene(step)
        expected = {
            node: filtered_by_hand(*held[node], member, scene, tracker) for node, member in cluster.members.items()
        }
        belief, _ = cluster.drive(tracker.step(belief, scene))
        mean = np.zeros(4)
        for node, (cloud, weights, moved) in expected.items():
            memory = cluster.members[node].memory
            assert memory[CLOUD] == pytest.approx(cloud, rel=1e-9, abs=1e-9)
            assert np.exp(memory[LOG_WEIGHTS]) == pytest.approx(weights, rel=1e-9)
            mean += cloud.shape[1] / 24 * (cloud @ weights / weights.sum())
            outcomes.add(moved)
            carried += [np.ptp(held[node][1])] if moved else []
        assert tracker.estimate(belief).mean == pytest.approx(mean, rel=1e-9)
    assert outcomes == {True, False}, "the case must show shares that move and shares that do not"
    assert max(carried) > 1.0, "a share that moves must carry unequal weights from a step without a move"


@pytest.mark.thorough(fast=["tracker4"])
@pytest.mark.parametrize(
    "tracker",
    [
        PsoMhpf(),
        PsoMhpf(measurements="all"),
        PsoMhpf(acceptance="transition", resample_first=True),
        PsoMhpf(acceptance="likelihood", random_factors=False, step_length="dt", iterations=5),
        PsoMhpf(particles=9, resample_always=True, estimate_when="before"),
        PsoMhpf(prior_fit="unweighted", ranking="likelihood"),
    ],
)
def test_the_work_of_a_whole_cluster_at_once_is_the_work_of_each_member_bit_for_bit(tracker: PsoMhpf) -> None:
    def one_by_one(ask) -> None:
        if hasattr(ask, "work_all"):
            ask.work_all = None

    together, apart = acoustic(2), acoustic(2)
    first, second = started(tracker, together), started(tracker, apart)
    for step in range(1, 6):
        first, _ = together.drive(tracker.step(first, together.scene(step)))
        second, _ = apart.drive(tracker.step(second, apart.scene(step)), watch=one_by_one)
        for node, member in together.members.items():
            assert np.array_equal(member.memory[CLOUD], apart.members[node].memory[CLOUD])
            assert np.array_equal(member.memory[LOG_WEIGHTS], apart.members[node].memory[LOG_WEIGHTS])
        assert np.array_equal(first.cov, second.cov)


def test_the_first_deal_out_sends_every_particle_but_the_heads_own() -> None:
    cluster = Cluster(17)
    belief, heard = cluster.drive(PsoMhpf(particles=400).start(cluster.prior, cluster.scene(0)))
    assert sent(heard, cluster.head) == {"vparticles": 400 - 400 // 17}
    assert list(belief.deal.held.values()) == [23] * 8 + [24] * 9


@pytest.mark.parametrize(
    ("tracker", "packets"),
    [
        (PsoMhpf(), {"^estimate": 16}),
        (PsoMhpf(fusion="inverse_variance"), {"^estimate": 32}),
        (PsoMhpf(feedback=True), {"^estimate": 16, "vfeedback": 1}),
        (PsoMhpf(measurements="all"), {"^estimate": 16, "^reading": 16, "vreadings": 5}),
    ],
)
def test_a_step_sends_what_the_papers_table_says(tracker: PsoMhpf, packets: dict[str, int]) -> None:
    cluster = Cluster(17)
    belief = started(tracker, cluster)
    _, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
    assert sent(heard, cluster.head) == packets


def test_when_members_leave_only_particles_that_move_cross_the_air_with_their_weights() -> None:
    tracker, cluster = PsoMhpf(particles=100), Cluster(5)
    belief = started(tracker, cluster)
    belief, heard = cluster.drive(tracker.step(belief, cluster.scene(1, cluster.ids[:4])))
    # 20 each become 25 each: the one that left gives 20, four receive 5 each, of which one is the head
    assert sent(heard, cluster.head) == {"^particles": 20 + 5, "vparticles": 3 * (5 + 2), "^estimate": 3}
    assert belief.deal.held == dict.fromkeys(cluster.ids[:4], 25)
    assert [present(member, 4)[1].size for member in cluster.members.values()] == [25, 25, 25, 25, 0]


def test_when_the_head_ceases_to_sense_it_gives_its_particles_and_every_estimate_comes_by_air() -> None:
    tracker, cluster = PsoMhpf(particles=100), Cluster(5)
    belief = started(tracker, cluster)
    belief, heard = cluster.drive(tracker.step(belief, cluster.scene(1, cluster.ids[1:])))
    assert sent(heard, cluster.head) == {"vparticles": 4 * (5 + 2), "^estimate": 4}
    assert np.isnan(tracker.estimate(belief).effective)


def test_moved_particles_keep_their_weights() -> None:
    tracker, cluster = PsoMhpf(particles=100, threshold=0.0), Cluster(5)
    belief = started(tracker, cluster)
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)))
    held = [present(member, 4) for member in cluster.members.values()]
    known = {tuple(column): weight for cloud, weights in held for column, weight in zip(cloud.T, weights, strict=True)}
    scene = cluster.scene(2, cluster.ids[:3])
    flow, asks = tracker.step(belief, scene), []
    cluster.drive(flow, watch=lambda ask: asks.append([present(member, 4) for member in cluster.members.values()]))
    dealt = asks[2]  # before the third ask: particles have gone up and down, and nobody has computed
    assert sum(cloud.shape[1] for cloud, _ in dealt) == 100
    for cloud, weights in dealt:
        for column, weight in zip(cloud.T, weights, strict=True):
            assert known[tuple(column)] == weight


def test_a_handover_collects_sends_and_deals_out_again() -> None:
    tracker, cluster = PsoMhpf(particles=402), Cluster(5)
    belief = started(tracker, cluster)
    scene = cluster.scene(1)
    belief, _ = cluster.drive(tracker.step(belief, scene))
    own = belief.deal.held[cluster.head]
    after, heard = cluster.drive(tracker.hand_over(belief, scene, 7))
    assert sent(heard, cluster.head) == {"^particles": 402 - own, "vhandover": 402 + 101 + 4}
    assert np.array_equal(after.mean, belief.mean) and np.array_equal(after.cov, belief.cov)
    cluster.renew()
    again, heard = cluster.drive(tracker.step(after, cluster.scene(2)))
    assert sent(heard, cluster.head) == {"vparticles": 402 - 402 // 5, "^estimate": 4}
    assert sum(again.deal.held.values()) == 402


def test_a_gaussian_handover_sends_the_moments_alone_and_members_draw_their_own() -> None:
    tracker, cluster = PsoMhpf(particles=400, handover="gaussian"), Cluster(5)
    scene = cluster.scene(0)
    belief, heard = cluster.drive(tracker.start(cluster.prior, scene))
    assert sent(heard, cluster.head) == {"vmoments": 4}
    after, heard = cluster.drive(tracker.hand_over(belief, scene, 7))
    assert sent(heard, cluster.head) == {"vhandover": 4}
    cluster.renew()
    again, heard = cluster.drive(tracker.step(after, cluster.scene(1)))
    assert sent(heard, cluster.head) == {"vmoments": 4, "^estimate": 4}
    assert list(again.deal.held.values()) == [80] * 5
    clouds = np.concatenate([member.memory[CLOUD] for member in cluster.members.values()], axis=1)
    assert len(np.unique(clouds[0])) == 400, "members draw with keys of their own"


@pytest.mark.parametrize(
    ("tracker", "per_particle"),
    [
        (PsoMhpf(particles=60, resample_always=True), 40 + 30 + 30 + 2 * (50 + 30)),
        (PsoMhpf(particles=60, resample_always=True, acceptance="likelihood"), 40 + 30 + 2 * (50 + 30)),
        (PsoMhpf(particles=60, resample_always=True, measurements="all", iterations=3), 40 + 180 + 30 + 3 * (50 + 180)),
        (PsoMhpf(particles=60, threshold=0.0), 40 + 30),
    ],
)
def test_a_step_costs_the_operations_that_are_counted_for_it(tracker: PsoMhpf, per_particle: float) -> None:
    cluster = Cluster(6)
    belief = started(tracker, cluster)
    _, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
    assert heard.cycles == dict.fromkeys(cluster.ids, 10 * per_particle)


@pytest.mark.parametrize(
    ("tracker", "cycles"),
    [
        (PsoMhpf(particles=300), 100 * 260.0),  # 40 + 30 to predict and weigh, 30 to fit, 2 (50 + 30) to move
        (PsoMhpf(particles=300, measurements="all"), 100 * 440.0),  # 40 + 3 · 30, 30, 2 (50 + 3 · 30)
        (PsoMhpf(particles=300, acceptance="likelihood", iterations=1), 100 * 150.0),  # 40 + 30, 50 + 30
        (PsoMhpf(particles=400), 400 * 260 / 3),
    ],
)
def test_a_member_of_three_is_said_to_need_what_a_step_with_a_move_takes(tracker: PsoMhpf, cycles: float) -> None:
    assert tracker.member_cycles == pytest.approx(cycles, rel=1e-15)


@pytest.mark.parametrize("measurements", ["own", "all"])
def test_what_a_member_is_said_to_need_is_what_one_of_three_spends(measurements: str) -> None:
    cluster = Cluster(3)
    tracker = PsoMhpf(particles=300, resample_always=True, measurements=measurements)
    _, heard = cluster.drive(tracker.step(started(tracker, cluster), cluster.scene(1)))
    assert heard.cycles == dict.fromkeys(cluster.ids, tracker.member_cycles)


def test_without_an_active_member_the_particles_stay_and_are_only_predicted() -> None:
    tracker, cluster = PsoMhpf(particles=40), Cluster(4)
    belief = started(tracker, cluster)
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)))
    held = {node: present(member, 4) for node, member in cluster.members.items()}
    after, heard = cluster.drive(tracker.step(belief, cluster.scene(3, (), steps=2)))
    assert heard.packets == [] and heard.cycles == dict.fromkeys(cluster.ids, 10 * 2 * 40.0)
    advanced = cluster.motion.advance(cluster.motion.advance(belief.mean[:, None], 1.0), 1.0)[:, 0]
    assert after.mean == pytest.approx(advanced) and np.all(np.diag(after.cov) > np.diag(belief.cov))
    for node, member in cluster.members.items():
        cloud = held[node][0]
        for step in range(2):
            cloud = cluster.motion.propagate(cloud, 0.04, keys_of(member, PREDICT + step, 10))
        assert member.memory[CLOUD] == pytest.approx(cloud)
    back, heard = cluster.drive(tracker.step(after, cluster.scene(4)))
    assert heard.total("particles") == 0 and sum(back.deal.held.values()) == 40


def test_lost_packets_shrink_the_set_until_a_head_holds_the_whole_again() -> None:
    tracker, cluster = PsoMhpf(particles=100), Cluster(5)

    lose = losing(slice(5), "particles")
    scene = cluster.scene(0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, scene), lose)
    assert list(belief.deal.held.values()) == [20, 15, 15, 15, 15]
    assert [present(member, 4)[1].size for member in cluster.members.values()] == [20, 15, 15, 15, 15]
    belief, _ = cluster.drive(tracker.hand_over(belief, scene, 7))
    assert belief.deal.whole.cloud.shape == (4, 80)
    cluster.renew()
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)))
    assert sum(belief.deal.held.values()) == 100


def test_a_silent_network_leaves_the_head_its_own_share_and_loses_the_handover_of_it() -> None:
    tracker, cluster = PsoMhpf(particles=100), Cluster(5)
    scene = cluster.scene(0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, scene), silent)
    assert belief.deal.held == {cluster.head: 20}
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)), silent)
    assert tracker.estimate(belief).mean == pytest.approx(
        np.average(
            cluster.members[cluster.head].memory[CLOUD],
            weights=np.exp(cluster.members[cluster.head].memory[LOG_WEIGHTS]),
            axis=1,
        )
    )
    assert cluster.drive(tracker.hand_over(belief, cluster.scene(2), 7), silent)[0] is None


def test_when_every_particle_is_lost_new_ones_are_drawn_from_what_the_head_still_knows() -> None:
    tracker, cluster = PsoMhpf(particles=400), Cluster(5)
    others = cluster.ids[1:]
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0, others)), silent)
    assert belief.deal.total == 0
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1, others)))
    assert belief.deal.held == dict.fromkeys(others, 100)


def test_a_missing_local_estimate_leaves_the_others_shares_renormalised() -> None:
    tracker, cluster = PsoMhpf(particles=100), Cluster(5)
    belief = started(tracker, cluster)

    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)), losing(sources=cluster.ids[3:]))
    locals_ = [cluster.members[node].memory["local"].mean for node in cluster.ids[:3]]
    assert belief.mean == pytest.approx(np.mean(locals_, axis=0))


def test_inverse_variance_fusion_weighs_each_column_by_its_reported_variance() -> None:
    tracker, cluster = PsoMhpf(particles=100, fusion="inverse_variance"), Cluster(5)
    belief = started(tracker, cluster)

    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)), losing(slice(1, None), sources=cluster.ids[4:]))
    results = [member.memory["local"] for member in cluster.members.values()]
    variances = np.array([np.diag(result.cov) for result in results])
    variances[4] = variances[:4].mean(axis=0)
    expected = np.average([result.mean for result in results], axis=0, weights=1.0 / variances)
    assert belief.mean == pytest.approx(expected)


def test_feedback_brings_every_local_mean_to_the_fused_one() -> None:
    tracker, cluster = PsoMhpf(particles=100, feedback=True), Cluster(5)
    belief, _ = cluster.drive(tracker.step(started(tracker, cluster), cluster.scene(1)))
    for member in cluster.members.values():
        weights = np.exp(member.memory[LOG_WEIGHTS])
        assert np.average(member.memory[CLOUD], weights=weights, axis=1) == pytest.approx(belief.mean)


def position_errors(tracker: PsoMhpf, seed: int, steps: int = 120) -> np.ndarray:
    cluster, errors = acoustic(seed), []
    belief = started(tracker, cluster)
    for step in range(1, steps + 1):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
        errors.append(np.hypot(*(tracker.estimate(belief).mean - cluster.truth[step])[[0, 2]]))
    return np.array(errors[-50:])


@pytest.mark.thorough
def test_the_defaults_track_and_the_literal_move_and_the_bare_likelihood_visibly_fail() -> None:
    def mean_error(tracker: PsoMhpf) -> float:
        return float(np.mean([position_errors(tracker, seed) for seed in range(3)]))

    former = PsoMhpf(prior_fit="unweighted", ranking="likelihood")
    good = mean_error(former)
    assert mean_error(PsoMhpf()) < 5.0
    assert good < 5.0
    assert mean_error(replace(former, random_factors=False)) > 2.0 * good
    assert mean_error(replace(former, random_factors=False, measurements="all")) > 2.0 * good
    assert mean_error(PsoMhpf(acceptance="likelihood")) > 20.0, "lost"
    assert mean_error(PsoMhpf(acceptance="likelihood", random_factors=False)) > 20.0, "lost"


def test_the_transition_density_needs_a_process_noise_that_has_one() -> None:
    parts = SimpleNamespace(filter_motions=(BoundedVelocity(noise="g_only"),), dt=0.04)
    assert [issue.path for issue in PsoMhpf(acceptance="transition").check(parts)] == [("motion",)]
    assert list(PsoMhpf().check(parts)) == []


def test_a_snapshot_shows_every_particle_where_it_is_and_changes_nothing() -> None:
    tracker, cluster = PsoMhpf(particles=100), Cluster(5)
    belief = started(tracker, cluster)
    for step in (1, 2):
        members = list(cluster.members.values())
        pieces = list(tracker.snapshot(belief, members))
        assert [node for node, _, _ in pieces] == list(cluster.ids)
        assert sum(cloud.shape[1] for _, cloud, _ in pieces) == 100
        assert sum(weights.sum() for _, _, weights in pieces) == pytest.approx(1.0)
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)))
