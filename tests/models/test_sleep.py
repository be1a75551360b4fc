"""Sleep schedules, against a slow scan of all periods and against the theory of random independent sleeping."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from scipy import stats

from wsnsim.base.radio import Mode
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.setups import BeaconSetup
from wsnsim.models.access import Csma, IdealMac
from wsnsim.models.sleep import CHUNK, AlwaysOn, DutyCycle, EventWake, RandomIndependent

KEYS = derive_all(7, np.arange(60))
NEVER_ASLEEP = [EventWake(), AlwaysOn()]
AWAKE_THROUGHOUT = [*NEVER_ASLEEP, RandomIndependent(probability=1.0), DutyCycle(awake_share=1.0)]
PERIODIC = [
    RandomIndependent(),
    RandomIndependent(period=0.7, probability=0.5),
    RandomIndependent(probability=0.0),
    RandomIndependent(probability=1.0),
    DutyCycle(),
    DutyCycle(period=0.7, awake_share=0.9),
    DutyCycle(period=3.0, awake_share=0.1),
    DutyCycle(phases="synchronous"),
    DutyCycle(period=0.7, awake_share=0.1, phases="synchronous"),
    DutyCycle(awake_share=1.0),
]
schedules = pytest.mark.parametrize("schedule", PERIODIC, ids=repr)


def one(node):
    return KEYS[node : node + 1]


@functools.cache
def spans(schedule, key):
    """The reference: (begin, end, awake) of one node's periods until 100 s, one after the other, in plain floats."""
    phase, period = 0.0, schedule.period
    if not isinstance(schedule, DutyCycle) or schedule.phases == "staggered":
        phase = period * float(uniforms(np.array([key]), 0)[0])
    found, number = [], 0
    while (begin := phase + (number - 1) * period) <= 100.0:
        end = phase + number * period
        if isinstance(schedule, DutyCycle):
            off = end if schedule.awake_share == 1.0 else begin + period * schedule.awake_share
            found += [(begin, off, True), (off, end, False)]
        else:
            drawn = float(uniforms(np.array([derive(int(key), number + 1)], dtype=np.uint64), 0)[0])
            found.append((begin, end, drawn < schedule.probability))
        number += 1
    return [span for span in found if span[1] > span[0]]


def reference_sums(schedule, key, since, until):
    """Seconds awake in [since, until) and changes in (since, until], by the reference."""
    history = spans(schedule, key)
    seconds = sum(max(0.0, min(end, until) - max(begin, since)) for begin, end, on in history if on)
    changes = sum(
        on != before and since < begin <= until for (_, _, before), (begin, _, on) in itertools.pairwise(history)
    )
    return seconds, changes


@pytest.mark.thorough(fast=["DutyCycle(period=10.0, awake_share=0.3, phases='synchronous')"])
@schedules
def test_awake_nodes_are_those_that_a_period_by_period_scan_finds(schedule):
    for time in np.random.default_rng(1).uniform(0.0, 80.0, 30):
        truth = [next(on for begin, end, on in spans(schedule, key) if begin <= time < end) for key in KEYS]
        assert np.array_equal(schedule.awake(KEYS, time), truth)


@schedules
@pytest.mark.parametrize("time", [0.0, 4.4, 1e3 / 3, 1e6, 1e9 / 7])
def test_no_change_falls_into_the_span_around_a_time_and_the_next_span_begins_at_its_end(schedule, time):
    awake, since, until = schedule.state(KEYS, time)
    assert np.all((since <= time) & (time < until))
    for node in range(30):
        for inside in (max(0.0, since[node]), (max(0.0, since[node]) + until[node]) / 2, np.nextafter(until[node], 0)):
            assert schedule.awake(one(node), float(inside))[0] == awake[node]
        _, following, later = schedule.state(one(node), float(until[node]))
        assert following[0] == until[node] < later[0]


@schedules
def test_the_sums_of_each_node_are_those_of_a_period_by_period_scan(schedule):
    draw, until = np.random.default_rng(2), 43.21
    since = np.where(draw.random(len(KEYS)) < 0.2, 0.0, draw.uniform(0.0, until, len(KEYS)))
    seconds, changes = schedule.tally(KEYS, since, until)
    truth = np.array([reference_sums(schedule, key, begin, until) for key, begin in zip(KEYS, since, strict=True)])
    assert seconds == pytest.approx(truth[:, 0], abs=1e-9)
    assert np.array_equal(changes, truth[:, 1])


