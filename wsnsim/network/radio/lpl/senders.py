"""The senders of a MAC with low-power listening: queues, random waits, assessments of the channel, retries.

    senders.send(bursts), senders.offer(...), senders.silence(node)         what the MAC offers the network
    senders.finish(sender, received), senders.fail(sender)                  how the protocol ends the frame of a sender

A sender waits for a random time with its radio off, listens for the length of an assessment, and asks the protocol to
send its frame if the channel was free. X-MAC and ContikiMAC differ in what they send then: a `SendingProtocol` each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np
import simpy

from wsnsim.base.arrays import Ints
from wsnsim.base.frames import EVERYONE, MacFrame, Received
from wsnsim.base.medium_access import off_time
from wsnsim.models.low_power_listening import ContikiMac, XMac
from wsnsim.network.radio.channel import Channel
from wsnsim.network.radio.lpl.radios import SENDS, LowPowerRadios
from wsnsim.network.radio.mac_services import FrameSender, NetworkMacServices, SenderQueues
from wsnsim.network.radio.transmission import Transmission

RESOLUTION: Final = 2.0**-53
"""Distance of two random numbers below 1."""


class FrameCopy(MacFrame):
    """One of the copies of a frame that are sent in a row."""

    __slots__ = ("original",)
    is_copy = True

    def __init__(self, original: MacFrame) -> None:
        super().__init__(
            original.to, original.bits, original.packets, original.target, original.code, original.kind,
            original.sequence,
        )  # fmt: skip
        self.original = original

    def note_arrival(self, now: float) -> None:
        """Note that the frame has arrived."""
        self.original.note_arrival(now)


@dataclass(slots=True, eq=False)
class CopyTrain:
    """The copies of a frame in one try.

    Attributes:
        left: Copies that may still be sent.
        until: When the last one may begin, in s.
        wakes: Whether the destination sleeps when they begin, so that an acknowledgement says when it wakes.
        start: When the last one began, in s.
        reached: Nodes that received one.
        last: The last transmission; None before the first.
    """

    left: int
    until: float
    wakes: bool
    start: float = 0.0
    reached: set[int] = field(default_factory=set)
    last: Transmission | None = None

    def received(self) -> Ints:
        """(n,) the nodes that received a copy, ascending."""
        return np.array(sorted(self.reached), dtype=np.int64)


def count_try(services: NetworkMacServices, frame: MacFrame, train: CopyTrain) -> None:
    """Count a try of a frame that has ended, for the run and for links: as one frame, however many its copies."""
    sent, nodes, counters = train.last, services.radio.nodes, services.counters
    if sent is None or not frame.packets:
        return
    received = train.received()
    if frame.to == EVERYONE:
        if services.links is not None:
            services.links.count(sent, received)
        # meant for those that are awake, over reliable links
        ids, reliable = sent.neighbours.ids, services.radio.topology.reliable(sent.neighbours, sent.frame.bits)
        meant = ids[reliable & nodes.hears(ids, sent.start)]
    else:
        meant = np.array([frame.to] if nodes.alive[frame.to] else [], dtype=np.int64)
    delivered = int(np.isin(meant, received).sum())
    counters.frames_sent += 1
    counters.packets_sent += frame.packets
    counters.in_range += meant.size
    counters.delivered += delivered
    counters.frames_lost += delivered < max(meant.size, frame.to != EVERYONE)


@dataclass(slots=True, eq=False)
class RepeatingSender(FrameSender):
    """A node with frames to send.

    Attributes:
        attempts: How often the channel was busy for this frame since it was last sent.
        turn: Number of the action that the sender waits for: earlier ones are void.
        train: What the protocol keeps while it sends the frame; None while the sender waits for the channel.
    """

    attempts: int = 0
    turn: int = 0
    train: Any = None

    @property
    def has_more(self) -> bool:
        """Whether the next frame in the queue is for the same destination."""
        return bool(self.queue) and self.queue[0].to == self.current.to


Action = Callable[[RepeatingSender], None]


class SendingProtocol(Protocol):
    """How the frame of a sender reaches its destination."""

    def delay(self, sender: RepeatingSender) -> float:
        """Seconds that a sender waits before it listens to the channel."""

    def transmit(self, sender: RepeatingSender) -> None:
        """Send the frame: the channel is free, and the radio of the sender is on."""

    @property
    def find_busy(self) -> Action:
        """Lets a sender wait that found the channel busy; see `Senders.back_off`."""

    def transmit_next(self, sender: RepeatingSender) -> None:
        """Send a frame to a destination that is known to be awake: it has just received the one before."""


class Senders(SenderQueues[RepeatingSender]):
    """All nodes that have something to send."""

    def __init__(
        self, mac: XMac | ContikiMac, services: NetworkMacServices, radios: LowPowerRadios, channel: Channel,
        protocol: SendingProtocol,
    ) -> None:  # fmt: skip
        super().__init__(mac, services)
        self._mac = mac
        self._radios = radios
        self._channel = channel
        self._protocol = protocol
        self._key = services.key("mac")
        self._off_time = off_time(services.radio.energy)

    def silence(self, node: int) -> None:
        """Stop a node that died or crashed: its queue is lost, its transmission is cut, its radio is off."""
        self._channel.silence(node)
        self._radios.forget(node)
        self._stop(node)

    def _result_of_cut(self, sender: RepeatingSender) -> Received | None:
        """The result of a frame that is cut: a broadcast has arrived where one of its copies has."""
        train = sender.train
        if isinstance(train, CopyTrain) and sender.current.to == EVERYONE:
            return train.received()
        return True if sender.received else None

    def get(self, node: int) -> RepeatingSender | None:
        """The sender of a node that has a frame in progress; None if it has none."""
        sender = self._senders.get(node)
        return None if sender is None or sender.frame is None else sender

    def uniform(self, sender: RepeatingSender) -> float:
        """Return a random number in [0, 1) of a sender."""
        return (sender.draw(self._key, self._log.step) >> 11) * RESOLUTION

    def after(self, sender: RepeatingSender, seconds: float, action: Action) -> None:
        """Call an action of a sender later, unless it has another one by then or its node goes down."""
        sender.turn += 1
        turn = sender.turn

        def act(_: simpy.Event) -> None:
            if sender.turn == turn and not sender.stopped:
                action(sender)

        self._env.timeout(max(seconds, 0.0)).callbacks.append(act)

    def _enqueue(self, node: int, frame: MacFrame) -> None:
        if not self._nodes.alive[node]:
            frame.finish(None)
            return
        sender = self._senders.get(node)
        if sender is None:
            sender = self._senders[node] = RepeatingSender(node)
        if sender.frame is not None:
            sender.queue.append(frame)
            return
        self._take(sender, frame)
        self._radios.begin_sending(node)
        if not sender.stopped:
            self._begin(sender)

    def _begin(self, sender: RepeatingSender) -> None:
        """Wait as the protocol wants, and until a radio that is off can be on again, then assess the channel."""
        least = 0.0 if self._radios.is_held(sender.node) else self._off_time
        self.after(sender, max(self._protocol.delay(sender), least), self._listen)

    def _listen(self, sender: RepeatingSender) -> None:
        """Turn the radio on and assess the channel."""
        sender.train = None
        if self._radios.hold(sender.node, SENDS):
            self.after(sender, self._mac.assessment, self.assess)

    def assess(self, sender: RepeatingSender) -> None:
        """Send the frame if the channel was free for the length of an assessment; otherwise wait."""
        (self._protocol.find_busy if self._channel.is_busy(sender.node) else self._protocol.transmit)(sender)

    def back_off(self, sender: RepeatingSender) -> None:
        """Wait for a random time with the radio off, then assess the channel again; or drop the frame."""
        self._radios.release(sender.node, SENDS)
        if sender.stopped:
            return
        sender.train = None
        sender.attempts += 1
        if sender.attempts <= self._mac.max_backoffs:
            self.after(sender, self._wait(sender), self._begin)
            return
        self._services.counters.access_failures += 1
        self._services.log_drop(sender.node, sender.current, "no_channel")
        self.finish(sender, True if sender.received else None)

    def _wait(self, sender: RepeatingSender) -> float:
        """A random wait, by the clock of the sender, in s."""
        return self._services.lasts(sender.node, self._mac.congestion * self.uniform(sender))

    def fail(self, sender: RepeatingSender) -> None:
        """Note that no acknowledgement came: try again after a random wait, or give up."""
        if not self._repeats(sender.current, self._mac.max_retries):
            self.finish(sender, sender.received)
            return
        sender.attempts = 0
        sender.train = None
        self._radios.release(sender.node, SENDS)
        if not sender.stopped:
            self.after(sender, self._wait(sender), self._begin)

    def finish(self, sender: RepeatingSender, received: Received | None, awake: bool = False) -> None:
        """Report the result of a frame, and begin with the next one.

        Args:
            sender: The sender.
            received: The result.
            awake: Whether the destination is awake and expects the next frame, if that is for it.
        """
        sender.current.acknowledged = awake
        frame, following = sender.current, sender.queue.popleft() if sender.queue else None
        sends_on = awake and following is not None and following.to == frame.to
        self._take(sender, following)
        frame.finish(received)
        if sender.stopped:
            return
        if sends_on:
            self._protocol.transmit_next(sender)
            return
        self._radios.release(sender.node, SENDS)
        if sender.stopped:
            return
        if following is not None:
            self._begin(sender)
        elif sender.frame is None:
            self._radios.end_sending(sender.node)

    def finish_awake(self, sender: RepeatingSender) -> None:
        """Report that a frame was acknowledged; its destination stays awake for the next one."""
        self.finish(sender, True, awake=True)

    def _take(self, sender: RepeatingSender, frame: MacFrame | None) -> None:
        """Make a frame that of the sender, or none."""
        sender.frame, sender.train = frame, None
        sender.received, sender.attempts = False, 0
        sender.turn += 1
