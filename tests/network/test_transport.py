"""Transport: unicasts, broadcasts, relayed datagrams and what they cost, on an ideal channel."""

import itertools

import networkx as nx
import numpy as np
import pytest

from tests.network.ledgers import SPENT, books
from tests.network.radio_network import RadioNetwork
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.tables import CAUSE, KIND
from wsnsim.models.access import Csma, IdealMac
from wsnsim.models.energy import FirstOrder
from wsnsim.models.links import Disk
from wsnsim.network.radio.datagrams import A_SINK, Datagram


def ideal_network(positions, battery=2.0, mac=None, **components):
    return RadioNetwork(positions, mac=mac or IdealMac(), energy=FirstOrder(battery=battery), **components)


def events(network):
    network.log.fingerprint()
    return network.memory.table("events")


def parcel(packets=1):
    return Parcel("payload", packets, PACKET_BITS, "test")


def test_a_unicast_costs_its_distance_to_the_sender_and_its_bits_to_the_receiver():
    network = ideal_network([(0, 0), (30, 40), (1, 1)])
    (sent,) = network.carry(Datagram(0, 1, parcel(3)))
    bits = 3 * 96
    assert sent.arrived and sent.mask.tolist() == [True] * 3 and (sent.hops, sent.bits) == (1, bits)
    assert books(network.nodes)[0][SPENT] == pytest.approx(bits * (50e-9 + 100e-12 * 2500), rel=1e-12)
    assert books(network.nodes)[1][SPENT] == pytest.approx(bits * 50e-9, rel=1e-12)
    assert 2 not in books(network.nodes), "overheard unicasts cost nothing on an ideal channel"


def test_a_broadcast_is_sent_with_the_power_for_the_range_and_received_by_every_living_node_within_it():
    network = ideal_network([(0, 0), (30, 0), (74, 0), (76, 0), (0, 50)])
    network.nodes.alive[4] = False
    event, (burst,) = network.transport.broadcast([0], [parcel()], 0)
    network.env.run(until=event)
    assert sorted(burst.received) == [1, 2]
    assert books(network.nodes)[0][SPENT] == pytest.approx(96 * (50e-9 + 100e-12 * 75**2), rel=1e-12)
    assert network.nodes.ledger.totals[CAUSE["rx"]] == pytest.approx(2 * 96 * 50e-9, rel=1e-12)


def test_a_broadcast_is_one_simpy_event():
    network = ideal_network([(0, 0)] + [(i, 1) for i in range(30)])
    before = network.env._eid
    next(before)
    network.transport.broadcast([0], [parcel()], 0)
    assert next(network.env._eid) == 2


def test_a_datagram_to_its_own_source_costs_nothing_and_arrives():
    network = ideal_network([(0, 0), (10, 0)])
    (sent,) = network.carry(Datagram(0, 0, parcel(5)))
    assert sent.arrived and sent.mask.all() and books(network.nodes) == {}


def test_of_datagrams_sent_at_one_instant_those_of_a_node_that_crashes_in_it_are_lost():
    network = ideal_network([(0, 0), (10, 0), (20, 7)])
    first, second = Datagram(1, 0, parcel(2)), Datagram(2, 0, parcel(2))
    event = network.transport.carry([first, second], 0, 0, one_hop=True)
    network.nodes.crash(2)
    network.env.run(until=event)
    assert first.arrived and first.mask.all() and first.bits == 2 * PACKET_BITS
    assert not second.arrived and not second.mask.any() and second.bits == 0
    assert sorted(books(network.nodes)) == [0, 1] and network.counters.frames_sent == 1


def test_a_datagram_of_no_packets_is_sent_and_does_not_arrive():
    network = ideal_network([(0, 0), (10, 0)])
    (sent,) = network.carry(Datagram(1, 0, parcel(0)))
    assert not sent.arrived and network.counters.frames_sent == 1


