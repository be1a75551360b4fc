"""Elections, the handover condition at its edges, and successors."""

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from tests.helpers.late_mac import LateCsma
from wsnsim.base.medium_access import head_waits, window_of
from wsnsim.base.setups import NetworkSetup
from wsnsim.models.access import Csma, IdealMac
from wsnsim.models.batteries import Linear
from wsnsim.models.clusters import Central, MovingHead, StrongestSignal
from wsnsim.models.energy import FirstOrder
from wsnsim.models.hardware import Processor
from wsnsim.models.links import Disk
from wsnsim.models.wakeup import DirectedFlood, ExperienceZones, NoWakeUp, Region

POSITIONS = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 20.0], [0.0, -20.0]])


def test_the_able_candidate_with_the_strongest_reading_leads():
    policy = StrongestSignal()
    assert policy.elect([4, 7, 9], [3.0, 8.0, 5.0], [True, True, True]) == 7
    assert policy.elect([4, 7, 9], [3.0, 8.0, 5.0], [True, False, True]) == 9


def test_of_equal_readings_the_lowest_id_leads():
    policy = StrongestSignal()
    assert policy.elect([9, 4, 7], [8.0, 8.0, 8.0], [True, True, True]) == 4
    assert policy.elect([9, 4, 7], [8.0, 8.0, 8.0], [True, False, True]) == 7


def test_without_an_able_candidate_no_node_leads():
    assert StrongestSignal().elect([4, 7], [3.0, 8.0], [False, False]) is None
    assert StrongestSignal().elect([], [], []) is None


@pytest.mark.parametrize(
    ("active", "members", "hands_over"),
    [
        (3, 3, False), (2, 3, True), (2, 2, True), (0, 0, True), (0, 17, True),
        (3, 12, False), (3, 13, True), (4, 16, False), (4, 17, True), (17, 17, False),
    ],
)  # fmt: skip
def test_a_cluster_hands_over_below_three_or_below_a_quarter(active, members, hands_over):
    assert StrongestSignal().must_hand_over(active, members) is hands_over


@pytest.mark.parametrize("members", range(1, 100))
def test_an_exact_fraction_does_not_hand_over(members):
    """active / members is compared as a quotient, which is exact here, unlike a product."""
    for active in range(1, members + 1):
        policy = StrongestSignal(minimum_active=1, handover_fraction=active / members)
        assert not policy.must_hand_over(active, members)
        assert policy.must_hand_over(active - 1, members)


def test_the_nearest_able_node_succeeds():
    policy = StrongestSignal()
    able = np.array([True, True, True, True])
    assert policy.successor(np.array([9.0, 1.0]), POSITIONS, able) == 1
    able[1] = False
    assert policy.successor(np.array([9.0, 1.0]), POSITIONS, able) == 0
    assert policy.successor(np.array([9.0, 1.0]), POSITIONS, np.zeros(4, bool)) is None


def test_of_equally_near_nodes_the_lowest_id_succeeds():
    able = np.array([False, False, True, True])
    assert StrongestSignal().successor(np.zeros(2), POSITIONS, able) == 2


@pytest.mark.parametrize("seed", range(30))
def test_among_many_nodes_the_successor_is_the_one_that_an_exhaustive_search_finds(seed):
    """Positions lie on a coarse lattice, so that many are equally near; in some cases few nodes are able."""
    draw = np.random.default_rng(seed)
    positions = draw.integers(-20, 20, (1000, 2)).astype(np.float64)
    able, point = draw.random(1000) < draw.choice([0.9, 0.01, 0.002]), draw.uniform(-25.0, 25.0, 2).round()
    apart = [(float(((positions[i] - point) ** 2).sum()), i) for i in np.flatnonzero(able).tolist()]
    assert StrongestSignal().successor(point, positions, able) == (min(apart)[1] if apart else None)


