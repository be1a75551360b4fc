"""The collection tree: routes, beacons, datagrams on their way to sinks, faults, and what all of it costs."""

import networkx as nx
import numpy as np
import pytest

from tests.network.tree_network import TreeNetwork, grid
from wsnsim.base.frames import EVERYONE
from wsnsim.base.tables import KIND, RECORDED_BY_DEFAULT, Memory
from wsnsim.experiment import replicate_of
from wsnsim.models.access import Csma, IdealMac, Tdma
from wsnsim.models.links import Disk, LogNormal
from wsnsim.models.low_power_listening import ContikiMac, XMac
from wsnsim.models.sleep import DutyCycle
from wsnsim.models.tsch import Tsch
from wsnsim.models.workloads import CollectionTreeProtocol
from wsnsim.scenario import build, load

LINE = [(60.0 * i, 0.0) for i in range(5)]
"""Node 0 is the sink; each node hears the one before and the one after."""
PAIR = [(0, 0), (60, 0), (60, 20), (110, 10)]
"""Node 3 reaches the sink, node 0, over node 1 or over node 2."""


def tree(positions=LINE, **more):
    return TreeNetwork(positions, **more)


def test_every_node_finds_a_route_of_next_to_the_fewest_hops():
    rng = np.random.default_rng(5)
    network = tree(rng.uniform(0, 260, (40, 2)))
    network.run(12.0)
    graph = nx.Graph()
    graph.add_nodes_from(range(40))
    for node in range(40):
        graph.add_edges_from((node, other) for other in network.transport.topology.neighbours(node).id_list)
    fewest = nx.single_source_shortest_path_length(graph, 0)
    for node in range(40):
        assert network.depth(node) >= fewest.get(node, -1)
        if node in fewest:
            assert fewest[node] <= network.depth(node) <= fewest[node] + 2
            assert network.tree.cost(node) >= fewest[node] - 1e-9


def test_a_network_starts_without_a_tree_and_pays_for_every_beacon():
    network = tree()
    assert network.parents() == [0, -1, -1, -1, -1]
    network.run(3.0)
    assert network.parents() == [0, 0, 1, 2, 3]
    beacons = [row for row in network.rows("send") if network.memory.words.all()[int(row["what"])] == "routing_beacon"]
    assert len(beacons) == network.tree.beacons.sent and all(row["joules"] > 0.0 for row in beacons)
    assert {row["peer"] for row in beacons} == {EVERYONE} and network.ledger_adds_up()


def test_a_report_takes_one_hop_after_another_and_each_is_paid_and_logged():
    network = tree()
    network.run(5.0)
    report = network.report(4)
    network.run(6.0)
    assert report.arrived and (report.to, report.hops) == (0, 4)
    hops = [(row["node"], row["peer"]) for row in network.rows("send", "relay") if row["peer"] >= 0]
    words = network.memory.words.all()
    data = [row for row in network.rows("send", "relay") if words[int(row["what"])] == "report"]
    assert [(row["node"], row["peer"]) for row in data] == [(4, 3), (3, 2), (2, 1), (1, 0)] and hops
    assert [row["kind"] for row in data].count(data[0]["kind"]) == 1, "one sends, three relay"
    assert len({row["sequence"] for row in data}) == 1 and report.bits == sum(row["bits"] for row in data)


def test_a_node_that_no_beacon_reaches_waits_for_a_route_and_then_drops_its_report():
    network = tree([(0, 0), (50, 0), (500, 0)], routing=CollectionTreeProtocol(patience=4.0))
    report = network.report(2)
    network.run(3.9)
    assert not network.ends[0].triggered
    network.run(4.1)
    assert network.ends[0].triggered and not report.arrived and network.drops() == ["no_route"]


def test_a_report_from_before_there_is_a_tree_waits_for_it():
    network = tree()
    report = network.report(4)
    network.run(5.0)
    assert report.arrived and report.arrived_at < 4.0 and network.drops() == []


