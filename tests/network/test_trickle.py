"""The Trickle timer against RFC 6206, written a second time in plain Python."""

import random

import pytest

from wsnsim.network.radio.tree_node import TrickleTimer


def rfc_6206(shortest, longest, redundancy, draws, heard, resets, end):
    """(transmissions, suppressed) until `end`, by the six rules of RFC 6206, section 4.2, on a list of events in time.

    `draws` are the random numbers of the intervals; consistent transmissions are `heard`, `resets` are inconsistent.
    """
    sent, suppressed = [], []
    inputs = sorted([(time, "consistent") for time in heard] + [(time, "inconsistent") for time in resets])
    draw = iter(draws)
    interval, start, at = shortest, 0.0, 0.0  # rule 1
    while start < end:
        counter, t = 0, start + interval / 2 + next(draw) * interval / 2  # rule 2
        stop, cut = start + interval, False
        while inputs and inputs[0][0] < stop:
            at, what = inputs[0]
            if at >= t and t not in sent + suppressed:
                break
            inputs.pop(0)
            if what == "consistent":
                counter += 1  # rule 3
            elif interval > shortest:  # rule 6
                interval, start, cut = shortest, at, True
                break
        if cut:
            continue
        (sent if redundancy is None or counter < redundancy else suppressed).append(t)  # rule 4
        while inputs and inputs[0][0] < stop:
            at, what = inputs.pop(0)
            if what == "inconsistent" and interval > shortest:
                interval, start, cut = shortest, at, True
                break
        if not cut:
            start, interval = stop, min(2 * interval, longest)  # rule 5
    return [t for t in sent if t < end], [t for t in suppressed if t < end]


def ours(shortest, longest, redundancy, draws, heard, resets, end):
    """The same by `TrickleTimer`."""
    timer = TrickleTimer(shortest, longest, iter(draws).__next__, redundancy)
    sent, suppressed, due, transmits = [], [], timer.begin(), True
    inputs = sorted([(time, "consistent") for time in heard] + [(time, "inconsistent") for time in resets])
    while due < end or inputs:
        if inputs and inputs[0][0] < due:
            time, what = inputs.pop(0)
            if what == "consistent":
                timer.hear_consistent()
            elif (seconds := timer.reset()) is not None:
                due, transmits = time + seconds, True
            continue
        sends, seconds = timer.advance()
        assert transmits or not sends
        if transmits:
            (sent if sends else suppressed).append(due)
        due, transmits = due + seconds, not transmits
    return [t for t in sent if t < end], [t for t in suppressed if t < end]


@pytest.mark.thorough
@pytest.mark.parametrize("redundancy", [None, 1, 2, 5])
def test_it_transmits_as_rfc_6206_says(redundancy):
    rng = random.Random(redundancy or 0)
    for _ in range(200):
        shortest = rng.choice([0.1, 0.128, 1.0])
        longest = shortest * rng.choice([1, 2, 8, 10, 4000])
        draws = [rng.random() for _ in range(4000)]
        end = 300 * shortest
        heard = [rng.uniform(0, end) for _ in range(rng.randrange(100))]
        resets = [rng.uniform(0, end) for _ in range(rng.randrange(6))]
        given = shortest, longest, redundancy, draws, heard, resets, end
        (sent, suppressed), (truth, held) = ours(*given), rfc_6206(*given)
        assert sent == pytest.approx(truth) and suppressed == pytest.approx(held)
        assert sent and (redundancy is not None or not suppressed)


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