@pytest.mark.thorough(fast=["0.0-RandomIndependent(period=0.7, probability=0.5)"])
@schedules
@pytest.mark.parametrize("until", [0.0, 1.5, 7.0, 43.21])
def test_the_profile_is_the_sum_over_all_nodes(schedule, until):
    """Also at multiples of the period, where all nodes of a synchronous network change."""
    times = np.unique(np.concatenate((np.linspace(0.0, until, 9), np.arange(0.0, until, schedule.period))))
    awake, switches = schedule.profile(KEYS[:20], times)
    for time, seconds, changes in zip(times, awake, switches, strict=True):
        truth = np.array([reference_sums(schedule, key, 0.0, float(time)) for key in KEYS[:20]])
        assert seconds == pytest.approx(truth[:, 0].sum(), abs=1e-8)
        assert changes == truth[:, 1].sum()


@schedules
def test_two_spans_that_meet_at_a_change_add_up_to_one(schedule):
    """No change is lost or counted twice, although its time is rounded."""
    for time in (0.3, 1e3 / 3, 1e5 / 7):
        meet = schedule.state(KEYS, time)[2]
        for node in range(30):
            key, between, end = one(node), float(meet[node]), float(meet[node]) + 3.3 * schedule.period
            first = schedule.tally(key, np.array([time]), between)
            second = schedule.tally(key, meet[node : node + 1], end)
            whole = schedule.tally(key, np.array([time]), end)
            assert first[0] + second[0] == pytest.approx(whole[0], abs=1e-7)
            assert first[1] + second[1] == whole[1]
            changed = bool(schedule.awake(key, time)[0] != schedule.awake(key, between)[0])
            assert first[1] == changed


def test_an_awake_spell_that_ended_before_the_run_counts_zero():
    """Nodes whose first period began 2 s to 8 s before time 0 and is awake in its first second only."""
    schedule = DutyCycle(period=10.0, awake_share=0.1)
    early = derive_all(3, np.arange(2000))
    early = early[(uniforms(early, 0) > 0.2) & (uniforms(early, 0) < 0.8)]
    awake, switches = schedule.profile(early, np.array([0.0, 1.0, 2.0]))
    assert np.array_equal(awake, np.zeros(3))
    assert np.array_equal(switches, np.zeros(3))


@schedules
def test_an_empty_span_sums_to_zero(schedule):
    since = np.full(len(KEYS), 12.3)
    assert np.array_equal(schedule.tally(KEYS, since, 12.3), np.zeros((2, len(KEYS))))
    assert np.array_equal(schedule.profile(KEYS, np.zeros(3)), np.zeros((2, 3)))


@schedules
def test_empty_arrays_of_nodes_and_times_are_allowed(schedule):
    nobody = KEYS[:0]
    assert schedule.awake(nobody, 5.0).shape == (0,)
    assert [part.shape for part in schedule.tally(nobody, np.zeros(0), 5.0)] == [(0,), (0,)]
    assert np.array_equal(schedule.profile(nobody, np.array([1.0, 2.0])), np.zeros((2, 2)))
    assert [part.shape for part in schedule.profile(KEYS, np.zeros(0))] == [(0,), (0,)]


@pytest.mark.parametrize("schedule", AWAKE_THROUGHOUT, ids=repr)
def test_nodes_that_never_sleep_are_always_awake_and_never_change(schedule):
    since = np.linspace(0.0, 50.0, len(KEYS))
    seconds, changes = schedule.tally(KEYS, since, 50.0)
    assert seconds == pytest.approx(50.0 - since, abs=1e-9)
    assert not changes.any()
    assert schedule.awake(KEYS, 1e6).all()
    awake, switches = schedule.profile(KEYS, np.array([0.0, 3.0, 50.0]))
    assert awake == pytest.approx(len(KEYS) * np.array([0.0, 3.0, 50.0]))
    assert not switches.any()


def test_schedules_say_how_nodes_rest_and_whether_they_always_listen():
    assert [(schedule.rest, schedule.always_listening) for schedule in NEVER_ASLEEP] == [
        (Mode.DORMANT, True), (Mode.AWAKE, True),
    ]  # fmt: skip
    for schedule in NEVER_ASLEEP:
        _, since, until = schedule.state(KEYS, 3.0)
        assert np.array_equal(since, np.zeros(len(KEYS)))
        assert np.all(until == math.inf)
    assert {(schedule.rest, schedule.always_listening) for schedule in PERIODIC} == {(Mode.SCHEDULED, False)}


def test_nodes_with_probability_zero_are_never_awake():
    schedule = RandomIndependent(probability=0.0)
    assert not schedule.awake(KEYS, 123.4).any()
    assert np.array_equal(schedule.tally(KEYS, np.zeros(len(KEYS)), 123.4), np.zeros((2, len(KEYS))))


@schedules
def test_a_nodes_schedule_depends_on_its_own_key_alone(schedule):
    some = np.arange(len(KEYS))[::-7]
    assert np.array_equal(schedule.awake(KEYS, 33.3)[some], schedule.awake(KEYS[some], 33.3))
    seconds, changes = schedule.tally(KEYS, np.zeros(len(KEYS)), 33.3)
    again = schedule.tally(KEYS[some], np.zeros(some.size), 33.3)
    assert np.array_equal(again, (seconds[some], changes[some]))


