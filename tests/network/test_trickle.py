"""The Trickle timer against RFC 6206, written a second time in plain Python."""

import random

import pytest

from wsnsim.network.radio.tree_node import TrickleTimer


def rfc_6206(shortest, longest, draws, resets, end):
    """The transmissions until `end`, by the six rules of RFC 6206, section 4.2, without suppression (rules 3 and 4).

    `draws` are the random numbers of the intervals, `resets` the times of what is inconsistent.
    """
    sent, resets, draw = [], sorted(resets), iter(draws)
    interval, start = shortest, 0.0  # rule 1
    while start < end:
        t, stop = start + interval / 2 + next(draw) * interval / 2, start + interval  # rule 2
        cut = next((time for time in resets if start <= time < stop and interval > shortest), None)
        if cut is None or cut >= t:
            sent.append(t)
        if cut is None:
            start, interval = stop, min(2 * interval, longest)  # rule 5
        else:
            start, interval = cut, shortest  # rule 6
    return [t for t in sent if t < end]


def ours(shortest, longest, draws, resets, end):
    """The same by `TrickleTimer`."""
    timer = TrickleTimer(shortest, longest, iter(draws).__next__)
    sent, due, resets = [], timer.begin(), sorted(resets)
    while due < end or resets:
        if resets and resets[0] < due:
            time = resets.pop(0)
            if (seconds := timer.reset()) is not None:
                due = time + seconds
            continue
        sends, seconds = timer.advance()
        sent += [due] if sends else []
        due += seconds
    return [t for t in sent if t < end]


@pytest.mark.thorough
def test_it_transmits_as_rfc_6206_says():
    rng = random.Random(0)
    for _ in range(200):
        shortest = rng.choice([0.1, 0.128, 1.0])
        longest = shortest * rng.choice([1, 2, 8, 10, 4000])
        draws = [rng.random() for _ in range(4000)]
        end = 300 * shortest
        given = shortest, longest, draws, [rng.uniform(0, end) for _ in range(rng.randrange(6))], end
        sent = ours(*given)
        assert sent and sent == pytest.approx(rfc_6206(*given))


def test_its_intervals_double_up_to_the_longest():
    timer = TrickleTimer(1.0, 10.0, lambda: 0.5)
    due, times = timer.begin(), []
    while due < 50.0:
        sends, seconds = timer.advance()
        times += [due] if sends else []
        due += seconds
    assert times == [0.75, 2.5, 6.0, 13.0, 22.5, 32.5, 42.5], "0-1, 1-3, 3-7, 7-15, then 10 s each"


def test_it_transmits_once_in_an_interval_though_the_random_number_is_the_largest():
    timer = TrickleTimer(0.128, 512.0, lambda: 1.0 - 2.0**-53)
    timer.begin()
    assert [timer.advance()[0] for _ in range(6)] == [True, False] * 3


def test_a_reset_in_the_shortest_interval_changes_nothing():
    timer = TrickleTimer(1.0, 8.0, lambda: 0.0)
    timer.begin()
    assert timer.reset() is None
    timer.advance(), timer.advance()
    assert timer.interval == 2.0 and timer.reset() == 0.5 and timer.interval == 1.0
