"""Parcels between a cluster head and its members: at once on an ideal radio, otherwise until a window or deadline ends.

    masks, journeys = yield from collection.gather(nodes, parcels, deadline)
    masks = yield from collection.exchange(sources, destinations, parcels)

What arrives after the head has gone on is paid for all the same; `LateReadings` keeps it for trackers that use it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np
import simpy
from simpy.events import EventPriority

from wsnsim.base.arrays import Bools, Reading
from wsnsim.base.requests import GatheredReadings, Journeys, Parcel
from wsnsim.network.event_log import Acting, then
from wsnsim.network.radio.datagrams import Datagram
from wsnsim.network.radio.transport import Transport

Masks: TypeAlias = list[Bools | None]
ROUNDING: Final = 1e-12
"""Waiting times (s) shorter than this are rounding error."""
LATE: Final = EventPriority(2)
"""Priority of a deadline among events of one instant: what arrives at that instant is in time."""


class Deadline(simpy.Event):
    """An event that fires after `seconds`, after all others of that instant."""

    def __init__(self, env: simpy.Environment, seconds: float) -> None:
        super().__init__(env)
        self._ok, self._value = True, None
        env.schedule(self, LATE, seconds)


@dataclass(slots=True)
class Gathering:
    """Readings of one step that were under way when their head went on.

    Attributes:
        step: their step; `began`: when they were requested, in s.
        datagrams: {node: datagram}.
        values: {node: reading} of these nodes.
        counted: the nodes whose reading was given to the tracker, and counted.
    """

    step: int
    began: float
    datagrams: dict[int, Datagram]
    values: dict[int, Reading]
    counted: set[int] = field(default_factory=set)


@dataclass(slots=True)
class LateReadings:
    """Keeps readings that arrive after their head has gone on, for as long as it leads.

    Attributes:
        used: {target: number of late readings that its tracker was given}; empty if trackers use none.
    """

    used: dict[int, int]
    _kept: dict[int, tuple[int, list[Gathering]]] = field(default_factory=dict)

    def keep(self, target: int, head: int, gathering: Gathering) -> None:
        """Keep what has not arrived yet; what was under way to an earlier head of the track is dropped."""
        leads, kept = self._kept.get(target, (head, []))
        self._kept[target] = head, [*(kept if leads == head else []), gathering]

    def arrived(self, target: int, head: int, since: int, until: int) -> dict[int, GatheredReadings]:
        """The reply to `GatherLate`. Readings of earlier steps are dropped."""
        leads, kept = self._kept.get(target, (head, []))
        if leads != head:
            return {}
        kept[:] = [gathering for gathering in kept if gathering.step >= since]
        return {
            each.step: found for each in kept if each.step <= until and (found := self._found(each, target, head)).ids
        }

    def _found(self, gathering: Gathering, target: int, head: int) -> GatheredReadings:
        """What has arrived of a gathering, which counts as used."""
        found = {
            node: arrived for node, each in gathering.datagrams.items() if (arrived := each.arrivals()) is not None
        }
        self.used[target] += len(found.keys() - gathering.counted)
        gathering.counted.update(found)
        each = {node: (found[node][1] - gathering.began, gathering.datagrams[node].hops) for node in found}
        values = np.array([gathering.values[node] for node in found], dtype=np.float64)
        return GatheredReadings(tuple(found), values, Journeys(head, each=each))


@dataclass(slots=True)
class Collection:
    """Sends parcels between one head and its members.

    Args:
        env: simulated time.
        transport: sends them.
        target: the target of the head's track.
        head: the cluster head.
        window: as for `Driver`.
        one_hop: as for `Driver`.

    Attributes:
        bits: sent in datagrams so far.
        missing: {node: datagram} of the last gathering that had not arrived when the head went on.
        overdue: whether some datagrams were still under way when the last deadline had passed.
    """

    _env: simpy.Environment
    _transport: Transport
    _target: int
    _head: int
    _window: tuple[float, float] | None
    _one_hop: bool
    bits: int = 0
    overdue: bool = False
    missing: dict[int, Datagram] = field(default_factory=dict)

    def gather(self, nodes: list[int], parcels: list[Parcel], deadline: float | None) -> Acting[tuple[Masks, Journeys]]:
        """Send a parcel from each node to the head.

        Returns:
            Which packets of each arrived within `deadline` s, None where nothing did, and how they came.
        """
        began, head = self._env.now, self._head
        datagrams = [Datagram(node, head, parcel) for node, parcel in zip(nodes, parcels, strict=True)]
        yield from self.collect(datagrams, deadline)
        if deadline is None:
            found = [(each.mask, each.arrived_at) if each.arrived else None for each in datagrams]
        else:
            found = [each.arrivals() for each in datagrams]
        self.missing = {each.source: each for each, arrived in zip(datagrams, found, strict=True) if arrived is None}
        journeys = {
            datagram.source: (arrived[1] - began, datagram.hops)
            for datagram, arrived in zip(datagrams, found, strict=True)
            if arrived is not None
        }
        return [None if arrived is None else arrived[0] for arrived in found], Journeys(head, each=journeys)

    def exchange(self, sources: list[int], destinations: list[int], parcels: list[Parcel]) -> Acting[Masks]:
        """Send parcels between the head and members, and wait until all have ended; the masks as in `gather`."""
        datagrams = list(map(Datagram, sources, destinations, parcels))
        yield from self.carry(datagrams, self._head if sources != destinations else None)
        return [datagram.mask if datagram.arrived else None for datagram in datagrams]

    def collect(self, datagrams: list[Datagram], deadline: float | None = None) -> Acting[None]:
        """Send datagrams to the head; wait until all have ended, for the window, or for `deadline` s if less."""
        self.overdue = False
        if self._window is not None:
            yield from self._collect_in_window(datagrams, *self._window, deadline)
        elif deadline is None:
            yield from self.carry(datagrams, self._head)
        elif self._takes_time(datagrams, self._head):
            ended = self._transport.carry(datagrams, self._target, self._head, self._one_hop)
            yield ended if ended.triggered else ended | Deadline(self._env, deadline)
            self.overdue = not ended.triggered
            self.bits += sum(datagram.bits for datagram in datagrams)
        else:
            yield from self.carry(datagrams)

    def _collect_in_window(
        self, datagrams: list[Datagram], quiet: float, cap: float, deadline: float | None
    ) -> Acting[None]:
        """As `collect`, until nothing arrived for `quiet` s, at most for `cap` s."""
        env = self._env
        began = last = env.now
        longest = cap if deadline is None else min(cap, deadline)

        def note(datagram: Datagram) -> None:
            nonlocal last
            last = env.now if datagram.arrived else last

        for datagram in datagrams:
            if datagram.source == datagram.to:
                datagram.arrived = True
                continue
            event = self._transport.carry([datagram], self._target, self._head, self._one_hop)
            then(event, note, datagram)
        while (left := min(last + quiet, began + longest) - env.now) > ROUNDING:
            yield env.timeout(left)
        self.bits += sum(datagram.bits for datagram in datagrams)

    def carry(self, datagrams: list[Datagram], hub: int | None = None) -> Acting[None]:
        """Send datagrams and wait until all have ended. `hub`: the head, if all are between it and its members."""
        if self._takes_time(datagrams, hub):
            one_hop = hub is not None and self._one_hop
            yield self._transport.carry(datagrams, self._target, hub, one_hop)
            self.bits += sum(datagram.bits for datagram in datagrams)
        else:
            for datagram in datagrams:
                datagram.arrived = True

    def _takes_time(self, datagrams: list[Datagram], hub: int | None) -> bool:
        """Whether a node sends to another one, or the head must wait for a round of slots to know that none does."""
        if hub is not None and self._transport.keeps_idle_slots:
            return True
        return any(datagram.source != datagram.to for datagram in datagrams)
