"""Forwarding along the cheapest paths that a router finds: the ideal reference, for which nothing is paid.

Every node knows all usable links of the network at every moment, and no frame was sent to find them.
"""

from __future__ import annotations

import itertools
from collections.abc import Generator, Sequence
from typing import Any

import simpy

from wsnsim.base.frames import Burst
from wsnsim.network.radio.datagrams import A_SINK, Datagram, Hops
from wsnsim.network.radio.radio_services import RadioServices
from wsnsim.network.radio.routing import Router


class PathForwarding:
    """Datagrams take the path of the router; those for a sink go to the one with the cheapest path."""

    def __init__(self, radio: RadioServices, hops: Hops, router: Router, sinks: Sequence[int] = ()) -> None:
        self._env = radio.env
        self._hops = hops
        self._router = router
        self._sinks = sinks

    def sink_of(self, source: int) -> int:
        """The sink with the cheapest path; the first one if no path leads to any."""
        if source in self._sinks:
            return source
        if len(self._sinks) == 1:
            return self._sinks[0]
        cheapest = self._router.cheapest_end(source, self._sinks)
        return self._sinks[0] if cheapest is None else cheapest

    def is_one_hop(self, source: int, to: int) -> bool:
        """Whether the path is one hop. A neighbour without a path has died: its sender does not know, and sends."""
        path = self._router.path(source, to)
        return path is None or len(path) == 2

    def forward(self, datagram: Datagram, target: int) -> simpy.Event:
        """Send a datagram along its path."""
        return self._env.process(self._relay(datagram, target))

    def remove(self, node: int) -> None:
        """Forget the paths over a node that died or crashed."""
        self._router.remove(node)

    def restore(self, node: int) -> None:
        """Forget all paths: those over the node may be cheaper."""
        self._router.restore()

    def forget_links(self) -> None:
        """Forget all paths, because links have changed."""
        self._router.restore()

    def start(self) -> None:
        """Do nothing: nothing is sent to find paths."""

    def _relay(self, datagram: Datagram, target: int) -> Generator[simpy.Event, Any, None]:
        """Send a datagram over several hops; each hop sends what arrived over the one before."""
        assert datagram.to != A_SINK, "the sink of a datagram is chosen before it is sent"
        source, parcel = datagram.source, datagram.parcel
        path = self._router.path(source, datagram.to)
        if path is None:
            datagram.lose()
            self._hops.drop(datagram, source, target, "no_path")
            return
        sequence, mask, packets = 0, datagram.mask, parcel.packets
        for node, to in itertools.pairwise(path):
            waking = self._hops.waking(node, to, target) if to == datagram.to else None
            if waking is not None:
                yield waking
            burst = Burst(node, to, parcel, target, mask, packets, sequence, relayed=node != source)
            datagram.hops += 1
            datagram.last_hop = burst if to == datagram.to else None
            yield self._hops.send([burst])
            datagram.bits += burst.sent
            sequence, mask, packets = burst.sequence, burst.mask, burst.packets
            if packets == 0:
                break
        datagram.end(mask, packets > 0, self._env.now)
