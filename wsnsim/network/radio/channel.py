"""The air when it takes time: frames overlap, collide, fade, are overheard, and keep nodes from hearing others.

    channel.is_busy(node)                            clear channel assessment
    channel.transmit(node, message, owner, landed)   on the air after the turnaround; `landed(transmission, heard)`

A frame costs one event, its end, however many hear it. Nothing is done for a pair of frames that do not overlap in
time within twice the range, which is nearly every pair. Every frame begins one turnaround after it was decided on, so
frames are met in the order in which they begin. What becomes of them at their listeners: see `reception`.
"""

from __future__ import annotations

from typing import Any, Final

import simpy

from wsnsim.base.arrays import Ints
from wsnsim.base.radio import EnergyModel, FramedMac, LinkModel, continuous_power
from wsnsim.base.tables import CAUSE, EVENT_CAUSE
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.counters import Counters
from wsnsim.network.radio.ideal_medium import EVERYONE
from wsnsim.network.radio.link_counters import LinkCounters
from wsnsim.network.radio.reception import Reception
from wsnsim.network.radio.topology import Topology
from wsnsim.network.radio.transmission import Landed, MacFrame, Transmission, meet, nobody

TX, SWITCH = EVENT_CAUSE["tx"], CAUSE["switch"]
WHOLE: Final = 1.0