@pytest.mark.parametrize(("retries", "mac_retries", "sends"), [(0, 0, 1), (3, 0, 4), (32, 0, 33), (32, 3, 36)])
def test_a_datagram_is_sent_again_up_to_the_limit(retries, mac_retries, sends):
    network = tree(LINE[:2], routing=CollectionTreeProtocol(retries=retries), mac=Csma(max_retries=mac_retries))
    network.run(5.0)
    network.crash(0)
    report = network.report(1)
    network.run(8.0)
    frames = [row for row in network.rows("send") if row["peer"] == 0]
    assert not report.arrived and len(frames) == sends and network.drops() == ["retry_limit"]


def test_a_full_queue_drops_what_comes_later():
    network = tree(LINE[:2], routing=CollectionTreeProtocol(queue=3))
    reports = [network.report(1) for _ in range(5)]
    network.run(5.0)
    assert [report.arrived for report in reports] == [True] * 3 + [False] * 2
    assert network.drops() == ["queue_full"] * 2


@pytest.mark.parametrize("how", ["crash", "jam"])
def test_a_parent_that_does_not_answer_costs_more_and_more_until_another_is_taken(how):
    network = tree(PAIR)
    network.run(10.0)
    first = network.tree.parent(3)
    if how == "crash":
        network.crash(first)
    else:
        network.nodes.jammed[first] = True
        network.nodes.disturbed = True
    reports = [network.report(3) for _ in range(3)]
    network.run(12.0)
    assert all(report.arrived for report in reports)
    links = network.tree._members[3].route.links
    assert network.tree.parent(3) == 3 - first and links.etx(first) > 2.0 > links.etx(3 - first)


def test_a_node_that_restarts_knows_nothing_and_asks_for_beacons():
    network = tree(LINE, routing=CollectionTreeProtocol(i_max=1000.0))
    network.run(300.0)
    sent = network.tree.beacons.sent
    network.crash(2)
    report = network.report(2)
    network.run(301.0)
    assert not report.arrived and network.tree.parent(2) == -1 and network.tree.beacons.sent <= sent + 5
    network.restart(2)
    network.run(306.0)
    assert network.tree.parent(2) == 1 and network.depth(4) == 4, "the pull bit makes its neighbours beacon at once"


def looped(routing=None):
    """A network in which 2 → 4 → 3 → 2 is a loop since node 1, over which the way to the sink led, is down."""
    places = [(0, 0), (60, 0), (120, 0), (160, 20), (160, -20), (60, 200)]
    network = tree(places, routing=routing or CollectionTreeProtocol())
    network.run(20.0)
    routes = {node: network.tree._members[node].route for node in (2, 3, 4)}
    routes[3]._take(2)
    routes[4]._take(3)
    routes[2]._advertised[4] = (3, routes[4].cost)
    assert [network.tree.parent(node) for node in (2, 3, 4)] == [1, 2, 3]
    network.crash(1)
    return network


@pytest.mark.thorough
def test_a_loop_is_noticed_by_the_cost_that_does_not_fall_and_no_datagram_lives_for_ever():
    network = looped()
    noticed = []
    hasten = network.tree.beacons.hasten
    network.tree.beacons.hasten = lambda node: (noticed.append((network.env.now, node)), hasten(node))
    sent = network.tree.beacons.sent
    reports = [network.report(2) for _ in range(3)]
    network.run(60.0)
    assert noticed and network.tree.beacons.sent > sent + 10
    assert all(event.triggered for event in network.ends) and not any(report.arrived for report in reports)
    assert set(network.drops()) <= {"retry_limit", "hop_limit", "no_route", "queue_full"}


def test_a_loop_is_repaired_as_soon_as_there_is_a_way():
    network = looped()
    lost = network.report(2)
    network.run(22.0)
    network.restart(1)
    network.run(60.0)
    assert [network.depth(node) for node in (1, 2, 3, 4)] == [1, 2, 3, 3]
    late = network.report(4)
    network.run(61.0)
    assert late.arrived and late.hops == 3 and network.ends[0].triggered and lost.hops <= 255


