"""The radio stack of a scenario: SimPy environment, nodes, topology, clocks and the mechanism of its `mac`."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Floats
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.frames import Counters
from wsnsim.base.initial_conditions import sample_initial_conditions
from wsnsim.base.mac_mechanisms import MacMechanism
from wsnsim.base.medium_access import DutyCycledMac
from wsnsim.base.radio import ContinuousPower, Mode, NoPower, continuous_power
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.rng import Streams, derive_all
from wsnsim.base.setups import NetworkSetup, RadioSetup
from wsnsim.base.sleeping import WakeUpRadio
from wsnsim.base.tables import Memory
from wsnsim.network.clocks import Clocks
from wsnsim.network.energy.local_schedules import LocalSchedules
from wsnsim.network.energy.power_table import PowerTable
from wsnsim.network.energy.storage import Storage
from wsnsim.network.event_log import EventLog
from wsnsim.network.mechanisms import make_mechanism
from wsnsim.network.node_states import SleepStates
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.mac_services import NetworkMacServices
from wsnsim.network.radio.topology import RadioServices, Topology
from wsnsim.network.radio.transmission import LinkCounters


class RadioStack(NamedTuple):
    """What every network is built on, with targets or without.

    `sinks` are the nodes nearest to the points of the scenario, each once; none if it has no sink.
    """

    radio: RadioServices
    clocks: Clocks
    mac: MacMechanism
    links: LinkCounters | None
    sinks: tuple[int, ...] = ()


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
    clocks = Clocks(setup.clock, streams.key("clock"), len(positions), env)
    nodes = make_nodes(env, setup, positions, traits, streams, clocks)
    topology = Topology(nodes, setup.link, streams.key("shadowing"), PACKET_BITS)
    topology.follow_rounds(env)
    links = LinkCounters(nodes.positions, topology) if count_links else None
    radio = RadioServices(env, nodes, topology, setup.energy, log, Counters())
    sinks = _sinks(setup, nodes.grid)
    services = NetworkMacServices(radio, setup.packing, clocks, streams, links, sinks)
    return RadioStack(radio, clocks, make_mechanism("mac", setup.mac, services), links, sinks)


def make_nodes(
    env: simpy.Environment, setup: RadioSetup, positions: Floats, traits: Floats, streams: Streams, clocks: Clocks
) -> Nodes:
    """Return the nodes of a scenario with their sleep states and background consumption.

    Args:
        env: The clock.
        setup: The scenario.
        positions: (N, 2) in m.
        traits: (N, T) constants of the sensors.
        streams: The random streams of the run, of which sleep schedules and batteries have one each.
        clocks: The clocks of the nodes, by which their schedules go.
    """
    schedules = None
    if setup.sleep.rest is Mode.SCHEDULED:
        schedules = LocalSchedules(setup.sleep, derive_all(streams.key("sleep"), np.arange(len(positions))), clocks)
    sleep_states = SleepStates(setup.sleep.rest, env, schedules)
    table = make_power_table(setup)
    battery, reach = setup.energy.battery, setup.link.reach
    storage = None if setup.plain_batteries else make_storage(env, setup, positions, streams)
    nodes = Nodes(positions, traits, battery, reach, sleep_states, env, table, setup.duration, storage)
    if nodes.follows_schedules:
        clocks.on_step.append(nodes.note_clock)
    return nodes


def make_power_table(setup: RadioSetup) -> PowerTable:
    """Return the power of a node in each of its states."""
    duties = setup.mac.duties if isinstance(setup.mac, DutyCycledMac) else ()
    model = continuous_power(setup.energy)
    searching = 0.0 if model is None and not duties else _search_power(setup)
    model = NoPower() if model is None else model
    return PowerTable(model, duties, searching, _standby_power(setup, model))


def make_storage(env: simpy.Environment, setup: RadioSetup, positions: Floats, streams: Streams) -> Storage:
    """Return the batteries of a scenario at the start of a run."""
    sinks = _sinks(setup, CellGrid(positions)) if setup.sink_points else ()
    return Storage(setup.battery, setup.battery.draw(setup, len(positions), sinks, streams("battery")), env)


def _sinks(setup: RadioSetup, grid: CellGrid) -> tuple[int, ...]:
    return tuple(dict.fromkeys(grid.nearest(np.array(point)) for point in setup.sink_points))


def _search_power(setup: RadioSetup) -> float:
    """Mean power in W that a node which is awake spends on measurements that look for targets."""
    if not isinstance(setup, NetworkSetup) or not setup.nodes_search:
        return 0.0
    return setup.energy.sense() / (setup.acquire.poll or setup.dt)


def _standby_power(setup: RadioSetup, model: ContinuousPower) -> float:
    """Power in W of the wake-up receiver of a sleeping node; zero where sleeping costs nothing, as in the papers."""
    asleep = model.mode_power(Mode.ASLEEP)
    if not isinstance(setup, NetworkSetup) or not asleep.radio + asleep.processor:
        return 0.0
    radio: WakeUpRadio = getattr(setup.wakeup, "radio", WakeUpRadio())
    return radio.standby


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
    conditions = sample_initial_conditions(replace(setup, steps=1), replicate)
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
