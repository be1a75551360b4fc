"""A scenario's radio, made: the clock, the nodes, who hears whom, and the way to the channel; and its run to the end.

make_ether(parts, positions, traits, streams, journal) -> Ether      run_until(env, event, seed, replicate)
"""

from __future__ import annotations

from dataclasses import dataclass

import simpy

from wsnsim.base.arrays import Floats
from wsnsim.base.asks import PACKET_BITS
from wsnsim.base.errors import ResultError, failed_run
from wsnsim.base.problem import Radio
from wsnsim.base.rng import Streams
from wsnsim.network.clocks import Clocks
from wsnsim.network.fleet import Fleet, make_fleet
from wsnsim.network.journal import Journal
from wsnsim.network.mac import Access, make_mac
from wsnsim.network.wiring import Wiring


@dataclass(frozen=True, slots=True)
class Ether:
    """What every network is made on, with targets or without."""

    env: simpy.Environment
    fleet: Fleet
    wiring: Wiring
    clocks: Clocks
    mac: Access


def make_ether(parts: Radio, positions: Floats, traits: Floats, streams: Streams, journal: Journal) -> Ether:
    """The radio of a scenario over nodes at positions (N, 2) with traits (N, T)."""
    env = simpy.Environment()
    fleet = make_fleet(env, parts, positions, traits, streams.key("sleep"))
    wiring = Wiring(fleet, parts.link, streams.key("shadowing"), PACKET_BITS)
    clocks = Clocks(parts.clock, streams.key("clock"), fleet.size)
    return Ether(env, fleet, wiring, clocks, make_mac(env, fleet, journal, wiring, parts, streams, clocks))


def run_until(env: simpy.Environment, event: simpy.Event, seed: int, replicate: int) -> None:
    """Run until an event has happened. A failure names seed, replicate and simulated time."""
    try:
        env.run(until=event)
    except ResultError:
        raise
    except Exception as raised:
        reason = raised.__cause__ or raised
        raise failed_run(env.now, seed, replicate, reason) from reason
