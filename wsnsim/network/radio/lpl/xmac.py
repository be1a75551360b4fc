"""X-MAC: strobes that name their destination, early acknowledgements, and data once the destination is awake.

For a unicast, strobes are sent until the destination answers one of them. Its early acknowledgement, the data frame and
the acknowledgement follow one another, a turnaround apart. For a broadcast, all strobes are sent, and then the frame.
What nodes do that hear frames for others is in `overhearing`.

Source: Buettner, Yee, Anderson, Han (2006), "X-MAC: a short preamble MAC protocol for duty-cycled wireless sensor
networks", SenSys 2006. See `models.xmac.XMac` for what is ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.frames import EVERYONE, Received
from wsnsim.base.medium_access import off_time
from wsnsim.models.low_power_listening import XMac
from wsnsim.network.event_log import then
from wsnsim.network.radio.lpl.overhearing import Overhearing
from wsnsim.network.radio.lpl.radios import EXPECTS, RECEIVES, ROUNDING, LowPowerRadios
from wsnsim.network.radio.lpl.senders import RepeatingSender, Senders
from wsnsim.network.radio.mac_services import MacPart, NetworkMacServices, control_frame
from wsnsim.network.radio.transmission import Transmission


class Countdowns(MacPart):
    """The broadcasts that each node expects.

        countdowns.hear(source, receivers, seconds)    a strobe says after how many seconds its frame begins
        countdowns.end(transmission)                   the frame has ended

    What a receiver expects is its own knowledge: it turns the radio on even if the sender has died meanwhile, and
    forgets what it expects when it crashes.
    """

    def __init__(self, mac: XMac, services: NetworkMacServices, radios: LowPowerRadios) -> None:
        super().__init__(services)
        self._radios = radios
        self._longest = mac.turnaround + mac.airtime(mac.bits(mac.payload_bits)) + mac.turnaround
        """For how long a receiver waits for the end of a broadcast, in s"""
        self._off_time = off_time(services.radio.energy)
        self._expected: dict[int, set[int]] = {}
        """{node: senders of the broadcasts that it expects}"""

    def hear(self, source: int, receivers: Ints, seconds: float) -> None:
        """Let nodes (n,) expect a broadcast in this many seconds; until then they turn off if there is time."""
        new = [node for node in receivers.tolist() if source not in self._expected.get(node, ())]
        for node in new:
            self._expected.setdefault(node, set()).add(source)
            if seconds < self._off_time:
                now = self._env.now
                self._radios.hold_until(node, EXPECTS, now + seconds + self._longest, since=now)
        if new:
            then(self._env.timeout(seconds), self._turn_on, source, new)

    def _turn_on(self, source: int, nodes: list[int]) -> None:
        """Turn on the radios of nodes that still expect a broadcast and do not sleep by their schedule."""
        for node in nodes:
            expected = self._expected.get(node, set())
            if source in expected:
                expected.discard(source)
                if self._nodes.is_awake(node):
                    self._radios.hold_until(node, EXPECTS, self._env.now + self._longest)

    def end(self, sent: Transmission) -> None:
        """Turn off the radios that were on for a broadcast, at its end."""
        if sent.listeners is not None:
            for node in sent.listeners.tolist():
                self._radios.release(node, EXPECTS)

    def forget(self, node: int) -> None:
        """Note that a node is down: it expects nothing any more."""
        self._expected.pop(node, None)


@dataclass(slots=True)
class _Train:
    """The strobes of a frame under way. `left`: strobes that may still be sent."""

    left: int


class XMacMechanism(MacPart):
    """X-MAC of all nodes on one channel."""

    def __init__(self, mac: XMac, services: NetworkMacServices) -> None:
        super().__init__(services)
        self._mac = mac
        self._radios = radios = LowPowerRadios(services, mac.interval, mac.near or mac.interval)
        self._off_until = np.full(self._nodes.size, -np.inf)
        """(N,) until when radios are off although their listening window has not ended"""
        self._heard_until = np.full(self._nodes.size, -np.inf)
        """(N,) until when radios have been charged for frames that they heard in listening windows"""
        radios.on_hold, radios.on_release = self._leave_window, self._end_window
        self._wait_after_ack = mac.ack_wait - mac.turnaround - mac.airtime(mac.ack_bits)
        """Seconds that a sender still waits after the end of an acknowledgement that it could not read"""
        self.channel = services.open_channel(mac, mac.assessment, self)
        self._senders = senders = Senders(mac, services, radios, self.channel, self)
        self._countdowns = Countdowns(mac, services, radios)
        self._overhearing = Overhearing(mac, services, radios, senders)
        self.find_busy = self._overhearing.wait
        code = self._log.code
        code("no_channel")  # registered first, so that the codes in result files stay the same
        self._strobe_code, self._early_ack, self._ack = code("strobe"), code("early_ack"), code("ack")
        self.send, self.offer, self.use_short_interval = senders.send, senders.offer, radios.use_short_interval

    def silence(self, node: int) -> None:
        """Stop a node that died or crashed: its frames are lost, and it forgets what it expected."""
        self._countdowns.forget(node)
        self._senders.silence(node)

    def hears(self, ids: Ints, since: float) -> Bools:
        """(n,) which radios have been on without a break since a time: held on, or in a listening window."""
        offsets, _ = self._radios.offsets(ids, since)
        window = self._mac.window + ROUNDING
        awake = (offsets + (self._env.now - since) <= window) & (self._off_until[ids] <= since)
        return np.asarray(awake | (self._radios.on_since[ids] <= since + ROUNDING))

    def delay(self, sender: RepeatingSender) -> float:
        """Return a random wait before the first attempt."""
        return self._mac.first_backoff * self._senders.uniform(sender)

    def transmit(self, sender: RepeatingSender) -> None:
        """Begin with the strobes of a frame; or send it, if its destination has just received another one."""
        if self._overhearing.is_awake_for(sender):
            self.transmit_next(sender)
            return
        sender.train = _Train(self._mac.strobes)
        self._strobe(sender)

    def transmit_next(self, sender: RepeatingSender) -> None:
        """Send the data frame: its destination is awake."""
        if sender.current.to == EVERYONE:  # a broadcast needs its strobes: others still sleep
            self.transmit(sender)
            return
        sender.current.owner = sender
        self.channel.transmit(sender.node, sender.current, self._data_sent)

    def _strobe(self, sender: RepeatingSender) -> None:
        """Send the next strobe; after the last one, end the train."""
        train, frame = sender.train, sender.current
        if train.left == 0:
            if frame.to == EVERYONE:
                frame.owner = sender
                self.channel.transmit(sender.node, frame, self._broadcast_sent)
            else:
                self._senders.fail(sender)
            return
        train.left -= 1
        self._nodes.begin_sending(sender.node)  # its schedule may end during a long train
        strobe = control_frame(frame, frame.to, self._mac.strobe_bits, self._strobe_code, sender)
        self.channel.transmit(sender.node, strobe, self._strobe_sent)

    def _strobe_sent(self, sent: Transmission, received: Received) -> None:
        """A strobe has ended: a node that heard it answers, expects the broadcast, or sleeps on."""
        sender: RepeatingSender = sent.frame.owner
        to = sent.frame.to
        if to == EVERYONE:
            self._expect(sender, sent, received)
        else:
            self._close_windows(sent, received)
            self._overhearing.note_frame(sent)
        if sender.stopped:
            return
        if to != EVERYONE and received and self._answer(sent, sender):
            return
        self._senders.after(sender, self._mac.ack_wait, self._strobe)

    def _answer(self, sent: Transmission, sender: RepeatingSender) -> bool:
        """Let the destination send an early acknowledgement and stay on for the data; return whether it does."""
        node, mac = sent.frame.to, self._mac
        own = self._senders.get(node)  # a node does not answer while it sends strobes itself
        if self.channel.is_sending(node) or (own is not None and isinstance(own.train, _Train)):
            return False
        answer = 2.0 * mac.turnaround + mac.airtime(mac.ack_bits) + mac.airtime(mac.bits(mac.payload_bits))
        now = self._env.now
        self._radios.hold_until(node, RECEIVES, now + answer + mac.turnaround, since=now)
        if not self._nodes.alive[node]:  # turning the radio on has emptied its battery
            return False
        ack = control_frame(sent.frame, sender.node, mac.ack_bits, self._early_ack, sender)
        self.channel.transmit(node, ack, self._early_ack_sent)
        return True

    def _early_ack_sent(self, sent: Transmission, received: Received) -> None:
        """An early acknowledgement has ended: its receiver sends the data, or more strobes if it could not read it."""
        self._close_windows(sent, received)
        sender: RepeatingSender = sent.frame.owner
        self._overhearing.note_answer(sent)
        if sender.stopped:
            return
        if received:
            self.transmit_next(sender)
        else:
            self._senders.after(sender, self._wait_after_ack, self._strobe)

    def _data_sent(self, sent: Transmission, received: Received) -> None:
        """A data frame has ended: its destination acknowledges it, and stays on for further frames."""
        self._close_windows(sent, received)
        sender: RepeatingSender = sent.frame.owner
        node, mac = sent.frame.to, self._mac
        sender.train = None
        self._overhearing.note_frame(sent)
        sender.received = sender.received or bool(received)
        if received and self._nodes.alive[node] and not self.channel.is_sending(node):
            self._radios.hold_until(node, RECEIVES, self._env.now + mac.linger)
            if self._nodes.alive[node]:
                ack = control_frame(sent.frame, sent.source, mac.ack_bits, self._ack, sender)
                self.channel.transmit(node, ack, self._ack_sent)
                return
        if not sender.stopped:
            self._senders.after(sender, mac.ack_wait, self._senders.fail)

    def _ack_sent(self, sent: Transmission, received: Received) -> None:
        self._close_windows(sent, received)
        sender: RepeatingSender = sent.frame.owner
        if not sender.stopped:
            if received:
                self._senders.after(sender, self._mac.spacing(sender.current.bits), self._senders.finish_awake)
            else:
                self._senders.after(sender, self._wait_after_ack, self._senders.fail)
        self._overhearing.note_acknowledgement(sent)

    def _expect(self, sender: RepeatingSender, sent: Transmission, received: Ints) -> None:
        """Nodes that heard a strobe of a broadcast expect the frame, and turn the radio off until it begins."""
        self._close_windows(sent, received)
        if received.size and not sender.stopped:
            mac = self._mac
            self._countdowns.hear(sent.source, received, sender.train.left * mac.period + mac.gap - mac.turnaround)

    def _broadcast_sent(self, sent: Transmission, received: Received) -> None:
        """A broadcast has ended: the radios that were on for it turn off."""
        self._close_windows(sent, received)
        sender: RepeatingSender = sent.frame.owner
        self._countdowns.end(sent)
        if not sender.stopped:
            self._senders.finish(sender, received)

    def _close_windows(self, sent: Transmission, received: Received) -> None:
        """End the listening windows in which a frame was heard, and give back the energy of listening.

        Reception is charged in place of listening while the frame lasts. A node that hears a frame for another node
        turns the radio off; the radio of the destination is held on. A node at which another frame overlaps listens on,
        unless it has received the frame: it cannot tell for whom that is.
        """
        listeners = sent.listeners
        if listeners is None or not listeners.size:
            return
        now = self._env.now
        # nodes whose radios are not held on: they listen in their windows
        nodes = listeners[self._radios.on_since[listeners] == np.inf]
        # time that an earlier overlapping frame covered has been given back already
        not_listened = now - np.maximum(sent.start, self._heard_until[nodes])
        self._heard_until[nodes] = now
        read = np.ones(nodes.size, dtype=np.bool_)
        for other in sent.overlapping or ():
            read &= ~np.isin(nodes, other.neighbours.ids)
        read |= np.isin(nodes, received) if sent.frame.to == EVERYONE else (nodes == sent.frame.to) & bool(received)
        left = np.where(read, self._window_left(nodes), 0.0)
        self._off_until[nodes[read]] = now + left[read] + ROUNDING
        not_listened += left
        for node, seconds in zip(nodes.tolist(), not_listened.tolist(), strict=True):
            self._nodes.spend_listening(node, -seconds)

    def _window_left(self, ids: Ints) -> Floats:
        """(n,) seconds that are left of the listening windows of nodes; 0 outside them."""
        offsets, _ = self._radios.offsets(ids, self._env.now)
        return np.maximum(self._mac.window - offsets, 0.0)

    def _leave_window(self, node: int) -> float:
        """Return since when a radio that is held on from now on has been on, inf if it was off.

        The rest of its listening window is not charged: holding the radio on is.
        """
        ids, now = np.array([node]), self._env.now
        left = float(self._window_left(ids)[0])
        if not left or self._off_until[node] > now:
            return np.inf
        self._nodes.spend_listening(node, -left)
        return now + left - self._mac.window

    def _end_window(self, node: int) -> None:
        """A radio that is turned off within a listening window stays off until the next one."""
        left = float(self._window_left(np.array([node]))[0])
        self._off_until[node] = self._env.now + left + ROUNDING
