"""Unslotted CSMA/CA with acknowledgements: channel access of IEEE 802.15.4-2006, 7.5.1.4.

A sender waits for a random number of backoff periods below 2^BE and then assesses the channel. If the channel is free,
it sends; if it is busy, BE grows by one and the sender waits again, until its attempts are used up. A unicast is
acknowledged, and sent again if no acknowledgement comes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import simpy

from wsnsim.base.frames import EVERYONE, MacFrame, Received
from wsnsim.base.rng import GOLDEN, MASK, derive, mix
from wsnsim.models.access import Csma
from wsnsim.network.event_log import then
from wsnsim.network.radio.mac_services import (
    ContentionPeriods,
    FrameSender,
    NetworkMacServices,
    SenderQueues,
    control_frame,
)
from wsnsim.network.radio.transmission import Transmission


@dataclass(slots=True, eq=False)
class _Sender(FrameSender):
    """The channel access of one node.

    Attributes:
        clock_scale: True seconds in one second of the node's clock.
        attempts: Backoffs of this frame after the first (NB of the standard).
        exponent: Backoff exponent (BE).
        free_at: The end of the spacing after the last frame, in s.
    """

    clock_scale: float = 1.0
    attempts: int = 0
    exponent: int = 0
    free_at: float = 0.0


class CsmaMechanism(SenderQueues[_Sender]):
    """CSMA/CA of all nodes on one channel.

    Args:
        mac: The parameters.
        services: The services of the network.
        periods: When nodes may contend, beside slots; None: always. With them, unicasts are always acknowledged, and BE
            grows by one with each retransmission of a frame, too.
    """

    def __init__(self, mac: Csma, services: NetworkMacServices, periods: ContentionPeriods | None = None) -> None:
        super().__init__(mac, services)
        self._mac = mac
        self._acks = mac.acks or periods is not None
        self._periods = periods
        self._key = services.key("mac")
        self._log.code("no_channel")  # Registered first, so that the codes in result files stay the same.
        self._ack = self._log.code("ack")
        self.channel = services.open_channel(mac, mac.cca)

    def silence(self, node: int) -> None:
        """Stop a node that died or crashed: its queue is lost, and its transmission is cut."""
        self.channel.silence(node)
        self._stop(node)

    def _enqueue(self, node: int, frame: MacFrame) -> None:
        sender = self._senders.get(node)
        if sender is None:
            sender = self._senders[node] = _Sender(node, clock_scale=self._services.clocks.lasts(node, 1.0))
        if sender.frame is None:
            self._begin(sender, frame)
        else:
            sender.queue.append(frame)

    def _begin(self, sender: _Sender, frame: MacFrame) -> None:
        sender.frame = frame
        sender.received = False
        if self._acks:
            frame.acknowledged = False
        self._nodes.begin_sending(sender.node)
        self._contend(sender)

    def _contend(self, sender: _Sender) -> None:
        sender.attempts = 0
        sender.exponent = self._mac.min_be
        if self._periods is not None and sender.frame is not None:  # Answers to one announcement collide otherwise.
            sender.exponent = min(sender.exponent + sender.frame.retries, self._mac.max_be)
        self._back_off(sender, max(sender.free_at - self._env.now, 0.0))

    def _back_off(self, sender: _Sender, pause: float = 0.0) -> None:
        """Wait for a random number of backoff periods below 2^BE, then assess the channel."""
        mac, step = self._mac, self._log.step
        if sender.step != step:  # as `FrameSender.draw`, without the call
            sender.step, sender.state = step, derive(self._key, sender.node, step)
        sender.state = (sender.state + GOLDEN) & MASK
        periods = mix(sender.state) >> (64 - sender.exponent) if sender.exponent else 0
        timeout = self._env.timeout(pause + periods * mac.backoff * sender.clock_scale + mac.cca, sender)
        timeout.callbacks.append(self._assess)

    def _assess(self, timeout: simpy.Event) -> None:
        sender: Any = timeout.value
        if sender.stopped or (self._periods is not None and self._is_held_back(sender, self._periods)):
            return
        if not self.channel.is_busy(sender.node):
            self._transmit(sender)
            return
        sender.attempts += 1
        sender.exponent = min(sender.exponent + 1, self._mac.max_be)
        if sender.attempts <= self._mac.max_backoffs:
            self._back_off(sender)
        else:
            self._counters.access_failures += 1
            self._services.log_drop(sender.node, sender.frame, "no_channel")
            self._finish(sender, True if sender.received else None)

    def _is_held_back(self, sender: _Sender, periods: ContentionPeriods) -> bool:
        """Whether a sender must wait for the end of a round of slots. It then backs off again: no further try."""
        reopens = periods.closed_until(sender.node)
        if reopens is None:
            return False
        reopens.callbacks.append(lambda _: self._resume(sender))
        return True

    def _resume(self, sender: _Sender) -> None:
        """Back off again: the round is over that held a frame back."""
        if not sender.stopped:
            self._back_off(sender)

    def _transmit(self, sender: _Sender) -> None:
        """Send a frame, followed by its acknowledgement."""
        frame, mac = sender.frame, self._mac
        assert frame is not None, "a sender that acts has a frame"
        frame.owner = sender
        if self._periods is not None:
            answer = 0.0 if frame.to == EVERYONE else mac.ack_wait
            self._periods.note_exchange((sender.node, frame.to), mac.turnaround + mac.airtime(frame.bits) + answer)
        self.channel.transmit(sender.node, frame, self._sent)

    def _sent(self, transmission: Transmission, received: Received) -> None:
        """Finish a frame that was sent, or send its acknowledgement; if none will come, wait until it is overdue."""
        frame = transmission.frame
        sender: _Sender = frame.owner
        if sender.stopped:
            return
        if frame.to == EVERYONE or not self._acks:
            self._finish(sender, received)
        elif received and not self.channel.is_sending(frame.to):
            sender.received = True
            ack = control_frame(frame, transmission.source, self._mac.ack_bits, self._ack, sender)
            self.channel.transmit(frame.to, ack, self._ack_sent)
        else:
            sender.received = sender.received or bool(received)
            self._await_ack(sender, self._mac.ack_wait)

    def _ack_sent(self, transmission: Transmission, received: Received) -> None:
        sender: _Sender = transmission.frame.owner
        if sender.stopped:
            return
        if received:
            sender.current.acknowledged = True
            self._finish(sender, True)
        else:
            airtime = transmission.end - transmission.start
            self._await_ack(sender, self._mac.ack_wait - self._mac.turnaround - airtime)

    def _await_ack(self, sender: _Sender, seconds: float) -> None:
        then(self._env.timeout(max(seconds, 0.0)), self._retry, sender)

    def _retry(self, sender: _Sender) -> None:
        """No acknowledgement came: contend again, or give up."""
        if sender.stopped:
            return
        if self._repeats(sender.current, self._mac.max_retries):
            self._contend(sender)
        else:
            self._finish(sender, sender.received)

    def _finish(self, sender: _Sender, received: Received | None) -> None:
        """Report the result of a frame; the next one follows after the spacing between frames."""
        frame = sender.frame
        assert frame is not None, "a sender finishes the frame that it has begun"
        sender.free_at = self._env.now + self._mac.spacing(frame.bits)
        sender.frame = None
        frame.finish(received)
        if sender.frame is None and not sender.stopped:
            if sender.queue:
                self._begin(sender, sender.queue.popleft())
            else:
                self._nodes.end_sending(sender.node)