MANY, PERIODS, P = derive_all(11, np.arange(20_000)), 40, 0.3
"""Numbers of nodes and periods for tests of theory; each test fails by chance with probability 1e-6."""
RIS = RandomIndependent(probability=P)


def draws():
    """(nodes, periods) whether nodes are awake in successive periods of their own, by the public interface."""
    middle = RIS.state(MANY, 0.0)[2] + RIS.period / 2
    rows = [[RIS.awake(MANY[i : i + 1], float(middle[i] + k * RIS.period))[0] for k in range(PERIODS)] for i in (0, 1)]
    table = np.column_stack([_at_own(middle + k * RIS.period) for k in range(PERIODS)])
    assert np.array_equal(table[:2], rows)
    return table


def _at_own(times):
    """(nodes,) which nodes are awake, each at a time of its own."""
    awake = np.zeros(len(MANY), dtype=bool)
    step = RIS.period / 8
    for tick in np.unique(np.floor(times / step)):
        chosen = np.floor(times / step) == tick
        awake[chosen] = RIS.awake(MANY[chosen], float(tick) * step)
    return awake


@pytest.fixture(scope="module")
def table():
    return draws()


def test_at_any_instant_a_share_p_of_the_nodes_is_awake():
    for time in (0.0, 7.7, 1234.5):
        assert stats.binomtest(int(RIS.awake(MANY, time).sum()), len(MANY), P).pvalue > 1e-6


def test_over_time_each_node_is_awake_a_share_p_of_its_periods():
    """One node over 20,000 whole periods: its seconds awake are a binomial number of periods."""
    start = float(RIS.state(one(0), 0.0)[2][0])
    seconds, changes = RIS.tally(one(0), np.array([start]), start + 20_000 * RIS.period)
    periods = seconds[0] / RIS.period
    assert periods == pytest.approx(round(periods), abs=1e-6)
    assert stats.binomtest(round(periods), 20_000, P).pvalue > 1e-6
    expected = 20_000 * 2 * P * (1 - P)  # a change at each beginning with probability 2p(1 - p); neighbours correlate:
    pairs = P * (1 - P) - (2 * P * (1 - P)) ** 2  # P(two changes in a row) = p(1 - p), less the square of one's
    deviation = math.sqrt(20_000 * (2 * P * (1 - P) * (1 - 2 * P * (1 - P)) + 2 * pairs))
    assert changes[0] == pytest.approx(expected, abs=5 * deviation)


def test_how_many_periods_nodes_are_awake_in_is_binomial(table):
    """Chi-square over the counts of 40 periods: neither nodes nor periods are correlated."""
    counts = np.bincount(table.sum(axis=1), minlength=PERIODS + 1)
    expected = len(MANY) * stats.binom(PERIODS, P).pmf(np.arange(PERIODS + 1))
    low, high = 4, 20
    pooled = [np.concatenate(([x[:low].sum()], x[low:high], [x[high:].sum()])) for x in (counts, expected)]
    assert stats.chisquare(*pooled).pvalue > 1e-6


@pytest.mark.parametrize("lag", [1, 2, 3, 7])
def test_a_nodes_periods_are_independent_of_its_earlier_ones(table, lag):
    now, later = table[:, :-lag].ravel(), table[:, lag:].ravel()
    counts = np.array([[np.sum((now == a) & (later == b)) for b in (0, 1)] for a in (0, 1)])
    assert stats.chi2_contingency(counts, correction=False).pvalue > 1e-6


@pytest.mark.parametrize("apart", [1, 2, 64])
def test_nodes_are_independent_of_nodes_with_numbers_near_theirs(table, apart):
    one_of, other = table[:-apart].ravel(), table[apart:].ravel()
    counts = np.array([[np.sum((one_of == a) & (other == b)) for b in (0, 1)] for a in (0, 1)])
    assert stats.chi2_contingency(counts, correction=False).pvalue > 1e-6


def test_how_many_of_a_hundred_neighbours_are_awake_scatters_as_independent_nodes_do():
    """Variance over 200 groups and 40 instants two periods apart: n p (1 - p)."""
    awake = [RIS.awake(MANY, 20.0 * k + 5.0).reshape(200, 100).sum(axis=1) for k in range(PERIODS)]
    numbers = np.concatenate(awake)
    assert numbers.var() == pytest.approx(100 * P * (1 - P), rel=5 * math.sqrt(2 / numbers.size))