class Channel:
    """The shared air. `window`: for how long a channel is assessed, in s."""

    def __init__(
        self,
        env: simpy.Environment,
        fleet: Nodes,
        journal: EventLog,
        energy: EnergyModel,
        link: LinkModel,
        wiring: Topology,
        mac: FramedMac,
        counts: Counters,
        key: int,
        window: float,
    ) -> None:
        self._env = env
        self._fleet = fleet
        self._journal = journal
        self._energy = energy
        self._wiring = wiring
        self._mac = mac
        self._reception = Reception(env, fleet, journal, link, wiring, counts, key)
        self._window = window
        self._turnaround = mac.turnaround
        power = continuous_power(energy)
        self._turning = 0.0 if power is None else 2.0 * power.turnaround()
        self._cells: dict[tuple[int, int], list[Transmission]] = {}
        self._around: dict[int, tuple[list[Transmission], ...]] = {}
        self._sending: dict[int, Transmission] = {}
        self._side = 2.0 * max(link.audible, 1e-9)
        self._costs: dict[int, tuple[float, float, float, float]] = {}
        self.counts = counts
        self.links: LinkCounters | None = None

    def is_busy(self, node: int) -> bool:
        """Whether a node hears anything in the window that ends now, or sends itself."""
        fleet = self._fleet
        if fleet.disturbed and fleet.jammed[node]:
            return True
        now = self._env.now
        since = now - self._window
        for cell in self._around.get(node) or self._near(node):
            for one in cell:
                if one.end > since and (one.source == node or (one.start < now and self._sensed(one, node))):
                    return True
        return False

    def transmit(
        self, source: int, message: MacFrame, owner: Any, landed: Landed, asleep: Ints | None = None
    ) -> Transmission:
        """Put a frame on the air, one turnaround from now. A sender whose charge does not last is cut short.

        `asleep`: nodes that have the radio off because they know that the frame is not for them.
        """
        env, counts = self._env, self.counts
        now = env.now
        start = now + self._turnaround
        costs = self._cost(message, source)
        counts.numbers += 1
        end = start + costs[3]
        joules = costs[0] + costs[1]
        if not self._fleet.holds_more(source, joules):
            end = start + costs[3] * self._fleet.residual_energy(source) / joules
        one = Transmission(source, message, self._wiring.audience(source), counts.numbers, start, end, owner, landed)
        one.costs, one.asleep = costs, asleep
        near = self._around.get(source) or self._near(source)
        for cell in near:
            for other in cell:
                if other.end > start and self._fleet.distance(source, other.source) <= self._side:
                    meet(one, other)
        own = near[0]
        if own and own[0].end <= now - self._window:
            own[:] = [other for other in own if other.end > now - self._window]
        own.append(one)
        self._sending[source] = one
        ended = env.timeout(end - now, one)
        ended.callbacks.append(self._land)
        return one

    def is_sending(self, node: int) -> bool:
        """Whether a node has a frame on the air, or is about to: its one radio cannot send another."""
        one = self._sending.get(node)
        return one is not None and one.end > self._env.now

    def silence(self, node: int) -> None:
        """A node falls silent, whatever it was sending: what is on the air so far is paid, and nobody can use it."""
        one = self._sending.pop(node, None)
        if one is None or one.cut:
            return
        one.cut = True
        share = min(max((self._env.now - one.start) / max(one.end - one.start, 1e-12), 0.0), 1.0)
        one.end = min(one.end, self._env.now)
        self._pay(one, share)

    def count_links(self) -> None:
        """Keep count of every link's broadcasts from now on, in `links`."""
        self.links = LinkCounters(self._fleet.positions, self._wiring)

    def _near(self, node: int) -> tuple[list[Transmission], ...]:
        """What is on the air in the cell of a node, first, and in the eight about it."""
        found = self._around.get(node)
        if found is None:
            column, row = int(self._fleet.x[node] // self._side), int(self._fleet.y[node] // self._side)
            about = [(0, 0), *((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0))]
            found = tuple(self._cells.setdefault((column + i, row + j), []) for i, j in about)
            self._around[node] = found
        return found

    def _sensed(self, one: Transmission, node: int) -> bool:
        at = one.audience.index(node)
        return at >= 0 and bool(one.audience.senses[at])

    def _cost(self, message: MacFrame, source: int) -> tuple[float, float, float, float]:
        """Joules of sending (electronics, amplifier) and of receiving, and the airtime; a broadcast goes to reach."""
        bits = message.bits
        known = self._costs.get(bits)
        if known is None:
            known = self._costs[bits] = (
                *self._energy.transmit(bits, self._fleet.reach),
                self._energy.receive(bits),
                self._mac.airtime(bits),
            )
        if message.to == EVERYONE:
            return known
        return *self._energy.transmit(bits, self._fleet.distance(source, message.to)), known[2], known[3]

    def _land(self, event: simpy.Event) -> None:
        """A frame has ended: everybody pays, and who heard it is told to its MAC."""
        one: Any = event.value
        message, source = one.message, one.source
        if self._sending.get(source) is one:
            del self._sending[source]
        if one.cut or not self._pay(one, WHOLE):
            one.cut = True
            one.landed(one, nobody(message))
            return
        heard = self._reception.resolve(one)
        if self.links is not None and message.to == EVERYONE:
            self.links.note(one, heard)
        one.landed(one, heard)

    def _pay(self, one: Transmission, share: float) -> bool:
        """Charge and log the sending of a share of a frame; whether it left whole."""
        fleet, message, source = self._fleet, one.message, one.source
        electronics, amplifier, _, airtime = one.costs
        bits = message.bits if share == WHOLE else int(message.bits * share)
        if share != WHOLE:
            electronics, amplifier, airtime = electronics * share, amplifier * share, airtime * share
        if bits == 0 or not fleet.alive[source]:
            return False
        turning = 2.0 * self._turnaround if self._turning else 0.0
        sent = fleet.spend_transmit(source, electronics, amplifier, bits, airtime + turning)
        joules = (electronics + amplifier) * sent / bits
        self._journal.add(
            event(self._env.now, self._journal.step, message.target, source, message.kind, message.code, one.number,
                  message.sequence, message.to, message.packets, sent, joules, TX)
        )  # fmt: skip
        if self._turning and fleet.alive[source]:
            fleet.spend(source, SWITCH, self._turning)
        return sent == message.bits and bool(fleet.alive[source])
