"""The radio stack of a scenario: SimPy environment, nodes, topology, clocks and MAC; and running it."""

from __future__ import annotations

from dataclasses import dataclass

import simpy

from wsnsim.base.arrays import Floats
from wsnsim.base.counters import Counters
from wsnsim.base.errors import ResultError, failed_run
from wsnsim.base.mac_mechanisms import MacMechanism
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.rng import Streams
from wsnsim.base.setups import RadioSetup
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog
from wsnsim.network.node_factory import make_nodes
from wsnsim.network.radio.link_counters import LinkCounters, NoLinkCounters
from wsnsim.network.radio.mac import make_mac
from wsnsim.network.radio.mac_services import NetworkMacServices
from wsnsim.network.radio.radio_services import RadioServices
from wsnsim.network.radio.topology import Topology


@dataclass(frozen=True, slots=True)
class RadioStack:
    """What every network is built on, with targets or without."""

    radio: RadioServices
    clocks: Clocks
    mac: MacMechanism
    links: LinkCounters | NoLinkCounters


def make_radio_stack(
    setup: RadioSetup, positions: Floats, traits: Floats, streams: Streams, log: EventLog, count_links: bool = False
) -> RadioStack:
    """Return the radio stack of a scenario.

    Args:
        setup: The scenario.
        positions: (N, 2) positions of the nodes in m.
        traits: (N, T) constants of their sensors.
        streams: The random streams of the run.
        log: The event log of the run.
        count_links: Whether broadcasts are counted per link.
    """
    env = simpy.Environment()
    nodes = make_nodes(env, setup, positions, traits, streams.key("sleep"))
    topology = Topology(nodes, setup.link, streams.key("shadowing"), PACKET_BITS)
    clocks = Clocks(setup.clock, streams.key("clock"), nodes.size)
    links = LinkCounters(nodes.positions, topology) if count_links else NoLinkCounters()
    radio = RadioServices(env, nodes, topology, setup.energy, log, Counters())
    mac = make_mac(setup.mac, NetworkMacServices(radio, setup.packing, clocks, streams, links))
    return RadioStack(radio, clocks, mac, links)


def run_until(env: simpy.Environment, event: simpy.Event, seed: int, replicate: int) -> None:
    """Run until an event has happened. A failure names seed, replicate and simulated time."""
    try:
        env.run(until=event)
    except ResultError:
        raise
    except Exception as raised:
        reason = raised.__cause__ or raised
        raise failed_run(env.now, seed, replicate, reason) from reason