def test_nodes_behind_a_dead_bridge_count_to_the_largest_cost_and_then_send_no_data():
    """TEP 123, section 3: routes that cost more than a constant are not considered. 4,600 frames in 20 s without it."""
    network = tree([(0, 0), (60, 0), (120, 0), (160, 20), (160, -20)], horizon=100.0)
    network.run(20.0)
    network.crash(1)
    before = network.counters.transmissions
    reports = []
    for i in range(30):
        network.at(20.1 + i / 3.0, lambda i=i: reports.append(network.report(2 + i % 3)))
    network.run(40.0)
    assert network.counters.transmissions - before < 2000
    assert network.parents()[2:] == [-1, -1, -1], "the count has ended"
    network.run(41.0)
    assert not [row for row in network.rows("send", "relay") if row["time"] > 35.0 and row["peer"] >= 0]
    assert len(reports) == len(network.drops()) == 30, "each is dropped once"
    network.restart(1)
    late = [network.report(node) for node in (2, 3, 4)]
    network.run(50.0)
    assert all(report.arrived for report in late)


@pytest.mark.parametrize("upwards", [True, False], ids=["to a sink", "by position"])
def test_a_copy_that_is_dropped_while_another_goes_on_is_no_dropped_datagram(upwards):
    network = tree(routing=CollectionTreeProtocol(retries=0, candidates=1), mac=Csma(max_retries=0))
    network.run(5.0)
    channel, transmit, lost = network.mac.channel, network.mac.channel.transmit, []

    def losing(source, frame, on_end, asleep=None):
        if frame.packets == 0 and not lost:
            lost.append(frame)
            return transmit(source, frame, lambda t, r: on_end(t, False), asleep)
        return transmit(source, frame, on_end, asleep)

    channel.transmit = losing
    datagram = network.report(4) if upwards else network.send(4, 0)
    network.run(8.0)
    assert lost and datagram.arrived and network.drops() == []


def test_a_report_whose_acknowledgement_is_lost_arrives_once():
    network = tree()
    network.run(5.0)
    channel, transmit, lost = network.mac.channel, network.mac.channel.transmit, []

    def losing(source, frame, on_end, asleep=None):
        if frame.packets == 0 and len(lost) < 4:  # the acknowledgements of the first burst of node 4
            lost.append(frame)
            return transmit(source, frame, lambda t, r: on_end(t, False), asleep)
        return transmit(source, frame, on_end, asleep)

    channel.transmit = losing
    report = network.report(4)
    network.run(7.0)
    words = network.memory.words.all()
    relayed = [row for row in network.rows("relay") if words[int(row["what"])] == "report"]
    assert report.arrived and len(lost) == 4
    assert [row["node"] for row in relayed] == [3, 2, 1], "the second copy is known, and goes no farther"


def test_of_several_sinks_the_one_that_costs_least_gets_the_report():
    network = tree([(60.0 * i, 0.0) for i in range(7)], sinks=(0, 6))
    network.run(10.0)
    reports = [network.report(node) for node in range(7)]
    network.run(11.0)
    assert all(report.arrived for report in reports)
    assert [reports[node].to for node in (0, 1, 2, 4, 5, 6)] == [0, 0, 0, 6, 6, 6] and reports[3].to in (0, 6)
    assert reports[0].bits == reports[6].bits == 0


@pytest.mark.thorough
def test_tables_hold_as_many_neighbours_as_they_may_and_everybody_has_a_route():
    rng = np.random.default_rng(2)
    network = tree(rng.uniform(0, 110, (45, 2)), routing=CollectionTreeProtocol(table=5, places=8))
    network.run(60.0)
    assert all(network.depth(node) >= 0 for node in range(45))
    members = network.tree._members.values()
    assert max(len(member.route.links._links) for member in members) == 5
    assert max(len(member.places.places) for member in members) == 8


def test_beacons_grow_rare_as_long_as_nothing_changes():
    network = tree(grid(4, 50.0), routing=CollectionTreeProtocol(i_max=16.0), mac=IdealMac())
    network.run(100.0)
    sent = network.tree.beacons.sent
    network.run(260.0)
    assert network.tree.beacons.sent - sent == pytest.approx(16 * 10, abs=16), "one in 16 s"
    network.run(100.0 + 16 * 20)


def test_intervals_of_one_length_are_beacons_at_a_fixed_rate():
    network = tree(grid(4, 50.0), routing=CollectionTreeProtocol(i_min=8.0, i_max=8.0))
    network.run(160.0)
    assert network.tree.beacons.sent == 16 * 20


