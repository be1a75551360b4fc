"""Cluster: the Kalman filter of one mode, the exact mixture of all modes, multiplicities, two moments, cycles."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tests.helpers.calls import counted_calls
from tests.helpers.range_cluster import Chase, asked, straight
from tests.helpers.thorough import thorough
from wsnsim.base.errors import RunError
from wsnsim.base.requests import Compute
from wsnsim.models.linear import ConstantAcceleration, ConstantVelocity
from wsnsim.models.ranging import Range, Rssi
from wsnsim.offline.loopback import silent
from wsnsim.testing import check_tracker
from wsnsim.trackers.mixture_pf import MixturePf, new_course
from wsnsim.trackers.shared.fixes import fix_cycles, fixed, usable
from wsnsim.trackers.shared.readings import Evidence

PLACES = [(0.0, 0.0), (40.0, 10.0), (10.0, 45.0), (50.0, 50.0)]
PATH = straight((5.0, 10.0), (3.0, 1.5), 30, 2.0)
NOISY = Range(sd=2.0, reach=1e4)
NEVER = 1e9
H = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
P0 = np.diag([25.0, 9.0, 25.0, 9.0])


def textbook_prediction(mean, cov, turns, dt=2.0, q=0.05, sd=3.0):
    """Matrices written out: F and Q of constant velocity, or a velocity that is drawn anew."""
    if turns:
        keep = np.diag([1.0, 0, 1.0, 0])
        drawn = np.array([[dt, 0], [1, 0], [0, dt], [0, 1]])
        return keep @ mean, keep @ cov @ keep + sd**2 * drawn @ drawn.T
    transition = np.array([[1, dt, 0, 0], [0, 1, 0, 0], [0, 0, 1, dt], [0, 0, 0, 1]])
    noise = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return transition @ mean, transition @ cov @ transition.T + np.kron(np.eye(2), noise)


def textbook_update(mean, cov, z, slope, noise):
    """In information form, and the log of the predictive density."""
    posterior = np.linalg.inv(np.linalg.inv(cov) + slope.T @ np.linalg.inv(noise) @ slope)
    score = multivariate_normal(slope @ mean, slope @ cov @ slope.T + noise).logpdf(z)
    return mean + posterior @ slope.T @ np.linalg.inv(noise) @ (z - slope @ mean), posterior, score


def fix_of(chase, scene, start):
    readings = np.array([chase.members[node].reading for node in scene.ids])
    evidence = Evidence(scene.ids, readings, scene.positions, scene.traits)
    return fixed(usable(evidence, scene), start, 1e6, scene)


@pytest.mark.parametrize("particles", [1, 1500])
def test_if_nothing_turns_it_is_the_kalman_filter_on_the_fixes(particles: int) -> None:
    chase, tracker = Chase(PATH, PLACES, NOISY), MixturePf(particles=particles, turn_time=NEVER)
    belief, _ = chase.drive(tracker.start(chase.prior, chase.scene(0)))
    mean, cov = chase.prior.mean, P0
    for step in range(1, 21):
        scene = chase.scene(step)
        belief, _ = chase.drive(tracker.step(belief, scene))
        mean, cov = textbook_prediction(mean, cov, turns=False)
        fix = fix_of(chase, scene, mean[[0, 2]])
        mean, cov, _ = textbook_update(mean, cov, fix.point, H, fix.cov)
        assert belief.mean == pytest.approx(mean, rel=1e-8) and belief.cov == pytest.approx(cov, rel=1e-7, abs=1e-9)
    assert belief.means.shape == (1, 4) and belief.effective == pytest.approx(particles)


@pytest.mark.parametrize("count", [1, 2])
def test_of_fewer_than_three_ranges_each_updates_it_linearised_where_it_stands(count: int) -> None:
    chase, tracker = Chase(PATH, PLACES, NOISY), MixturePf(particles=3, turn_time=NEVER)
    belief, _ = chase.drive(tracker.start(chase.prior, chase.scene(0)))
    scene = chase.scene(1, chase.ids[:count])
    belief, _ = chase.drive(tracker.step(belief, scene))
    mean, cov = textbook_prediction(chase.prior.mean, P0, turns=False)
    for node, place in zip(scene.ids, scene.positions, strict=True):
        away = mean[[0, 2]] - place
        expected = np.hypot(*away)
        slope = np.array([[away[0], 0.0, away[1], 0.0]]) / expected
        z = chase.members[node].reading - expected + slope @ mean
        mean, cov, _ = textbook_update(mean, cov, z, slope, np.array([[4.0]]))
    assert belief.mean == pytest.approx(mean, rel=1e-9) and belief.cov == pytest.approx(cov, rel=1e-8, abs=1e-9)


def test_the_mixture_is_the_sum_over_all_courses_of_modes() -> None:
    """2³ courses, each with its prior probability and its Kalman filter, against 60 000 particles that draw theirs.

    The fixes are searched from the filter's own prediction, but exact to 1e-3 wherever the search starts.
    """
    path = straight((5.0, 10.0), (3.0, 1.5), 4, 2.0)
    path[2:] = straight(tuple(path[1, [0, 2]]), (-2.0, 3.0), 3, 2.0)[1:]  # it turns
    chase = Chase(path, PLACES, NOISY)
    tracker = MixturePf(particles=60_000, turn_time=5.0)
    turn = 1.0 - np.exp(-2.0 / 5.0)
    belief, _ = chase.drive(tracker.start(chase.prior, chase.scene(0)))
    courses = {(): (chase.prior.mean, P0, 0.0)}
    for step in (1, 2, 3):
        scene = chase.scene(step)
        belief, _ = chase.drive(tracker.step(belief, scene))
        fix = fix_of(chase, scene, path[step][[0, 2]])
        longer = {}
        for (course, (mean, cov, score)), turns in product(courses.items(), (False, True)):
            moved = textbook_prediction(mean, cov, turns)
            after, shrunk, density = textbook_update(*moved, fix.point, H, fix.cov)
            longer[(*course, turns)] = after, shrunk, score + np.log(turn if turns else 1.0 - turn) + density
        courses = longer
        scores = np.array([score for *_, score in courses.values()])
        weights = np.exp(scores - scores.max()) / np.exp(scores - scores.max()).sum()
        means = np.array([mean for mean, *_ in courses.values()])
        mean = weights @ means
        cov = sum(
            w * (c + np.outer(m - mean, m - mean)) for w, (m, c, _) in zip(weights, courses.values(), strict=True)
        )
        assert belief.mean == pytest.approx(mean, abs=0.05)
        assert belief.cov == pytest.approx(cov, abs=0.05 * np.diag(cov).max())
        assert belief.counts.sum() == 60_000 and len(belief.means) <= 2**step
    assert 0.01 < weights[:-1].max() < 0.999, "more than one course matters"


def test_particles_kept_once_are_those_kept_each_for_itself() -> None:
    chase, tracker = Chase(PATH, PLACES, NOISY), MixturePf(particles=40, turn_time=5.0)
    once, _ = chase.drive(tracker.start(chase.prior, chase.scene(0)))
    for step in range(1, 8):
        each = replace(
            once, means=np.repeat(once.means, once.counts, axis=0), covs=np.repeat(once.covs, once.counts, axis=0),
            log_weights=np.repeat(once.log_weights, once.counts), counts=np.ones(40, dtype=np.int64),
        )  # fmt: skip
        scene = chase.scene(step)
        singly, _ = chase.drive(tracker.step(each, scene))
        once, _ = chase.drive(tracker.step(once, scene))
        assert singly.mean == pytest.approx(once.mean, rel=1e-9) and singly.cov == pytest.approx(once.cov, rel=1e-9)
        assert singly.effective == pytest.approx(once.effective) and once.counts.sum() == 40
        assert once.counts.size < 40


def test_a_new_course_forgets_the_velocity_and_is_that_of_draws() -> None:
    rng, cov = np.random.default_rng(2), np.array([[4.0, 1, 0, 0], [1, 2, 0, 0], [0, 0, 3, -1], [0, 0, -1, 5.0]])
    (mean,), (spread,) = new_course(np.array([[10.0, 8.0, -5.0, 3.0]]), cov[None], 2.0, 3.0)
    start, velocity = rng.multivariate_normal([10, 8, -5, 3], cov, 200_000), rng.normal(0.0, 3.0, (200_000, 2))
    drawn = np.stack(
        [start[:, 0] + 2 * velocity[:, 0], velocity[:, 0], start[:, 2] + 2 * velocity[:, 1], velocity[:, 1]]
    )
    assert mean == pytest.approx([10.0, 0.0, -5.0, 0.0]) and spread == pytest.approx(np.cov(drawn), abs=0.4)


@pytest.mark.thorough
def test_after_a_turn_it_finds_the_target_again_and_one_mode_does_later() -> None:
    path = straight((5.0, 10.0), (3.0, 3.0), 20, 2.0)
    path[10:] = straight(tuple(path[9, [0, 2]]), (-4.0, -4.0), 11, 2.0)[1:]
    errors = {60.0: 0.0, NEVER: 0.0}
    for turn_time in errors:
        for seed in range(6):
            chase, tracker = Chase(path, PLACES, Range(sd=4.0, reach=1e4), seed=seed), MixturePf(turn_time=turn_time)
            belief, _ = chase.drive(tracker.start(chase.prior, chase.scene(0)))
            for step in range(1, 15):
                belief, _ = chase.drive(tracker.step(belief, chase.scene(step)))
                if step > 9:
                    errors[turn_time] += float(np.hypot(*(belief.mean - path[step])[[0, 2]]))
    assert errors[60.0] < 0.8 * errors[NEVER]


def test_a_handover_carries_two_moments_in_100_bytes() -> None:
    chase, tracker = Chase(PATH, PLACES, NOISY), MixturePf(particles=200, turn_time=5.0)
    belief = chase.follow(tracker, 4)
    assert belief.counts.size > 1
    _, (send,) = asked(tracker.hand_over(belief, chase.scene(4), 7), np.array([True]))
    assert (send.parcel.packets, send.parcel.packet_bits) == (1, 800) and tracker.belief_bits(belief) == 800
    after, _ = chase.drive(tracker.hand_over(belief, chase.scene(4), 7))
    assert after.counts.tolist() == [200] and after.head == 7
    assert np.array_equal(after.means[0], belief.mean) and np.array_equal(after.covs[0], belief.cov)
    assert chase.drive(tracker.hand_over(belief, chase.scene(4), 7), silent)[0] is None


def test_the_forecast_has_the_two_moments_of_both_modes() -> None:
    chase, tracker = Chase(PATH, PLACES, NOISY), MixturePf(particles=200, turn_time=5.0)
    belief = chase.follow(tracker, 3)
    turn = 1.0 - np.exp(-0.4)
    straight_on, turned = (textbook_prediction(belief.mean, belief.cov, turns) for turns in (False, True))
    found = tracker.forecast(belief, chase.scene(3), 1)
    assert found.mean == pytest.approx((1.0 - turn) * straight_on[0] + turn * turned[0])
    apart = straight_on[0] - turned[0]
    mixed = (1.0 - turn) * straight_on[1] + turn * turned[1] + turn * (1.0 - turn) * np.outer(apart, apart)
    assert found.cov == pytest.approx(mixed)
    assert np.array_equal(tracker.forecast(belief, chase.scene(3), 0).mean, belief.mean)


def test_all_particles_are_paid_for_though_equal_ones_are_kept_once() -> None:
    chase, tracker = Chase(PATH, PLACES), MixturePf(particles=500, turn_time=NEVER)
    belief, _ = chase.drive(tracker.start(chase.prior, chase.scene(0)))
    _, heard = chase.drive(tracker.step(belief, chase.scene(1)))
    rest = heard.cycles[chase.head] - 500 * (45 + 126 + 82) - (60 + 4 * 33)
    assert rest in [fix_cycles(4, iterations) for iterations in range(1, 31)]
    _, heard = chase.drive(tracker.step(belief, chase.scene(1, chase.ids[:2])))
    assert heard.cycles == {chase.head: 500 * (45 + 2 * 92 + 82)}
    _, asks = asked(tracker.step(belief, chase.scene(2, steps=2)))
    assert [ask.cycles for ask in asks if isinstance(ask, Compute)] == [500 * 2 * 45]


def work_of_steps(particles: int) -> tuple[int, int]:
    """The largest number of calls and of bytes in use at once of ten steps."""
    chase, tracker = Chase(PATH, PLACES, NOISY), MixturePf(particles=particles)
    belief = chase.follow(tracker, 5)
    calls = []
    tracemalloc.start()
    try:
        for step in range(6, 16):
            scene = chase.scene(step)
            with counted_calls() as counted:
                belief, _ = chase.drive(tracker.step(belief, scene))
            calls.append(counted.number)
        return max(calls), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_step_of_1500_particles_has_no_loop_over_them_and_no_array_of_pairs() -> None:
    (few, _), (many, size) = work_of_steps(100), work_of_steps(1500)
    assert many < 1.2 * few and size < 1500**2


def test_it_needs_ranges_and_its_own_state() -> None:
    tracker = MixturePf()
    assert all(hasattr(Range, need) and hasattr(Rssi, need) for need in tracker.needs)
    assert list(tracker.check(SimpleNamespace(filter_motions=(ConstantVelocity(),)))) == []
    (issue,) = tracker.check(SimpleNamespace(filter_motions=(ConstantVelocity(), ConstantAcceleration())))
    assert issue.path == ("tracker", "kind") and "px vx py vy" in issue.message
    chase = Chase(PATH, PLACES)
    chase.motion = ConstantAcceleration()
    with pytest.raises(RunError, match="px vx py vy"):
        chase.drive(tracker.start(chase.prior, chase.scene(0)))


@pytest.mark.thorough
@pytest.mark.parametrize("sensor", [Range(), Rssi(), *thorough((Range(sd=50.0), Range(sd=1e-3), Rssi(sd=30.0)))])
@pytest.mark.parametrize("tracker", [MixturePf(particles=60), MixturePf(particles=1, turn_time=0.1)])
def test_the_rules_of_the_seam_are_kept(tracker, sensor) -> None:
    check_tracker(tracker, sensor=sensor)