def test_paths_are_the_cheapest_by_energy_or_by_hops():
    rng = np.random.default_rng(4)
    positions = rng.uniform(-150, 150, (60, 2))
    for weight in ("energy", "hop"):
        network = ideal_network(positions, weight=weight)
        graph = nx.Graph()
        for a in range(60):
            for b in range(a):
                d = float(np.linalg.norm(positions[a] - positions[b]))
                if d <= 75:
                    graph.add_edge(a, b, w=1.0 if weight == "hop" else 100e-9 + 100e-12 * d * d)
        for to in range(1, 60, 7):
            found = network.router.path(0, to)
            truth = nx.shortest_path_length(graph, 0, to, weight="w")
            assert sum(graph[a][b]["w"] for a, b in itertools.pairwise(found)) == pytest.approx(truth)


BETWEEN = [(0, 0), (35, 0), (70, 0), (105, 0)]
"""On the first-order model two hops of 35 m cost less than one of 70 m."""


@pytest.mark.parametrize(("weight", "hops"), [("energy", 2), ("hop", 1), ("greedy", 1)])
def test_routing_decides_the_path_within_range_as_well(weight, hops):
    network = ideal_network(BETWEEN, weight=weight)
    (sent,) = network.carry(Datagram(0, 2, parcel(3)))
    each = 70.0 / hops
    spent = sum(book[SPENT] for book in books(network.nodes).values())
    assert sent.arrived and (sent.hops, sent.bits) == (hops, 3 * 96 * hops)
    assert spent == pytest.approx(sent.bits * (2 * 50e-9 + 100e-12 * each**2), rel=1e-12)


def test_a_metre_more_does_not_make_a_datagram_cheaper():
    energy = []
    for end in (74.0, 76.0):
        network = ideal_network([(0, 0), (25, 0), (50, 0), (end, 0)])
        network.carry(Datagram(0, 3, parcel(100)))
        energy.append(sum(book[SPENT] for book in books(network.nodes).values()))
    assert energy[0] < energy[1]


def test_within_a_cluster_a_member_in_range_is_one_hop_away():
    network = ideal_network(BETWEEN)
    near, far = Datagram(2, 0, parcel()), Datagram(3, 0, parcel())
    network.env.run(until=network.transport.carry([near, far], 0, 0, one_hop=True))
    assert (near.hops, far.hops) == (1, 3)


def test_a_datagram_to_a_neighbour_that_died_is_sent_in_vain():
    network = ideal_network([(0, 0), (35, 0), (70, 0)])
    network.nodes.spend(2, CAUSE["cpu"], 10.0)
    (sent,) = network.carry(Datagram(0, 2, parcel()))
    assert not sent.arrived and (sent.hops, sent.bits) == (1, 96)


def test_dead_nodes_relay_nothing():
    network = ideal_network([(0, 0), (60, 0), (60, 30), (120, 0)], weight="hop")
    network.router.path(0, 3)
    network.nodes.spend(1, CAUSE["cpu"], 10.0)
    assert network.router.path(0, 3) == [0, 2, 3]
    network.nodes.spend(2, CAUSE["cpu"], 10.0)
    assert network.router.path(0, 3) is None
    (sent,) = network.carry(Datagram(0, 3, parcel(2)))
    assert not sent.arrived and not sent.mask.any()


def test_packets_lost_on_a_hop_are_not_forwarded_and_hops_share_one_sequence():
    network = ideal_network([(0, 0), (70, 0), (140, 0)], link=Disk(reach=75.0, loss=0.3))
    (sent,) = network.carry(Datagram(0, 2, parcel(200)))
    table = events(network)
    sends = np.isin(table["kind"], [KIND["send"], KIND["relay"]])
    assert table["packets"][sends][0] == 200
    received = table["packets"][table["kind"] == KIND["receive"]]
    assert table["packets"][sends][1] == received[0] < 200
    assert received[1] == sent.mask.sum() < received[0]
    assert len(set(table["sequence"][sends])) == 1 and len(set(table["frame"][sends])) == 2
    assert 0.4 < sent.mask.mean() < 0.58


def test_a_sender_whose_battery_runs_out_during_a_burst_delivers_nothing_and_has_spent_all():
    network = ideal_network([(0, 0), (10, 0)], battery=1e-5)
    (sent,) = network.carry(Datagram(0, 1, parcel(100)))
    assert not sent.arrived
    assert not network.nodes.alive[0]
    assert books(network.nodes)[0][SPENT] == 1e-5
    assert 1 not in books(network.nodes)