def test_each_policy_names_what_its_heads_do():
    policies = StrongestSignal(), StrongestSignal(successor_rule="elect"), Central(), MovingHead()
    assert [policy.protocol for policy in policies] == ["standing", "electing", "open", "moving"]


def test_the_open_cluster_has_one_fixed_head_near_its_point():
    policy, able = Central(x=9.0, y=0.0), np.ones(4, bool)
    assert policy.elect([2, 3], [1.0, 2.0], [True, True]) is None
    assert policy.successor(np.array([0.0, 20.0]), POSITIONS, able) == 1
    able[1] = False
    assert policy.successor(np.array([0.0, 20.0]), POSITIONS, able) == 0
    assert not policy.must_hand_over(0, 17)
    assert policy.minimum_active == 0


def test_the_moving_head_has_the_times_of_its_documentation():
    head = MovingHead()
    assert head.minimum_active == 1
    assert (head.main, head.sampling, head.patience) == ("prediction", 2e-3, 3.0)
    assert (
        window_of(head.quiet, head.cap, head_waits(Csma(), 2.0))
        == window_of(head.quiet, head.cap, head_waits(IdealMac(), 2.0))
        == (12e-3, 50e-3)
    )


def test_the_waits_of_a_moving_head_follow_from_a_mac_whose_radios_are_mostly_off():
    late = LateCsma(interval=0.5)
    hop = late.latency(96).unicast
    assert 0.5 < hop < 0.51
    assert window_of(None, None, head_waits(late, 10.0)) == pytest.approx((1.5 * hop, 4.0 * hop))
    assert window_of(None, None, head_waits(late, 2.0)) == pytest.approx((1.5 * hop, 1.2)), "0.6 of a step"
    assert window_of(None, None, head_waits(late, 0.6)) == pytest.approx((hop, hop)), "a hop at least"
    assert window_of(0.7, 0.8, head_waits(late, 2.0)) == (0.7, 0.8), "what is given stays"
    assert window_of(None, 0.6, head_waits(late, 2.0)) == (0.6, 0.6)


def test_a_wait_that_ends_before_a_reading_can_arrive_is_refused_with_the_figure_that_is_needed():
    late = LateCsma(interval=0.5)
    [(path, message)] = moving(MovingHead(quiet=0.02, cap=1.0), DirectedFlood(), mac=late)
    assert path == ("clusters", "quiet")
    assert message.startswith("0.02 s is over before a reading can arrive: over mac: late a unicast takes up to 0.50")
    assert message.endswith("or leave it out")
    [(path, _)] = moving(MovingHead(cap=0.1), DirectedFlood(), mac=late)
    assert path == ("clusters", "cap")
    assert not moving(MovingHead(quiet=0.6, cap=1.0), DirectedFlood(), mac=late)
    assert not moving(MovingHead(), DirectedFlood(), mac=late)
    [(path, message)] = moving(MovingHead(), DirectedFlood(), mac=late, dt=0.5)
    assert path == ("clusters", "cap") and "a step lasts 0.5 s" in message


def test_the_moving_head_never_hands_over_and_is_the_nearest_or_the_strongest():
    head, able = MovingHead(), np.ones(4, bool)
    assert not any(head.must_hand_over(active, 17) for active in range(18))
    assert head.successor(np.array([9.0, 1.0]), POSITIONS, able) == 1
    able[1] = False
    assert head.successor(np.array([9.0, 1.0]), POSITIONS, able) == 0
    assert head.successor(np.array([9.0, 1.0]), POSITIONS, np.zeros(4, bool)) is None
    assert head.elect([4, 7, 9], [3.0, 8.0, 8.0], [True, False, True]) == 9
    assert head.elect([4], [3.0], [False]) is None


def moving(head, wakeup, tracker=None, dt=2.0, mac=None):
    """The paths of the issues that a moving head yields with these components."""
    names = dict.fromkeys(field.name for field in fields(NetworkSetup))
    company = NetworkSetup(**names | {
        "energy": FirstOrder(), "link": Disk(), "clusters": head, "wakeup": wakeup, "dt": dt,
        "tracker": tracker or Gathered(), "cpu": Processor(), "mac": mac or IdealMac(),
    })  # fmt: skip
    return [(issue.path, issue.message) for issue in head.check(company)]


