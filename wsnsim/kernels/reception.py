"""What a frame does at the neighbours of its sender, in one pass over them.

    find_links(positions, sources, ids, ...)      the lengths and the keys of links
    overlap(ids, others, ..., marks, until)       another frame is heard meanwhile
    outcomes(key, ..., ids, ..., order, groups)   received, collided, overheard or lost
    add_common(ids, others, values, sums)         interference
    unlock(ids, locks, node), take_over(...)      capture

Nodes are given by their numbers, ascending. The random numbers are those of `base.rng`, so that the general path of
`network.radio.reception` gives the same result.

    advance(keys, durations, time, good, until, counts)      bursty links, to their states at a time

Links whose losses come in bursts are Markov chains of two states in continuous time. Their states at a time do not
depend on when they were looked at.
"""

from __future__ import annotations

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.kernels.compilation import exact_kernel, inlined, kernel
from wsnsim.kernels.elementary import GOLDEN, ONE, mix, uniform

RECEIVED, COLLIDED, FOREIGN, LOST = 1, 2, 3, 4
"""The outcomes of a frame at one node, in the order of the groups. FOREIGN: it was for another node."""
HEARD_OTHER, HIT = 1, 2
"""Marks: another frame was heard meanwhile; the frame is lost."""


@exact_kernel
def find_links(
    positions: Floats, sources: Ints, ids: Ints, pair_key: np.uint64, direction_key: np.uint64,
    distances: Floats, pairs: Keys, directions: Keys,
) -> None:  # fmt: skip
    """Find the length of each link, and the keys of its random part: `base.rng.derive(key, lower, higher)`.

    Args:
        positions: (N, 2) of all nodes in m.
        sources: (n,) the senders.
        ids: (n,) the receivers.
        pair_key: The key of what is the same in both directions.
        direction_key: The key of what is not.
        distances: (n,) in which the lengths are written, in m.
        pairs: (n,) in which the keys are written that are equal for both directions.
        directions: (n,) in which the keys are written of which those of the two directions are complements.
    """
    for i in range(ids.size):
        dx = positions[sources[i], 0] - positions[ids[i], 0]
        dy = positions[sources[i], 1] - positions[ids[i], 1]
        distances[i] = np.sqrt(dx * dx + dy * dy)
        low, high = np.uint64(min(sources[i], ids[i])), np.uint64(max(sources[i], ids[i]))
        pairs[i] = mix(mix(pair_key + (low + ONE) * GOLDEN) + (high + ONE) * GOLDEN)
        directions[i] = mix(mix(direction_key + (low + ONE) * GOLDEN) + (high + ONE) * GOLDEN)
        if sources[i] > ids[i]:
            directions[i] = ~directions[i]


@inlined
def _next_common(ids: Ints, others: Ints, i: int, j: int) -> tuple[int, int]:
    """From places i and j on, those of the next common number of two ascending lists; their ends if there is none."""
    while i < ids.size and j < others.size:
        if ids[i] < others[j]:
            i += 1
        elif ids[i] > others[j]:
            j += 1
        else:
            return i, j
    return ids.size, others.size


@inlined
def _place(ids: Ints, node: int) -> int:
    """The place of a node in an ascending list; -1 if it is not in it."""
    at: int = np.searchsorted(ids, node)  # type: ignore[assignment]
    return at if at < ids.size and ids[at] == node else -1


@kernel
def overlap(
    ids: Ints, others: Ints, source: int, mark: int, paid: float, end: float, marks: Ints, until: Floats
) -> None:
    """Mark at the nodes (n,) what another frame does, which `source` has sent and `others` (m,) hear.

    Args:
        ids: (n,) the nodes that hear the frame.
        others: (m,) the nodes that hear the other frame.
        source: The sender of the other frame: it receives nothing.
        mark: HIT if a frame is lost where another one is heard; else HEARD_OTHER.
        paid: Time in s until which a radio that hears the other frame pays for that one.
        end: The end of the frame in s.
        marks: (n,) in which `mark` is set, and HIT at the sender.
        until: (n,) time in s until which each radio pays for other frames or sends itself; raised.
    """
    i, j = _next_common(ids, others, 0, 0)
    while i < ids.size:
        marks[i] |= mark
        if paid > until[i]:
            until[i] = paid
        i, j = _next_common(ids, others, i + 1, j + 1)
    at = _place(ids, source)
    if at >= 0:
        marks[at] |= HIT
        until[at] = end


@inlined
def _latest(found: Ints, outcome: int, until: Floats, below: float) -> float:
    """The latest `until` of the nodes with an outcome that is less than `below`."""
    latest = -np.inf
    for i in range(found.size):
        if found[i] == outcome and latest < until[i] < below:
            latest = until[i]
    return latest


@inlined
def _frame_key(key: np.uint64, numbers: tuple[int, int, int]) -> np.uint64:
    """The key of the random numbers of one frame: `base.rng.derive(key, *numbers)`."""
    for number in numbers:
        key = mix(key + (np.uint64(number) + ONE) * GOLDEN)
    return key


@inlined
def _grouped(found: Ints, counts: Ints, ids: Ints, until: Floats, quiet: bool, order: Ints, groups: Floats) -> int:
    """Group the nodes (n,) of equal outcome `found` and equal `until`, as `outcomes` says; return how many groups."""
    size, last = 0, 0
    for outcome in range(RECEIVED, LOST + 1):
        end = size + counts[outcome]
        together, below = quiet or outcome == LOST, np.inf
        while size < end:
            top = 0.0 if together else _latest(found, outcome, until, below)
            groups[last, 0], groups[last, 1], groups[last, 3] = outcome, size, top
            for i in range(ids.size):
                if found[i] == outcome and (together or until[i] == top):
                    order[size] = ids[i]
                    size += 1
            groups[last, 2] = size
            last, below = last + 1, top
    return last


