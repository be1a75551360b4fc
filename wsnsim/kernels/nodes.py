"""Which nodes listen, what their sleep schedules say, and charges for several nodes, in one pass over them.

    listening(nodes, time, ..., result) -> unknown
    period_spans(keys, times, law, awake, begins, ends)        period_sums(keys, since, until, law, seconds, changes)
    book(nodes, joules, spent, spent_on)                  the energy ledger
    mark_busy(nodes, seconds, busy, states, ...)          background consumption

A schedule in periods has a law: period in s, awake part of a period in s, probability of being awake in a period, and
whether each node's periods have a phase of its own. The random numbers are those of `base.rng`. For the few neighbours
of a sender each is several times as fast as the same in array operations.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.kernels.compilation import exact_inlined, exact_kernel, kernel
from wsnsim.kernels.elementary import GOLDEN, ONE, mix, uniform

Law: TypeAlias = tuple[float, float, float, bool]
"""(period, awake part, probability, staggered)"""


@kernel
def listening(
    nodes: Ints, time: float, living: Bools, awake: Bools, begins: Floats, ends: Floats, held: Bools, since: Floats,
    result: Bools,
) -> int:  # fmt: skip
    """Find which nodes (n,) are living and have been awake since a time, by schedule or because they were held awake.

    Args:
        nodes: (n,) the nodes.
        time: The time in s.
        living: (N,) which nodes are up.
        awake: (N,) what the schedules last said.
        begins: (N,) from when on they said so, in s.
        ends: (N,) until when, in s.
        held: (N,) which nodes are held awake.
        since: (N,) from when on, in s.
        result: (n,) in which the answer is written.

    Returns:
        The number of nodes of which the schedule must be asked first, because what it said is not about this time.
    """
    unknown = 0
    for i in range(nodes.size):
        node = nodes[i]
        if not begins[node] <= time < ends[node]:
            unknown += 1
        result[i] = living[node] and (awake[node] or (held[node] and since[node] <= time))
    return unknown


@exact_inlined
def _start(phase: float, period: float, number: int) -> float:
    """When a period begins. All comparisons use this one formula, so that rounding is the same everywhere."""
    return phase + (number - 1) * period


@exact_inlined
def _number(phase: float, period: float, time: float) -> int:
    """The number of the period at a time: a quotient, corrected where rounding crossed a beginning."""
    number = int(np.floor((time - phase) / period)) + 1
    if _start(phase, period, number) > time:
        number -= 1
    if _start(phase, period, number + 1) <= time:
        number += 1
    return number


@exact_inlined
def _is_on(key: np.uint64, number: int, probability: float) -> bool:
    """Whether a node is awake in a period, of which number 0 contains time 0."""
    return uniform(mix(key + (np.uint64(np.int64(number + 1)) + ONE) * GOLDEN), 0) < probability


@exact_kernel
def period_spans(keys: Keys, times: Floats, law: Law, awake: Bools, begins: Floats, ends: Floats) -> None:
    """Find what the schedules say at a time of each, and the part of a period around it for which they say so.

    Args:
        keys: (n,) the counter keys of the nodes.
        times: (n,) times in s.
        law: The law of the schedules.
        awake: (n,) in which is written which nodes are awake.
        begins: (n,) in which is written from when on, in s.
        ends: (n,) in which is written until when, in s.
    """
    period, length, probability, staggered = law
    for i in range(keys.size):
        phase = period * uniform(keys[i], 0) if staggered else 0.0
        number = _number(phase, period, times[i])
        awake[i] = _is_on(keys[i], number, probability)
        begins[i], ends[i] = _start(phase, period, number), _start(phase, period, number + 1)
        if length < period:
            falls_asleep = begins[i] + length
            if times[i] >= falls_asleep:
                awake[i], begins[i] = False, falls_asleep
            else:
                ends[i] = falls_asleep


@exact_kernel
def period_sums(keys: Keys, since: Floats, until: Floats, law: Law, seconds: Floats, changes: Floats) -> None:
    """Find for how long each node is awake in [since, until), and how often it changes in (since, until].

    Args:
        keys: (n,) the counter keys of the nodes.
        since: (n,) times in s.
        until: (n,) times in s.
        law: The law of the schedules.
        seconds: (n,) in which the time awake is written, in s.
        changes: (n,) in which the number of changes is written.
    """
    period, length, probability, staggered = law
    for i in range(keys.size):
        phase = period * uniform(keys[i], 0) if staggered else 0.0
        first, total, count = _number(phase, period, since[i]), 0.0, 0
        before = _is_on(keys[i], first - 1, probability)
        for number in range(first, _number(phase, period, until[i]) + 1):
            on, start = _is_on(keys[i], number, probability), _start(phase, period, number)
            end = start + length
            if on:
                total += max(min(end, until[i]) - max(start, since[i]), 0.0)
            if on if length < period else on != before:
                count += since[i] < start <= until[i]
            if on and length < period:
                count += since[i] < end <= until[i]
            before = on
        seconds[i], changes[i] = total, count


@kernel
def book(nodes: Ints, joules: float, spent: Floats, spent_on: Floats) -> None:
    """Add joules to what different nodes (n,) have spent (N,), and to what they have spent on one cause (N,)."""
    for i in range(nodes.size):
        spent[nodes[i]] += joules
        spent_on[nodes[i]] += joules


@exact_kernel
def mark_busy(
    nodes: Ints, seconds: float, busy: Floats, states: NDArray[np.int16], counts: Ints,
    powers: Floats, causes: Ints, totals: Floats,
) -> None:  # fmt: skip
    """Add seconds to the time for which the radios of different nodes (n,) were busy (N,).

    What they would have consumed in that time is subtracted from the network's totals, state by state.

    Args:
        nodes: (n,) the nodes.
        seconds: The time in s.
        busy: (N,) the time of all nodes in s.
        states: (N,) the state of each node: its mode, and what its radio does.
        counts: (states,) in which is written how many of the nodes are in each state.
        powers: (states,) the power of a radio in each state, in W.
        causes: (states,) on which it is booked.
        totals: (causes,) the network's totals in J.
    """
    counts[:] = 0
    for i in range(nodes.size):
        busy[nodes[i]] += seconds
        counts[states[nodes[i]]] += 1
    for state in range(counts.size):
        if counts[state] > 0:
            totals[causes[state]] -= powers[state] * seconds * counts[state]
