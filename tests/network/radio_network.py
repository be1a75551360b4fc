"""A radio network over given nodes, with its event log, for tests of the radio."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from wsnsim.base.frames import EVERYONE, Burst, full_burst
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.rng import Streams
from wsnsim.base.tables import KIND, Memory
from wsnsim.models.access import Csma
from wsnsim.models.batteries import Linear
from wsnsim.models.energy import FirstOrder
from wsnsim.models.hardware import NoPacking, NoSync, PerfectClock
from wsnsim.models.links import Disk
from wsnsim.models.sleep import EventWake
from wsnsim.network.event_log import EventLog
from wsnsim.network.radio.datagrams import Datagram, Hops
from wsnsim.network.radio.radio_stack import make_radio_stack
from wsnsim.network.radio.routing import PathForwarding
from wsnsim.network.radio.transport import Transport


class RadioNetwork:
    """Nodes with a radio stack, a router and a transport. `died` lists (time, node) of every death."""

    def __init__(
        self, positions: Any, *, seed: int = 11, horizon: float = 10.0, weight: str = "energy",
        count_links: bool = False, sinks: tuple[int, ...] = (), **components: Any,
    ) -> None:  # fmt: skip
        self.memory = Memory()
        self.log = EventLog(self.memory, 0)
        defaults = {
            "mac": Csma(), "link": Disk(reach=75.0), "energy": FirstOrder(), "packing": NoPacking(),
            "clock": PerfectClock(), "sync": NoSync(), "sleep": EventWake(), "battery": Linear(),
        }  # fmt: skip
        setup: Any = SimpleNamespace(
            **defaults | components,
            steps=1,
            dt=horizon,
            duration=2.0 * horizon,
            sink_points=(),
            plain_batteries=getattr(components.get("battery", Linear()), "plain", False),
        )
        points = np.array(positions, dtype=np.float64)
        traits = np.ones((len(points), 1))
        stack = make_radio_stack(setup, points, traits, Streams(seed, 0), self.log, count_links)
        self.radio, self.clocks, self.links = stack.radio, stack.clocks, stack.links
        self.mac: Any = stack.mac
        self.env, self.nodes, self.topology = self.radio.env, self.radio.nodes, self.radio.topology
        self.counters = self.radio.counters
        hops = Hops(self.radio, self.mac)
        self.router = PathForwarding(self.radio, hops, weight, setup.link.audible, sinks)
        self.transport = Transport(self.radio, self.mac, hops, self.router)
        self.died: list[tuple[float, int]] = []
        self.nodes.on_death = self._take_down

    def _take_down(self, node: int) -> None:
        self.nodes.died_at[node] = self.env.now
        self.died.append((self.env.now, node))
        self.mac.silence(node)
        self.router.remove(node)

    def unicast(
        self, source: int, to: int, packets: int = 1, bits: int = PACKET_BITS, head: int | None = None
    ) -> Burst:
        """Send a burst and wait until it has ended."""
        burst = full_burst(source, to, Parcel("payload", packets, bits, "test"), 0)
        self.env.run(until=self.mac.send([burst], head))
        return burst

    def broadcast(self, source: int, packets: int = 1, bits: int = PACKET_BITS) -> Burst:
        """Broadcast a burst and wait until it has ended."""
        return self.unicast(source, EVERYONE, packets, bits)

    def carry(self, *datagrams: Datagram) -> tuple[Datagram, ...]:
        """Send datagrams and wait until they have ended."""
        self.env.run(until=self.transport.carry(list(datagrams), 0))
        return datagrams

    def at(self, time: float, action: Callable[[], Any]) -> None:
        """Call an action at a time."""
        event = self.env.timeout(time - self.env.now)
        event.callbacks.append(lambda _: action())

    def rows(self, *kinds: str) -> list[dict[str, Any]]:
        """The events of these kinds so far, in order; of all kinds if none is given."""
        self.log.fingerprint()
        table = self.memory.table("events")
        if not table:
            return []
        codes = [KIND[kind] for kind in kinds]
        chosen = np.isin(table["kind"], codes) if kinds else np.ones(len(table["kind"]), dtype=bool)
        return [{name: column[i].item() for name, column in table.items()} for i in np.flatnonzero(chosen)]

    def ledger_adds_up(self) -> bool:
        """Whether the causes of each node add up to what it spent, and the totals to the sum over the nodes."""
        nodes = self.nodes
        per_node = np.allclose(nodes.ledger.joules.sum(axis=0), nodes.ledger.spent, rtol=1e-9, atol=0.0)
        return bool(per_node and np.isclose(sum(nodes.ledger.totals), nodes.ledger.spent.sum(), rtol=1e-9, atol=0.0))
