"""Late readings: a filter that goes back is the filter of the order of measurement, and one that corrects is close."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.helpers.linear_cluster import VARIANCE, Cluster, F
from tests.helpers.range_cluster import Chase, straight
from wsnsim.base.arrays import Floats
from wsnsim.base.requests import Compute, GatheredReadings, GatherLate, GatherReadings, Send, all_arrived
from wsnsim.models.ranging import Range
from wsnsim.testing import check_tracker
from wsnsim.trackers.bootstrap_pf import CentralPf
from wsnsim.trackers.ekf import ExtendedKalman
from wsnsim.trackers.gaussian_pf import GaussianPf
from wsnsim.trackers.imm import InteractingModels
from wsnsim.trackers.sigma_points import CubatureKalman, UnscentedKalman

Delays = Callable[[int, int], int]
"""(step, node) → how many steps later its reading arrives; 0: in time."""
EXACT = 1e-9
"""Digits that rounding leaves of estimates of some metres."""


def drawn(seed: int, most: int = 4) -> Delays:
    """Delays at random, half of them 0; the head's own reading is in time."""
    table = np.random.default_rng(seed).integers(-most + 1, most + 1, (64, 8)).clip(0)
    return lambda step, node: 0 if node == 100 else int(table[step, node - 100])


def delayed(lag: int, *, node: int, step: int | None = None) -> Delays:
    """One node's readings, or that of one step, arrive so many steps later; all others in time."""
    return lambda at, of: lag if of == node and step in (None, at) else 0


class LateNetwork:
    """A head and members whose readings arrive late: performs flows, and counts operations."""

    def __init__(self, cluster: Any, delays: Delays) -> None:
        self.cluster, self.delays = cluster, delays
        self.readings: dict[int, dict[int, float]] = {}
        self.cycles = 0.0

    def perform(self, flow: Any, step: int) -> Any:
        answer = None
        while True:
            try:
                request = flow.send(answer)
            except StopIteration as end:
                return end.value
            answer = self.answer(request, step)

    def answer(self, request: Any, step: int) -> Any:
        if isinstance(request, GatherReadings):
            members = self.cluster.members.values()
            self.readings[step] = {member.id: member.reading for member in members if member.reading is not None}
            return self.of(step, lambda delay: delay == 0)
        if isinstance(request, GatherLate):
            steps = range(request.since, request.until + 1)
            found = {at: self.of(at, lambda delay, at=at: 0 < delay <= step - at) for at in steps}
            return {at: reply for at, reply in found.items() if reply.ids}
        if isinstance(request, Send):
            return all_arrived(request.parcel.packets)
        assert isinstance(request, Compute)
        self.cycles += request.cycles
        return None

    def of(self, step: int, arrived: Callable[[int], bool]) -> GatheredReadings:
        chosen = {node: z for node, z in self.readings[step].items() if arrived(self.delays(step, node))}
        return GatheredReadings(tuple(chosen), np.array(list(chosen.values())))

    def known(self, now: int) -> dict[int, Mapping[int, float]]:
        """{step: {node: reading}} of what has arrived when the step `now` is made."""
        return {
            at: {node: z for node, z in each.items() if self.delays(at, node) <= now - at}
            for at, each in self.readings.items()
        }


def tracked(tracker: Any, cluster: Any, delays: Delays, steps: int = 12) -> Iterator[tuple[int, Any, LateNetwork]]:
    """(step, belief, network) of the steps of a track."""
    cluster.renew()
    network = LateNetwork(cluster, delays)
    belief = network.perform(tracker.start(cluster.prior, cluster.scene(0)), 0)
    for step in range(1, steps + 1):
        belief = network.perform(tracker.step(belief, cluster.scene(step)), step)
        yield step, belief, network


def kalman(cluster: Any, known: Mapping[int, Mapping[int, float]], last: int) -> tuple[Floats, Floats]:
    """The Kalman filter of the linear world, in information form, in the order of measurement."""
    mean, cov = cluster.prior.mean, cluster.prior.cov
    for step in range(1, last + 1):
        mean, cov = F @ mean, F @ cov @ F.T + cluster.motion.noise
        information, vector = np.linalg.inv(cov), np.linalg.solve(cov, mean)
        for node, z in known[step].items():
            a, b = cluster.traits[node - 100]
            h = np.array([a, 0.0, b, 0.0])
            information, vector = information + np.outer(h, h) / VARIANCE, vector + h * z / VARIANCE
        cov = np.linalg.inv(information)
        mean = cov @ vector
    return mean, cov


@pytest.mark.parametrize("tracker", [ExtendedKalman, UnscentedKalman, CubatureKalman])
def test_in_a_linear_world_refiltering_is_the_kalman_filter_of_the_order_of_measurement(tracker) -> None:
    cluster = Cluster(5)
    for step, belief, network in tracked(tracker(late="refilter", late_window=100.0), cluster, drawn(1)):
        mean, cov = kalman(cluster, network.known(step), step)
        np.testing.assert_allclose(belief.mean, mean, rtol=0, atol=EXACT)
        np.testing.assert_allclose(belief.cov, cov, rtol=0, atol=EXACT)


