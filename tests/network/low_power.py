"""Networks with low-power listening on a CC2420, and what their radios spend, for tests."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

from tests.network.radio_network import RadioNetwork
from wsnsim.base.tables import CAUSE
from wsnsim.models.datasheets import ProcessorSheet, RadioSheet
from wsnsim.models.energy import States
from wsnsim.models.low_power_listening import ContikiMac

TURNAROUND, ACK = 192e-6, 88 / 250e3
LISTEN, SEND, SLEEP, SWITCHING, START, STOP = 62e-3, 57.42e-3, 66e-6, 62e-3, 1.054e-3 * 12.55e-3, 0.05e-3 * 1.4e-3
START_TIME, STOP_TIME = 1.054e-3, 0.05e-3
OFF_TIME: Final = START_TIME + STOP_TIME
"""A sender listens at the earliest when its radio has stopped and started."""
IDLE_PROCESSOR: Final = 15.3e-6
CC2420: Final = RadioSheet(
    name="CC2420", source="SWRS041", rate=250e3, receive=LISTEN, listen=LISTEN, levels=(0.0,), transmit=(SEND,),
    sleep=SLEEP, wake=START_TIME, wake_power=12.55e-3, doze=STOP_TIME, doze_power=1.4e-3, turnaround=TURNAROUND,
    turnaround_power=SWITCHING, sensitivity=-95.0, noise=-100.0,
)  # fmt: skip
IN_IDLE: Final = dataclasses.replace(CC2420, sleep=1.4e-3, wake=0.194e-3, wake_power=62e-3)
"""The same radio, its crystal left on: as ContikiMAC needs it, whose channel checks are 0.5 ms apart."""
PROCESSOR: Final = ProcessorSheet(
    name="MSP430", source="SLAS368", rate=8e6, run=5.4e-3, idle=163.5e-6, sleep=IDLE_PROCESSOR, wake=6e-6
)
PAIR: Final = [(0, 0), (50, 0)]


def low_power(mac: Any, positions: Any = PAIR, **given: Any) -> RadioNetwork:
    """Return a network of nodes with a CC2420, within 75 m of each other or not."""
    energy = States(radio=IN_IDLE if isinstance(mac, ContikiMac) else CC2420, processor=PROCESSOR)
    return RadioNetwork(positions, mac=mac, **{"energy": energy, "horizon": 1e4} | given)


def phases(network: RadioNetwork) -> Any:
    """(N,) when each node first wakes, in s."""
    return network.mac._radios._phases


def joules(network: RadioNetwork, cause: str, node: int) -> float:
    """What a node has spent on a cause; the network must have been closed."""
    return float(network.nodes.ledger.joules[CAUSE[cause]][node])


def spent(mac: Any, until: float, act: Any = None, positions: Any = PAIR, **given: Any) -> tuple[RadioNetwork, Any]:
    """Return a network after some seconds, closed, and what an act returned that it performed at the start."""
    network = low_power(mac, positions, horizon=until, **given)
    result = None if act is None else act(network)
    network.env.run(until=until)
    network.nodes.close()
    assert network.ledger_adds_up()
    return network, result
