"""How nodes ahead of a target are woken: messages on the radio, and calls on the wake-up radio. Paid for, and logged.

    waker.start(track, node, message) -> Waking      what came of it is noted there while the clock goes on

What a node does about a message is the wake-up protocol's pure rule; here it is done. A call on the wake-up radio
reaches whoever sleeps within the radio's reach, undisturbed by anything else (our choice: a channel of its own), and
carries the message. A node knows which of its neighbours sleep, and hears whom the others call (our choice).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import simpy

from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.sleeping import Decision, WakeUpMessage
from wsnsim.base.tables import EVENT_CAUSE, KIND
from wsnsim.network.clusters.track import Track
from wsnsim.network.event_log import event
from wsnsim.network.run_context import RunContext

CALL, CALLED, DROP = KIND["call"], KIND["called"], KIND["drop"]
NONE, TX, RX = EVENT_CAUSE["none"], EVENT_CAUSE["tx"], EVENT_CAUSE["rx"]
WORDS = {"flood": "track", "region": "announce", "invite": "invitation"}
"""What the log calls the message of each mechanism."""


@dataclass(slots=True)
class WakeUpRound:
    """One message that wakes nodes for a step, and what came of it.

    `tracking`: who tracks for that step, with the copy that it heeded. `asleep`: who slept in the region when it was
    sent, and has not been called since; `hailed`: who has been; `rung`: whom the call reached. `sequence`: the number
    of its frames.
    """

    message: WakeUpMessage
    node: int
    time: float
    foreseen: bool
    tracking: dict[int, WakeUpMessage] = field(default_factory=dict)
    asleep: set[int] = field(default_factory=set)
    hailed: set[int] = field(default_factory=set)
    rung: set[int] = field(default_factory=set)
    sequence: int = 0
    forwards: int = 0
    called: int = 0
    expired: int = 0
    dismissed: int = 0
    woken: int = 0
    ineffective: int = 0


class WakeUpService:
    """The wake-up protocol of a run.

    `watch(node, target, until, why)` keeps a node awake; `relax(node, target)` lets it go. `key`: of nodes' draws.
    """

    def __init__(
        self,
        stage: RunContext,
        key: int,
        watch: Callable[[int, int, float, str], None],
        relax: Callable[[int, int], None],
    ) -> None:
        self._stage = stage
        self._key = key
        self._watch = watch
        self._relax = relax
        self._protocol = stage.parts.wakeup
        self._seen: dict[tuple[int, int, int], float] = {}
        rate = getattr(stage.parts.mac, "rate", None)
        self._call_bits = None if rate is None else max(1, round(rate * self._protocol.call))
        self.sequence = 0

    def start(self, track: Track, node: int, message: WakeUpMessage, foreseen: bool) -> WakeUpRound:
        """Send a message on its way; it goes on by itself."""
        waking = WakeUpRound(message, node, self._stage.env.now, foreseen)
        track.waking = waking
        track.wakings.append(waking)
        self._forget()
        waking.asleep = self._sleepers(node, message)
        if self._protocol.mechanism == "invite":
            self._track(waking, node, message)
            self._call(waking, node, message, lambda: self._broadcast(waking, node, message))
        else:
            self._heed(waking, node, message)
            self._broadcast(waking, node, message)
        return waking

    def rouse(self, node: int, to: int, target: int) -> simpy.Event:
        """Call one sleeping neighbour; the event fires when it is awake."""
        done = self._stage.env.event()

        def awake(_: Sequence[int]) -> None:
            done.succeed()

        self._ring(node, [to], target, PACKET_BITS, awake)
        return done

    def _broadcast(self, waking: WakeUpRound, node: int, message: WakeUpMessage, relayed: bool = False) -> None:
        """One copy on the air; whoever hears it heeds it."""
        stage = self._stage
        if not stage.fleet.alive[node]:
            return
        copy = replace(message, sender=node, place=(stage.fleet.x[node], stage.fleet.y[node]))
        parcel = Parcel(copy, 1, copy.bits, WORDS[self._protocol.mechanism])
        event, (frame,) = stage.air.broadcast([node], [parcel], copy.target, waking.sequence if relayed else 0, relayed)

        def heard(_: Any) -> None:
            waking.sequence = waking.sequence or frame.sequence
            waking.forwards += relayed and frame.sent > 0
            for listener in sorted(frame.received):
                self._heed(waking, listener, copy)

        assert event.callbacks is not None
        event.callbacks.append(heard)

    def _heed(self, waking: WakeUpRound, node: int, message: WakeUpMessage) -> None:
        """What a node does about a copy of the message that has reached it: the first copy decides."""
        stage = self._stage
        if not stage.fleet.alive[node]:
            return
        place = stage.fleet.x[node], stage.fleet.y[node]
        known = (node, message.target, message.sequence)
        decision = self._protocol.decide(
            place, message, known in self._seen, stage.env.now, self._chance(node, message)
        )
        if decision is Decision.DROP:
            waking.expired += 1
            self._log(DROP, node, message.target, "expired", message.sender, waking.sequence)
            return
        self._seen[known] = message.expires
        if decision is Decision.TRACK:
            self._track(waking, node, message)
            if self._protocol.mechanism != "invite":
                self._call(waking, node, message)
        elif decision is Decision.FORWARD:
            self._broadcast(waking, node, message, relayed=True)
        elif node in waking.hailed and node not in waking.tracking:
            self._relax(node, message.target)

    def _track(self, waking: WakeUpRound, node: int, message: WakeUpMessage) -> None:
        waking.tracking[node] = message
        self._watch(node, message.target, message.due + self._protocol.wait, "frame")

    def _sleepers(self, node: int, message: WakeUpMessage) -> set[int]:
        """Who sleeps in the message's region; where all neighbours are invited, which of them do."""
        stage, fleet = self._stage, self._stage.fleet
        if not fleet.follows_schedules:
            return set()
        if self._protocol.mechanism == "invite":
            ids = stage.air.neighbours(node).ids
        else:
            ids = np.array(fleet.tree.query_ball_point(message.centre, message.radius), dtype=np.int64)
        asleep = fleet.living[ids] & ~fleet.hears(ids, stage.env.now)
        return set(ids[asleep].tolist())

    def _call(
        self, waking: WakeUpRound, node: int, message: WakeUpMessage, then: Callable[[], None] | None = None
    ) -> None:
        """A node calls its neighbours that sleep in the region, together; they heed the message. `then` follows."""
        sleepers = waking.asleep & self._stage.air.neighbours(node).members if waking.asleep else set()
        waking.asleep -= sleepers
        waking.hailed |= sleepers

        def awake(woken: Sequence[int]) -> None:
            waking.called += len(woken)
            waking.rung.update(woken)
            for one in woken:
                if self._protocol.mechanism != "invite":
                    self._heed(waking, one, replace(message, sender=node))
            if then is not None:
                then()

        if sleepers:
            self._ring(node, sorted(sleepers), message.target, message.bits, awake)
        elif then is not None:
            then()

    def _ring(
        self, node: int, sleepers: Sequence[int], target: int, bits: int, awake: Callable[[Sequence[int]], None]
    ) -> None:
        """A call on the wake-up radio: both ends pay for its time, and who was called is awake at its end."""
        stage = self._stage
        event = stage.env.timeout(self._protocol.call)
        assert event.callbacks is not None
        event.callbacks.append(lambda _: awake(self._rung(node, sleepers, target, self._call_bits or bits)))

    def _rung(self, node: int, sleepers: Iterable[int], target: int, bits: int) -> list[int]:
        stage, fleet, energy = self._stage, self._stage.fleet, self._stage.parts.energy
        if not fleet.alive[node]:
            return []
        electronics, amplifier = energy.transmit(bits, fleet.reach)
        sent = fleet.spend_transmit(node, electronics, amplifier, bits, self._protocol.call)
        joules = (electronics + amplifier) * sent / bits
        self._log(CALL, node, target, "", -1, 0, sent, joules, TX)
        woken = []
        for one in sleepers if sent == bits else ():
            if not fleet.alive[one]:
                continue
            cost = energy.receive(bits)
            paid = fleet.spend_receive(one, cost, bits)
            self._log(CALLED, one, target, "", node, 0, paid, cost * paid / bits, RX)
            if fleet.alive[one]:
                self._watch(one, target, stage.env.now + self._protocol.wait, "call")
                woken.append(one)
        return woken

    def _chance(self, node: int, message: WakeUpMessage) -> float:
        """A node's uniform draw for a message, on [0, 1), where anything is decided by chance."""
        if self._protocol.mechanism != "invite":
            return 0.0
        key = derive(self._key, message.target, message.step)
        return float(uniforms(derive_all(key, np.array([node])), 0)[0])

    def _forget(self) -> None:
        """Messages that have expired need not be known any more: their sequence number may come again."""
        now = self._stage.env.now
        if self._seen and min(self._seen.values()) < now:
            self._seen = {known: expires for known, expires in self._seen.items() if expires >= now}

    def _log(
        self, kind: int, node: int, target: int, what: str, peer: int, sequence: int, bits: int = 0,
        joules: float = 0.0, cause: int = NONE,
    ) -> None:  # fmt: skip
        stage = self._stage
        code, packets = stage.journal.code(what), int(bits > 0)
        now, step = stage.env.now, stage.step
        stage.journal.add(event(now, step, target, node, kind, code, 0, sequence, peer, packets, bits, joules, cause))
