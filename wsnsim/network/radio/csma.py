"""Carrier sense with collision avoidance: the unslotted access of IEEE 802.15.4 (2006), 7.5.1.4, with acknowledgements.

    mac.send(frames) -> simpy.Event              fires when every burst has ended
    mac.offer(node, message)                     one frame; message.done(heard) at its end

Wait for a random number of slots below 2^BE, assess the channel, send if it is free; if it is busy, double the range
and wait again, until the attempts are used up. A unicast is acknowledged, and sent again where no acknowledgement
came. Only nodes that send have a station.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import simpy

from wsnsim.base.radio import ContendingMac
from wsnsim.base.rng import GOLDEN, MASK, derive, mix
from wsnsim.base.tables import KIND
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.channel import Channel
from wsnsim.network.radio.counters import Counters
from wsnsim.network.radio.fragmentation import Fragmentation
from wsnsim.network.radio.ideal_medium import EVERYONE, SEND, Burst
from wsnsim.network.radio.transmission import Heard, MacFrame, Transmission

DROP = KIND["drop"]


class Offered(MacFrame):
    """A broadcast of one packet, and who is told how it fared."""

    __slots__ = ("done",)

    def __init__(self, bits: int, code: int, done: Callable[[Heard | None], None]) -> None:
        super().__init__(EVERYONE, bits, code=code)
        self.done = done


class _Station:
    """A node's access to the channel: what waits, and how far the first of it has come.

    `state` is of its random numbers, which begin anew at each step: they do not depend on what it sent before.
    """

    __slots__ = (
        "backoffs",
        "exponent",
        "free_at",
        "gone",
        "message",
        "node",
        "received",
        "scale",
        "state",
        "step",
        "waiting",
    )

    def __init__(self, node: int, scale: float) -> None:
        self.node = node
        self.state = 0
        self.scale = scale
        self.waiting: deque[Any] = deque()
        self.message: Any = None
        self.backoffs = 0
        self.exponent = 0
        self.received = False
        self.free_at = 0.0
        self.step = -1
        self.gone = False


class CsmaMechanism:
    """Every node's access to one channel."""

    def __init__(
        self, env: simpy.Environment, fleet: Nodes, channel: Channel, bursts: Fragmentation, journal: EventLog,
        part: ContendingMac, key: int, clocks: Clocks,
    ) -> None:  # fmt: skip
        self._env = env
        self._fleet = fleet
        self._channel = channel
        self._bursts = bursts
        self._journal = journal
        self._part = part
        self._key = key
        self._clocks = clocks
        self._stations: dict[int, _Station] = {}
        self.counts: Counters = channel.counts
        self._no_channel = journal.code("no_channel")
        self._ack = journal.code("ack")

    def send(self, frames: Sequence[Burst], hub: int | None = None) -> simpy.Event:
        """Offer bursts to their senders' stations; the event fires when the last of them has ended."""
        event = self._env.event()
        open_bursts = len(frames)

        def ended(frame: Burst) -> None:
            nonlocal open_bursts
            open_bursts -= 1
            if open_bursts == 0:
                event.succeed()

        if not frames:
            return event.succeed()
        for frame in frames:
            pieces = self._bursts.cut(frame, lambda frame=frame: ended(frame))  # type: ignore[misc]
            if not pieces or not self._fleet.alive[frame.source]:
                nothing_arrives(frame)
                ended(frame)
            else:
                for piece in pieces:
                    self._queue(frame.source, piece)
        return event

    def offer(self, node: int, payload_bits: int, done: Callable[[Heard | None], None], code: int = 0) -> None:
        """Broadcast a payload without more ado; `done(ids)` at its end, `done(None)` if it never got the channel."""
        self._queue(node, Offered(self._part.bits(payload_bits), code, done))

    def _queue(self, node: int, message: Any) -> None:
        station = self._stations.get(node)
        if station is None:
            scale = self._clocks.lasts(node, 1.0)
            station = self._stations[node] = _Station(node, scale)
        if station.message is None:
            self._begin(station, message)
        else:
            station.waiting.append(message)

    def count_links(self) -> None:
        """Keep count of every link's broadcasts from now on."""
        self._channel.count_links()

    def link_rows(self) -> dict[str, Any]:
        """The columns of the table `links`."""
        return self._channel.links.rows() if self._channel.links is not None else {}

    def silence(self, node: int) -> None:
        """A node is dead or down: what it had to send is lost, and what it was sending cut short."""
        self._channel.silence(node)
        station = self._stations.pop(node, None)
        if station is None:
            return
        station.gone = True
        waiting = [station.message, *station.waiting] if station.message is not None else []
        station.message = None
        for message in waiting:
            message.done(True if station.received and message is waiting[0] else None)

    def _begin(self, station: _Station, message: Any) -> None:
        station.message = message
        station.received = False
        self._fleet.begin_sending(station.node)
        self._contend(station)

    def _contend(self, station: _Station) -> None:
        station.backoffs = 0
        station.exponent = self._part.min_be
        self._back_off(station, max(station.free_at - self._env.now, 0.0))

    def _back_off(self, station: _Station, pause: float = 0.0) -> None:
        """Wait for a random number of slots, then assess the channel."""
        part = self._part
        if station.step != self._journal.step:
            station.step = self._journal.step
            station.state = derive(self._key, station.node, station.step)
        station.state = (station.state + GOLDEN) & MASK
        slots = mix(station.state) >> (64 - station.exponent) if station.exponent else 0
        event = self._env.timeout(pause + slots * part.backoff * station.scale + part.cca, station)
        event.callbacks.append(self._assess)

    def _assess(self, event: simpy.Event) -> None:
        station: Any = event.value
        if station.gone:
            return
        if not self._channel.is_busy(station.node):
            self._channel.transmit(station.node, station.message, station, self._landed)
            return
        station.backoffs += 1
        station.exponent = min(station.exponent + 1, self._part.max_be)
        if station.backoffs <= self._part.max_backoffs:
            self._back_off(station)
        else:
            self._give_up(station)

    def _give_up(self, station: _Station) -> None:
        """The channel was never free: the frame is dropped."""
        message = station.message
        self.counts.access_failures += 1
        self._journal.add(
            event(
                self._env.now, self._journal.step, message.target, station.node, DROP, self._no_channel,
                sequence=message.sequence, peer=message.to, packets=message.packets,
            )
        )  # fmt: skip
        self._finish(station, True if station.received else None)

    def _landed(self, one: Transmission, heard: Heard) -> None:
        station: _Station = one.owner
        counts = self.counts
        one.message.sends += 1
        counts.frames_sent += 1
        counts.packets_sent += one.message.packets
        broadcast = one.message.to == EVERYONE
        counts.frames_lost += (one.cut or one.missed) if broadcast else not heard
        if station.gone:
            return
        if broadcast or not self._part.acks:
            self._finish(station, heard)
        elif heard and not self._channel.is_sending(one.message.to):
            station.received = True
            self._acknowledge(one, station)
        else:
            station.received = station.received or bool(heard)
            self._await(station, self._part.ack_wait)

    def _acknowledge(self, one: Transmission, station: _Station) -> None:
        """The destination answers, without contending, after its turnaround."""
        message = one.message
        ack = MacFrame(one.source, self._part.ack_bits, 0, message.target, self._ack, SEND, message.sequence)
        self._channel.transmit(message.to, ack, station, self._ack_landed)

    def _ack_landed(self, one: Transmission, heard: Heard) -> None:
        station: _Station = one.owner
        if station.gone:
            return
        if heard:
            self._finish(station, True)
        else:
            self._await(station, self._part.ack_wait - self._part.turnaround - (one.end - one.start))

    def _await(self, station: _Station, seconds: float) -> None:
        event = self._env.timeout(max(seconds, 0.0), station)
        event.callbacks.append(self._try_again)

    def _try_again(self, event: simpy.Event) -> None:
        """No acknowledgement came: contend once more, or leave it."""
        station: Any = event.value
        if station.gone:
            return
        message = station.message
        if message.retries >= self._part.max_retries:
            self._finish(station, station.received)
            return
        message.retries += 1
        self.counts.retries += 1
        self._contend(station)

    def _finish(self, station: _Station, heard: Heard | None) -> None:
        """The frame is done with; the next one follows after the spacing between frames."""
        message = station.message
        station.free_at = self._env.now + self._part.spacing(message.bits)
        station.message = None
        message.done(heard)
        if station.message is None and not station.gone:
            if station.waiting:
                self._begin(station, station.waiting.popleft())
            else:
                self._fleet.end_sending(station.node)


def nothing_arrives(frame: Burst) -> None:
    """Say of a burst that no packet of it arrived."""
    frame.mask, frame.packets = np.zeros(frame.mask.size, dtype=np.bool_), 0
