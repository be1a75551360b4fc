"""What a network is before it runs: where its nodes stand, which can exchange frames, and which are sinks."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import Memory
from wsnsim.network.event_log import EventLog
from wsnsim.network.radio.radio_stack import RadioStack, make_radio_stack


class NetworkFacts(NamedTuple):
    """A network of N nodes.

    Attributes:
        positions: (N, 2) in m.
        sinks: the nodes that are sinks.
        links: (N, N) whether two nodes can exchange frames over one hop, in both directions.
    """

    positions: Floats
    sinks: tuple[int, ...]
    links: Bools


def inspect_radio(setup: NetworkSetup, replicate: int) -> RadioStack:
    """The radio stack of a run, at its start.

    Raises:
        RunError: the deployment did not succeed.
    """
    conditions = sample_initial_conditions(dataclasses.replace(setup, steps=1), replicate)
    log = EventLog(Memory({}), replicate)
    return make_radio_stack(setup, conditions.positions, conditions.traits, setup.streams(replicate), log)


def inspect_network(setup: NetworkSetup, replicate: int) -> NetworkFacts:
    """The network of a run.

    Raises:
        RunError: the deployment did not succeed.
    """
    stack = inspect_radio(setup, replicate)
    topology, positions = stack.radio.topology, stack.radio.nodes.positions
    size = len(positions)
    topology.find_all()
    links = np.zeros((size, size), dtype=np.bool_)
    for node in range(size):
        near = topology.neighbours(node).ids.tolist()
        links[node, near] = [topology.connected(node, other) for other in near]
    return NetworkFacts(positions, stack.sinks, links & links.T)
