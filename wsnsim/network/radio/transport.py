"""From a parcel to its destination: one hop where it is in reach, relayed where it is not.

air.carry(letters) -> simpy.Event                    fires when every letter has ended; see `Letter.mask`
air.broadcast(sources, parcels, target) -> (event, frames)
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import simpy

from wsnsim.base.arrays import Bools
from wsnsim.base.requests import Parcel, all_arrived
from wsnsim.base.tables import KIND
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.ideal_medium import EVERYONE, Burst, burst
from wsnsim.network.radio.mac import Access
from wsnsim.network.radio.routing import Router
from wsnsim.network.radio.topology import Neighbours, Topology

DROP = KIND["drop"]


@dataclass(slots=True)
class Datagram:
    """A parcel under way between two nodes. After `carry`: what arrived, over how many hops, for how many bits."""

    source: int
    to: int
    parcel: Parcel
    mask: Bools
    arrived: bool = False
    hops: int = 0
    bits: int = 0


def datagram(source: int, to: int, parcel: Parcel) -> Datagram:
    """A letter about to be sent."""
    return Datagram(source, to, parcel, all_arrived(parcel.packets))


class Transport:
    """What nodes use to send."""

    def __init__(
        self, env: simpy.Environment, fleet: Nodes, wiring: Topology, mac: Access, router: Router, journal: EventLog
    ) -> None:
        self._env = env
        self._fleet = fleet
        self._mac = mac
        self._wiring = wiring
        self._router = router
        self._journal = journal
        self.rouse: Callable[[int, int, int], simpy.Event] | None = None
        """(node, sleeping neighbour, target) -> awake: how the end of a path is woken, where there is a way."""

    def carry(self, letters: Sequence[Datagram], target: int, hub: int | None = None) -> simpy.Event:
        """Put letters on the air; the event fires when the last has arrived or is lost.

        `hub`: the head, if the letters go between it and its cluster, which a MAC may arrange in slots.
        """
        direct, far = [], []
        for item in letters:
            if item.source == item.to:
                item.arrived = True
            elif self._wiring.connected(item.source, item.to) and (self.rouse is None or not self._sleeps(item.to)):
                direct.append(item)
            else:
                far.append(item)
        events: list[simpy.Event] = [self._env.process(self._relay(item, target)) for item in far]
        if direct or not far:
            events.append(self._one_hop(direct, target, hub))
        return events[0] if len(events) == 1 else self._env.all_of(events)

    def broadcast(
        self, sources: Sequence[int], parcels: Sequence[Parcel], target: int, sequence: int = 0, relayed: bool = False
    ) -> tuple[simpy.Event, list[Burst]]:
        """Each source sends its parcel once to everyone within reach; `frame.heard` says who got it.

        `sequence`: the number of a message that is `relayed` by other nodes than the first.
        """
        frames = [burst(source, EVERYONE, parcel, target) for source, parcel in zip(sources, parcels, strict=True)]
        for frame in frames:
            frame.sequence, frame.relayed = sequence, relayed
        return self._mac.send(frames), frames

    def audience(self, node: int) -> Neighbours:
        """Who may hear a node, the dead included."""
        return self._wiring.audience(node)

    def _one_hop(self, letters: list[Datagram], target: int, hub: int | None) -> simpy.Event:
        frames = [burst(item.source, item.to, item.parcel, target) for item in letters]
        event = self._mac.send(frames, hub)
        assert event.callbacks is not None
        event.callbacks.append(lambda _: self._settle(letters, frames))
        return event

    def _settle(self, letters: list[Datagram], frames: list[Burst]) -> None:
        for item, frame in zip(letters, frames, strict=True):
            item.mask, item.arrived = frame.mask, frame.packets > 0
            item.hops, item.bits = 1, frame.sent

    def _relay(self, item: Datagram, target: int) -> Any:
        path = self._router.path(item.source, item.to)
        if path is None:
            self._no_path(item, target)
            return
        sequence, mask, packets = 0, item.mask, item.parcel.packets
        for source, to in itertools.pairwise(path):
            if self.rouse is not None and to == item.to and self._sleeps(to):
                yield self.rouse(source, to, target)
            frame = Burst(source, to, item.parcel, target, mask, packets, sequence, relayed=source != item.source)
            yield self._mac.send([frame])
            item.hops += 1
            item.bits += frame.sent
            sequence, mask, packets = frame.sequence, frame.mask, frame.packets
            if packets == 0:
                break
        item.mask, item.arrived = mask, packets > 0

    def _sleeps(self, node: int) -> bool:
        """Whether a node must be woken before it hears anything."""
        return bool(self._fleet.alive[node]) and not self._fleet.is_awake(node)

    def _no_path(self, item: Datagram, target: int) -> None:
        item.mask = np.zeros(item.parcel.packets, dtype=np.bool_)
        code, packets = self._journal.code("no_path"), item.parcel.packets
        self._journal.add(
            event(self._env.now, self._journal.step, target, item.source, DROP, code, peer=item.to, packets=packets)
        )
