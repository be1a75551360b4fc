"""Components that cannot be combined are refused with a reason; those that can, run."""

from __future__ import annotations

import pytest

from tests.helpers.late_mac import LateCsma
from wsnsim import load
from wsnsim.base.errors import ScenarioError
from wsnsim.experiment import simulate_run
from wsnsim.scenario import build
from wsnsim.scenario.abilities import RULES

HOP = LateCsma(interval=0.5).latency(96).unicast


def late(more: str = "", interval: float = 0.5) -> str:
    return f"mac={{kind: 'tests.helpers.late_mac:LateCsma', rate: 250 kbit/s, interval: {interval} s{more}}}"


MOVING = "clusters={kind: moving_head, main: prediction}"
SLOW = "mac={kind: xmac, interval: 1 s}"
NEAR = late(", near: 0.125 s")
REFUSED = [
    ("gmtt", (late(), MOVING, "sleep={kind: duty_cycle, period: 1 s, awake_share: 0.3}"),
     ("sleep", "period"), "nodes are awake for 0.3 s at a time, and over mac: late a node can be reached once in 0.5"),
    ("gmtt", (late(), MOVING, "sleep={kind: ris, period: 0.4 s}"), ("sleep", "period"), "nodes are awake for 0.4 s"),
    ("beacons", (NEAR,), ("mac", "near"), "without a target there is nothing that the wake interval could follow"),
    ("ekf_real", (NEAR, "step=1 s", "duration=28 s", "clusters={kind: central}"),
     ("mac", "near"), "no node is told of a target: an op"),
    ("gmtt", (late(interval=2.5), MOVING, "sleep={kind: event_wake}", "step=2 s", "acquire.poll=1 s"),
     ("wakeup", "kind"), "a message takes 2.5 s over mac: late, and a step lasts 2 s: no node would be woken in time"),
    ("beacons", (late(), "workload.period=0.4 s"), ("workload", "period"), "0.4 s is over before a broadcast"),
    ("collection", (SLOW, "workload.period=0.5 s"), ("workload", "period"), "0.5 s is over before a unicast has ended"),
    ("gmtt", (late(), "clusters={kind: moving_head, main: prediction, quiet: 12 ms, cap: 1 s}"),
     ("clusters", "quiet"), "0.012 s is over before a reading can arrive: over mac: late a unicast takes up to 0.50"),
    ("beacons", ("mac={kind: tsch}", "clock={kind: drift}", "sync={kind: ftsp}", "workload.period=4 s"),
     ("sync", "kind"), "mac: tsch keeps the clocks of nodes together itself: use none"),
    ("ekf_real", ("clock.sd=5000 ppm",), ("mac", "guard"),
     "in a step of 0.04 s two clocks drift apart by 0.000283 s (standard deviation, by clock.sd), more than 0.00025 s"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "changes", "path", "reason"), REFUSED)
def test_a_combination_that_cannot_work_is_refused_with_its_reason(name, changes, path, reason):
    with pytest.raises(ScenarioError) as refused:
        build(load(name, list(changes)))
    (line,) = [line for line in str(refused.value).splitlines() if reason in line]
    assert ".".join(path) in line


ALLOWED = [
    ("gmtt", (late(), MOVING, "sleep={kind: ris, period: 10 s}")),
    ("gmtt", (NEAR, MOVING, "sleep={kind: duty_cycle, period: 4 s, awake_share: 0.2}")),
    ("gmtt", (late(), MOVING, "sleep={kind: event_wake}")),
    ("tsstp", (NEAR, "clusters={kind: moving_head, main: detection}", "sleep={kind: always_on}")),
    ("ekf_real", (NEAR, "step=1 s", "clusters={kind: appointed}", "sleep={kind: ris}", "wakeup={kind: region}")),
    ("ekf_real", (late(), "step=1 s", "clusters={kind: central}")),
    ("beacons", (late(), "workload.period=4 s")),
    ("gmtt", ("mac={kind: csma, rate: 250 kbit/s}", "sleep={kind: duty_cycle, period: 1 s, awake_share: 0.3}")),
]


@pytest.mark.thorough(fast=["gmtt-changes0"])
@pytest.mark.parametrize(("name", "changes"), ALLOWED)
def test_what_can_be_combined_runs(name, changes):
    assert simulate_run(load(name, [*changes, "duration=4 s"])).run["frames_sent"] > 0


def test_there_is_a_refused_example_of_each_rule():
    whole = {path for _, _, path, _ in REFUSED}
    assert len(RULES) == len(whole - {("clusters", "quiet")})