def test_nodes_that_sleep_leave_their_beacons_out_and_reports_still_arrive():
    network = tree(grid(4, 40.0), sleep=DutyCycle(period=2.0, awake_share=0.5), horizon=100.0)
    network.run(60.0)
    awake = [node for node in range(16) if network.nodes.is_awake(node)]
    reports = [network.report(node) for node in awake]
    network.run(80.0)
    assert sum(report.arrived for report in reports) >= len(reports) / 2
    assert all(event.triggered for event in network.ends)


def test_over_lossy_links_retransmissions_deliver_what_is_lost_without_them():
    share = {}
    for retries in (0, 32):
        link, mac = LogNormal(asymmetry=0.0), Csma(max_retries=0)
        network = tree(grid(5, 28.0), link=link, mac=mac, routing=CollectionTreeProtocol(retries=retries))
        reports = []
        for i in range(72):
            network.at(20.0 + i / 4, lambda i=i, n=network, r=reports: r.append(n.report(i % 24 + 1)))
        network.run(50.0)
        share[retries] = np.mean([report.arrived for report in reports])
        assert all(event.triggered for event in network.ends) and network.ledger_adds_up()
    assert share[32] > 0.95 > share[0]


def test_the_same_seed_gives_the_same_run_and_a_death_ends_what_a_node_holds():
    runs = []
    for _ in range(2):
        network = tree(LINE, link=Disk(reach=75.0))
        network.run(4.0)
        network.report(4)
        network.nodes.spend(2, 0, 10.0)
        network.run(30.0)
        assert network.died and network.ends[0].triggered
        runs.append(network.log.fingerprint())
    assert runs[0] == runs[1]


@pytest.mark.thorough(fast=["contikimac", "tsch"])
@pytest.mark.parametrize("mac", [Tdma(), XMac(), ContikiMac(), Tsch()], ids=lambda mac: mac.mechanism)
def test_it_works_over_every_mac(mac):
    places = [(0, 0), (50, 0), (100, 0), (50, 40)]
    network = tree(places, mac=mac, horizon=400.0, routing=CollectionTreeProtocol(i_min=2.0))
    network.run(100.0)
    reports = [network.report(node) for node in (1, 2, 3)]
    network.run(140.0)
    assert all(report.arrived for report in reports) and network.depth(2) == 2
    assert network.ledger_adds_up()


@pytest.mark.thorough
@pytest.mark.parametrize(("retries", "least", "most"), [(32, 0.99, 1.0), (3, 0.95, 0.995), (0, 0.8, 0.93)])
def test_retransmissions_deliver_nine_reports_in_ten_and_more_on_a_log_normal_field(retries, least, most):
    """Published: above 90 % on every testbed, with 32 retransmissions. Measured on these seeds: 99.9, 97.7, 87.5 %."""
    arrived = []
    for seed in range(1, 7):
        setup = build(load("collection", [f"seed={seed}", f"routing.retries={retries}"]))
        memory = Memory({**RECORDED_BY_DEFAULT, "reports": True})
        replicate_of(setup, 0, memory)
        reports = memory.table("reports")
        arrived += np.isfinite(reports["received"][reports["time"] < 115.0]).tolist()
    assert len(arrived) > 1500 and least <= np.mean(arrived) <= most


@pytest.mark.thorough
def test_an_hour_needs_far_fewer_beacons_than_a_fixed_rate():
    """Published: 73 % fewer than at a fixed rate. One per 30 s and node is that rate; measured here: 83 % fewer."""
    changes = ["duration=3600 s", "workload.period=60 s"]
    sent = []
    for rule in ([], ["routing.i_min=30 s", "routing.i_max=30 s"]):
        memory = Memory()
        replicate_of(build(load("collection", changes + rule)), 0, memory)
        events, words = memory.table("events"), memory.words.all()
        beacons = events["time"][(events["what"] == words.index("routing_beacon")) & (events["kind"] == KIND["send"])]
        sent.append(np.histogram(beacons, [0, 60, 600, 3600])[0])
    adaptive, fixed = sent
    assert fixed.sum() == 60 * 120 and adaptive.sum() < 0.27 * fixed.sum()
    rates = adaptive / [60, 540, 3000]
    assert rates[0] > 5 * rates[1] > 10 * rates[2]
