"""Frames on the air and their receivers, as arguments of the kernels `reception` and `nodes`."""

from __future__ import annotations

from typing import Any

import numpy as np

from wsnsim.kernels.reception import HEARD_OTHER, HIT


def frame(count: int, seed: int = 7, to: int = -1, busy: bool = True) -> tuple[Any, ...]:
    """The arguments of `outcomes` for a frame that `count` nodes may hear."""
    rng = np.random.default_rng(seed)
    ids = np.sort(rng.choice(4 * count, count, replace=False))
    marks = rng.choice([0, 0, HEARD_OTHER, HIT, HEARD_OTHER | HIT], count) if busy else np.zeros(0, np.int64)
    until = rng.choice([1.0, 1.5, 2.0], count) if busy else np.zeros(0)
    to = int(ids[to]) if to >= 0 else -1
    usable, hears = rng.random(count) < 0.7, rng.random(count) < 0.8
    results = np.zeros(count, np.int64), np.zeros((count, 4))
    return np.uint64(seed), (3, 1, 4), ids, rng.random(count), usable, hears, marks, until, to, *results


def other_frame(count: int) -> tuple[Any, ...]:
    """The arguments of `overlap` for two frames that many nodes hear, the sender of one among them."""
    rng = np.random.default_rng(count)
    ids, others = (np.sort(rng.choice(2 * count, count, replace=False)) for _ in range(2))
    return ids, others, int(ids[0]), HEARD_OTHER, 1.5, 2.0, np.zeros(count, np.int64), np.full(count, 1.0)


def interferer(count: int) -> tuple[Any, ...]:
    """The arguments of `add_common` for two frames that many nodes hear."""
    ids, others, *_ = other_frame(count)
    return ids, others, np.linspace(1.0, 2.0, count), np.full((3, count), 0.5)


def sending(count: int) -> tuple[Any, ...]:
    """The arguments of `unlock` for a node that begins to send."""
    ids, *_ = other_frame(count)
    return ids, np.ones(count, dtype=np.bool_), int(ids[count // 2])


def rivals(count: int) -> tuple[Any, ...]:
    """The arguments of `take_over` for two frames that many nodes hear."""
    rng, (ids, others, *_) = np.random.default_rng(count), other_frame(count)
    powers, other_powers = rng.uniform(-95.0, -75.0, (2, count))
    return ids, powers, rng.random(count) < 0.8, others, other_powers, rng.random(count) < 0.8, 3.0


def sleepers(count: int) -> tuple[Any, ...]:
    """The arguments of `listening` for every second of many nodes."""
    rng, size = np.random.default_rng(count), 2 * count
    begins, since = rng.uniform(0.0, 1.2, size), rng.uniform(0.0, 2.0, size)
    living, awake, held = (rng.random(size) < share for share in (0.9, 0.4, 0.3))
    return np.arange(0, size, 2), 1.0, living, awake, begins, begins + 0.9, held, since, np.zeros(count, dtype=np.bool_)


def schedules(count: int) -> tuple[Any, ...]:
    """The arguments of `period_spans` for many nodes that sleep at random."""
    keys = np.random.default_rng(count).integers(0, 2**64, count, dtype=np.uint64)
    return (
        keys,
        np.linspace(20.0, 40.0, count),
        (10.0, 10.0, 0.3, True),
        np.zeros(count, dtype=np.bool_),
        np.zeros(count),
        np.zeros(count),
    )


def spells(count: int) -> tuple[Any, ...]:
    """The arguments of `period_sums` for many nodes that sleep at random, over a few periods."""
    keys, _, law, *_ = schedules(count)
    since = np.linspace(0.0, 20.0, count)
    return keys, since, since[::-1] + 30.0, law, np.zeros(count), np.zeros(count)


def charge(count: int) -> tuple[Any, ...]:
    """The arguments of `book` for every second of many nodes."""
    return np.arange(0, 2 * count, 2), 0.5, np.zeros(2 * count), np.ones(2 * count)


def busy(count: int) -> tuple[Any, ...]:
    """The arguments of `mark_busy` for every second of many nodes."""
    modes = (np.arange(2 * count) % 5).astype(np.int16)
    law = np.linspace(0.1, 0.3, 5), np.arange(5) % 2, np.zeros(2)
    return np.arange(0, 2 * count, 2), 0.5, np.zeros(2 * count), modes, np.zeros(5, np.int64), *law


def links(count: int) -> tuple[Any, ...]:
    """The arguments of `find_links` from one node to many others, and back from some of them."""
    positions = np.random.default_rng(count).uniform(0.0, 99.0, (count + 1, 2))
    sources, ids = np.full(count, count // 2), np.arange(1, count + 1)
    keys = (np.zeros(count, dtype=np.uint64) for _ in range(2))
    return positions, sources, ids, np.uint64(3), np.uint64(5), np.zeros(count), *keys


def bursty_links(count: int) -> tuple[Any, ...]:
    """The arguments of `advance` for many links that change once in a second or two, after two seconds."""
    keys = np.random.default_rng(count).integers(0, 2**64, count, dtype=np.uint64)
    durations, good = np.column_stack([np.full(count, 0.8), np.linspace(0.5, 2.0, count)]), np.arange(count) % 3 == 0
    return keys, durations, 2.0, good, np.linspace(0.0, 3.0, count), np.full(count, 2)