@pytest.mark.parametrize("schedule", [RIS, DutyCycle()], ids=repr)
def test_phases_are_uniform_over_a_period_and_independent_of_being_awake(schedule):
    until = schedule.state(MANY, 0.0)[2] % schedule.period
    if schedule is RIS:
        phases, awake = until, RIS.awake(MANY, 0.0)
        assert stats.ks_2samp(phases[awake], phases[~awake]).pvalue > 1e-6
    else:
        phases = np.where(schedule.awake(MANY, 0.0), until - schedule.period * schedule.awake_share, until)
        phases %= schedule.period
    assert stats.kstest(phases / schedule.period, "uniform").pvalue > 1e-6


def test_a_synchronous_network_wakes_and_sleeps_as_one_and_a_staggered_one_never_does():
    times = np.linspace(0.0, 30.0, 301)[:-1]
    together = np.array([DutyCycle(phases="synchronous").awake(MANY[:2000], float(t)).mean() for t in times])
    assert set(together) == {0.0, 1.0}
    assert together.mean() == pytest.approx(0.3, abs=0.01)
    apart = np.array([DutyCycle().awake(MANY[:2000], float(t)).mean() for t in times])
    assert np.abs(apart - 0.3).max() < 5 * math.sqrt(0.21 / 2000)


@pytest.mark.parametrize("schedule", [RandomIndependent(period=0.5), DutyCycle(period=0.5)], ids=repr)
def test_sums_over_more_periods_than_one_chunk_are_exact(schedule):
    """The sums over short spans add up to the sum over the whole."""
    edges = np.linspace(0.0, 2.5 * CHUNK * 0.5, 8)
    assert edges[1] < CHUNK * 0.5 < edges[-1]
    since, keys = np.zeros(3), KEYS[:3]
    parts = [schedule.tally(keys, np.full(3, a), float(b)) for a, b in itertools.pairwise(edges)]
    seconds, changes = schedule.tally(keys, since, float(edges[-1]))
    assert seconds == pytest.approx(np.sum([part[0] for part in parts], axis=0), rel=1e-9)
    assert np.array_equal(changes, np.sum([part[1] for part in parts], axis=0))
    awake, switches = schedule.profile(keys, edges)
    assert awake[-1] == pytest.approx(seconds.sum(), rel=1e-9)
    assert switches[-1] == changes.sum()


def test_a_duty_cycles_seconds_are_exact_fractions():
    """By hand, in fractions: 3 s of every 10; at 1,000,004 s it has been awake for 300,000 + 3 s."""
    schedule = DutyCycle(period=10.0, awake_share=0.3, phases="synchronous")
    seconds, changes = schedule.tally(one(0), np.zeros(1), 1_000_004.0)
    assert seconds[0] == pytest.approx(float(Fraction(3, 10) * 1_000_000 + 3), rel=1e-12)
    assert changes[0] == 200_001


def setup_with(schedule, mac, steps=100, dt=2.0):
    names = dict.fromkeys(field.name for field in dataclasses.fields(BeaconSetup))
    return BeaconSetup(**names | {"sleep": schedule, "mac": mac, "steps": steps, "dt": dt})


def issues_of(schedule, mac=None, **times):
    parts = setup_with(schedule, mac or Csma(), **times)
    return [(issue.path, issue.message) for issue in schedule.check(parts)]


def test_the_papers_schedule_has_no_issue():
    assert not issues_of(RandomIndependent())
    assert not issues_of(DutyCycle())
    assert not issues_of(DutyCycle(), IdealMac())


def test_being_awake_for_less_than_two_of_the_longest_frames_is_an_issue():
    """133 bytes at 250 kbit/s take 4.256 ms: at least 8.512 ms are needed."""
    [(path, message)] = issues_of(DutyCycle(period=0.085, awake_share=0.1))
    assert path == ("sleep", "period")
    assert "8.5 ms" in message and "4.26 ms" in message
    assert not issues_of(DutyCycle(period=0.086, awake_share=0.1))
    assert not issues_of(RandomIndependent(period=0.01, probability=0.1))


def test_a_run_of_too_many_periods_is_an_issue():
    [(path, message)] = issues_of(RandomIndependent(period=0.01), steps=1000, dt=1e6)
    assert path == ("sleep", "period")
    assert "1e+11 periods" in message and "10,000,000" in message
    assert not issues_of(RandomIndependent(), steps=999, dt=1e5)


@pytest.mark.parametrize("time", [0, 0.0, np.zeros(2, dtype=np.int64)], ids=["int", "float", "array"])
def test_a_schedule_needs_one_compilation_of_its_kernel_whatever_number_the_time_is(monkeypatch, time):
    types = []
    monkeypatch.setattr("wsnsim.models.sleep.period_spans", lambda keys, times, *rest: types.append(times.dtype))
    DutyCycle().state(KEYS[:2], time)
    assert types == [np.float64]
