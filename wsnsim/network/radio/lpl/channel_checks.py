"""The wake-ups of ContikiMAC: which channel checks hear a transmission, and when the nodes turn the radio off again.

    checks.expect(transmission)      its start and end are known: whose assessments fall into it
    checks.wake(transmission)        it has ended: their radios are on
    checks.end(transmission)         those who heard it wait for the next frame, or for silence; or they sleep

A node whose wake-up hears nothing does nothing. One that hears something keeps the radio on. If its assessment began
before the frame, it hears all of it; otherwise it waits for the next copy. Fast sleep ends the wait: the channel is
busy for longer than the longest frame, or silent for longer than the gap between copies, or what follows the silence is
not for the node.

Source: Dunkels (2011), "The ContikiMAC radio duty cycling protocol", SICS T2011:13, section 2.2 and figures 3 and 4.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.medium_access import RepeatingMac
from wsnsim.network.radio.lpl.radios import EXPECTS, NEVER, ROUNDING, LowPowerRadios
from wsnsim.network.radio.mac_services import NetworkMacServices
from wsnsim.network.radio.transmission import Transmission

NONE: Final = (np.zeros(0, dtype=np.int64), np.zeros(0), 0.0)


class ChannelChecks:
    """The wake-ups of all nodes that hear something."""

    def __init__(self, mac: RepeatingMac, services: NetworkMacServices, radios: LowPowerRadios) -> None:
        self._mac = mac
        self._env = services.radio.env
        self._nodes = services.radio.nodes
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
        return np.asarray(np.minimum(self._awake_from[ids], self._radios.on_since(ids)) <= since + ROUNDING)

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
        """A node that hears a transmission in its wake-up begins to send: it pays until now; since when it has been on.

        Infinity if its radio is off.
        """
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
        hit = (wait < sent.end - sent.start) & (self._radios.on_since(ids) == NEVER)
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
            wait = self._mac.frame_gap + self._mac.cca
            self._env.timeout(wait, silent).callbacks.append(self._check_silence)

    def _sleeps(self, node: int, sent: Transmission) -> bool:
        """Whether a waiting node turns the radio off at the end of a transmission that it heard."""
        since = float(self._radios.on_since(np.array([node]))[0])
        whole = since <= sent.start + ROUNDING
        too_long = self._busy_until[node] > self._env.now and self._env.now - since > self._mac.longest
        if whole or too_long or not self._radios.is_held(node, EXPECTS):
            self._let_sleep(node)
            return True
        return False

    def _check_silence(self, timeout: simpy.Event) -> None:
        """Nodes that have heard nothing for longer than the gap between two copies turn the radio off."""
        nodes: Any = timeout.value
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
