"""The shared channel on which sending takes time: transmissions overlap, collide, fade and are overheard.

    channel.is_busy(node)                       clear channel assessment
    channel.transmit(node, frame, on_end)       send after the turnaround; at the end `on_end(transmission, result)`

A transmission costs one SimPy event, at its end, however many nodes receive it. Transmissions are looked up by cells
of twice the range, so that only neighbouring cells are searched for overlaps. Each one starts one turnaround after it
was decided, so that overlaps are found in the order of the starts. `reception` decides what each node receives.
"""

from __future__ import annotations

from typing import Any, Final

import simpy

from wsnsim.base.arrays import Ints
from wsnsim.base.frames import EVERYONE, MacFrame
from wsnsim.base.mac_mechanisms import Listening
from wsnsim.base.medium_access import FramedMac
from wsnsim.base.radio import continuous_power
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.network.event_log import event
from wsnsim.network.radio.capture import HEADER_BITS, CapturingReceivers
from wsnsim.network.radio.reception import Reception
from wsnsim.network.radio.topology import RadioServices
from wsnsim.network.radio.transmission import (
    NOBODY,
    LinkCounters,
    OnEnd,
    RadiosOn,
    SomeRadiosOn,
    Transmission,
    UseCounter,
    overlap,
)

DROP: Final = KIND["drop"]
WHOLE: Final = 1.0
TX, SWITCH = EVENT_CAUSE["tx"], CAUSE["switch"]


