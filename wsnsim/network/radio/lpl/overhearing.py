"""What a sender of X-MAC does that finds the channel busy: it listens whether others send to its own destination.

If so, it keeps the radio on instead of waiting with the radio off. When it hears the acknowledgement of the other's
data, its destination is awake, and stays so for a while: it waits for a random time and sends its data without strobes.
If it hears no acknowledgement, it waits as after any busy channel.

Source: Buettner and others (2006), section 3.3: a waiting sender backs off, and then sends without a preamble.
"""

from __future__ import annotations

from dataclasses import dataclass

from wsnsim.base.frames import EVERYONE
from wsnsim.models.low_power_listening import XMac
from wsnsim.network.radio.lpl.radios import SENDS, LowPowerRadios
from wsnsim.network.radio.lpl.senders import RepeatingSender, Senders
from wsnsim.network.radio.mac_services import NetworkMacServices
from wsnsim.network.radio.transmission import Transmission


@dataclass(slots=True)
class Waiting:
    """What a sender keeps that waits for an exchange of others to end. `direct`: its destination is awake."""

    direct: bool = False


class Overhearing:
    """What waiting senders know of the exchanges that they overhear."""

    def __init__(self, mac: XMac, services: NetworkMacServices, radios: LowPowerRadios, senders: Senders) -> None:
        self._mac = mac
        self._env = services.radio.env
        self._radios = radios
        self._senders = senders
        answer = mac.turnaround + mac.airtime(mac.ack_bits)
        longest = mac.airtime(mac.bits(mac.payload_bits))
        self._exchange = mac.turnaround + longest + answer + mac.turnaround
        """The longest time in s from an early acknowledgement to that of the data."""
        self._spread = max(mac.linger - answer - mac.turnaround - longest, 0.0)
        """The longest random wait in s after which a frame still ends while its destination is on."""
        self._heard: dict[int, float] = {}
        """{node: when it last heard a frame to the destination of its own}"""

    def note_frame(self, sent: Transmission) -> None:
        """Senders hear a frame for their own destination."""
        if sent.frame.to != EVERYONE:
            for sender in self._listening(sent, sent.frame.to):
                self._heard[sender.node] = self._env.now

    def note_answer(self, sent: Transmission) -> None:
        """Waiting senders hear the early acknowledgement of their destination: the data follow."""
        for sender in self._listening(sent, sent.source):
            if isinstance(sender.train, Waiting):
                self._senders.after(sender, self._exchange, self._senders.back_off)

    def note_acknowledgement(self, sent: Transmission) -> None:
        """Waiting senders hear that their destination has received data: it stays on for theirs."""
        for sender in self._listening(sent, sent.source):
            if isinstance(sender.train, Waiting):
                sender.train.direct = True
                wait = max(self._spread * self._senders.uniform(sender), self._mac.assessment)
                self._senders.after(sender, wait, self._senders.assess)

    def wait(self, sender: RepeatingSender) -> None:
        """Let a sender that found the channel busy listen for long enough to hear whose strobes are on the air."""
        sender.train = Waiting()
        self._senders.after(sender, self._mac.window, self._judge)

    def _judge(self, sender: RepeatingSender) -> None:
        """A sender that heard a frame for its own destination waits for the end of that exchange; others back off.

        A sender that waits again and again gives up as often as one that finds the channel busy.
        """
        if self._heard.get(sender.node, -1.0) >= self._env.now - self._mac.window - self._mac.assessment:
            self._senders.after(sender, self._mac.interval + self._exchange, self._senders.back_off)
        else:
            self._senders.back_off(sender)

    def is_awake_for(self, sender: RepeatingSender) -> bool:
        """Whether the destination of a sender is on, because it has just received another frame."""
        return isinstance(sender.train, Waiting) and sender.train.direct

    def _listening(self, sent: Transmission, destination: int) -> list[RepeatingSender]:
        """The senders that heard a frame, and wait for the channel to send to this destination."""
        if sent.listeners is None:
            return []
        found = (self._senders.get(node) for node in sent.listeners.tolist() if self._radios.is_held(node, SENDS))
        return [
            sender
            for sender in found
            if sender is not None and sender.current.to == destination and sender.node != sent.source
            and (sender.train is None or isinstance(sender.train, Waiting))
        ]  # fmt: skip
