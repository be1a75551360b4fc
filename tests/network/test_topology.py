"""Topology: symmetric where it must be, and independent of the order in which neighbours are found."""

import numpy as np
import pytest

from tests.network.radio_network import RadioNetwork
from wsnsim.models.links import Disk, LogNormal
from wsnsim.network.radio import topology as topology_module

FIELD = np.random.default_rng(3).uniform(0, 200, (60, 2))


def test_links_do_not_depend_on_the_order_in_which_they_are_found():
    one, all_at_once = RadioNetwork(FIELD, link=LogNormal()).topology, RadioNetwork(FIELD, link=LogNormal()).topology
    all_at_once.find_all()
    for node in reversed(range(60)):
        here, there = one.neighbours(node), all_at_once.neighbours(node)
        assert np.array_equal(here.ids, there.ids) and np.array_equal(here.powers, there.powers)
        assert np.array_equal(here.senses, there.senses) and here.id_list == there.id_list


def test_a_disk_is_symmetric_and_a_shadowed_link_nearly_so():
    topology = RadioNetwork(FIELD, link=Disk(reach=40.0)).topology
    assert all(a in topology.neighbours(b).id_list for a in range(60) for b in topology.neighbours(a).id_list)
    shadowed = RadioNetwork(FIELD, link=LogNormal(asymmetry=1.0)).topology
    gaps = []
    for a in range(60):
        there = shadowed.neighbours(a)
        for b, power in zip(there.id_list, there.powers, strict=True):
            back = shadowed.neighbours(b).index(a)
            if back >= 0:
                gaps.append(power - shadowed.neighbours(b).powers[back])
    assert np.std(gaps) == pytest.approx(1.0, rel=0.1), "the directions differ by 1 dB"


def test_nodes_are_connected_if_a_packet_arrives_more_often_than_not_in_both_directions():
    topology = RadioNetwork(FIELD, link=LogNormal()).topology
    pairs = [(a, b) for a in range(60) for b in range(60) if a != b]
    for a, b in pairs:
        assert topology.connected(a, b) == topology.connected(b, a)
        assert topology.connected(a, b) == (min(topology.probability(a, b), topology.probability(b, a)) >= 0.5)
    assert 0 < sum(topology.connected(a, b) for a, b in pairs) < len(pairs)


def test_a_disk_that_loses_most_packets_still_connects():
    topology = RadioNetwork([(0, 0), (30, 0), (90, 0)], link=Disk(reach=40.0, loss=0.9)).topology
    assert topology.connected(0, 1) and not topology.connected(1, 2)
    assert topology.probability(0, 1) == pytest.approx(0.1) and topology.probability(0, 2) == 0.0


def test_neighbours_know_the_index_of_a_node():
    neighbours = RadioNetwork([(0, 0), (30, 0), (90, 0), (35, 0)], link=Disk(reach=40.0)).topology.neighbours(0)
    assert neighbours.id_list == [1, 3]
    assert [neighbours.index(node) for node in range(4)] == [-1, 0, -1, 1]


def test_neighbours_found_together_in_small_parts_are_those_found_one_by_one(monkeypatch):
    monkeypatch.setattr(topology_module, "PAIRS_AT_ONCE", 100)
    one, together = RadioNetwork(FIELD, link=LogNormal()).topology, RadioNetwork(FIELD, link=LogNormal()).topology
    together.find_all()
    assert set(together._neighbours) == set(range(60))
    for node, there in together._neighbours.items():
        here = one.neighbours(node)
        assert here.id_list == there.id_list and np.array_equal(here.powers, there.powers)


def test_where_too_many_pairs_may_be_linked_neighbours_are_found_on_first_use(monkeypatch):
    monkeypatch.setattr(topology_module, "MOST_PAIRS", 50)
    topology = RadioNetwork(FIELD, link=LogNormal()).topology
    topology.find_all()
    assert not topology._neighbours and topology.neighbours(3).ids.size
