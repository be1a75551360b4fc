"""Routing beacons: every node broadcasts what its route costs, when its Trickle timer says so."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from wsnsim.base.frames import Received
from wsnsim.base.mac_mechanisms import MacMechanism
from wsnsim.network.clocks import Clocks
from wsnsim.network.radio.radio_services import RadioServices
from wsnsim.network.radio.tree_node import RouteBeacon
from wsnsim.network.radio.trickle import TrickleTimer

BEACON_BITS: Final = 88
"""Bits of a beacon: options 8, parent 16, cost 16 (TEP 123); link estimation: flags 8, number 8; position 32 (ours)."""
NUMBERS: Final = 256

Compose = Callable[[int, int], RouteBeacon]
"""(node, number) -> the beacon that the node sends now."""


class _BeaconSender:
    """The timer of one node, the number of its next beacon, and whether one is waiting or on the air.

    `epoch` counts how often the timer was set: of several times, the last counts.
    """

    __slots__ = ("epoch", "number", "sending", "timer")

    def __init__(self, timer: TrickleTimer) -> None:
        self.timer = timer
        self.epoch = 0
        self.number = 0
        self.sending = False


class RouteBeacons:
    """The beacons of all nodes. A node that sleeps when its beacon is due leaves it out.

    Args:
        radio: The services of the radio.
        mac: The MAC.
        clocks: The clocks of the nodes, which the timers follow.
        compose: Composes a beacon.
        heard: Called with each receiver of a beacon, ascending, and the beacon.

    Attributes:
        sent: The number of beacons that nodes tried to send.
    """

    def __init__(
        self, radio: RadioServices, mac: MacMechanism, clocks: Clocks, compose: Compose,
        heard: Callable[[int, RouteBeacon], None],
    ) -> None:  # fmt: skip
        self._env = radio.env
        self._nodes = radio.nodes
        self._mac = mac
        self._clocks = clocks
        self._compose = compose
        self._heard = heard
        self._code = radio.log.code("routing_beacon")
        self._senders: dict[int, _BeaconSender] = {}
        self.sent = 0

    def begin(self, node: int, timer: TrickleTimer) -> None:
        """Start the timer of a node."""
        sender = self._senders[node] = _BeaconSender(timer)
        self._set(node, sender, timer.begin())

    def end(self, node: int) -> None:
        """Stop the timer of a node that is down."""
        self._senders.pop(node, None)

    def hasten(self, node: int) -> None:
        """Start the shortest interval of a node: its neighbours should hear from it soon."""
        sender = self._senders.get(node)
        seconds = None if sender is None else sender.timer.reset()
        if sender is not None and seconds is not None:
            self._set(node, sender, seconds)

    def _set(self, node: int, sender: _BeaconSender, seconds: float) -> None:
        sender.epoch += 1
        timeout = self._env.timeout(self._clocks.lasts(node, seconds))
        assert timeout.callbacks is not None, "a timeout has not passed yet"
        due = partial(self._due, node, sender, sender.epoch)
        timeout.callbacks.append(lambda _: due())

    def _due(self, node: int, sender: _BeaconSender, epoch: int) -> None:
        if self._senders.get(node) is not sender or sender.epoch != epoch:
            return
        transmit, seconds = sender.timer.advance()
        self._set(node, sender, seconds)
        if transmit and not sender.sending and self._nodes.is_awake(node):
            self._send(node, sender)

    def _send(self, node: int, sender: _BeaconSender) -> None:
        beacon = self._compose(node, sender.number)
        if self._senders.get(node) is not sender:
            return
        sender.number = (sender.number + 1) % NUMBERS
        sender.sending = True
        self.sent += 1
        self._mac.offer(node, BEACON_BITS, partial(self._sent, sender, beacon), self._code)

    def _sent(self, sender: _BeaconSender, beacon: RouteBeacon, received: Received | None) -> None:
        sender.sending = False
        for node in () if received is None else received.tolist():
            self._heard(node, beacon)