@pytest.mark.parametrize(
    "tracker",
    [
        ExtendedKalman(), ExtendedKalman(iterations=3), UnscentedKalman(), CubatureKalman(), InteractingModels(),
        GaussianPf(particles=50), CentralPf(particles=50), CentralPf(particles=50, threshold=1.0),
    ],
    ids=lambda tracker: type(tracker).__name__,
)  # fmt: skip
def test_with_ranges_a_filter_that_goes_back_is_bit_by_bit_the_one_to_which_all_came_in_time(tracker) -> None:
    places, steps = [(-20, 30), (40, 10), (10, -30), (60, 40), (0, 60)], 8
    cluster = Chase(straight((0, 0), (5, 3), 20, 2.0), places, Range(sd=2.0, reach=1e3))
    *_, (_, late, network) = tracked(replace(tracker, late="refilter", late_window=100.0), cluster, drawn(2, 3), steps)
    known = network.known(steps)
    *_, (_, timely, _) = tracked(tracker, cluster, lambda step, node: 0 if node in known[step] else 99, steps)
    assert late.mean.tolist() == timely.mean.tolist() and late.cov.tolist() == timely.cov.tolist()


@pytest.mark.parametrize("lag", [1, 2])
def test_retrodiction_is_exact_in_a_linear_world_if_one_update_at_most_lies_between(lag) -> None:
    cluster = Cluster(5)

    def delays(step: int, node: int) -> int:
        return lag if node in (101, 103) and step % 4 == 0 else 0

    for step, belief, network in tracked(ExtendedKalman(late="retrodict"), cluster, delays):
        mean, cov = kalman(cluster, network.known(step), step)
        np.testing.assert_allclose(belief.mean, mean, rtol=0, atol=EXACT)
        np.testing.assert_allclose(belief.cov, cov, rtol=0, atol=EXACT)


@pytest.mark.parametrize(("updates", "lost"), [(2, 0.001), (3, 0.01), (4, 0.15), (5, 0.3)])
def test_after_more_updates_retrodiction_keeps_most_of_what_a_late_reading_tells(updates, lost) -> None:
    """`lost` is the normalised square distance to the filter of the order of measurement, over that of ignoring.

    The former adds less than 0.2 % to the mean square error in all cases.
    """
    squares, lag = {"retrodict": 0.0, "ignore": 0.0}, updates + 1
    for seed in range(6):
        cluster = Cluster(2, seed=seed)
        once = delayed(lag, node=101, step=12 - lag)
        for late in squares:
            *_, (step, belief, network) = tracked(ExtendedKalman(late=late, late_window=100.0), cluster, once)
            mean, cov = kalman(cluster, network.known(step), step)
            squares[late] += float((belief.mean - mean) @ np.linalg.solve(cov, belief.mean - mean)) / (6 * 4)
    assert squares["retrodict"] < lost * squares["ignore"] and squares["retrodict"] < 0.002


def test_a_handover_uses_what_has_arrived_and_leaves_the_past_behind() -> None:
    cluster, tracker = Cluster(5), ExtendedKalman(late="refilter")
    *_, (step, belief, network) = tracked(tracker, cluster, delayed(2, node=101), 6)
    arrived = network.perform(tracker.hand_over(belief, cluster.scene(6), 104), step + 1)
    mean, _ = kalman(cluster, network.known(step + 1), step)
    np.testing.assert_allclose(arrived.mean, mean, rtol=0, atol=EXACT)
    assert belief.past and arrived.past == ()


def test_what_is_older_than_the_window_is_not_used_and_not_kept() -> None:
    cluster = Cluster(5)
    delays = delayed(3, node=101)
    *_, (_, short, _) = tracked(ExtendedKalman(late="refilter", late_window=2.5 * cluster.dt), cluster, delays)
    *_, (_, never, _) = tracked(ExtendedKalman(), cluster, delays)
    assert short.mean.tolist() == never.mean.tolist() and len(short.past) == 3


def test_operations_are_those_of_the_steps_that_are_made_again() -> None:
    cluster = Cluster(5)
    once = delayed(3, node=101, step=4)
    *_, (*_, ignored) = tracked(ExtendedKalman(), cluster, once, 8)
    *_, (*_, again) = tracked(ExtendedKalman(late="refilter"), cluster, once, 8)
    *_, (*_, at_once) = tracked(ExtendedKalman(late="retrodict"), cluster, once, 8)
    a_step = ignored.cycles / 8
    assert 2.9 * a_step < again.cycles - ignored.cycles < 3.1 * a_step, "steps 4, 5 and 6, with one reading more"
    assert at_once.cycles - ignored.cycles > 0.0


@pytest.mark.thorough
@pytest.mark.parametrize("tracker", [ExtendedKalman(late="retrodict"), CentralPf(particles=50, late="refilter")])
def test_filters_that_use_late_readings_keep_the_contract_of_trackers(tracker) -> None:
    check_tracker(tracker)
