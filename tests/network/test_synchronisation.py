"""Time synchronisation by flooding: against closed forms, a plain second simulation, and the rules of the protocol."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.network.clock_networks import line, network, ran
from wsnsim.base.errors import RunError
from wsnsim.base.tables import KIND
from wsnsim.network.ftsp import ReferencePoints
from wsnsim.network.mechanisms import make_mechanism
from wsnsim.testing import check_sync

JITTER = 1e-4
QUICK = {"kind": "ftsp", "period": 1.0, "jitter": JITTER, "outlier": 0.1}


def test_the_line_through_reference_points_is_that_of_least_squares():
    rng = np.random.default_rng(1)
    points, known = ReferencePoints(8), []
    for number in range(20):
        own = 1e4 + 30.0 * number + rng.uniform(0, 5)
        known.append((own, own * (1 + 4e-5) + 0.3 + rng.normal(0, 1e-5)))
        points.add(*known[-1])
        x, y = np.array(known[-8:]).T
        if number >= 1:
            skew, offset = np.polyfit(x - x.mean(), y - x, 1)
            assert points.other(own + 7.0) == pytest.approx(
                own + 7.0 + offset + skew * (own + 7.0 - x.mean()), abs=1e-9
            )
            assert points.rate == pytest.approx(1 / (1 + skew), rel=1e-12)
    assert len(points) == 8


def test_without_points_the_other_clock_is_the_own_one_and_one_point_gives_the_offset():
    points = ReferencePoints(8)
    assert points.other(5.0) == 5.0 and points.rate == 1.0 and len(points) == 0
    points.add(10.0, 12.5)
    assert points.other(20.0) == 22.5 and points.rate == 1.0
    points.clear()
    assert len(points) == 0 and points.other(20.0) == 22.5
    points.restart()
    assert points.other(20.0) == 20.0


def difference_to_root(run, since):
    """(T, N) by how much clocks differ from that of node 0, from a step on."""
    return run.errors[since:, :] - run.errors[since:, :1]


@pytest.mark.thorough
def test_the_error_one_hop_from_the_root_is_that_of_a_regression():
    # The variance of the line through n points that are T apart, u periods after the last: s² (1/n + (u + 3.5)² / 42)
    # for n = 8; the mean over a period, u from 0 to 1, is s² (1/8 + 16.08 / 42).
    run = ran(duration=1750.0, step=0.7, deploy=line(2), sync=QUICK)
    errors = difference_to_root(run, since=60)[:, 1]
    expected = JITTER * (1 / 8 + (4.5**3 - 3.5**3) / 3 / 42) ** 0.5
    # Some 210 independent tables of points tell the deviation to 5 %.
    assert np.sqrt((errors**2).mean()) == pytest.approx(expected, rel=0.15)
    assert run.table["synchronised"][-1] == 1.0


def twin(hops, periods, seed):
    """The root mean square error at each hop of a chain, simulated plainly: no radio, no clocks, one message a period.

    Clocks are perfect, which the regression cannot know: the error of a line does not depend on the drift.
    """
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 1, hops + 1)
    points = [[] for _ in range(hops + 1)]
    errors = [[] for _ in range(hops + 1)]

    def estimate(hop, time):
        if hop == 0:
            return time
        x, y = np.array(points[hop][-8:]).T
        slope, offset = np.polyfit(x - x.mean(), y - x, 1) if len(x) > 1 else (0.0, (y - x)[0])
        return time + offset + slope * (time - x.mean())

    for period in range(periods):
        for hop in np.argsort(phases).tolist():
            time = period + phases[hop]
            if hop < hops and (hop == 0 or len(points[hop]) >= 3):
                points[hop + 1].append((time + rng.normal(0, JITTER), estimate(hop, time)))
        for hop in range(1, hops + 1):
            at = period + 1 + rng.uniform(0, 1)
            if len(points[hop]) >= 8:
                errors[hop].append(estimate(hop, at) - at)
    return np.array([np.sqrt(np.mean(np.square(each[20:]))) for each in errors[1:]])


@pytest.mark.thorough
def test_the_error_grows_from_hop_to_hop_as_in_a_plain_second_simulation():
    errors = [
        difference_to_root(ran(seed=seed, duration=1400.0, step=0.7, deploy=line(4), sync=QUICK), since=120)
        for seed in (1, 2, 3)
    ]
    found = np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0))[1:]
    expected = np.mean([twin(3, 1000, seed) for seed in range(3)], axis=0)
    assert np.all(np.diff(found) > 0) and found == pytest.approx(expected, rel=0.2)


def test_clocks_that_nobody_corrects_drift_apart_in_proportion_to_time():
    run = ran(duration=1000.0)
    apart, time = np.abs(run.errors - run.errors[0]), run.table["time"]
    assert apart[-1] == pytest.approx(apart[50] * time[-1] / time[50], rel=1e-9) and apart[-1].min() > 0
    assert run.table["spread"][-1] > 5e-3 and not run.table["synchronised"].any() and not run.log


def test_all_nodes_follow_the_lowest_id_over_several_hops_and_say_that_they_do():
    run = ran(duration=1200.0, deploy=line(6), sync={"kind": "ftsp", "period": 10.0})
    assert {state.root for state in run.sync._nodes} == {0}
    assert run.table["spread_max"][-1] < 3e-5 < run.table["spread_max"][0]
    assert run.errors[-1, 0] == pytest.approx(run.errors[0, 0] + 1190.0 * (run.clocks.rate(0) - 1.0), rel=1e-6)


def test_messages_are_sent_paid_for_and_logged_and_as_many_as_the_protocol_says():
    run = ran(duration=1200.0, mac={"kind": "csma"}, sync={"kind": "ftsp", "period": 30.0})
    sent = run.log["kind"] == KIND["send"]
    words = run.memory.words.all()
    assert {words[code] for code in run.log["what"][sent]} == {"sync"}
    # Forty periods; in the first four nobody knows of a root.
    assert 9 * 30 <= sent.sum() <= 9 * 36 and (run.log["bits"][sent] == 8 * (6 + 11 + 9)).all()
    assert run.outcome.nodes.ledger.totals[0] > 0 and run.outcome.counters.delivered > 0


def test_the_death_of_the_root_is_survived():
    crash = [{"kind": "crash", "at": 600.0, "nodes": [0]}]
    run = ran(duration=1400.0, deploy=line(4), sync={"kind": "ftsp", "period": 10.0}, faults=crash)
    assert [state.root for state in run.sync._nodes[1:]] == [1, 1, 1]
    apart = np.abs(run.errors[:, 1:] - run.errors[:, 1:2]).max(axis=1)
    times = run.table["time"]
    assert apart[(times > 400.0) & (times < 600.0)].max() < 3e-5 and apart[times > 1100.0].max() < 3e-5
    assert apart[(times > 600.0) & (times < 1100.0)].max() < 2e-4


def test_a_node_that_crashed_has_forgotten_all_and_is_synchronised_again():
    crash = [{"kind": "crash", "at": 605.0, "duration": 10.0, "nodes": [2]}]
    run = ran(duration=800.0, deploy=line(4), sync={"kind": "ftsp", "period": 10.0}, faults=crash)
    apart = np.abs(run.errors[:, 2] - run.errors[:, 1])
    assert apart[60] < 3e-5 and apart[62] > 1e-4 and apart[-1] < 3e-5
    assert run.table["synchronised"][60] == run.table["synchronised"][-1] == 1.0 > run.table["synchronised"][62]


def test_a_clock_that_jumps_is_an_outlier_three_times_and_then_followed_again():
    jump = [{"kind": "clock_step", "at": 605.0, "nodes": [2], "offset": 0.5}]
    run = ran(duration=900.0, deploy=line(4), sync={"kind": "ftsp", "period": 10.0}, faults=jump)
    apart = np.abs(run.errors[:, 2] - run.errors[:, 1])
    assert apart[60] < 3e-5 and apart[61:64] == pytest.approx(0.5, abs=1e-3) and apart[-1] < 3e-5


def test_the_network_synchronises_over_lossy_links():
    link = {"kind": "disk", "reach": 75.0, "loss": 0.4}
    run = ran(duration=2000.0, deploy=line(4), link=link, sync={"kind": "ftsp", "period": 10.0})
    assert run.table["spread_max"][-1] < 1e-4 and run.table["synchronised"][-1] == 1.0


@pytest.mark.thorough
def test_nodes_that_sleep_send_when_they_wake_and_hear_what_they_are_awake_for():
    sleep = {"kind": "duty_cycle", "period": 10.0, "awake_share": 0.2, "phases": "synchronous"}
    run = ran(duration=2400.0, mac={"kind": "csma"}, sleep=sleep, sync={"kind": "ftsp", "period": 30.0})
    sent = run.log["time"][run.log["kind"] == KIND["send"]]
    # Clocks that are not corrected yet are up to 0.1 s wrong.
    assert len(sent) > 9 * 60 and ((sent + 0.1) % 10.0 < 2.2).all()
    assert run.table["spread_max"][-1] < 1e-4


def test_a_run_with_synchronisation_is_repeatable_and_other_seeds_differ():
    first, again, other = (
        ran(seed=seed, duration=300.0, mac={"kind": "csma"}, sync={"kind": "ftsp", "period": 10.0})
        for seed in (1, 1, 2)
    )
    assert np.array_equal(first.errors, again.errors) and not np.array_equal(first.errors, other.errors)
    assert first.outcome.event_fingerprint == again.outcome.event_fingerprint


def test_a_message_that_the_mac_has_not_sent_yet_is_not_sent_twice():
    made = network(sync=QUICK)
    waiting = []
    made.sync._services.broadcast = lambda node, bits, done: waiting.append((node, done))
    made.world._start()
    made.env.run(until=20.0)
    assert sorted(node for node, _ in waiting) == list(range(9))


def test_a_message_that_waited_in_the_mac_says_the_root_whose_time_it_bears():
    # Node 2 follows node 1 and has a message waiting when it hears of node 0, whose clock shows another time.
    made = network(deploy=line(3), sync=QUICK, clock={"kind": "drift", "sd": 0, "offset": 0.5})
    sync, waiting, told = made.sync, [], []
    clocks = sync._services
    clocks.broadcast = lambda node, bits, done: waiting.append(done)
    first, other, late = sync._nodes
    first.root, other.root = 0, 1
    for _ in range(3):
        sync._send(1, other)
        waiting.pop()(np.array([2]))
    assert late.root == 1
    sync._send(2, late)
    for _ in range(2):
        sync._send(0, first)
        waiting.pop()(np.array([2]))
    assert late.root == 0
    sync._receive = lambda node, root, sequence, stamp, error: told.append((root, stamp))
    waiting.pop()(np.array([1]))
    assert all(stamp == pytest.approx(clocks.clock(root), abs=1e-3) for root, stamp in told)


class Cheat:
    """A component that sets clocks by what no node has heard, or forgets nothing."""

    mechanism = "cheat"

    def __init__(self, **told):
        self.told = told

    def start(self, services):
        return CheatMechanism(services, **self.told)


class CheatMechanism:
    def __init__(self, services, sends=True, forgets=True, sets=True, alike=True):
        self.services, self.sends, self.forgets, self.sets, self.alike = services, sends, forgets, sets, alike
        self.down = set()

    def begin(self):
        wait = 10.0 if self.alike else 10.0 + np.random.default_rng().uniform()
        self.services.call_later(wait, self.send)

    def send(self):
        for node in range(self.services.size) if self.sets else ():
            self.services.set_clock(node, self.services.now, 1.0)
        if self.sends:
            self.services.broadcast(0, 64, lambda nodes: None)
        self.begin()

    def forget(self, node):
        self.down.add(node)

    def is_synchronised(self, node):
        return node not in self.down or not self.forgets


@pytest.mark.thorough(fast=["told3-repeatable"])
@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"sets": False}, "agreement"), ({"sends": False}, "paid"), ({"forgets": False}, "forgets"),
        ({"alike": False}, "repeatable"),
    ],
)  # fmt: skip
def test_the_check_for_plug_ins_names_the_demand_that_fails(told, said):
    with pytest.raises(AssertionError, match=f"demand '{said}'"):
        check_sync(Cheat(**told))


def test_a_mechanism_without_a_member_of_its_port_is_refused():
    class Lacking:
        mechanism = "lacking"

        def start(self, services):
            return object()

    with pytest.raises(RunError, match=r"sync: object, which start.services. returned, lacks begin, forget, is_sync"):
        make_mechanism("sync", Lacking(), None)
    with pytest.raises(RunError, match=r"sync: unknown mechanism 'mine'.* known: none, ftsp"):
        make_mechanism("sync", SimpleNamespace(mechanism="mine"), None)