@kernel
def outcomes(
    key: np.uint64,
    numbers: tuple[int, int, int],
    ids: Ints,
    thresholds: Floats,
    usable: Bools,
    hears: Bools,
    marks: Ints,
    until: Floats,
    to: int,
    order: Ints,
    groups: Floats,
) -> tuple[int, int, int]:
    """Find the outcome of a frame at each node, and group the nodes of equal outcome and equal `until`.

    A frame arrives at a node that hears it, is not hit, and whose random number reaches the threshold. The results are
    written into given arrays: to return an array takes longer than everything else.

    Args:
        key: The key of the random numbers of all frames.
        numbers: What the key of this frame is derived with: its sender, the step, and its number in the step.
        ids: (n,) the nodes.
        thresholds: (n,) one less the probability that an undisturbed frame arrives; (0,): it always does.
        usable: (n,) whether the link is usable, so that a loss counts; (0,): all are.
        hears: (n,) whether the node is up and listens; (0,): all do.
        marks: (n,) what other frames do, see `overlap`; (0,): nothing disturbs the frame.
        until: (n,) until when the radios pay for other frames.
        to: The destination; -1 for everyone.
        order: (n,) or more, for the nodes group by group.
        groups: (n, 4) or more, for the groups: outcome, begin and end in `order`, `until`.

    Returns:
        The number of groups, of nodes that should receive the frame, and of those among them that do.
    """
    key = _frame_key(key, numbers)
    everyone, quiet = to < 0, marks.size == 0
    found, counts = np.zeros(ids.size, np.int64), np.zeros(5, np.int64)
    in_range, delivered = 0, 0
    for i in range(ids.size):
        listens = hears.size == 0 or hears[i]
        arrives = listens and (quiet or marks[i] < HIT)
        if arrives and thresholds.size > 0:
            arrives = uniform(mix(key + (np.uint64(ids[i]) + ONE) * GOLDEN), 0) >= thresholds[i]
        reliable = usable.size == 0 or usable[i]
        collides = listens and not arrives and not quiet and marks[i] > 0 and reliable
        meant = (listens and reliable) if everyone else ids[i] == to
        outcome = 0
        if arrives and (everyone or meant):
            outcome = RECEIVED
        elif collides and meant:
            outcome = COLLIDED
        elif arrives or collides:
            outcome = FOREIGN
        elif meant:
            outcome = LOST
        in_range += meant
        delivered += meant and arrives
        found[i] = outcome
        counts[outcome] += 1
    return _grouped(found, counts, ids, until, quiet, order, groups), in_range, delivered


@kernel
def add_common(ids: Ints, others: Ints, values: Floats, sums: Floats) -> None:
    """Add the values (m,) of other nodes (m,) to all sums (k, n) of those of the nodes (n,) that are among them."""
    i, j = _next_common(ids, others, 0, 0)
    while i < ids.size:
        for row in range(len(sums)):
            sums[row, i] += values[j]
        i, j = _next_common(ids, others, i + 1, j + 1)


@kernel
def unlock(ids: Ints, locks: Bools, node: int) -> None:
    """A node sends, and is not locked on a frame that the nodes (n,) hear: clear its lock, if it is one of them."""
    at = _place(ids, node)
    if at >= 0:
        locks[at] = False


@kernel
def take_over(
    ids: Ints, powers: Floats, locks: Bools, others: Ints, other_powers: Floats, other_locks: Bools, margin: float
) -> None:
    """Decide on which of two frames the receivers lock that hear both, the later of which would lock them, too.

    Args:
        ids: (n,) the nodes that hear the later frame.
        powers: (n,) its powers in dBm.
        locks: (n,) which nodes it would lock; changed.
        others: (m,) the nodes that hear the earlier frame.
        other_powers: (m,) its powers in dBm.
        other_locks: (m,) which nodes are locked on it; changed.
        margin: By how many dB the later frame must be stronger to take a receiver over.
    """
    i, j = _next_common(ids, others, 0, 0)
    while i < ids.size:
        if other_locks[j]:
            if locks[i] and powers[i] >= other_powers[j] + margin:
                other_locks[j] = False
            else:
                locks[i] = False
        i, j = _next_common(ids, others, i + 1, j + 1)


@kernel
def advance(keys: Keys, durations: Floats, time: float, good: Bools, until: Floats, counts: Ints) -> float:
    """Advance the states of links (n,) to a time; returns the time in s of the next change of any of them.

    A state lasts for an exponentially distributed time, the k-th of a link by the k-th uniform number of its key.

    Args:
        keys: (n,) random keys.
        durations: (n, 2) mean duration in s of a bad and of a good state.
        time: The time in s, not before that of an earlier call.
        good: (n,) whether the link is in a good state; changed.
        until: (n,) end of the state in s; changed.
        counts: (n,) random numbers that were used; changed.
    """
    following = np.inf
    for i in range(keys.size):
        while until[i] <= time:
            good[i] = not good[i]
            until[i] -= durations[i, int(good[i])] * np.log1p(-uniform(keys[i], counts[i]))
            counts[i] += 1
        following = min(following, until[i])
    return following
