"""What a burst does on the air: its sender pays, its listeners pay, packets arrive or not, and each act is an event.

The MAC decides *when* a burst gets the channel and calls `Medium.carry(frame)` at the end of its airtime.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import simpy

from wsnsim.base.arrays import Bools
from wsnsim.base.asks import Parcel, all_arrived
from wsnsim.base.ports import EnergyModel, LinkModel
from wsnsim.base.rng import derive
from wsnsim.base.tables import EVENT_CAUSE, KIND
from wsnsim.network.fleet import Fleet
from wsnsim.network.journal import Journal

SEND, RELAY, RECEIVE, DROP = KIND["send"], KIND["relay"], KIND["receive"], KIND["drop"]
NONE, TX, RX = EVENT_CAUSE["none"], EVENT_CAUSE["tx"], EVENT_CAUSE["rx"]
EVERYONE = -1


@dataclass(slots=True)
class Frame:
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


def burst(source: int, to: int, parcel: Parcel, target: int) -> Frame:
    """A frame that carries a whole parcel."""
    return Frame(source, to, parcel, target, all_arrived(parcel.packets), parcel.packets)


class Medium:
    """The air between the nodes."""

    def __init__(
        self, env: simpy.Environment, fleet: Fleet, journal: Journal, energy: EnergyModel, link: LinkModel, key: int
    ) -> None:
        self._env = env
        self._fleet = fleet
        self._journal = journal
        self._energy = energy
        self._link = link
        self._key = key
        self._counts: dict[tuple[int, int], int] = {}
        self.step = 0
        self.frames_sent = 0
        self.frames_lost = 0
        self.packets_sent = 0

    def carry(self, frame: Frame) -> None:
        """Perform a burst: charge, log, and leave in the frame what arrived. The dead send nothing."""
        if not self._fleet.alive[frame.source]:
            frame.mask, frame.packets = np.zeros(frame.mask.size, dtype=np.bool_), 0
            return
        self.frames_sent += 1
        frame.sequence = frame.sequence or self.frames_sent
        number, packets = self.frames_sent, frame.packets
        self.packets_sent += packets
        code = self._journal.code(frame.parcel.what)
        if frame.to == EVERYONE:
            self._broadcast(frame, number, packets, code)
        else:
            self._unicast(frame, number, packets, code)

    def _unicast(self, frame: Frame, number: int, packets: int, code: int) -> None:
        to = frame.to
        distance = self._fleet.distance(frame.source, to)
        if not self._transmit(frame, number, packets, code, distance):
            mask, got = frame.mask, 0
        elif not self._fleet.alive[to]:
            mask, got = frame.mask, 0
            self._drop(frame, number, packets, code, to)
        else:
            mask, got = self._receive(frame, number, packets, code, to, distance)
        frame.mask, frame.packets = mask if got else np.zeros(mask.size, dtype=np.bool_), got
        self.frames_lost += got < packets

    def _broadcast(self, frame: Frame, number: int, packets: int, code: int) -> None:
        fleet = self._fleet
        if not self._transmit(frame, number, packets, code, self._link.reach):
            self.frames_lost += 1
            return
        least = packets
        for node in fleet.neighbours(frame.source):
            if fleet.alive[node]:
                distance = fleet.distance(frame.source, node)
                mask, got = self._receive(frame, number, packets, code, node, distance)
                least = min(least, got)
                if got:
                    frame.heard[node] = mask
        self.frames_lost += least < packets

    def _transmit(self, frame: Frame, number: int, packets: int, code: int, distance: float) -> bool:
        """Charge and log the sending; whether the burst left whole."""
        fleet, source = self._fleet, frame.source
        bits = packets * frame.parcel.packet_bits
        electronics, amplifier = self._energy.transmit(bits, distance)
        joules = electronics + amplifier
        frame.sent = fleet.spend_transmit(source, electronics, amplifier, bits)
        if frame.sent < bits:
            joules *= frame.sent / bits
        kind = RELAY if frame.relayed else SEND
        self._log(frame, source, kind, code, number, frame.to, packets, frame.sent, joules, TX)
        return fleet.alive[source]

    def _receive(
        self, frame: Frame, number: int, packets: int, code: int, node: int, distance: float
    ) -> tuple[Bools, int]:
        """Charge and log one listener: the mask of what it got, and how much. It pays for what reaches it."""
        mask, got = self._arrivals(frame, node, distance)
        if got == 0:
            self._drop(frame, number, packets, code, node)
            return mask, 0
        fleet, bits = self._fleet, got * frame.parcel.packet_bits
        joules = self._energy.receive(bits)
        paid = fleet.spend_receive(node, joules, bits)
        if fleet.alive[node]:
            self._log(frame, node, RECEIVE, code, number, frame.source, got, bits, joules, RX)
            return mask, got
        self._log(frame, node, DROP, code, number, frame.source, packets, paid, joules * paid / bits, RX)
        return mask, 0

    def _arrivals(self, frame: Frame, node: int, distance: float) -> tuple[Bools, int]:
        if self._link.perfect:
            return frame.mask, frame.packets
        link = (frame.source, node)
        count = self._counts[link] = self._counts.get(link, 0) + 1
        key = derive(self._key, frame.source, node, self.step, count)
        mask = np.logical_and(frame.mask, self._link.arrivals(distance, frame.mask.size, key))
        return mask, int(mask.sum())

    def _drop(self, frame: Frame, number: int, packets: int, code: int, node: int) -> None:
        self._log(frame, node, DROP, code, number, frame.source, packets, 0, 0.0, NONE)

    def _log(
        self, frame: Frame, node: int, kind: int, code: int, number: int, peer: int, packets: int, bits: int,
        joules: float, cause: int,
    ) -> None:  # fmt: skip
        self._journal.add(
            (
                self._env.now,
                self.step,
                frame.target,
                node,
                kind,
                code,
                number,
                frame.sequence,
                peer,
                packets,
                bits,
                joules,
                cause,
            )
        )

    def begin_step(self, step: int) -> None:
        """Number the step for the log, and count each link's draws anew: they depend on link and step alone."""
        self.step = step
        self._counts.clear()
