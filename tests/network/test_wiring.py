"""Who hears whom: symmetric where it must be, the same whoever asks and in whatever order."""

import numpy as np
import pytest

from tests.network.places import Place
from wsnsim.models.links import Disk, LogNormal

FIELD = np.random.default_rng(3).uniform(0, 200, (60, 2))


def test_links_do_not_depend_on_who_asks_first_nor_on_asking_for_all_at_once():
    one, all_at_once = Place(FIELD, link=LogNormal()).wiring, Place(FIELD, link=LogNormal()).wiring
    all_at_once.survey()
    for node in reversed(range(60)):
        here, there = one.audience(node), all_at_once.audience(node)
        assert np.array_equal(here.ids, there.ids) and np.array_equal(here.powers, there.powers)
        assert np.array_equal(here.senses, there.senses) and here.listed == there.listed


def test_a_disk_is_symmetric_and_a_shadowed_link_nearly_so():
    wiring = Place(FIELD, link=Disk(reach=40.0)).wiring
    assert all(a in wiring.neighbours(b) for a in range(60) for b in wiring.neighbours(a))
    shadowed = Place(FIELD, link=LogNormal(asymmetry=1.0)).wiring
    gaps = []
    for a in range(60):
        there = shadowed.audience(a)
        for b, power in zip(there.listed, there.powers, strict=True):
            back = shadowed.audience(b).index(a)
            if back >= 0:
                gaps.append(power - shadowed.audience(b).powers[back])
    assert np.std(gaps) == pytest.approx(np.sqrt(2.0), rel=0.15), "two independent directions of 1 dB"


def test_nodes_are_connected_where_a_packet_more_often_arrives_than_not_both_ways():
    wiring = Place(FIELD, link=LogNormal()).wiring
    pairs = [(a, b) for a in range(60) for b in range(60) if a != b]
    for a, b in pairs:
        assert wiring.connected(a, b) == wiring.connected(b, a)
        assert wiring.connected(a, b) == (min(wiring.success(a, b), wiring.success(b, a)) >= 0.5)
    assert 0 < sum(wiring.connected(a, b) for a, b in pairs) < len(pairs)


def test_a_disk_that_loses_most_packets_still_connects():
    wiring = Place([(0, 0), (30, 0), (90, 0)], link=Disk(reach=40.0, loss=0.9)).wiring
    assert wiring.connected(0, 1) and not wiring.connected(1, 2)
    assert wiring.success(0, 1) == pytest.approx(0.1) and wiring.success(0, 2) == 0.0


def test_an_audience_knows_where_a_node_stands_in_it():
    audience = Place([(0, 0), (30, 0), (90, 0), (35, 0)], link=Disk(reach=40.0)).wiring.audience(0)
    assert audience.listed == [1, 3]
    assert [audience.index(node) for node in range(4)] == [-1, 0, -1, 1]
