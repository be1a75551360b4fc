"""Nodes that listen, sleep schedules in periods, and charges of several nodes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench.frames import schedules, sleepers, spells
from wsnsim.base.radio import Mode
from wsnsim.base.rng import derive_each, uniforms
from wsnsim.kernels.nodes import book, listening, mark_busy, period_spans, period_sums

LAWS = [(10.0, 10.0, 0.3, True), (0.7, 0.7, 0.5, True), (3.0, 0.3, 1.0, True), (0.7, 0.63, 1.0, False)]
laws = pytest.mark.parametrize("law", LAWS, ids=repr)


def listening_twin(nodes, time, living, awake, begins, ends, held, since, result):
    """`listening` by masks."""
    result[:] = living[nodes] & (awake[nodes] | (held[nodes] & (since[nodes] <= time)))
    return int((~((begins[nodes] <= time) & (time < ends[nodes]))).sum())


@pytest.mark.parametrize("count", [1, 7, 60])
def test_who_listens_and_whose_schedule_must_be_asked_are_those_of_the_twin(count):
    mine, twins = sleepers(count), sleepers(count)
    assert listening(*mine) == listening_twin(*twins)
    assert np.array_equal(mine[-1], twins[-1])


def test_a_schedule_is_asked_at_the_end_of_what_it_said_and_not_at_its_beginning():
    *arguments, result = sleepers(1)
    for time, unknown in ((1.0, 0), (2.0, 1)):
        arguments[1], arguments[4][:], arguments[5][:] = time, 1.0, 2.0
        assert listening(*arguments, result) == unknown


def phases_of(keys, law):
    """(n,) when a period of each node begins."""
    return law[0] * uniforms(keys, 0) if law[3] else np.zeros(keys.size)


def starts_of(phases, numbers, law):
    """(n,) when periods begin."""
    return phases + (numbers - 1) * law[0]


def numbers_of(phases, time, law):
    """(n,) the number of each node's period at a time."""
    numbers = np.floor((time - phases) / law[0]).astype(np.int64) + 1
    numbers -= starts_of(phases, numbers, law) > time
    numbers += starts_of(phases, numbers + 1, law) <= time
    return numbers


def on_of(keys, numbers, law):
    """(n,) whether nodes are awake in their periods."""
    return uniforms(derive_each(keys, (numbers + 1).astype(np.uint64)), 0) < law[2]


def period_spans_twin(keys, times, law, awake, begins, ends):
    """`period_spans` in array operations."""
    phases = phases_of(keys, law)
    numbers = numbers_of(phases, times, law)
    begins[:], ends[:] = starts_of(phases, numbers, law), starts_of(phases, numbers + 1, law)
    awake[:] = on_of(keys, numbers, law)
    if law[1] < law[0]:
        asleep_from = begins + law[1]
        late = times >= asleep_from
        awake &= ~late
        begins[:], ends[:] = np.where(late, asleep_from, begins), np.where(late, ends, asleep_from)


def period_sums_twin(keys, since, until, law, seconds, changes):
    """`period_sums` node by node, in array operations over its periods."""
    phases = phases_of(keys, law)
    first, last = numbers_of(phases, since, law), numbers_of(phases, until, law)
    for i in range(keys.size):
        numbers = np.arange(first[i] - 1, last[i] + 1)
        on, starts = on_of(keys[i], numbers, law), starts_of(phases[i], numbers[1:], law)
        spells = np.minimum(starts + law[1], until[i]) - np.maximum(starts, since[i])
        seconds[i] = np.bincount(np.zeros(starts.size, np.int64), np.maximum(spells, 0.0) * on[1:], 1)[0]
        times = np.concatenate((starts, starts + law[1])) if law[1] < law[0] else starts[on[1:] != on[:-1]]
        changes[i] = np.sum((since[i] < times) & (times <= until[i]))


@laws
@pytest.mark.parametrize("time", [0.0, 4.4, 1e3 / 3, 0.7 * 1000, 1e9 / 7])
def test_what_schedules_say_has_the_bits_of_array_operations(law, time):
    mine, twins = schedules(200), schedules(200)
    times = time + np.random.default_rng(1).uniform(-20.0, 20.0, 200)
    times[:100] = time
    period_spans(mine[0], times, law, *mine[3:])
    period_spans_twin(twins[0], times, law, *twins[3:])
    for got, wanted in zip(mine[3:], twins[3:], strict=True):
        assert np.array_equal(got, wanted)


@laws
def test_sums_over_periods_have_the_bits_of_array_operations(law):
    keys, since, until, _, *mine = spells(200)
    *_, twin_seconds, twin_changes = spells(200)
    period_sums(keys, since, until, law, *mine)
    period_sums_twin(keys, since, until, law, twin_seconds, twin_changes)
    assert np.array_equal(mine[0], twin_seconds)
    assert np.array_equal(mine[1], twin_changes)
    assert twin_changes.any()


NODES = np.array([1, 4, 5])


def book_twin(nodes, joules, spent, spent_on):
    """`book` in array operations."""
    spent[nodes] += joules
    spent_on[nodes] += joules


def mark_busy_twin(nodes, seconds, busy, states, counts, powers, causes, totals):
    """`mark_busy` in array operations."""
    busy[nodes] += seconds
    counts[:] = np.bincount(states[nodes], minlength=counts.size)
    for state, count in enumerate(counts.tolist()):
        totals[causes[state]] -= powers[state] * seconds * count


def test_a_charge_is_added_to_the_chosen_nodes_on_both_accounts():
    mine, twins = ([np.full(6, 1.0), np.full(6, 0.25)] for _ in range(2))
    book(NODES, 0.1, *mine)
    book_twin(NODES, 0.1, *twins)
    assert np.array_equal(mine, twins) and mine[0].tolist() == [1.0, 1.1, 1.0, 1.0, 1.1, 1.1]


def test_busy_seconds_are_added_and_what_they_would_have_cost_is_subtracted():
    states, powers, causes = (
        np.array([0, 1, 2, 3, 4, 4], dtype=np.int16),
        np.linspace(0.1, 0.3, 5),
        np.array([2, 1, 1, 0, 1]),
    )
    mine, twins = ((np.zeros(6), states, np.full(len(Mode), 9), powers, causes, np.full(3, 1.0)) for _ in range(2))
    mark_busy(NODES, 0.5, *mine)
    mark_busy_twin(NODES, 0.5, *twins)
    assert mine[0].tolist() == [0.0, 0.5, 0.0, 0.0, 0.5, 0.5] and mine[2].tolist() == [0, 1, 0, 0, 2]
    assert mine[-1].tolist() == twins[-1].tolist() == pytest.approx([1.0, 1.0 - 0.15 * 0.5 - 0.3 * 0.5 * 2, 1.0])
    assert np.array_equal(mine[0], twins[0]) and np.array_equal(mine[2], twins[2])