def test_with_a_rate_the_bursts_of_a_batch_follow_one_another():
    network = ideal_network([(0, 0), (10, 0), (20, 0)], mac=IdealMac(rate=9600.0))
    network.carry(Datagram(0, 1, parcel(2)), Datagram(2, 1, parcel(3)))
    table = events(network)
    assert table["time"][table["kind"] == KIND["receive"]] == pytest.approx([0.02, 0.05])
    assert network.env.now == pytest.approx(0.05)


SINKS = [(0, 0), (50, 0), (100, 0), (190, 0), (500, 0)]
"""Node 2 is one hop of 90 m from sink 3 (with a range of 95 m), or two of 50 m from sink 0."""


@pytest.mark.parametrize(
    ("weight", "sink", "hops"), [("energy", 0, 2), ("hop", 3, 1), ("greedy", 3, 1)]
)  # fmt: skip
def test_a_datagram_for_a_sink_goes_to_the_one_with_the_cheapest_path(weight, sink, hops):
    network = ideal_network(SINKS, weight=weight, sinks=(4, 0, 3), link=Disk(reach=95.0))
    (sent,) = network.carry(Datagram(2, A_SINK, parcel()))
    assert sent.arrived and (sent.to, sent.hops) == (sink, hops)


def test_a_datagram_of_a_sink_for_a_sink_has_arrived_and_one_that_reaches_none_is_dropped_once():
    network = ideal_network(SINKS, sinks=(4, 0))
    own, far = network.carry(Datagram(0, A_SINK, parcel()), Datagram(3, A_SINK, parcel()))
    assert own.arrived and own.bits == 0 and not far.arrived
    (drop,) = network.rows("drop")
    assert network.memory.words.all()[int(drop["what"])] == "no_path"


@pytest.mark.parametrize(("weight", "nearest"), [("energy", False), ("hop", False), ("greedy", True)])
def test_the_cheapest_sink_is_that_of_all_shortest_paths(weight, nearest):
    rng = np.random.default_rng(7)
    network = ideal_network(rng.uniform(-150, 150, (60, 2)), weight=weight)
    ends, router = [3, 20, 41], network.router
    for source in range(0, 60, 5):
        found = router.cheapest_end(source, ends)
        reached = {end: path for end in ends if (path := router.path(source, end)) is not None}
        if not reached:
            assert found is None
            continue

        def cost(end, paths=reached, source=source):
            hops = [network.nodes.distance(a, b) for a, b in itertools.pairwise(paths[end])]
            if weight == "energy":
                return sum(100e-9 + 100e-12 * hop**2 for hop in hops)
            return network.nodes.distance(source, end) if nearest else len(hops)

        assert cost(found) == pytest.approx(min(map(cost, reached)))


def test_a_burst_says_how_often_it_was_tried_and_whether_its_sender_knows_that_it_arrived():
    network = RadioNetwork([(0, 0), (10, 0), (500, 0)], mac=Csma(max_retries=3))
    near, far = network.unicast(0, 1, packets=2), network.unicast(0, 2)
    assert (near.attempts, near.acknowledged) == (2, True), "one try for each of two frames"
    assert (far.attempts, far.acknowledged) == (4, False)
    ideal = ideal_network([(0, 0), (10, 0)]).unicast(0, 1)
    assert (ideal.attempts, ideal.acknowledged) == (1, True)


def test_a_sender_whose_acknowledgements_are_lost_does_not_know_that_its_burst_arrived():
    network = RadioNetwork([(0, 0), (10, 0)], mac=Csma(max_retries=2))
    channel, transmit = network.mac.channel, network.mac.channel.transmit

    def without_acknowledgements(source, frame, on_end, asleep=None):
        return transmit(source, frame, (lambda t, r: on_end(t, False)) if frame.packets == 0 else on_end, asleep)

    channel.transmit = without_acknowledgements
    burst = network.unicast(0, 1)
    assert burst.packets == 1 and (burst.attempts, burst.acknowledged) == (3, False)
