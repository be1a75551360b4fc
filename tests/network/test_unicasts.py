"""Unicasts that are sent at one instant: the same rows, books and answers as burst by burst."""

from __future__ import annotations

import numpy as np
import pytest

import wsnsim
from tests.network.ledgers import books
from tests.network.radio_network import RadioNetwork
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.tables import Memory
from wsnsim.models.access import IdealMac
from wsnsim.models.energy import FirstOrder
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.datagrams import Datagram, Hops, Unicasts
from wsnsim.network.radio.ideal_medium import IdealMechanism
from wsnsim.network.radio.routing import PathForwarding
from wsnsim.network.radio.transport import Transport

POSITIONS = [(0.0, 0.0), (10.0, 0.0), (20.0, 7.0), (3.0, 30.0), (500.0, 500.0)]


FORM = Parcel(None, 1, PACKET_BITS, "reading")


def to_head(*nodes: int) -> Unicasts:
    """Readings on their way to node 0."""
    return Unicasts(list(nodes), [0] * len(nodes), [FORM] * len(nodes), 0)


def network(battery: float = 2.0, rate: float | None = None) -> RadioNetwork:
    return RadioNetwork(POSITIONS, mac=IdealMac(rate=rate), energy=FirstOrder(battery=battery))


def one_by_one(patch: pytest.MonkeyPatch) -> None:
    """Never perform several acts at once: somebody might die."""
    patch.setattr(Nodes, "all_outlast", lambda self, nodes, joules: False)


def tables(name: str, *overrides: str) -> dict[str, dict[str, np.ndarray]]:
    memory = Memory()
    wsnsim.experiment.simulate_run(wsnsim.load(name, ["duration=0.6 s", *overrides]), 0, memory)
    return {table: memory.table(table) for table in ("events", "energy", "energy_steps", "estimates", "nodes")}


@pytest.mark.thorough(fast=["0.002"])
@pytest.mark.parametrize("battery", [2.0, 0.002])
def test_a_run_has_the_same_tables_at_once_and_one_by_one(battery, monkeypatch):
    at_once = tables("pso_mhpf", f"energy.battery={battery}")
    split: list[Unicasts] = []
    original = Unicasts.split
    monkeypatch.setattr(Unicasts, "split", lambda self: split.append(self) or original(self))
    one_by_one(monkeypatch)
    slowly = tables("pso_mhpf", f"energy.battery={battery}")
    assert split, "the twin performs every unicast by itself"
    assert np.isfinite(at_once["nodes"]["died_at"]).any() == (battery < 2.0)
    for table, columns in at_once.items():
        for column, values in columns.items():
            assert values.tobytes() == slowly[table][column].tobytes(), f"{table}.{column}"


def test_nothing_is_split_while_everything_arrives(monkeypatch):
    monkeypatch.setattr(Unicasts, "split", lambda self: pytest.fail("bursts are made"))
    net = network()
    first, second = net.carry(*(Datagram(node, 0, Parcel(None, 2, PACKET_BITS, "x")) for node in (1, 2)))
    assert first.arrived and first.mask.all() and (first.bits, first.hops) == (2 * PACKET_BITS, 1)
    assert second.arrived and net.counters.delivered == net.counters.frames_sent == 2


def test_a_gathering_says_from_whom_something_arrived():
    net = network()
    unicasts = to_head(1, 2)
    event = net.transport.carry_unicasts(unicasts, one_hop=True)
    assert event is not None
    net.nodes.crash(2)
    net.env.run(until=event)
    arrived, lost = unicasts.masks()
    assert arrived is not None and arrived.all() and lost is None and unicasts.bits == PACKET_BITS
    assert sorted(books(net.nodes)) == [0, 1]


def test_what_takes_time_or_several_hops_needs_datagrams():
    assert network(rate=9600.0).transport.carry_unicasts(to_head(1, 2), one_hop=True) is None
    assert network().transport.carry_unicasts(to_head(1, 4), one_hop=True) is None


class Listed(IdealMechanism):
    """A MAC of somebody else, who inherits and has a way of its own to send."""

    def send(self, bursts, head=None):
        self.sent = [*getattr(self, "sent", ()), *bursts]
        return super().send(bursts, head)


class Passing:
    """A MAC of somebody else, who passes on to the ideal one what it lacks."""

    def __init__(self, mac):
        self._mac, self.sent = mac, []

    def __getattr__(self, name):
        return getattr(self._mac, name)

    def send(self, bursts, head=None):
        self.sent += bursts
        return self._mac.send(bursts, head)


@pytest.mark.parametrize("inherits", [True, False])
def test_a_mac_with_a_way_of_its_own_to_send_gets_every_burst(inherits):
    net = network()
    if inherits:
        net.mac.__class__ = Listed
    mac = net.mac if inherits else Passing(net.mac)
    hops = Hops(net.radio, mac)
    net.transport = Transport(net.radio, mac, hops, PathForwarding(net.radio, hops, net.router))
    assert net.transport.carry_unicasts(to_head(1, 2), one_hop=True) is None
    net.carry(Datagram(1, 0, FORM), Datagram(2, 0, FORM))
    assert [burst.source for burst in mac.sent] == [1, 2]


def test_unicasts_of_no_packets_are_performed_one_by_one():
    net = network()
    (sent,) = net.carry(Datagram(1, 0, Parcel(None, 0, PACKET_BITS, "nothing")))
    assert not sent.arrived and net.counters.frames_sent == 1
