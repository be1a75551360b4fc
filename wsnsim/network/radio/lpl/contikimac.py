"""ContikiMAC: the data frame is repeated until its destination wakes, hears a copy and acknowledges it.

A sender that knows when its destination wakes (`PhaseLocks`) begins shortly before. A broadcast is repeated for a
whole interval. How nodes wake up is in `ChannelChecks`.

Source: Dunkels (2011), "The ContikiMAC radio duty cycling protocol", SICS T2011:13. `ContikiMac` says what is ours.
"""

from __future__ import annotations

from math import ceil
from typing import Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.frames import EVERYONE, MacFrame, Received
from wsnsim.models.low_power_listening import ContikiMac
from wsnsim.network.event_log import then
from wsnsim.network.radio.capture import HEADER_BITS
from wsnsim.network.radio.lpl.radios import EXPECTS, NEVER, RECEIVES, ROUNDING, LowPowerRadios
from wsnsim.network.radio.lpl.senders import CopyTrain, FrameCopy, RepeatingSender, Senders, count_try
from wsnsim.network.radio.mac_services import MacPart, NetworkMacServices, control_frame
from wsnsim.network.radio.transmission import OnEnd, Transmission

NONE: Final = (np.zeros(0, dtype=np.int64), np.zeros(0), 0.0)
DETECTED: Final = 0.5
"""An acknowledgement is detected whose preamble and delimiter arrive with at least this probability (our choice)."""
AWAKE_COPIES: Final = 3
"""Copies for a destination that expects the frame (our choice)."""


