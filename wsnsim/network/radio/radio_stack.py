"""A scenario's radio, made: the clock, the nodes, who hears whom, and the way to the channel; and its run to the end.

make_ether(parts, positions, traits, streams, journal) -> Ether      run_until(env, event, seed, replicate)
"""

from __future__ import annotations

from dataclasses import dataclass

import simpy

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import ResultError, failed_run
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.rng import Streams
from wsnsim.base.setups import RadioSetup
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog
from wsnsim.network.node_factory import make_nodes
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.mac import Access, make_mac
from wsnsim.network.radio.topology import Topology


@dataclass(frozen=True, slots=True)
class RadioStack:
    """What every network is made on, with targets or without."""

    env: simpy.Environment
    fleet: Nodes
    wiring: Topology
    clocks: Clocks
    mac: Access


def make_radio_stack(
    parts: RadioSetup, positions: Floats, traits: Floats, streams: Streams, journal: EventLog
) -> RadioStack:
    """The radio of a scenario over nodes at positions (N, 2) with traits (N, T)."""
    env = simpy.Environment()
    fleet = make_nodes(env, parts, positions, traits, streams.key("sleep"))
    wiring = Topology(fleet, parts.link, streams.key("shadowing"), PACKET_BITS)
    clocks = Clocks(parts.clock, streams.key("clock"), fleet.size)
    return RadioStack(env, fleet, wiring, clocks, make_mac(env, fleet, journal, wiring, parts, streams, clocks))


def run_until(env: simpy.Environment, event: simpy.Event, seed: int, replicate: int) -> None:
    """Run until an event has happened. A failure names seed, replicate and simulated time."""
    try:
        env.run(until=event)
    except ResultError:
        raise
    except Exception as raised:
        reason = raised.__cause__ or raised
        raise failed_run(env.now, seed, replicate, reason) from reason
