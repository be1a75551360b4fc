import itertools
from types import SimpleNamespace

import networkx as nx
import numpy as np
import pytest
import simpy

from tests.network.ledgers import SPENT, books
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.rng import Streams
from wsnsim.base.tables import CAUSE, KIND, Memory
from wsnsim.models.access import IdealMac
from wsnsim.models.energy import FirstOrder
from wsnsim.models.hardware import NoPacking, PerfectClock
from wsnsim.models.links import Disk, MinimumEnergy
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.mac import make_mac
from wsnsim.network.radio.routing import Router
from wsnsim.network.radio.topology import Topology
from wsnsim.network.radio.transport import Transport, datagram


class Place:
    """An air over given nodes, with its log."""

    def __init__(self, positions, link=None, battery=2.0, mac=None, weight="energy"):
        self.env = simpy.Environment()
        self.memory = Memory()
        self.journal = EventLog(self.memory, 0)
        self.energy, self.link = FirstOrder(battery=battery), link or Disk(reach=75.0)
        self.fleet = Nodes(np.array(positions, dtype=float), np.ones((len(positions), 1)), battery, self.link.reach)
        wiring = Topology(self.fleet, self.link, 11, PACKET_BITS)
        clocks = Clocks(PerfectClock(), 0, self.fleet.size)
        parts = SimpleNamespace(
            mac=mac or IdealMac(), energy=self.energy, link=self.link, packing=NoPacking(), routing=MinimumEnergy()
        )
        self.mac = make_mac(self.env, self.fleet, self.journal, wiring, parts, Streams(11, 0), clocks)
        self.counts = self.mac.counts
        self.router = Router(self.env, self.fleet, wiring, self.energy, weight, self.link.audible)
        self.fleet.on_death = self.router.bury
        self.air = Transport(self.env, self.fleet, wiring, self.mac, self.router, self.journal)

    def carry(self, *letters):
        self.env.run(until=self.air.carry(list(letters), 0))
        return letters

    def events(self):
        self.journal.fingerprint()
        return self.memory.table("events")


def parcel(packets=1):
    return Parcel("payload", packets, PACKET_BITS, "test")


def test_a_unicast_costs_its_distance_to_the_sender_and_its_bits_to_the_receiver():
    place = Place([(0, 0), (30, 40), (1, 1)])
    (sent,) = place.carry(datagram(0, 1, parcel(3)))
    bits = 3 * 96
    assert sent.arrived and sent.mask.tolist() == [True] * 3 and (sent.hops, sent.bits) == (1, bits)
    assert books(place.fleet)[0][SPENT] == pytest.approx(bits * (50e-9 + 100e-12 * 2500), rel=1e-12)
    assert books(place.fleet)[1][SPENT] == pytest.approx(bits * 50e-9, rel=1e-12)
    assert 2 not in books(place.fleet), "overheard unicasts cost nothing on an ideal channel"


def test_a_broadcast_is_paid_at_reach_and_heard_by_every_living_node_within():
    place = Place([(0, 0), (30, 0), (74, 0), (76, 0), (0, 50)])
    place.fleet.alive[4] = False
    event, (frame,) = place.air.broadcast([0], [parcel()], 0)
    place.env.run(until=event)
    assert sorted(frame.heard) == [1, 2]
    assert books(place.fleet)[0][SPENT] == pytest.approx(96 * (50e-9 + 100e-12 * 75**2), rel=1e-12)
    assert place.fleet.ledger.totals[CAUSE["rx"]] == pytest.approx(2 * 96 * 50e-9, rel=1e-12)


def test_a_broadcast_is_one_event_of_the_engine():
    place = Place([(0, 0)] + [(i, 1) for i in range(30)])
    before = place.env._eid
    next(before)
    place.air.broadcast([0], [parcel()], 0)
    assert next(place.env._eid) == 2


def test_what_is_sent_to_oneself_costs_nothing_and_arrives():
    place = Place([(0, 0), (10, 0)])
    (sent,) = place.carry(datagram(0, 0, parcel(5)))
    assert sent.arrived and sent.mask.all() and books(place.fleet) == {}


def test_paths_are_the_cheapest_by_energy_or_by_hops():
    rng = np.random.default_rng(4)
    positions = rng.uniform(-150, 150, (60, 2))
    for weight in ("energy", "hop"):
        place = Place(positions, weight=weight)
        graph = nx.Graph()
        for a in range(60):
            for b in range(a):
                d = float(np.linalg.norm(positions[a] - positions[b]))
                if d <= 75:
                    graph.add_edge(a, b, w=1.0 if weight == "hop" else 100e-9 + 100e-12 * d * d)
        for to in range(1, 60, 7):
            found = place.router.path(0, to)
            truth = nx.shortest_path_length(graph, 0, to, weight="w")
            assert sum(graph[a][b]["w"] for a, b in itertools.pairwise(found)) == pytest.approx(truth)


def test_the_dead_relay_nothing():
    place = Place([(0, 0), (60, 0), (60, 30), (120, 0)], weight="hop")
    place.router.path(0, 3)
    place.fleet.spend(1, CAUSE["cpu"], 10.0)
    assert place.router.path(0, 3) == [0, 2, 3]
    place.fleet.spend(2, CAUSE["cpu"], 10.0)
    assert place.router.path(0, 3) is None
    (sent,) = place.carry(datagram(0, 3, parcel(2)))
    assert not sent.arrived and not sent.mask.any()


def test_packets_lost_on_a_hop_are_not_forwarded_and_hops_share_one_sequence():
    place = Place([(0, 0), (70, 0), (140, 0)], link=Disk(reach=75.0, loss=0.3))
    (sent,) = place.carry(datagram(0, 2, parcel(200)))
    table = place.events()
    sends = np.isin(table["kind"], [KIND["send"], KIND["relay"]])
    assert table["packets"][sends][0] == 200
    received = table["packets"][table["kind"] == KIND["receive"]]
    assert table["packets"][sends][1] == received[0] < 200
    assert received[1] == sent.mask.sum() < received[0]
    assert len(set(table["sequence"][sends])) == 1 and len(set(table["frame"][sends])) == 2
    assert 0.4 < sent.mask.mean() < 0.58


def test_a_sender_whose_charge_ends_in_mid_burst_delivers_nothing_and_has_spent_all():
    place = Place([(0, 0), (10, 0)], battery=1e-5)
    (sent,) = place.carry(datagram(0, 1, parcel(100)))
    assert not sent.arrived
    assert not place.fleet.alive[0]
    assert books(place.fleet)[0][SPENT] == 1e-5
    assert 1 not in books(place.fleet)


def test_with_a_rate_the_bursts_of_a_batch_follow_one_another():
    place = Place([(0, 0), (10, 0), (20, 0)], mac=IdealMac(rate=9600.0))
    place.carry(datagram(0, 1, parcel(2)), datagram(2, 1, parcel(3)))
    table = place.events()
    assert table["time"][table["kind"] == KIND["receive"]] == pytest.approx([0.02, 0.05])
    assert place.env.now == pytest.approx(0.05)