class ChannelChecks(MacPart):
    """The wake-ups of all nodes that hear something.

        checks.expect(transmission)      its start and end are known: whose assessments fall into it
        checks.wake(transmission)        it has ended: their radios are on
        checks.end(transmission)         those who heard it wait for the next frame, or for silence; or they sleep

    A node whose wake-up hears nothing does nothing. One that hears something keeps the radio on. If its assessment
    began before the frame, it hears all of it; otherwise it waits for the next copy. Fast sleep ends the wait: the
    channel is busy for longer than the longest frame, or silent for longer than the gap between copies, or what follows
    the silence is not for the node.

    Source: Dunkels (2011), SICS T2011:13, section 2.2 and figures 3 and 4.
    """

    def __init__(self, mac: ContikiMac, services: NetworkMacServices, radios: LowPowerRadios) -> None:
        super().__init__(services)
        self._mac = mac
        self._radios = radios
        self._samples = mac.cca, 2.0 * mac.cca + mac.cca_gap
        """When the two assessments of a wake-up end, in s after its beginning."""
        self._awake_from = np.full(self._nodes.size, NEVER)
        """(N,) when an assessment begins that hears a transmission on the air; infinite for none"""
        self._woken: dict[int, tuple[Ints, Floats, float]] = {}
        """{number of a transmission: (n,) nodes whose assessment hears it, (n,) when, and when it began}"""
        self._charged: dict[int, tuple[float, float]] = {}
        """{node whose assessment hears what is still on the air: (until when, for how many s) it has been charged}"""
        self._busy_until: dict[int, float] = {}
        """{node that waits for a frame: when the last transmission ends that it hears}"""
        radios.on_hold = self._end_wake_up

    def hears(self, ids: Ints, since: float) -> Bools:
        """(n,) which radios have been on without a break since a time, and have heard something."""
        return np.asarray(np.minimum(self._awake_from[ids], self._radios.on_since[ids]) <= since + ROUNDING)

    def expect(self, sent: Transmission) -> None:
        """Find the nodes with an assessment during a transmission that has been decided."""
        for node, until in self._busy_until.items():
            if until < sent.end and node in sent.neighbours.sensing:
                self._busy_until[node] = sent.end
        ids, times = self._hit(sent)
        if ids.size:
            self._woken[sent.number] = ids, times, sent.start
            self._awake_from[ids] = times - self._mac.cca

    def _end_wake_up(self, node: int) -> float:
        """A node begins to send in its wake-up, and pays until now. Return since when it is on; infinity: it is off."""
        since = float(self._awake_from[node])
        if since + self._mac.cca > self._env.now:
            return NEVER
        ids, times, start = next(woken for woken in self._woken.values() if node in woken[0])
        _, charged = self._charged.pop(node, (0.0, 0.0))
        self._pay_wake_up(node, since + self._mac.cca, start, charged)
        times[ids == node] = self._awake_from[node] = NEVER
        return since

    def _hit(self, sent: Transmission) -> tuple[Ints, Floats]:
        """(n,) nodes whose assessment ends during a transmission, and (n,) when, in s."""
        neighbours = sent.neighbours
        ids = neighbours.ids if neighbours.senses.all() else neighbours.ids[neighbours.senses]
        if not ids.size:
            return NONE[:2]
        offsets, intervals = self._radios.offsets(ids, sent.start)
        first, second = ((sample - offsets) % intervals for sample in self._samples)
        wait = np.minimum(first, second)
        hit = (wait < sent.end - sent.start) & (self._radios.on_since[ids] == NEVER)
        hit &= self._awake_from[ids] == NEVER
        chosen = np.flatnonzero(hit)
        if chosen.size:
            chosen = chosen[self._nodes.hears(ids[chosen], self._env.now)]
        return ids[chosen], sent.start + wait[chosen]

    def wake(self, sent: Transmission) -> None:
        """A transmission has ended: the radios of nodes that it woke have been on since their assessment began."""
        ids, times, start = self._woken.pop(sent.number, NONE)
        self._awake_from[ids] = NEVER
        self._note_charges(sent)
        for node, time in zip(ids.tolist(), times.tolist(), strict=True):
            _, charged = self._charged.pop(node, (0.0, 0.0))
            if time < sent.end and self._nodes.alive[node] and not self._radios.is_held(node):
                self._pay_wake_up(node, time, start, charged)
                if self._radios.hold(node, EXPECTS, time - self._mac.cca):
                    self._busy_until[node] = self._env.now

    def _note_charges(self, sent: Transmission) -> None:
        """Nodes whose assessment hears a longer transmission have been charged for a frame that ends before it."""
        if sent.listeners is not None and self._woken:
            now = self._env.now
            for node in sent.listeners[self._awake_from[sent.listeners] < now].tolist():
                until, seconds = self._charged.get(node, (-NEVER, 0.0))
                self._charged[node] = now, seconds + now - max(sent.start, until)

    def _pay_wake_up(self, node: int, time: float, start: float, charged: float) -> None:
        """Charge a node for listening since an assessment ended, at a time; after the first one, there is no second.

        A node whose assessment began before the start of the transmission hears all of it, and is charged for that.
        `charged`: s for which it has been charged for other frames meanwhile.
        """
        offsets, _ = self._radios.offsets(np.array([node]), time)
        whole = time - self._mac.cca <= start + ROUNDING
        seconds, starts = start - time if whole else self._env.now - time - charged, 0.0
        if offsets[0] < self._samples[1] - ROUNDING:
            seconds, starts = seconds - self._mac.cca, -1.0
        self._nodes.spend_listening(node, seconds, starts)

    def end(self, sent: Transmission) -> None:
        """What follows a transmission: nodes that it woke wait for the next one; others have heard it, and sleep."""
        waiting = [node for node in self._busy_until if node in sent.neighbours.sensing]
        silent = [node for node in waiting if not self._sleeps(node, sent)]
        if silent:
            then(self._env.timeout(self._mac.frame_gap + self._mac.cca), self._check_silence, silent)

    def _sleeps(self, node: int, sent: Transmission) -> bool:
        """Whether a waiting node turns the radio off at the end of a transmission that it heard."""
        since = float(self._radios.on_since[node])
        whole = since <= sent.start + ROUNDING
        too_long = self._busy_until[node] > self._env.now and self._env.now - since > self._mac.longest
        if whole or too_long or not self._radios.is_held(node, EXPECTS):
            self._let_sleep(node)
            return True
        return False

    def _check_silence(self, nodes: list[int]) -> None:
        """Nodes that have heard nothing for longer than the gap between two copies turn the radio off."""
        for node in nodes:
            if self._busy_until.get(node, NEVER) <= self._env.now:
                self._let_sleep(node)

    def _let_sleep(self, node: int) -> None:
        self._busy_until.pop(node, None)
        self._radios.release(node, EXPECTS)

    def forget(self, node: int) -> None:
        """Note that a node is down."""
        self._busy_until.pop(node, None)
        self._charged.pop(node, None)
        self._awake_from[node] = NEVER


