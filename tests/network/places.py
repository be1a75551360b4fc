"""A radio over given nodes, with its log: what tests of the air are written on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.rng import Streams
from wsnsim.base.tables import KIND, Memory
from wsnsim.models.access import Csma
from wsnsim.models.energy import FirstOrder
from wsnsim.models.hardware import NoPacking, PerfectClock
from wsnsim.models.links import Disk, MinimumEnergy
from wsnsim.models.sleep import EventWake
from wsnsim.network.event_log import EventLog
from wsnsim.network.radio.ideal_medium import EVERYONE, Burst, burst
from wsnsim.network.radio.radio_stack import make_radio_stack


class Place:
    """Nodes, their radio, and what happened."""

    def __init__(
        self, positions: Any, mac: Any = None, link: Any = None, energy: Any = None, packing: Any = None,
        clock: Any = None, horizon: float = 10.0, seed: int = 11, sleep: Any = None,
    ) -> None:  # fmt: skip
        self.memory = Memory()
        self.journal = EventLog(self.memory, 0)
        self.parts = SimpleNamespace(
            mac=mac or Csma(),
            link=link or Disk(reach=75.0),
            energy=energy or FirstOrder(),
            packing=packing or NoPacking(),
            routing=MinimumEnergy(),
            clock=clock or PerfectClock(),
            sleep=sleep or EventWake(),
            steps=1,
            dt=horizon,
        )
        points = np.array(positions, dtype=np.float64)
        self.streams = Streams(seed, 0)
        ether = make_radio_stack(self.parts, points, np.ones((len(points), 1)), self.streams, self.journal)
        self.env, self.fleet, self.wiring = ether.env, ether.fleet, ether.wiring
        self.clocks, self.mac = ether.clocks, ether.mac
        self.died: list[tuple[float, int]] = []
        self.fleet.on_death = self._bury

    def _bury(self, node: int) -> None:
        self.fleet.died_at[node] = self.env.now
        self.died.append((self.env.now, node))
        self.mac.silence(node)

    def unicast(self, source: int, to: int, packets: int = 1, bits: int = PACKET_BITS, hub: int | None = None) -> Burst:
        """Send a burst and wait until it has ended."""
        frame = burst(source, to, Parcel("payload", packets, bits, "test"), 0)
        self.env.run(until=self.mac.send([frame], hub))
        return frame

    def broadcast(self, source: int, packets: int = 1, bits: int = PACKET_BITS) -> Burst:
        """Broadcast a burst and wait until it has ended."""
        return self.unicast(source, EVERYONE, packets, bits)

    def at(self, time: float, act: Any) -> None:
        """Do something at a time."""
        event = self.env.timeout(time - self.env.now)
        assert event.callbacks is not None
        event.callbacks.append(lambda _: act())

    def rows(self, *kinds: str) -> list[dict[str, Any]]:
        """The events of these kinds so far, in order; all without a kind."""
        self.journal.fingerprint()
        table = self.memory.table("events")
        if not table:
            return []
        codes = [KIND[kind] for kind in kinds]
        chosen = np.isin(table["kind"], codes) if kinds else np.ones(len(table["kind"]), dtype=bool)
        return [{name: column[i].item() for name, column in table.items()} for i in np.flatnonzero(chosen)]

    def closes(self) -> bool:
        """Whether each node's causes sum to what it spent, and the events' joules to the ledger's."""
        fleet = self.fleet
        books = np.allclose(fleet.ledger.joules.sum(axis=0), fleet.ledger.spent, rtol=1e-9, atol=0.0)
        return bool(books and np.isclose(sum(fleet.ledger.totals), fleet.ledger.spent.sum(), rtol=1e-9, atol=0.0))
