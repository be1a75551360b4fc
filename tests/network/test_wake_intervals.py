"""A wake interval that follows the target: who is told, for how long, and what share of time that is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import simpy

from tests.helpers import late_mac
from tests.network.late_runs import CALM, LATE, MOVING, played
from wsnsim.base.tables import KIND
from wsnsim.network.clusters.network_view import WakeIntervals
from wsnsim.network.event_log import StepClock


class Clocked:
    """Ten nodes, all up, at a time."""

    def __init__(self) -> None:
        self.env = simpy.Environment()
        self.clock = StepClock(self.env, 2.0)
        self.told: list[tuple[tuple[int, ...], float]] = []
        self.nodes: Any = SimpleNamespace(alive=[True] * 9 + [False], size=10)
        self.intervals = self.intervals_of(late_mac.LateCsma(near=0.03), self)

    def intervals_of(self, mac: Any, mechanism: Any) -> WakeIntervals:
        setup: Any = SimpleNamespace(mac=mac, wakeup=SimpleNamespace(wait=3.0))
        return WakeIntervals(setup, self.clock, self.nodes, mechanism)

    def use_short_interval(self, nodes: Any, until: float) -> None:
        self.told.append((tuple(nodes.tolist()), until))


def test_nodes_are_told_to_hurry_once_and_again_only_for_longer_and_never_when_down():
    at = Clocked()
    at.intervals.shorten([1, 2, 9], 4.0)
    at.intervals.shorten([2, 3], 4.0)
    at.intervals.shorten([1, 2], 3.0)
    at.intervals.shorten_for_next_step([2])
    assert at.told == [((1, 2), 4.0), ((3,), 4.0), ((2,), 5.0)], "a step of 2 s and 3 s after it"
    at.env.run(until=2.0)
    assert at.intervals.share() == pytest.approx(3 / 10), "three of ten all the time"
    at.intervals.forget(3)
    at.env.run(until=8.0)
    assert at.intervals.share() == pytest.approx((4.0 + 5.0 + 2.0) / 80.0)
    at.intervals.shorten([1], 10.0)
    at.env.run(until=10.0)
    assert at.intervals.share() == pytest.approx((4.0 + 5.0 + 2.0 + 2.0) / 100.0)


def test_without_a_short_interval_nobody_hurries():
    near, far = late_mac.LateCsma(near=0.03), late_mac.LateCsma()
    at = Clocked()
    for mac, mechanism, is_told in ((near, at, True), (far, at, False), (near, object(), False)):
        made = at.intervals_of(mac, mechanism)
        made.shorten([1], 1.0)
        made.shorten_for_next_step([1])
        assert bool(at.told) == is_told
        at.told.clear()
    made.forget(1)
    assert np.isnan(made.share())


NEAR = {
    "standing": ("ekf_real", CALM),
    "appointing": ("ekf_real", (*CALM, "clusters={kind: appointed}")),
    "flood": ("gmtt", ("duration=40 s", MOVING.format("prediction"))),
    "calls": ("tsstp", ("duration=40 s", MOVING.format("detection"))),
    "asked": ("ris", ("duration=40 s", MOVING.format("detection"))),
}


@pytest.mark.thorough
@pytest.mark.parametrize("policy", NEAR)
def test_nodes_hurry_by_what_they_heard_and_heads_by_themselves(policy):
    name, changes = NEAR[policy]
    run = played(name, *changes, LATE.format(0.125), "mac.near=31.25 ms")
    events, heads = run.events, {*run.memory.table("clusters")["head"].tolist()}
    heard: dict[int, list[float]] = {}
    for kind in ("receive", "called"):
        for node, time in zip(
            *(events[c][events["kind"] == KIND[kind]].tolist() for c in ("node", "time")), strict=True
        ):
            heard.setdefault(node, []).append(time)
    assert run.hurried
    for now, nodes, until in run.hurried:
        assert until > now
        for node in nodes:
            assert node in heads or any(now - 1e-6 <= time <= now for time in heard[node]), (
                "it heard something just then"
            )
    told = {node for _, nodes, _ in run.hurried for node in nodes}
    assert 0.0 < len(told) < 0.8 * run.setup.deploy.nodes
    far = played(name, *changes, LATE.format(0.125))
    if policy != "asked":
        near_delay, far_delay = (np.nanmean(each.estimates["issued"] - each.estimates["time"]) for each in (run, far))
        assert near_delay < far_delay


@pytest.mark.thorough
def test_the_share_of_time_at_the_short_interval_is_that_of_what_nodes_were_told():
    name, changes = NEAR["standing"]
    run = played(name, *changes, LATE.format(0.125), "mac.near=31.25 ms")
    near: dict[int, float] = {}
    seconds, end = 0.0, run.setup.duration
    for now, nodes, until in run.hurried:
        for node in nodes:
            seconds += max(min(until, end) - max(near.get(node, 0.0), now), 0.0)
            near[node] = max(near.get(node, 0.0), min(until, end))
    assert 0.0 < run.summary.run["hurried"] == pytest.approx(seconds / (256 * end), rel=1e-9)
    far = played(name, *changes, LATE.format(0.125))
    assert np.isnan(far.summary.run["hurried"])
    assert "hurried" not in played("ekf_real", "duration=1 s").summary.run