class PhaseLocks:
    """What all senders know.

        locks.learn(node, to, start, period)     an acknowledgement answered the copy that began at `start`
        locks.next(node, to, after) -> s or None when the destination is next expected to have woken

    The destination woke during the copy before the one that it acknowledged. It wakes again after multiples of the
    interval, by its clock; the sender counts them by its own.

    Source: Dunkels (2011), SICS T2011:13, section 2.4, after WiseMAC (El-Hoiydi, Decotignie 2004).
    """

    def __init__(self, services: NetworkMacServices, interval: float) -> None:
        self._clocks = services.clocks
        self._interval = interval
        self._known: dict[tuple[int, int], tuple[float, float]] = {}
        """{(sender, destination): (start of the copy that was acknowledged on the sender's clock, its period)}"""

    def learn(self, node: int, to: int, start: float, period: float) -> None:
        """Note which copy a destination has acknowledged."""
        self._known[node, to] = self._clocks.local_time(node, start), period

    def forget(self, node: int, to: int) -> None:
        """Forget when a destination wakes: it did not answer."""
        self._known.pop((node, to), None)

    def forget_all(self, node: int) -> None:
        """Forget what a node knows: it crashed."""
        self._known = {pair: known for pair, known in self._known.items() if pair[0] != node}

    def next(self, node: int, to: int, now: float, lead: float) -> tuple[float, float] | None:
        """Return between which times (s) a destination wakes next, the first of them at least `lead` after now."""
        known = self._known.get((node, to))
        if known is None:
            return None
        start, period = known
        local = self._clocks.local_time(node, now)
        turns = ceil((local + lead + period - start) / self._interval)
        expected = now + (start + turns * self._interval - local)
        return expected - period, expected


class ContikiMacMechanism(MacPart):
    """ContikiMAC of all nodes on one channel."""

    def __init__(self, mac: ContikiMac, services: NetworkMacServices) -> None:
        super().__init__(services)
        self._mac = mac
        self._radios = radios = LowPowerRadios(services, mac.interval, mac.near or mac.interval)
        self._checks = ChannelChecks(mac, services, radios)
        self._locks = PhaseLocks(services, mac.interval)
        self._ends: dict[int, float] = {}
        """{sender that waits for its destination to wake: when it gives up, in s}"""
        self.channel = services.open_channel(mac, mac.assessment, self._checks)
        self._senders = senders = Senders(mac, services, radios, self.channel, self)
        self._log.code("no_channel")
        self._ack = self._log.code("ack")
        self.send, self.offer, self.find_busy = senders.send, senders.offer, senders.back_off
        self.use_short_interval = radios.use_short_interval

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

    def transmit(self, sender: RepeatingSender) -> None:
        """Begin with the copies of a frame."""
        until = self._ends.pop(sender.node, np.inf)
        sender.train = CopyTrain(self._mac.copies(sender.current.bits), until, wakes=True)
        self._copy(sender)

    def transmit_next(self, sender: RepeatingSender) -> None:
        """Begin with the copies of a frame for a destination that waits for it."""
        sender.train = CopyTrain(AWAKE_COPIES, np.inf, wakes=False)
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
        ack = control_frame(sent.frame, sender.node, mac.ack_bits, self._ack, sender)
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
            count_try(self._services, sender.current, train)
            self._senders.after(sender, self._mac.spacing(sender.current.bits), self._senders.finish_awake)
        elif self._detects(sender.node, sent):
            count_try(self._services, sender.current, train)
            self._senders.fail(sender)

    def _end_without_answer(self, sender: RepeatingSender) -> None:
        """All copies have been sent: that was it for a broadcast; a destination that did not answer is not known."""
        train, frame = sender.train, sender.current
        count_try(self._services, frame, train)
        if frame.to == EVERYONE:
            self._senders.finish(sender, train.received())
        else:
            if train.wakes:
                self._locks.forget(sender.node, frame.to)
            self._senders.fail(sender)
