"""Receptions at the neighbours of a sender, and links whose losses come in bursts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.bench.frames import bursty_links, frame, interferer, links, other_frame, rivals, sending
from wsnsim.base.rng import derive, derive_all, derive_each, uniforms
from wsnsim.kernels.reception import (
    COLLIDED,
    FOREIGN,
    HIT,
    LOST,
    RECEIVED,
    add_common,
    advance,
    find_links,
    outcomes,
    overlap,
    take_over,
    unlock,
)


def find_links_twin(positions, sources, ids, pair_key, direction_key, distances, pairs, directions):
    """`find_links` in array operations."""
    apart = positions[sources] - positions[ids]
    distances[:] = np.sqrt(apart[:, 0] ** 2 + apart[:, 1] ** 2)
    low, high = np.minimum(sources, ids), np.maximum(sources, ids)
    pairs[:] = derive_each(derive_all(int(pair_key), low), high.astype(np.uint64))
    links = derive_each(derive_all(int(direction_key), low), high.astype(np.uint64))
    directions[:] = np.where(sources == low, links, ~links)


def overlap_twin(ids, others, source, mark, paid, end, marks, until):
    """`overlap` by sets."""
    here, sender = np.isin(ids, others), ids == source
    marks[here] |= mark
    until[here] = np.maximum(until[here], paid)
    marks[sender] |= HIT
    until[sender] = end


def outcomes_twin(key, numbers, ids, thresholds, usable, hears, marks, until, to, order, groups):
    """`outcomes` by masks."""
    quiet, everyone = marks.size == 0, to < 0
    marks, until = (np.zeros(ids.size, np.int64), np.zeros(ids.size)) if quiet else (marks, until)
    usable = usable if usable.size else np.ones(ids.size, dtype=bool)
    arrives = hears & (marks < HIT)
    if thresholds.size:
        arrives &= uniforms(derive_all(derive(int(key), *numbers), ids), 0) >= thresholds
    collides = hears & ~arrives & (marks > 0) & usable
    meant = hears & usable if everyone else ids == to
    masks = {
        RECEIVED: arrives if everyone else arrives & meant,
        COLLIDED: collides & meant,
        FOREIGN: (arrives | collides) & ~meant if not everyone else np.zeros_like(arrives),
        LOST: meant & ~(arrives | collides),
    }
    count = size = 0
    for outcome, mask in masks.items():
        for time in [0.0] if quiet or outcome == LOST else np.unique(until[mask])[::-1]:
            chosen = ids[mask] if quiet or outcome == LOST else ids[mask & (until == time)]
            if chosen.size:
                groups[count] = outcome, size, size + chosen.size, time
                order[size : size + chosen.size] = chosen
                count, size = count + 1, size + chosen.size
    return count, int(meant.sum()), int((meant & arrives).sum())


def add_common_twin(ids, others, values, sums):
    """`add_common` by a dictionary."""
    heard = dict(zip(others.tolist(), values.tolist(), strict=True))
    sums += [heard.get(node, 0.0) for node in ids.tolist()]


def unlock_twin(ids, locks, node):
    """`unlock` by a mask."""
    locks[ids == node] = False


def take_over_twin(ids, powers, locks, others, other_powers, other_locks, margin):
    """`take_over` by masks."""
    _, here, there = np.intersect1d(ids, others, return_indices=True)
    held = other_locks[there].copy()
    takes = held & locks[here] & (powers[here] >= other_powers[there] + margin)
    other_locks[there[takes]] = False
    locks[here[held & ~takes]] = False


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("to", "busy"), [(-1, False), (-1, True), (3, False), (3, True)])
def test_the_outcomes_of_a_frame_are_those_of_the_twin(seed, to, busy):
    for count in (5, 40):
        mine, twins = frame(count, seed, to, busy), frame(count, seed, to, busy)
        assert outcomes(*mine) == outcomes_twin(*twins)
        assert np.array_equal(mine[-2], twins[-2]) and np.array_equal(mine[-1], twins[-1])


def test_without_thresholds_every_frame_arrives_that_is_heard_and_not_hit():
    key, numbers, ids, _, usable, hears, marks, until, to, order, groups = frame(30)
    count, in_range, _ = outcomes(key, numbers, ids, np.zeros(0), usable[:0], hears, marks, until, to, order, groups)
    received = np.concatenate([order[int(b) : int(e)] for outcome, b, e, _ in groups[:count] if outcome == RECEIVED])
    assert np.sort(received).tolist() == ids[hears & (marks < HIT)].tolist() and in_range == hears.sum()


def test_a_frame_that_nobody_may_hear_has_no_outcome():
    empty = frame(1)
    assert outcomes(*empty[:2], *(part[:0] for part in empty[2:8]), -1, *empty[9:]) == (0, 0, 0)


@pytest.mark.parametrize("count", [1, 6, 50])
def test_an_overlapping_frame_marks_those_who_hear_both_and_its_own_sender(count):
    mine, twins = other_frame(count), other_frame(count)
    overlap(*mine)
    overlap_twin(*twins)
    assert np.array_equal(mine[6], twins[6]) and np.array_equal(mine[7], twins[7])
    assert mine[6][0] & HIT and mine[7][0] == 2.0


def test_a_frame_for_which_others_have_paid_longer_already_raises_nothing():
    *arguments, marks, until = other_frame(6)
    until[:] = 1.75
    overlap(*arguments, marks, until)
    assert until.tolist() == [2.0, *[1.75] * 5]


@pytest.mark.parametrize(
    ("kernel", "twin", "maker"),
    [(add_common, add_common_twin, interferer), (unlock, unlock_twin, sending), (take_over, take_over_twin, rivals)],
)
@pytest.mark.parametrize("count", [1, 6, 50])
def test_interference_and_capture_are_those_of_the_twins(kernel, twin, maker, count):
    mine, twins = maker(count), maker(count)
    kernel(*mine)
    twin(*twins)
    assert all(np.array_equal(a, b) for a, b in zip(mine, twins, strict=True))


@pytest.mark.parametrize("count", [1, 8, 300])
def test_lengths_and_keys_of_links_have_the_bits_of_array_operations(count):
    mine, twins = links(count), links(count)
    find_links(*mine)
    find_links_twin(*twins)
    for got, wanted in zip(mine[-3:], twins[-3:], strict=True):
        assert np.array_equal(got, wanted)


def test_the_keys_of_the_two_directions_of_a_link_are_equal_and_complements():
    positions, sources, ids, *keys = links(8)[:5]
    there, back = ((np.zeros(8), np.zeros(8, np.uint64), np.zeros(8, np.uint64)) for _ in range(2))
    find_links(positions, sources, ids, *keys, *there)
    find_links(positions, ids, sources, *keys, *back)
    assert np.array_equal(there[0], back[0]) and np.array_equal(there[1], back[1])
    apart = sources != ids
    assert np.array_equal(there[2][apart], ~back[2][apart])


def advance_twin(keys, durations, time, good, until, counts):
    """`advance` with one change after the other, and the numbers of `base.rng`."""
    for i in range(keys.size):
        while until[i] <= time:
            good[i] = not good[i]
            (u,) = uniforms(keys[i : i + 1], int(counts[i])).tolist()
            until[i] += durations[i, 1 if good[i] else 0] * -math.log1p(-u)
            counts[i] += 1
    return until.min(initial=math.inf)


@pytest.mark.parametrize("count", [1, 10])
@pytest.mark.parametrize("time", [0.0, 2.0, 50.0])
def test_the_states_at_a_time_are_those_of_the_twin(count, time):
    mine, twins = bursty_links(count), bursty_links(count)
    following, expected = advance(*mine[:2], time, *mine[3:]), advance_twin(*twins[:2], time, *twins[3:])
    assert following == pytest.approx(expected, rel=1e-12) and following > time
    for one, other in zip(mine[3:], twins[3:], strict=True):
        assert one == pytest.approx(other, rel=1e-12)


def test_a_link_without_an_end_of_its_state_never_changes():
    keys, durations, time, good, until, counts = bursty_links(3)
    until[:] = np.inf
    assert math.isinf(advance(keys, durations, time, good, until, counts))
    assert counts.tolist() == [2, 2, 2] and good.tolist() == [True, False, False]