class Channel:
    """The shared channel.

    Args:
        radio: The services of the radio.
        mac: The MAC component, which knows airtime and turnaround.
        assessment: Duration of a clear channel assessment, in s.
        losses: The numbers of the frames that may be lost, shared by all channels.
        links: Counts broadcasts per link; None: nobody does.
        listening: Which radios are on; None: those of all nodes that are awake.
    """

    def __init__(
        self, radio: RadioServices, mac: FramedMac, assessment: float, losses: UseCounter,
        links: LinkCounters | None, listening: Listening | None = None,
    ) -> None:  # fmt: skip
        self._env, self._nodes, self._topology, self._energy, self._log, self._counters = radio
        self._mac = mac
        captures = radio.topology.link.captures
        self._radios_on = RadiosOn(radio.nodes) if listening is None else SomeRadiosOn(radio.nodes, listening)
        self._receivers = CapturingReceivers(radio, mac.airtime(HEADER_BITS), self._radios_on) if captures else None
        self._reception = Reception(radio, losses, self._radios_on, self._receivers)
        self._assessment = assessment
        self._links = links
        self._turnaround = mac.turnaround
        power = continuous_power(radio.energy)
        self._turnaround_joules = 0.0 if power is None else 2.0 * power.turnaround()
        self._side = 2.0 * max(radio.topology.link.audible, 1e-9)
        self._cells: dict[tuple[int, int], list[Transmission]] = {}
        self._cells_around: dict[int, tuple[list[Transmission], ...]] = {}
        self._sending: dict[int, Transmission] = {}
        self._costs: dict[int, tuple[float, float, float, float]] = {}

    def is_busy(self, node: int) -> bool:
        """Whether a node hears a transmission during the assessment that ends now, or sends itself."""
        nodes = self._nodes
        if nodes.disturbed and nodes.jammed[node]:
            return True
        now = self._env.now
        since = now - self._assessment
        for cell in self._cells_around.get(node) or self._find_cells(node):
            for other in cell:
                if other.end <= since:
                    continue
                if other.source == node or (other.start < now and node in other.neighbours.sensing):
                    return True
        return False

    def transmit(self, source: int, frame: MacFrame, on_end: OnEnd, asleep: Ints | None = None) -> Transmission:
        """Send a frame, one turnaround from now. It is cut short if the sender's battery does not last.

        Args:
            source: The sender.
            frame: The frame.
            on_end: Called at the end with the transmission and the result.
            asleep: Nodes that have the radio off because they know that the frame is not for them.
        """
        env, counters = self._env, self._counters
        now = env.now
        start = now + self._turnaround
        costs = self._cost(frame, source)
        counters.transmissions += 1
        end = start + costs[3]
        joules = costs[0] + costs[1]
        if not self._nodes.holds_more(source, joules):
            end = start + costs[3] * self._nodes.residual_energy(source) / joules
        neighbours = self._topology.neighbours(source)
        number = counters.transmissions
        transmission = Transmission(source, frame, neighbours, number, start, end, on_end, costs, asleep)
        near = self._cells_around.get(source) or self._find_cells(source)
        for cell in near:
            for other in cell:
                if other.end > start and self._nodes.distance(source, other.source) <= self._side:
                    overlap(transmission, other)
        own = near[0]
        if own and own[0].end <= now - self._assessment:
            own[:] = [other for other in own if other.end > now - self._assessment]
        own.append(transmission)
        if self._receivers is not None:
            self._receivers.expect(transmission)
        self._sending[source] = transmission
        timeout = env.timeout(end - now, transmission)
        timeout.callbacks.append(self._end)
        return transmission

    def is_sending(self, node: int) -> bool:
        """Whether a node sends or is about to: its radio cannot send another frame."""
        transmission = self._sending.get(node)
        return transmission is not None and transmission.end > self._env.now

    def silence(self, node: int) -> None:
        """Cut the transmission of a node that died or crashed: the part sent so far is paid, no node can use it."""
        transmission = self._sending.pop(node, None)
        if transmission is None or transmission.cut:
            return
        transmission.cut = True
        airtime = max(transmission.end - transmission.start, 1e-12)
        share = min(max((self._env.now - transmission.start) / airtime, 0.0), 1.0)
        transmission.end = min(transmission.end, self._env.now)
        self._pay(transmission, share)

    def _find_cells(self, node: int) -> tuple[list[Transmission], ...]:
        """The transmissions in the cell of a node, first, and in the eight cells around it."""
        x, y = self._nodes.x[node], self._nodes.y[node]
        column, row = int(x // self._side), int(y // self._side)
        offsets = [(0, 0), *((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0))]
        found = tuple(self._cells.setdefault((column + i, row + j), []) for i, j in offsets)
        self._cells_around[node] = found
        return found

    def _cost(self, frame: MacFrame, source: int) -> tuple[float, float, float, float]:
        """(electronics J, amplifier J, reception J, airtime s); a broadcast is sent with the power for the range."""
        bits = frame.bits
        costs = self._costs.get(bits)
        if costs is None:
            costs = self._costs[bits] = (
                *self._energy.transmit(bits, self._nodes.reach),
                self._energy.receive(bits),
                self._mac.airtime(bits),
            )
        if frame.to == EVERYONE:
            return costs
        return *self._energy.transmit(bits, self._nodes.distance(source, frame.to)), costs[2], costs[3]

    def _end(self, timeout: simpy.Event) -> None:
        """End a transmission: charge sender and receivers, and report to the MAC who received it."""
        transmission: Any = timeout.value
        frame, source = transmission.frame, transmission.source
        if self._sending.get(source) is transmission:
            del self._sending[source]
        if transmission.cut or not self._pay(transmission, WHOLE):
            transmission.cut = True
            received = NOBODY if frame.to == EVERYONE else False
            self._radios_on.note(transmission, NOBODY)
        else:
            received = self._reception.resolve(transmission)
            if frame.to == EVERYONE:
                if self._links is not None and frame.packets and not frame.is_copy:
                    self._links.count(transmission, received)
            elif received:
                frame.note_arrival(self._env.now)
            elif frame.to not in transmission.neighbours.members:
                self._log_unheard(transmission)
        frame.sends += 1
        if frame.packets and not frame.is_copy:
            counters = self._counters
            counters.frames_sent += 1
            counters.packets_sent += frame.packets
            counters.frames_lost += (transmission.cut or transmission.missed) if frame.to == EVERYONE else not received
        transmission.on_end(transmission, received)

    def _log_unheard(self, sent: Transmission) -> None:
        """Log a frame whose destination hears nothing of it: the link ended while the frame waited."""
        frame = sent.frame
        self._log.add(
            event(self._env.now, self._log.step, frame.target, frame.to, DROP, frame.code, sent.number,
                  frame.sequence, sent.source, frame.packets)
        )  # fmt: skip
        if frame.packets and not frame.is_copy and self._nodes.alive[frame.to]:
            self._counters.in_range += 1

    def _pay(self, transmission: Transmission, share: float) -> bool:
        """Charge and log the sending of a share of a frame; returns whether it was sent completely."""
        nodes, frame, source = self._nodes, transmission.frame, transmission.source
        electronics, amplifier, _, airtime = transmission.costs
        bits = frame.bits if share == WHOLE else int(frame.bits * share)
        if share != WHOLE:
            electronics, amplifier, airtime = electronics * share, amplifier * share, airtime * share
        if bits == 0 or not nodes.alive[source]:
            return False
        turnarounds = 2.0 * self._turnaround if self._turnaround_joules else 0.0
        sent = nodes.spend_transmit(source, electronics, amplifier, bits, airtime + turnarounds)
        joules = (electronics + amplifier) * sent / bits
        self._log.add(
            event(self._env.now, self._log.step, frame.target, source, frame.kind, frame.code, transmission.number,
                  frame.sequence, frame.to, frame.packets, sent, joules, TX)
        )  # fmt: skip
        if self._turnaround_joules and nodes.alive[source]:
            nodes.spend(source, SWITCH, self._turnaround_joules)
        return sent == frame.bits and bool(nodes.alive[source])
