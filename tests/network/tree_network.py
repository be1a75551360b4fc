"""A radio network whose nodes forward datagrams over a collection tree and by position, for tests."""

from __future__ import annotations

from typing import Any

import numpy as np
import simpy

from tests.network.radio_network import RadioNetwork
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.models.workloads import CollectionTreeProtocol
from wsnsim.network.radio.collection_tree import CollectionTree
from wsnsim.network.radio.datagrams import A_SINK, Datagram, Hops
from wsnsim.network.radio.radio_stack import RadioStack
from wsnsim.network.radio.transport import Transport


class TreeNetwork(RadioNetwork):
    """Nodes with `routing: ctp`, of which `sinks` are the roots; started at time 0."""

    def __init__(
        self, positions: Any, sinks: tuple[int, ...] = (0,), routing: CollectionTreeProtocol | None = None, **more: Any
    ) -> None:
        super().__init__(positions, **more)
        hops = Hops(self.radio, self.mac)
        stack = RadioStack(self.radio, self.clocks, self.mac, self.links)
        self.tree = CollectionTree(stack, hops, routing or CollectionTreeProtocol(), sinks, 77)
        self.transport = Transport(self.radio, self.mac, hops, self.tree)
        self.topology.on_change = self.tree.forget_links
        self.ends: list[simpy.Event] = []
        self.tree.start()

    def _take_down(self, node: int) -> None:
        super()._take_down(node)
        self.tree.remove(node)

    def crash(self, node: int) -> None:
        """Take a node down, as a fault does."""
        self.mac.silence(node)
        self.nodes.crash(node)
        self.tree.remove(node)

    def restart(self, node: int) -> None:
        """Bring a node back, as a fault does."""
        self.nodes.restart(node, self.env.now)
        self.tree.restore(node)

    def report(self, source: int, bits: int = PACKET_BITS) -> Datagram:
        """Send a datagram to whichever sink; it is under way."""
        datagram = Datagram(source, A_SINK, Parcel(None, 1, bits, "report"))
        self.ends.append(self.transport.carry([datagram], -1))
        return datagram

    def send(self, source: int, to: int, packets: int = 1) -> Datagram:
        """Send a datagram to a node; it is under way."""
        datagram = Datagram(source, to, Parcel(None, packets, PACKET_BITS, "test"))
        self.ends.append(self.transport.carry([datagram], -1))
        return datagram

    def run(self, until: float) -> None:
        """Run until a time."""
        self.env.run(until=until)

    def parents(self) -> list[int]:
        """The parent of each node."""
        return [self.tree.parent(node) for node in range(self.nodes.size)]

    def depth(self, node: int) -> int:
        """Hops from a node to a sink along its parents; -1 if that way does not end at one."""
        hops = 0
        while self.tree.parent(node) != node:
            node, hops = self.tree.parent(node), hops + 1
            if node < 0 or hops > self.nodes.size:
                return -1
        return hops

    def drops(self) -> list[str]:
        """The reasons of all drops that say one."""
        words = self.memory.words.all()
        return [words[int(row["what"])] for row in self.rows("drop") if not row["frame"]]


def grid(side: int, spacing: float) -> np.ndarray[Any, Any]:
    """(side², 2) positions of a square grid; node 0 is in a corner."""
    x, y = np.meshgrid(np.arange(side) * spacing, np.arange(side) * spacing)
    return np.column_stack([x.ravel(), y.ravel()])
