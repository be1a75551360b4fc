"""The ideal channel: bursts without contention or collisions. It charges sender and receivers, and logs each event.

A burst is carried at the end of its airtime.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import simpy

from wsnsim.base.arrays import Bools
from wsnsim.base.frames import EVERYONE, SEND, Burst, Received, full_burst
from wsnsim.base.requests import Parcel
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.tables import EVENT_CAUSE, KIND
from wsnsim.models.access import IdealMac
from wsnsim.network.event_log import Acting, event, then
from wsnsim.network.radio.mac_services import NetworkMacServices
from wsnsim.network.radio.transmission import UseCounter

RELAY, RECEIVE, DROP = KIND["relay"], KIND["receive"], KIND["drop"]
TX, RX = EVENT_CAUSE["tx"], EVENT_CAUSE["rx"]


class IdealMechanism:
    """The ideal channel of the papers: no contention, no collision; packets are lost only to the link, or to a fault.

    Without a rate, bursts are delivered within the instant. With a rate (bit/s), the bursts of one batch follow one
    another; different batches do not disturb each other. A burst is delivered at its end, to whom listens then: a node
    that wakes in the middle of it receives it, and a node that falls asleep in the middle does not. On a channel with
    frames (`reception`) it is the other way round: a radio must have listened from the beginning, and then receives the
    frame to its end.
    """

    def __init__(self, mac: IdealMac, services: NetworkMacServices) -> None:
        self._env, self._nodes, self._topology, self._energy, self._log, self._counters = services.radio
        self._rate, self._seconds_per_bit = mac.rate, 0.0 if mac.rate is None else 1.0 / mac.rate
        self._uses = UseCounter(services.key("link"))
        self._silenced: dict[int, int] = {}

    def send(self, bursts: Sequence[Burst], head: int | None = None) -> simpy.Event:
        """Send bursts: one event for all of them, or one per burst if sending takes time."""
        if self._rate is not None:
            return self._env.process(self._one_by_one(bursts, self._rate))
        event = self._env.event()
        then(event, self._carry_all, bursts)
        return event.succeed()

    def _carry_all(self, bursts: Sequence[Burst]) -> None:
        for burst in bursts:
            self.carry(burst)

    def offer(self, node: int, payload_bits: int, done: Callable[[Received | None], None], code: int = 0) -> None:
        """Broadcast one payload, now or after its airtime."""
        what = self._log.word(code) or "beacon"
        burst = full_burst(node, EVERYONE, Parcel(None, 1, payload_bits, what), -1)
        event = self.send([burst])
        then(event, lambda: done(np.array(sorted(burst.received), dtype=np.int64)))

    def silence(self, node: int) -> None:
        """Stop a node that died or crashed: what it is sending is lost."""
        self._silenced[node] = self._silenced.get(node, 0) + 1

    def _one_by_one(self, bursts: Sequence[Burst], rate: float) -> Acting[None]:
        before = [self._silenced.get(burst.source) for burst in bursts]
        for burst, silenced in zip(bursts, before, strict=True):
            self._nodes.begin_sending(burst.source)
            yield self._env.timeout(burst.bits / rate)
            if self._silenced.get(burst.source) == silenced:
                self.carry(burst)
            else:
                burst.lose()
            self._nodes.end_sending(burst.source)

    def carry(self, burst: Burst) -> None:
        """Perform a burst: charge and log it, and write into it what arrived. A dead node sends nothing."""
        if not self._nodes.alive[burst.source]:
            burst.lose()
            return
        counters = self._counters
        counters.frames_sent += 1
        counters.packets_sent += burst.packets
        number = counters.frames_sent
        burst.sequence = burst.sequence or number
        burst.attempts = 1
        code = self._log.code(burst.parcel.what)
        if burst.to == EVERYONE:
            self._broadcast(burst, number, code)
        else:
            self._unicast(burst, number, code)

    def _unicast(self, burst: Burst, number: int, code: int) -> None:
        to, packets, counters = burst.to, burst.packets, self._counters
        got = 0
        if self._transmit(burst, number, code, self._nodes.distance(burst.source, to)):
            if self._nodes.is_awake(to):
                mask, got = self._receive(burst, number, code, to)
            else:
                self._drop(burst, number, code, to)
        counters.in_range += 1
        counters.delivered += got == packets
        counters.frames_lost += got < packets
        if got:
            burst.mask, burst.packets = mask, got
            burst.heard, burst.heard_at = mask, self._env.now
            burst.acknowledged = True
        else:
            burst.lose()

    def _broadcast(self, burst: Burst, number: int, code: int) -> None:
        nodes, counters, packets = self._nodes, self._counters, burst.packets
        if not self._transmit(burst, number, code, nodes.reach):
            counters.frames_lost += 1
            return
        least = packets
        for node in self._listeners(burst.source):
            if not nodes.alive[node]:
                continue
            expected = self._topology.is_reliable(burst.source, node)
            mask, got = self._receive(burst, number, code, node, expected)
            if got:
                burst.received[node] = mask
            if expected:
                least = min(least, got)
                counters.in_range += 1
                counters.delivered += got == packets
        counters.frames_lost += least < packets

    def _listeners(self, source: int) -> list[int]:
        """The neighbours that listen now, ascending; if no node follows a schedule, dead nodes included."""
        neighbours = self._topology.neighbours(source)
        if not self._nodes.follows_schedules:
            return neighbours.id_list
        awake: list[int] = neighbours.ids[self._nodes.hears(neighbours.ids, self._env.now)].tolist()
        return awake

    def _transmit(self, burst: Burst, number: int, code: int, distance: float) -> bool:
        """Charge and log the transmission; returns whether the sender lived to its end."""
        nodes, source = self._nodes, burst.source
        bits = burst.packets * burst.parcel.packet_bits
        electronics, amplifier = self._energy.transmit(bits, distance)
        joules = electronics + amplifier
        burst.sent = nodes.spend_transmit(source, electronics, amplifier, bits, bits * self._seconds_per_bit)
        if burst.sent < bits:
            joules *= burst.sent / bits
        kind = RELAY if burst.relayed else SEND
        self._log.add(
            (self._env.now, self._log.step, burst.target, source, kind, code, number, burst.sequence, burst.to,
             burst.packets, burst.sent, joules, TX)
        )  # fmt: skip
        result: bool = nodes.alive[source]
        return result

    def _receive(self, burst: Burst, number: int, code: int, node: int, expected: bool = True) -> tuple[Bools, int]:
        """Charge and log one receiver; returns the mask and the number of the packets that it received."""
        mask, got = self._arrivals(burst, node)
        if got == 0:
            if expected:
                self._drop(burst, number, code, node)
            return mask, 0
        nodes, bits = self._nodes, got * burst.parcel.packet_bits
        joules = self._energy.receive(bits)
        paid = nodes.spend_receive(node, joules, bits, seconds=bits * self._seconds_per_bit)
        kind, packets = RECEIVE, got
        if not nodes.alive[node]:
            kind, packets, joules, bits, got = DROP, burst.packets, joules * paid / bits, paid, 0
        self._log.add(
            (self._env.now, self._log.step, burst.target, node, kind, code, number, burst.sequence, burst.source,
             packets, bits, joules, RX)
        )  # fmt: skip
        return mask, got

    def _arrivals(self, burst: Burst, node: int) -> tuple[Bools, int]:
        """The mask and the number of the packets that reach a node, by link and faults."""
        nodes = self._nodes
        if self._topology.distance_only and not nodes.disturbed:
            return burst.mask, burst.packets
        probability = self._topology.probability(burst.source, node, self._env.now)
        if nodes.disturbed:
            if nodes.jammed[burst.source] or nodes.jammed[node]:
                return np.zeros(burst.mask.size, dtype=np.bool_), 0
            probability *= (1.0 - nodes.loss[burst.source]) * (1.0 - nodes.loss[node])
        if probability >= 1.0:
            return burst.mask, burst.packets
        samples = uniforms(derive_all(self._link_key(burst.source, node), np.arange(burst.mask.size)), 0)
        mask = np.logical_and(burst.mask, samples >= 1.0 - probability)
        return mask, int(mask.sum())

    def _link_key(self, source: int, node: int) -> int:
        """The random key of a burst on a link: a function of link, step, and number of its use in the step."""
        step = self._log.step
        return derive(self._uses.key, source, node, step, self._uses.next((source, node), step))

    def _drop(self, burst: Burst, number: int, code: int, node: int) -> None:
        self._log.add(
            event(self._env.now, self._log.step, burst.target, node, DROP, code, number, burst.sequence, burst.source,
                  burst.packets)
        )  # fmt: skip
