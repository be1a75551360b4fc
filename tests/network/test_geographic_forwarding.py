"""Geographic forwarding by heard positions: progress, detours around nodes that do not answer, voids, and its price."""

import itertools
import math

import numpy as np
import pytest
import simpy

from tests.network.tree_network import TreeNetwork, grid
from wsnsim.base.frames import Burst
from wsnsim.base.requests import Parcel
from wsnsim.models.access import Csma, IdealMac
from wsnsim.models.links import LogNormal
from wsnsim.models.workloads import CollectionTreeProtocol
from wsnsim.network.node_states import Places
from wsnsim.network.radio.collection_tree import PLACE_HEADER
from wsnsim.network.radio.datagrams import Datagram, Journey


def hops_of(network):
    """(sender, receiver) of each transmission of a test datagram, in order."""
    words = network.memory.words.all()
    return [(row["node"], row["peer"]) for row in network.rows("send", "relay") if words[int(row["what"])] == "test"]


def test_every_hop_makes_progress_and_carries_the_header():
    network = TreeNetwork(grid(6, 50.0), mac=IdealMac())
    network.run(5.0)
    sent = network.send(0, 35, packets=2)
    network.run(5.1)
    hops, places = hops_of(network), network.nodes.positions
    assert sent.arrived and sent.mask.all() and sent.hops == len(hops)
    away = [math.dist(places[node], places[35]) for node, _ in hops] + [0.0]
    assert all(later < earlier for earlier, later in itertools.pairwise(away))
    assert sent.bits == len(hops) * 2 * (96 + PLACE_HEADER)


def test_a_destination_in_range_is_sent_to_directly_though_no_beacon_of_it_was_heard():
    network = TreeNetwork([(0, 0), (70, 0)], sinks=())
    sent = network.send(0, 1)
    network.run(0.1)
    assert network.tree.beacons.sent == 0 or not network.tree._places[0].places
    assert sent.arrived and sent.hops == 1


def test_before_any_beacon_nobody_knows_a_neighbour_farther_on():
    network = TreeNetwork([(0, 0), (60, 0), (120, 0)])
    early = network.send(0, 2)
    network.run(5.0)
    late = network.send(0, 2)
    network.run(6.0)
    assert not early.arrived and network.drops() == ["void"]
    assert late.arrived and late.hops == 2


def test_at_a_void_the_datagram_is_dropped():
    network = TreeNetwork([(0, 0), (-50, 50), (-50, 110), (10, 140), (90, 100), (110, 40)])
    network.run(5.0)
    sent = network.send(0, 5)
    network.run(6.0)
    assert not sent.arrived and network.drops() == ["void"] and network.ends[0].triggered


@pytest.mark.parametrize(("candidates", "arrives"), [(1, False), (3, True)])
def test_a_neighbour_that_does_not_answer_is_passed_over_for_the_next_best(candidates, arrives):
    places = [(0, 0), (60, 0), (55, 30), (50, -40), (110, 0)]
    network = TreeNetwork(places, routing=CollectionTreeProtocol(candidates=candidates))
    network.run(5.0)
    network.crash(1)
    sent = network.send(0, 4)
    network.run(6.0)
    assert sent.arrived == arrives
    assert [to for _, to in hops_of(network)][:4] == [1] * 4, "the best one first, as often as the MAC tries"
    assert network.drops() == ([] if arrives else ["retry_limit"])


def test_a_good_link_is_worth_more_than_a_long_one():
    network = TreeNetwork([(0, 0), (60, 0), (40, 0), (110, 0)], mac=Csma(max_retries=0))
    network.run(5.0)
    heard = network.tree._places[0]
    assert heard.best((0, 0), (110, 0), set()) == 1
    for _ in range(60):
        heard.links.note_sent(1, 1, False)
        heard.links.note_sent(1, 1, True)
    assert heard.links.etx(1) > 1.6 and heard.best((0, 0), (110, 0), set()) == 2


def test_it_goes_by_assumed_positions():
    network = TreeNetwork([(0, 0), (60, 0), (60, 30), (120, 0)])
    network.nodes.assumed = Places(np.array([(0.0, 0.0), (-30.0, 0.0), (80.0, 0.0), (120.0, 0.0)]))
    network.run(5.0)
    sent = network.send(0, 3)
    network.run(6.0)
    assert sent.arrived and hops_of(network) == [(0, 2), (2, 3)], "node 1 is taken to stand behind"


def test_a_sleeping_destination_is_woken_on_the_last_hop_where_it_can_be():
    network = TreeNetwork([(0, 0), (60, 0), (120, 0)])
    network.run(5.0)
    woken = []

    def wake(node, to, target):
        woken.append((node, to))
        return network.env.timeout(0.01)

    network.transport.hops.wake_neighbour = wake
    network.transport.hops.sleeps = lambda node: node == 2
    sent = network.send(0, 2)
    network.run(6.0)
    assert sent.arrived and woken == [(1, 2)]


@pytest.mark.thorough
def test_over_lossy_links_datagrams_end_and_the_ledger_adds_up():
    rng = np.random.default_rng(3)
    network = TreeNetwork(rng.uniform(0, 150, (50, 2)), link=LogNormal())
    network.run(20.0)
    sent = []
    for i, (source, to) in enumerate(rng.integers(0, 50, (40, 2)).tolist()):
        network.at(20.0 + i / 20, lambda source=source, to=to: sent.append(network.send(source, to)))
    network.run(30.0)
    assert all(event.triggered for event in network.ends) and network.ledger_adds_up()
    assert sum(each.arrived for each in sent) > 0.9 * len(sent)


def test_a_crashed_node_loses_what_it_holds():
    network = TreeNetwork([(60.0 * i, 0.0) for i in range(4)])
    network.run(5.0)
    sent = network.send(0, 3)
    network.at(5.004, lambda: network.crash(1))
    network.run(8.0)
    assert not sent.arrived and network.ends[0].triggered


def test_a_burst_that_never_got_the_channel_is_sent_again_to_the_same_neighbour_after_a_pause():
    network = TreeNetwork([(60.0 * i, 0.0) for i in range(3)])
    network.run(5.0)
    channel, busy = network.mac.channel, network.mac.channel.is_busy
    channel.is_busy = lambda node: True if network.env.now < 5.03 else busy(node)
    sent = network.send(0, 2)
    network.run(6.0)
    assert sent.arrived and hops_of(network) == [(0, 1), (1, 2)] and "no_channel" in network.drops()


def test_packets_that_arrive_in_several_copies_are_put_together_until_the_last_copy_has_ended():
    env, parcel = simpy.Environment(), Parcel(None, 4, 96, "test")
    journey = Journey(env, datagram := Datagram(0, 9, parcel), -1, 1, 80)
    journey.add_copy(), journey.add_copy()
    for mask, done in (([1, 0, 0, 0], False), ([1, 0, 0, 0], False), ([0, 1, 1, 0], False)):
        journey.arrive(9, Burst(1, 9, parcel, -1, np.array(mask, dtype=bool), sum(mask)), 2)
        assert journey.ended.triggered == done
    journey.end_copy()
    assert not journey.ended.triggered
    journey.end_copy()
    assert datagram.arrived and datagram.mask.tolist() == [True, True, True, False]
    full = Journey(env, whole := Datagram(0, 9, parcel), -1, 2, 80)
    full.add_copy()
    full.arrive(9, Burst(1, 9, parcel, -1, np.ones(4, dtype=bool), 4), 2)
    assert full.ended.triggered and whole.mask.all() and whole.hops == 2