class Spread:
    """A tracker whose members compute: its belief is distributed over them."""

    member_cycles = 100.0


class Gathered:
    """A tracker whose members compute nothing."""

    member_cycles = 0.0


@pytest.mark.parametrize(
    ("main", "wakeup", "goes"),
    [
        ("prediction", DirectedFlood(), True), ("prediction", ExperienceZones(), True), ("prediction", Region(), True),
        ("prediction", NoWakeUp(), False), ("detection", DirectedFlood(), True),
        ("detection", ExperienceZones(), True), ("detection", Region(), False), ("detection", NoWakeUp(), True),
    ],
)  # fmt: skip
def test_the_rule_for_the_head_must_fit_the_wake_up_protocol(main, wakeup, goes):
    found = moving(MovingHead(main=main), wakeup)
    assert [path for path, _ in found] == ([] if goes else [("clusters", "main")])
    other = {"prediction": "detection", "detection": "prediction"}[main]
    assert all(f"use main: {other}" in message for _, message in found)


def test_a_step_must_outlast_the_wait_for_readings_and_the_quiet_must_fit_into_it():
    assert not moving(MovingHead(), DirectedFlood(), dt=0.0521)
    [(path, message)] = moving(MovingHead(), DirectedFlood(), dt=0.052)
    assert path == ("clusters", "cap")
    assert "0.052 s" in message
    assert moving(MovingHead(sampling=0.25, cap=0.5), DirectedFlood(), dt=0.75), "just as long is too long"
    [(path, message)] = moving(MovingHead(quiet=0.06), DirectedFlood())
    assert path == ("clusters", "quiet")
    assert "cap = 0.05 s" in message
    assert not moving(MovingHead(quiet=0.05), DirectedFlood())


def test_a_tracker_with_its_belief_on_the_members_cannot_be_combined_with_a_moving_head():
    [(path, message)] = moving(MovingHead(), DirectedFlood(), Spread())
    assert path == ("clusters", "kind")
    assert "keep its belief in the head (gmtt, tsstp, cluster, ris" in message
    assert not moving(MovingHead(), DirectedFlood(), Gathered())


@pytest.mark.parametrize("policy", [StrongestSignal, Central, MovingHead])
def test_a_battery_below_the_threshold_of_heads_is_an_issue(policy):
    """96 bits take 4.8 uJ to send, 54 uJ to radiate over 75 m and 4.8 uJ to receive; computing is added."""

    def found(battery, operations=0.0, per_flop=1.0, **given):
        names = dict.fromkeys(field.name for field in fields(NetworkSetup))
        company = NetworkSetup(**names | {
            "energy": FirstOrder(battery=battery), "battery": Linear(), "link": Disk(), "clusters": policy(**given),
            "tracker": SimpleNamespace(member_cycles=operations), "cpu": Processor(cycles_per_flop=per_flop),
            "wakeup": DirectedFlood(), "dt": 1.0,
        })  # fmt: skip
        found = [(issue.path, issue.message) for issue in company.clusters.check(company)]
        return [issue for issue in found if issue[0][0] == "energy"]

    [(path, message)] = found(63.5e-6)
    assert path == ("energy", "battery")
    assert "6.35e-05 J" in message and "more than 6.36e-05 J" in message
    assert not found(63.7e-6)
    assert found(63.7e-6, operations=1000.0)
    assert not found(63.7e-6, operations=10.0)
    assert found(63.7e-6, operations=10.0, per_flop=100.0), "a tracker states operations, a processor takes cycles"
    [(path, message)] = found(2.0, threshold=2.0)
    assert "more than 2 J (clusters.threshold)" in message
    assert not found(2.0, threshold=1.9)
    assert not found(float("inf"))
