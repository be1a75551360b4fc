"""Link estimates against a second implementation in plain Python, and who stays in a full table."""

import random
from math import inf

import pytest

from wsnsim.network.radio.link_estimator import BAD_ETX, WORST_ETX, LinkTable


def etx_of(inputs):
    """The ETX after a list of inputs, from whole windows instead of counters: a second way to the same rules.

    An input is ('beacon', number), or ('sent', acknowledged?) for one transmission.
    """
    share = etx = None
    window, data, last = [], [], None
    for what, value in inputs:
        if what == "beacon":
            gap = 1 if last is None else (value - last) % 256
            last = value
            if gap > 10:
                window, share, etx = [True], None, None
                continue
            window += [False] * (gap - 1) + [True]
            if len(window) >= 3:
                new = sum(window) / len(window)
                window = []
                if share is None:
                    share, etx = new, min(1 / new, 6553.5)
                share = 0.9 * share + 0.1 * new
                etx = 0.9 * etx + 0.1 * (1 / share if share > 0.04 else 6553.5)
        else:
            data.append(value)
            if len(data) >= 5:
                found = len(data) / sum(data) if any(data) else len(data)
                etx = None if etx is None else 0.9 * etx + 0.1 * found
                data = [] if any(data) else data
    return inf if etx is None else etx


@pytest.mark.thorough
def test_estimates_are_those_of_a_second_implementation():
    rng = random.Random(3)
    for case in range(300):
        table, inputs, number = LinkTable(3, rng.random), [], rng.randrange(256)
        for _ in range(rng.randrange(1, 120)):
            if inputs and rng.random() < 0.5:
                inputs.append(("sent", rng.random() < 0.7))
                table.note_sent(7, 1, inputs[-1][1])
            else:
                number = (number + rng.choice([1, 1, 1, 2, 3, 9, 10, 11, 40])) % 256
                inputs.append(("beacon", number))
                table.hear(7, number)
            assert table.etx(7) == pytest.approx(etx_of(inputs), rel=1e-12), case


def test_a_burst_of_several_attempts_counts_as_that_many_transmissions():
    one, other = LinkTable(3, random.random), LinkTable(3, random.random)
    for table in (one, other):
        for number in range(3):
            table.hear(1, number)
    one.note_sent(1, 4, True)
    one.note_sent(1, 3, False)
    for acknowledged in [False] * 3 + [True] + [False] * 3:
        other.note_sent(1, 1, acknowledged)
    assert one.etx(1) == other.etx(1) > 1.0


def test_a_perfect_link_costs_one_transmission_and_one_that_fails_ever_more():
    table, costs = LinkTable(3, random.random), []
    for number in range(30):
        table.hear(1, number)
        table.note_sent(1, 1, True)
    assert table.etx(1) == pytest.approx(1.0)
    for _ in range(40):
        table.note_sent(1, 1, False)
        costs.append(table.etx(1))
    assert costs[3:] == sorted(costs[3:]) and costs[-1] > 10.0


def full(size=4, etx=1.0):
    table = LinkTable(size, lambda: 0.5)
    for node in range(size):
        for number in range(3):
            table.hear(node, number)
    return table


def test_a_full_table_of_good_links_takes_a_newcomer_only_for_a_neighbour_that_it_may_displace():
    table = full()
    assert table.hear(9, 0) == (False, None)
    assert table.hear(9, 0, displaces=lambda other: False) == (False, None)
    assert table.hear(9, 0, displaces=lambda other: other == 2) == (True, 2)
    assert [node for node in range(4) if table.etx(node) < inf] == [0, 1, 3]
    assert table.hear(9, 1) == (True, None)


def test_a_bad_link_makes_room_for_any_newcomer_and_a_pinned_one_for_none():
    table = full()
    table.pin(1)
    for neighbour in (1, 3):
        for _ in range(400):
            table.note_sent(neighbour, 1, False)
        assert table.etx(neighbour) > BAD_ETX
    assert table.hear(9, 0) == (True, 3)
    assert table.hear(10, 0) == (False, None), "the newcomer has no estimate yet, and node 1 is pinned"


def test_a_sink_is_taken_at_any_price_and_stays():
    table = full()
    known, evicted = table.hear(9, 0, force=True)
    assert known and evicted in range(4)
    assert not any(table.hear(20 + i, 0, displaces=lambda other: other == 9)[0] for i in range(3))


def test_a_link_without_three_beacons_has_no_estimate_and_a_long_silence_takes_it_away():
    table = LinkTable(3, random.random)
    costs = [table.hear(1, number) and table.etx(1) for number in (250, 251, 252, 253)]
    assert costs[:2] == [inf, inf] and costs[2] == costs[3] == pytest.approx(1.0)
    table.hear(1, (253 + 11) % 256)
    assert table.etx(1) == inf


def test_a_link_on_which_hardly_a_beacon_arrives_is_not_used():
    table = LinkTable(3, random.random)
    for number in range(0, 100, 10):
        table.hear(1, number)
    assert 5.0 < table.etx(1) < WORST_ETX


def test_estimates_computed_by_hand():
    """Two of three beacons: 3/2 at first, and then 0.9 · 1.5 + 0.1 · 1.5. All of the next three: the share is 0.7."""
    table = LinkTable(3, random.random)
    table.hear(1, 0), table.hear(1, 2)
    assert table.etx(1) == pytest.approx(1.5)
    table.hear(1, 3), table.hear(1, 4), table.hear(1, 5)
    assert table.etx(1) == pytest.approx(0.9 * 1.5 + 0.1 / 0.7)
    table.note_sent(1, 5, False)
    assert table.etx(1) == pytest.approx(0.9 * (1.35 + 0.1 / 0.7) + 0.1 * 5.0)


@pytest.mark.parametrize("period", [1, 2, 3])
def test_in_the_limit_a_link_costs_the_inverse_of_the_share_of_beacons_that_arrive(period):
    table = LinkTable(3, random.random)
    for number in range(0, 6000, period):
        table.hear(1, number % 256 if period != 3 else number % 255)
    assert table.etx(1) == pytest.approx(period, rel=0.35 if period > 1 else 1e-9)
