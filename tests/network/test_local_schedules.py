"""Sleep schedules by clocks that drift, jump and are corrected: against brute force, and whole networks' ledgers."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import simpy

from tests.network.clock_networks import ran
from wsnsim.base.rng import derive_all
from wsnsim.models.hardware import DriftingClock, PerfectClock
from wsnsim.models.sleep import DutyCycle, RandomIndependent
from wsnsim.network.clocks import Clocks
from wsnsim.network.energy.local_schedules import LocalSchedules

NODES = np.arange(12)
SCHEDULES = [
    RandomIndependent(period=1.0, probability=0.4),
    DutyCycle(period=0.7, awake_share=0.3),
    DutyCycle(period=1.0, awake_share=0.5, phases="synchronous"),
]
schedules = pytest.mark.parametrize("schedule", SCHEDULES, ids=["ris", "staggered", "synchronous"])


def restless(schedule, clock=None, until=20.0):
    """Local schedules whose clocks are stepped and corrected at random times, and what they showed: error(node, t)."""
    env = simpy.Environment()
    clocks = Clocks(clock or DriftingClock(sd=0.01, offset=0.3), 3, NODES.size, env)
    local = LocalSchedules(schedule, derive_all(5, NODES), clocks)
    rng, history = np.random.default_rng(2), []

    def changed(node):
        local.note_change(node, env.now)
        history.append((env.now, node, *(float(each[0]) for each in clocks.error_lines(np.array([node])))))

    history += [
        (-1.0, node, *map(float, line)) for node, line in enumerate(zip(*clocks.error_lines(NODES), strict=True))
    ]
    clocks.on_step.append(changed)
    for time in np.sort(rng.uniform(0.0, until, 60)).tolist():
        env.run(until=time)
        node = int(rng.integers(9))  # three clocks are left alone
        if rng.uniform() < 0.5:
            clocks.step([node], rng.normal(0, 0.4))
        else:
            clocks.correct(node, rng.normal(0, 0.2), 1.0 + rng.normal(0, 0.01))
    env.run(until=until)

    def error(node, time):
        _, _, base, slope = [row for row in history if row[1] == node and row[0] <= time][-1]
        return base + slope * time

    return SimpleNamespace(local=local, schedule=schedule, error=error, keys=derive_all(5, NODES), history=history)


@schedules
def test_a_node_is_awake_when_its_clock_at_that_time_says_so(schedule):
    made, rng = restless(schedule), np.random.default_rng(7)
    for time in rng.uniform(0.0, 20.0, 40).tolist():
        awake, since, until = made.local.state(NODES, time)
        shown = [time + made.error(node, time) for node in NODES]
        expected = [bool(schedule.awake(made.keys[i : i + 1], shown[i])[0]) for i in NODES]
        assert awake.tolist() == expected
        assert (since <= time).all() and (time < until).all()
        for node in NODES.tolist():  # the span holds no change
            for inside in rng.uniform(max(since[node], 0.0), min(until[node], 20.0), 3).tolist():
                shows = inside + made.error(node, inside)
                assert schedule.awake(made.keys[node : node + 1], shows)[0] == awake[node]


@pytest.mark.thorough
@schedules
def test_tallies_of_spans_are_those_of_a_fine_grid_and_add_up_to_the_last_bits(schedule):
    made = restless(schedule)
    grid = np.linspace(0.0, 20.0, 40_001)
    for node in (0, 4, 11):
        shown = np.array([time + made.error(node, time) for time in grid[:-1]])
        state = schedule.awake(np.repeat(made.keys[node], shown.size), shown)
        awake, switches = made.local.tally(np.array([node]), np.zeros(1), 20.0)
        assert awake[0] == pytest.approx(state.mean() * 20.0, abs=0.03)
        assert switches[0] == pytest.approx((state[1:] != state[:-1]).sum(), abs=2)
        changes = [row[0] for row in made.history if row[1] == node and row[0] > 0]
        cuts = np.sort([0.0, 20.0, *np.random.default_rng(node).uniform(0, 20, 30), *changes[::2]])
        parts = [made.local.tally(np.array([node]), np.array([a]), b) for a, b in pairwise(cuts)]
        assert sum(float(part[0][0]) for part in parts) == pytest.approx(float(awake[0]), rel=1e-11)
        assert sum(float(part[1][0]) for part in parts) == switches[0]


@schedules
def test_the_profile_of_all_nodes_is_the_sum_of_their_tallies_at_times_of_changes_too(schedule):
    made = restless(schedule)
    times = np.sort([0.0, 3.3, 20.0, *(row[0] for row in made.history[NODES.size :: 7])])
    awake, switches = made.local.profile(times)
    for index, time in enumerate(times.tolist()):
        one = made.local.tally(NODES, np.zeros(NODES.size), time)
        assert awake[index] == pytest.approx(one[0].sum(), rel=1e-11, abs=1e-12) and switches[index] == one[1].sum()


@schedules
def test_the_most_switches_bound_those_of_every_node(schedule):
    made = restless(schedule)
    assert made.local.tally(NODES, np.zeros(NODES.size), 20.0)[1].max() <= made.local.most_switches(20.0)


@schedules
def test_perfect_clocks_ask_the_schedule_itself_and_a_first_step_changes_nothing_before_it(schedule):
    env = simpy.Environment()
    clocks = Clocks(PerfectClock(), 3, NODES.size, env)
    keys = derive_all(5, NODES)
    local = LocalSchedules(schedule, keys, clocks)
    since = np.linspace(0, 3, NODES.size)
    before = local.tally(NODES, since, 9.0), local.profile(np.array([4.0, 9.0])), local.state(NODES, 3.3)
    assert np.array_equal(before[0], schedule.tally(keys, since, 9.0))
    assert np.array_equal(before[1], schedule.profile(keys, np.array([4.0, 9.0])))
    assert np.array_equal(before[2], schedule.state(keys, 3.3))
    clocks.on_step.append(lambda node: local.note_change(node, env.now))
    env.run(until=10.0)
    clocks.step(NODES.tolist(), 0.25)
    assert np.allclose(local.tally(NODES, since, 9.0), before[0], rtol=1e-12)
    assert np.allclose(local.profile(np.array([4.0, 9.0])), before[1], rtol=1e-12)
    assert np.array_equal(local.state(NODES, 3.3)[0], before[2][0])


SLEEP = {"kind": "duty_cycle", "period": 10.0, "awake_share": 0.2, "phases": "synchronous"}
PRICES = {"kind": "first_order", "idle": 0.03, "sleep": 1e-4, "switch": 1e-3, "battery": 1e4}


def overlap(run, period=10.0, awake=2.0):
    """(T,) the mean share of its awake time that a node shares with another one: 1 - |difference| / awake time."""
    errors = run.errors
    apart = np.abs(errors[:, :, None] - errors[:, None, :]) % period
    apart = np.minimum(apart, period - apart)
    shared = np.clip(1.0 - apart / awake, 0.0, 1.0)
    others = ~np.eye(errors.shape[1], dtype=bool)
    return shared[:, others].mean(axis=1)


def awake_together(run, times):
    """(T,) the same from what the schedules say: awake together within a period before a time, over awake at all."""
    schedules = run.world._nodes.sleep_states._schedules
    shares = []
    for time in times:
        moments = np.linspace(time - 10.0, time, 2000, endpoint=False)
        awake = np.array([schedules.state(np.arange(schedules.size), moment)[0] for moment in moments])
        together = (awake[:, :, None] & awake[:, None, :]).sum(axis=0)
        others = ~np.eye(schedules.size, dtype=bool)
        shares.append(together[others].sum() / (np.repeat(np.diag(together)[:, None], schedules.size, 1)[others].sum()))
    return np.array(shares)


@pytest.mark.thorough
def test_schedules_that_should_coincide_fall_apart_as_the_closed_form_says_and_with_ftsp_they_do_not():
    # 30 ppm: two nodes part by some 42 µs a second; after 2 s / 42 µs/s = 13 hours they no longer meet.
    base = {"duration": 72_000.0, "step": 3600.0, "sleep": SLEEP, "clock": {"kind": "drift"}, "energy": PRICES}
    alone = ran(**base)
    times = np.array([3600.0, 36_000.0, 68_400.0])
    expected = overlap(alone)[(times / 3600).astype(int)]
    assert awake_together(alone, times) == pytest.approx(expected, abs=0.01)
    assert expected[0] > 0.9 > 0.6 > expected[-1]
    together = ran(**{**base, "duration": 7200.0, "step": 600.0}, sync={"kind": "ftsp", "period": 100.0})
    assert awake_together(together, np.array([6600.0])) == pytest.approx([1.0], abs=0.001)
    assert overlap(together)[-1] > 0.9999


@pytest.mark.parametrize("sync", [{"kind": "none"}, {"kind": "ftsp", "period": 7.0, "jitter": 0.01, "outlier": 1.0}])
@pytest.mark.parametrize("kind", ["duty_cycle", "ris"])
def test_the_ledger_of_nodes_whose_clocks_drift_jump_and_are_corrected_closes(kind, sync):
    sleep = {**SLEEP, "period": 3.0} if kind == "duty_cycle" else {"kind": "ris", "period": 2.0}
    faults = [
        {"kind": "clock_step", "at": 31.0, "duration": 20.0, "fraction": 0.5, "offset": 1.1},
        {"kind": "crash", "at": 40.2, "duration": 15.0, "nodes": [3, 5]},
    ]
    run = ran(
        duration=120.0, step=1.0, sleep=sleep, clock={"kind": "drift", "sd": 0.009, "offset": 0.7}, energy=PRICES,
        mac={"kind": "csma"}, sync=sync, faults=faults,
    )  # fmt: skip
    nodes = run.outcome.nodes
    by_cause = dict.fromkeys(range(len(nodes.ledger.totals)), 0.0)
    steps = run.memory.table("energy_steps")
    for cause, joules in zip(steps["cause"].tolist(), steps["joules"].tolist(), strict=True):
        by_cause[cause] += joules
    for cause, total in enumerate(nodes.ledger.totals):
        assert by_cause[cause] == pytest.approx(total, rel=1e-9, abs=1e-12)
    spent = nodes.ledger.joules.sum(axis=0)
    assert spent == pytest.approx(np.asarray(nodes.ledger.spent), rel=1e-9)


def test_a_node_with_a_fast_clock_is_awake_as_long_as_its_clock_says_and_dies_when_that_has_used_it_up():
    lasting = {"kind": "first_order", "idle": 0.03, "sleep": 0.0, "switch": 0.0, "battery": 0.6}
    clock = {"kind": "drift", "sd": 0.01}
    run = ran(duration=200.0, step=10.0, sleep={**SLEEP, "period": 10.0}, clock=clock, energy=lasting)
    died = run.outcome.nodes.died_at
    assert len(died) == 9
    for node, time in died.items():
        # 20 s awake at 30 mW, which are 20 r s of its clock: 2 s in each 10 s of it.
        shown = 20.0 * run.clocks.rate(node)
        assert time * run.clocks.rate(node) == pytest.approx(10.0 * (shown // 2.0) + shown % 2.0, rel=1e-6)
