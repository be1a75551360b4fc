"""PPF: the same as one bootstrap filter on a perfect network, its packets, and what losses do."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers.linear_cluster import Cluster, against_kalman, sent
from tests.helpers.losses import losing
from wsnsim.base.requests import Delivery, Gather, Scatter
from wsnsim.kernels.particles import allocate
from wsnsim.offline.loopback import silent
from wsnsim.trackers.parallel_pf import COUNTS, ParallelPf, replicate
from wsnsim.trackers.shared.stacks import CLOUD, LOG_WEIGHTS, present


def started(tracker: ParallelPf, cluster: Cluster):
    return cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))[0]


def the_whole(cluster: Cluster) -> tuple[np.ndarray, np.ndarray]:
    """Every particle and its log-weight, wherever it is."""
    pieces = [present(member, 4) for member in cluster.members.values()]
    return np.concatenate([piece[0] for piece in pieces], axis=1), np.concatenate([piece[1] for piece in pieces])


def shares(log_weights: np.ndarray) -> np.ndarray:
    weights = np.exp(log_weights - log_weights.max())
    return weights / weights.sum()


@pytest.mark.thorough
def test_on_a_linear_gaussian_model_it_is_the_kalman_filter_but_for_its_particles() -> None:
    errors, ratios = against_kalman(ParallelPf(particles=2000), seeds=6)
    assert np.sqrt(np.mean(errors**2)) < 0.4
    assert np.abs(errors.mean(axis=0)).max() < 0.25
    assert np.median(ratios) == pytest.approx(1.0, abs=0.3), "the spread is that of one cloud and the local means"


def test_on_a_perfect_network_each_step_is_that_of_one_bootstrap_filter_over_all_particles() -> None:
    tracker, cluster, resampled = ParallelPf(particles=200), Cluster(6, seed=3), 0
    belief = started(tracker, cluster)
    for step in range(1, 9):
        _, old = the_whole(cluster)
        weighed: list[tuple[np.ndarray, np.ndarray]] = []
        scene = cluster.scene(step)

        def watch(ask, seen=weighed) -> None:
            if isinstance(ask, Gather) and "log_weights" in cluster.members[cluster.head].memory:
                seen.append(the_whole(cluster))

        belief, _ = cluster.drive(tracker.step(belief, scene), watch=watch)
        readings, traits = cluster.readings()
        cloud, log_weights = weighed[0]
        fitness = cluster.sensor.log_likelihood(cloud[[0, 2]], readings, None, traits)
        assert log_weights == pytest.approx(old + fitness)
        assert belief.mean == pytest.approx(cloud @ shares(log_weights))
        assert belief.effective == pytest.approx(1.0 / np.sum(shares(log_weights) ** 2))
        after, new = the_whole(cluster)
        assert after.shape == (4, 200)
        assert [present(member, 4)[1].size for member in cluster.members.values()] == allocate(200, 6).tolist()
        if belief.effective < 100.0:
            resampled += 1
            assert np.all(new == new[0]), "equal weights after resampling"
            copies = np.array([np.all(after == cloud[:, [j]], axis=0).sum() for j in range(200)])
            expected = 200 * shares(log_weights)
            assert np.all(copies >= np.floor(expected - 1e-9)) and np.all(copies <= np.ceil(expected + 1e-9))
        else:
            assert new == pytest.approx(log_weights)
    assert 0 < resampled < 8, "the case must show steps with and without resampling"


def test_a_step_sends_what_the_papers_table_says() -> None:
    cluster = Cluster(17)
    tracker = ParallelPf(threshold=0.0)
    belief, heard = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)))
    assert sent(heard, cluster.head) == {"vparticles": 400 - 23}
    _, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
    # 23 or 24 particles have 6 packets of weights, and the local mean is one more
    assert sent(heard, cluster.head) == {"^reading": 16, "vreadings": 5, "^weights": 16 * 7}


def test_resampling_sends_counts_down_and_the_surplus_both_ways() -> None:
    cluster, tracker = Cluster(17), ParallelPf(threshold=1.0)
    belief, counts = started(tracker, cluster), {}

    def watch(ask) -> None:
        if isinstance(ask, Scatter):
            counts.update({i: p.payload[0] for i, p in ask.parcels.items() if p.what == "counts"})

    _, heard = cluster.drive(tracker.step(belief, cluster.scene(1)), watch=watch)
    target = dict(zip(cluster.ids, allocate(400, 17).tolist(), strict=True))
    have = {node: int(copies.sum()) for node, copies in counts.items()}
    up = sum(max(have[node] - target[node], 0) for node in cluster.ids[1:])
    down = sum(max(target[node] - have[node], 0) for node in cluster.ids[1:])
    packets = sent(heard, cluster.head)
    assert packets["vcounts"] == 16 * 3 and sum(have.values()) == 400
    assert (packets["^particles"], packets["vparticles"]) == (up, down) and up > 0 and down > 0


def test_a_handover_costs_what_pso_mhpfs_does_and_brings_the_weights_that_the_head_knows() -> None:
    cluster, tracker = Cluster(5), ParallelPf(particles=402, threshold=0.0)
    belief = started(tracker, cluster)
    scene = cluster.scene(1)
    belief, _ = cluster.drive(tracker.step(belief, scene))
    cloud, log_weights = the_whole(cluster)
    own = belief.deal.held[cluster.head]
    after, heard = cluster.drive(tracker.hand_over(belief, scene, 7))
    assert sent(heard, cluster.head) == {"^particles": 402 - own, "vhandover": 402 + 101 + 4}
    assert np.array_equal(after.deal.whole.cloud, cloud)
    assert after.deal.whole.log_weights == pytest.approx(log_weights)


def test_a_member_that_misses_its_counts_keeps_particles_that_are_weighed_rightly() -> None:
    cluster, tracker = Cluster(5, seed=2), ParallelPf(particles=200, threshold=1.0)
    belief = started(tracker, cluster)
    deaf = cluster.ids[3]

    for step in range(1, 4):
        belief, _ = cluster.drive(tracker.step(belief, cluster.scene(step)), losing(what="counts", to=deaf))
    mean = belief.mean
    cloud, log_weights = the_whole(cluster)
    sd = np.sqrt(np.diag(belief.cov))
    assert np.abs(cloud @ shares(log_weights) - mean).max() < sd.max(), "what follows is weighed on one scale"
    deaf_share = shares(log_weights)[
        np.repeat(cluster.ids, [present(m, 4)[1].size for m in cluster.members.values()]) == deaf
    ]
    assert 0.01 < deaf_share.sum() < 0.9


def test_a_lost_packet_of_counts_leaves_its_eight_particles_as_they_are() -> None:
    cluster, tracker = Cluster(1), ParallelPf(particles=20, threshold=0.0)
    belief = started(tracker, cluster)
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)))
    member = cluster.members[cluster.head]
    cloud = member.memory[CLOUD].copy()
    counts = np.array([0] * 19 + [20])
    member.inbox.append(Delivery(COUNTS, (counts, -3.0), np.array([True, False, True])))
    replicate(member)
    expected = np.concatenate([cloud[:, 8:16], np.repeat(cloud[:, 19:], 20, axis=1)], axis=1)
    assert np.array_equal(member.memory[CLOUD], expected)
    assert np.all(member.memory[LOG_WEIGHTS] == -3.0)


def test_resampling_makes_good_what_was_lost() -> None:
    cluster, tracker = Cluster(5), ParallelPf(particles=200, threshold=1.0)

    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)), losing(slice(3), "particles"))
    assert belief.deal.total == 200 - 4 * 3
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)))
    assert belief.deal.total == 200 and the_whole(cluster)[0].shape == (4, 200)


def test_in_a_silent_network_the_head_goes_on_with_what_it_has() -> None:
    cluster, tracker = Cluster(5), ParallelPf(particles=200, threshold=0.0)
    belief, _ = cluster.drive(tracker.start(cluster.prior, cluster.scene(0)), silent)
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)), silent)
    memory = cluster.members[cluster.head].memory
    assert belief.mean == pytest.approx(memory[CLOUD] @ shares(memory[LOG_WEIGHTS]))


def test_a_step_costs_the_operations_that_are_counted_for_it() -> None:
    for measurements, sensors in (("all", 6), ("own", 1)):
        cluster, tracker = Cluster(6), ParallelPf(particles=60, measurements=measurements, threshold=0.0)
        belief = started(tracker, cluster)
        _, heard = cluster.drive(tracker.step(belief, cluster.scene(1)))
        assert heard.cycles == dict.fromkeys(cluster.ids, 10 * (40.0 + 30.0 * sensors))


def test_weights_that_are_lost_count_as_the_mean_of_the_others() -> None:
    cluster, tracker = Cluster(2), ParallelPf(particles=16, threshold=0.0)
    belief = started(tracker, cluster)

    lost = losing([1], "weights")  # weights 4-7 of the other member's eight
    belief, _ = cluster.drive(tracker.step(belief, cluster.scene(1)), lost)
    head, other = (np.exp(member.memory[LOG_WEIGHTS]) for member in cluster.members.values())
    known = np.concatenate([head, other[:4]])
    assert np.exp(belief.weights[101]) == pytest.approx(np.concatenate([other[:4], np.full(4, known.mean())]))
    locals_ = [member.memory["local"].mean for member in cluster.members.values()]
    sums = [head.sum(), other[:4].sum() + 4 * known.mean()]
    assert belief.mean == pytest.approx(np.average(locals_, axis=0, weights=sums))


@pytest.mark.parametrize(("measurements", "cycles"), [("own", 100 * 70.0), ("all", 100 * 130.0)])
def test_a_member_of_three_is_said_to_need_what_its_step_takes(measurements: str, cycles: float) -> None:
    assert ParallelPf(particles=300, measurements=measurements).member_cycles == cycles
