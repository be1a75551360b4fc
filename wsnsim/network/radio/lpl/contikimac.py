"""ContikiMAC: the data frame is repeated until its destination wakes, hears a copy and acknowledges it.

A sender that knows when its destination wakes (`phase_locks`) begins shortly before. A broadcast is repeated for a
whole interval. How nodes wake up is in `channel_checks`.

Source: Dunkels (2011), "The ContikiMAC radio duty cycling protocol", SICS T2011:13. See
`models.contikimac.ContikiMac` for what is ours.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.base.frames import EVERYONE, SEND, MacFrame, Received
from wsnsim.base.medium_access import RepeatingMac
from wsnsim.network.radio.capture import HEADER_BITS
from wsnsim.network.radio.lpl.channel_checks import ChannelChecks
from wsnsim.network.radio.lpl.copies import CopyCounts, CopyTrain, FrameCopy
from wsnsim.network.radio.lpl.phase_locks import PhaseLocks
from wsnsim.network.radio.lpl.radios import RECEIVES, LowPowerRadios
from wsnsim.network.radio.lpl.senders import RepeatingSender, Senders
from wsnsim.network.radio.mac_services import NetworkMacServices
from wsnsim.network.radio.transmission import OnEnd, Transmission

DETECTED: Final = 0.5
"""An acknowledgement is detected whose preamble and delimiter arrive with at least this probability (our choice)."""
AWAKE_COPIES: Final = 3
"""Copies for a destination that expects the frame (our choice)."""


class ContikiMacMechanism:
    """ContikiMAC of all nodes on one channel."""

    def __init__(self, mac: RepeatingMac, services: NetworkMacServices) -> None:
        self._mac = mac
        self._env = services.radio.env
        self._nodes = services.radio.nodes
        self._topology = services.radio.topology
        self._radios = radios = LowPowerRadios(services, mac.interval, mac.near or mac.interval)
        self._checks = ChannelChecks(mac, services, radios)
        self._locks = PhaseLocks(services, mac.interval)
        self._counts = CopyCounts(services)
        self._ends: dict[int, float] = {}
        """{sender that waits for its destination to wake: when it gives up, in s}"""
        self.channel = services.open_channel(mac, mac.assessment, self._checks)
        self._senders = senders = Senders(mac, services, radios, self.channel, self)
        services.radio.log.code("no_channel")
        self._ack = services.radio.log.code("ack")
        self.send, self.offer, self.hurry = senders.send, senders.offer, radios.hurry

    def silence(self, node: int) -> None:
        """Stop a node that died or crashed: its frames are lost, and it forgets when others wake."""
        self._checks.forget(node)
        self._locks.forget_all(node)
        self._ends.pop(node, None)
        self._senders.silence(node)

    def delay(self, sender: RepeatingSender) -> float:
        """Return a random wait; to a destination with a known phase, until shortly before it wakes."""
        node, to, mac = sender.node, sender.current.to, self._mac
        self._ends.pop(node, None)
        early = mac.guard * (1.0 + self._senders.uniform(sender)) + mac.assessment + mac.turnaround
        wakes = None if to == EVERYONE or not mac.phase_lock else self._locks.next(node, to, self._env.now, early)
        if wakes is None:
            return mac.first_backoff * self._senders.uniform(sender)
        self._ends[node] = wakes[1] + mac.period(sender.current.bits) + mac.guard
        return wakes[0] - early - self._env.now

    def find_busy(self, sender: RepeatingSender) -> None:
        """A sender that found the channel busy waits for a random time."""
        self._senders.back_off(sender)

    def transmit(self, sender: RepeatingSender) -> None:
        """Begin with the copies of a frame."""
        copies = self._mac.copies(sender.current.bits)
        self._start(sender, CopyTrain(copies, self._ends.pop(sender.node, np.inf), wakes=True))

    def transmit_next(self, sender: RepeatingSender) -> None:
        """Begin with the copies of a frame for a destination that waits for it."""
        self._start(sender, CopyTrain(AWAKE_COPIES, np.inf, wakes=False))

    def _start(self, sender: RepeatingSender, train: CopyTrain) -> None:
        sender.train = train
        self._copy(sender)

    def _copy(self, sender: RepeatingSender) -> None:
        """Send the next copy; after the last one, end the try."""
        train, frame = sender.train, sender.current
        if train.left == 0 or self._env.now + self._mac.turnaround > train.until:
            self._end_without_answer(sender)
            return
        train.left -= 1
        self._nodes.begin_sending(sender.node)  # its schedule may end during a long train
        copy = FrameCopy(frame)
        copy.owner = sender
        train.last = self._transmit(sender.node, copy, self._copy_sent)
        train.start = train.last.start

    def _transmit(self, node: int, frame: MacFrame, on_end: OnEnd) -> Transmission:
        sent = self.channel.transmit(node, frame, on_end)
        self._checks.expect(sent)
        return sent

    def _copy_sent(self, sent: Transmission, received: Received) -> None:
        """A copy has ended: its destination acknowledges it; without an answer, the next copy follows."""
        self._checks.wake(sent)
        sender: RepeatingSender = sent.frame.owner
        train, to = sender.train, sent.frame.to
        answered = False
        if not sender.stopped:
            sender.current.sends += 1
            if to == EVERYONE:
                train.reached.update(received.tolist())
            elif received:
                train.reached.add(to)
                sender.received = True
                answered = self._answer(sent, sender)
        self._checks.end(sent)
        if not sender.stopped and not answered:
            self._senders.after(sender, self._mac.frame_gap - self._mac.turnaround, self._copy)

    def _answer(self, sent: Transmission, sender: RepeatingSender) -> bool:
        """The destination acknowledges a copy. Return whether its sender detects that before the next copy."""
        node, mac = sent.frame.to, self._mac
        if self.channel.is_sending(node) or not self._nodes.alive[node]:
            return False
        answer = mac.turnaround + mac.airtime(mac.ack_bits)
        more = mac.linger if sender.has_more else mac.turnaround
        self._radios.hold_until(node, RECEIVES, self._env.now + answer + more)
        if not self._nodes.alive[node]:
            return False
        ack = MacFrame(sender.node, mac.ack_bits, 0, sent.frame.target, self._ack, SEND, sent.frame.sequence)
        ack.owner = sender
        return self._detects(sender.node, self._transmit(node, ack, self._ack_sent))

    def _detects(self, node: int, ack: Transmission) -> bool:
        """Whether a sender detects an acknowledgement: it takes the channel for busy, or its header may be received."""
        neighbours = ack.neighbours
        at = neighbours.index(node)
        if at < 0 or neighbours.senses[at]:
            return at >= 0
        return bool(self._topology.probabilities(neighbours, HEADER_BITS)[at] >= DETECTED)

    def _ack_sent(self, sent: Transmission, received: Received) -> None:
        """An acknowledgement has ended. A sender that cannot read it tries again later, as after a collision."""
        self._checks.wake(sent)
        sender: RepeatingSender = sent.frame.owner
        self._checks.end(sent)
        train = sender.train
        if sender.stopped or not isinstance(train, CopyTrain):
            return
        if received:
            if train.wakes:
                self._locks.learn(sender.node, sent.source, train.start, self._mac.period(sender.current.bits))
            self._counts.count(sender.current, train)
            spacing = self._mac.spacing(sender.current.bits)
            self._senders.after(sender, spacing, self._acknowledged)
        elif self._detects(sender.node, sent):
            self._counts.count(sender.current, train)
            self._senders.fail(sender)

    def _acknowledged(self, sender: RepeatingSender) -> None:
        self._senders.finish(sender, True, awake=True)

    def _end_without_answer(self, sender: RepeatingSender) -> None:
        """All copies have been sent: that was it for a broadcast; a destination that did not answer is not known."""
        train, frame = sender.train, sender.current
        self._counts.count(frame, train)
        if frame.to == EVERYONE:
            self._senders.finish(sender, train.received())
        else:
            if train.wakes:
                self._locks.forget(sender.node, frame.to)
            self._senders.fail(sender)
