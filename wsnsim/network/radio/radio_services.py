"""Services that everything on the radio uses: SimPy environment, nodes, topology, energy model, event log, counters."""

from __future__ import annotations

from dataclasses import dataclass

import simpy

from wsnsim.base.frames import Counters
from wsnsim.base.radio import EnergyModel
from wsnsim.network.event_log import EventLog
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.topology import Topology


@dataclass(frozen=True, slots=True)
class RadioServices:
    """Services shared by media, channel, MAC, routing and transport of one run."""

    env: simpy.Environment
    nodes: Nodes
    topology: Topology
    energy: EnergyModel
    log: EventLog
    counters: Counters
