"""What a burst does on the air: its sender pays, its listeners pay, packets arrive or not, and each act is an event.

The MAC decides *when* a burst gets the channel and calls `Medium.carry(frame)` at the end of its airtime.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import simpy

from wsnsim.base.arrays import Bools
from wsnsim.base.radio import EnergyModel
from wsnsim.base.requests import Parcel, all_arrived
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.tables import EVENT_CAUSE, KIND
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.counters import Counters, Uses
from wsnsim.network.radio.topology import Topology

SEND, RELAY, RECEIVE, DROP = KIND["send"], KIND["relay"], KIND["receive"], KIND["drop"]
NONE, TX, RX = EVENT_CAUSE["none"], EVENT_CAUSE["tx"], EVENT_CAUSE["rx"]
EVERYONE = -1


@dataclass(slots=True)
class Burst:
    """One burst over one hop: before `Medium.carry` what is sent, after it what arrived.

    `mask` says which of the parcel's packets, `packets` how many; `sent` are the bits that left the sender. For a
    broadcast (`to` is EVERYONE) `heard` says which packets each listener got.
    """

    source: int
    to: int
    parcel: Parcel
    target: int
    mask: Bools
    packets: int
    sequence: int = 0
    relayed: bool = False
    sent: int = 0
    heard: dict[int, Bools] = field(default_factory=dict)

    @property
    def bits(self) -> int:
        """Bits in the burst."""
        return self.packets * self.parcel.packet_bits


def burst(source: int, to: int, parcel: Parcel, target: int) -> Burst:
    """A frame that carries a whole parcel."""
    return Burst(source, to, parcel, target, all_arrived(parcel.packets), parcel.packets)


class IdealMedium:
    """The air of the papers' world, in which nothing disturbs anything else. With a `rate`, airtime is paid as such."""

    def __init__(
        self,
        env: simpy.Environment,
        fleet: Nodes,
        journal: EventLog,
        energy: EnergyModel,
        wiring: Topology,
        counts: Counters,
        key: int,
        rate: float | None = None,
    ) -> None:
        self._env = env
        self.fleet = fleet
        self._journal = journal
        self._energy = energy
        self._wiring = wiring
        self._key = key
        self._second = 0.0 if rate is None else 1.0 / rate
        self._uses = Uses()
        self.counts = counts

    def carry(self, frame: Burst) -> None:
        """Perform a burst: charge, log, and leave in the frame what arrived. The dead send nothing."""
        if not self.fleet.alive[frame.source]:
            frame.mask, frame.packets = np.zeros(frame.mask.size, dtype=np.bool_), 0
            return
        counts = self.counts
        counts.frames_sent += 1
        frame.sequence = frame.sequence or counts.frames_sent
        number, packets = counts.frames_sent, frame.packets
        counts.packets_sent += packets
        code = self._journal.code(frame.parcel.what)
        if frame.to == EVERYONE:
            self._broadcast(frame, number, packets, code)
        else:
            self._unicast(frame, number, packets, code)

    def _unicast(self, frame: Burst, number: int, packets: int, code: int) -> None:
        to = frame.to
        distance = self.fleet.distance(frame.source, to)
        if not self._transmit(frame, number, packets, code, distance):
            mask, got = frame.mask, 0
        elif not self.fleet.is_awake(to):
            mask, got = frame.mask, 0
            self._drop(frame, number, packets, code, to)
        else:
            mask, got = self._receive(frame, number, packets, code, to)
        self.counts.in_range += 1
        self.counts.delivered += got == packets
        frame.mask, frame.packets = mask if got else np.zeros(mask.size, dtype=np.bool_), got
        self.counts.frames_lost += got < packets

    def _broadcast(self, frame: Burst, number: int, packets: int, code: int) -> None:
        fleet = self.fleet
        if not self._transmit(frame, number, packets, code, self.fleet.reach):
            self.counts.frames_lost += 1
            return
        least, counts = packets, self.counts
        for node in self._listeners(frame.source):
            if not fleet.alive[node]:
                continue
            expected = self._wiring.expects(frame.source, node)
            mask, got = self._receive(frame, number, packets, code, node, expected)
            if got:
                frame.heard[node] = mask
            if expected:
                least = min(least, got)
                counts.in_range += 1
                counts.delivered += got == packets
        self.counts.frames_lost += least < packets

    def _listeners(self, source: int) -> list[int]:
        """Who may hear a node now, ascending; where nobody sleeps the dead included."""
        audience = self._wiring.audience(source)
        if not self.fleet.follows_schedules:
            return audience.listed
        awake: list[int] = audience.ids[self.fleet.hears(audience.ids, self._env.now)].tolist()
        return awake

    def _transmit(self, frame: Burst, number: int, packets: int, code: int, distance: float) -> bool:
        """Charge and log the sending; whether the burst left whole."""
        fleet, source = self.fleet, frame.source
        bits = packets * frame.parcel.packet_bits
        electronics, amplifier = self._energy.transmit(bits, distance)
        joules = electronics + amplifier
        frame.sent = fleet.spend_transmit(source, electronics, amplifier, bits, bits * self._second)
        if frame.sent < bits:
            joules *= frame.sent / bits
        kind = RELAY if frame.relayed else SEND
        self._log(frame, source, kind, code, number, frame.to, packets, frame.sent, joules, TX)
        return fleet.alive[source]

    def _receive(
        self, frame: Burst, number: int, packets: int, code: int, node: int, expected: bool = True
    ) -> tuple[Bools, int]:
        """Charge and log one listener: the mask of what it got, and how much. It pays for what reaches it."""
        mask, got = self._arrivals(frame, node)
        if got == 0:
            if expected:
                self._drop(frame, number, packets, code, node)
            return mask, 0
        fleet, bits = self.fleet, got * frame.parcel.packet_bits
        joules = self._energy.receive(bits)
        paid = fleet.spend_receive(node, joules, bits, seconds=bits * self._second)
        if fleet.alive[node]:
            self._log(frame, node, RECEIVE, code, number, frame.source, got, bits, joules, RX)
            return mask, got
        self._log(frame, node, DROP, code, number, frame.source, packets, paid, joules * paid / bits, RX)
        return mask, 0

    def _arrivals(self, frame: Burst, node: int) -> tuple[Bools, int]:
        fleet = self.fleet
        if self._wiring.sharp and not fleet.disturbed:
            return frame.mask, frame.packets
        chance = self._wiring.success(frame.source, node)
        if fleet.disturbed:
            if fleet.jammed[frame.source] or fleet.jammed[node]:
                return np.zeros(frame.mask.size, dtype=np.bool_), 0
            chance *= (1.0 - fleet.loss[frame.source]) * (1.0 - fleet.loss[node])
        if chance >= 1.0:
            return frame.mask, frame.packets
        drawn = uniforms(derive_all(self._link_key(frame.source, node), np.arange(frame.mask.size)), 0)
        mask = np.logical_and(frame.mask, drawn >= 1.0 - chance)
        return mask, int(mask.sum())

    def _link_key(self, source: int, node: int) -> int:
        """A link's draws of a frame: they depend on the link, the step, and how often it was used in it."""
        step = self._journal.step
        return derive(self._key, source, node, step, self._uses.next((source, node), step))

    def _drop(self, frame: Burst, number: int, packets: int, code: int, node: int) -> None:
        self._log(frame, node, DROP, code, number, frame.source, packets, 0, 0.0, NONE)

    def _log(
        self, frame: Burst, node: int, kind: int, code: int, number: int, peer: int, packets: int, bits: int,
        joules: float, cause: int,
    ) -> None:  # fmt: skip
        self._journal.add(
            event(self._env.now, self._journal.step, frame.target, node, kind, code, number, frame.sequence, peer,
                  packets, bits, joules, cause)
        )  # fmt: skip
