"""Slots inside a cluster, contention outside: the head schedules its members, as in LEACH.

Where a head's members change, it broadcasts a schedule; who hears it knows its slots, and everybody else of the
cluster has the radio off in them. A round is one slot a frame, in the order of the schedule, with a guard at either
end; a member whose clock has drifted by more than the guard since it heard the schedule misses its slot. What no
cluster's head arranges (elections, announcements, relays, handovers) contends as in `csma`.

Source: Heinzelman, Chandrakasan, Balakrishnan (2002), sections III-B and III-C; acknowledgements and guards are ours.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Sequence
from typing import Any

import numpy as np
import simpy

from wsnsim.base.arrays import Ints
from wsnsim.base.radio import SlottedMac
from wsnsim.base.requests import Parcel
from wsnsim.base.tables import KIND
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.channel import Channel
from wsnsim.network.radio.counters import Counters
from wsnsim.network.radio.csma import CsmaMechanism, nothing_arrives
from wsnsim.network.radio.fragmentation import Fragment, Fragmentation
from wsnsim.network.radio.ideal_medium import EVERYONE, Burst, burst
from wsnsim.network.radio.transmission import Heard, MacFrame, Transmission

DROP, SEND = KIND["drop"], KIND["send"]
Round = Generator[simpy.Event, Any, None]


class _Slot:
    """One frame's turn: `heard` once it has landed, `acknowledged` once its sender knows."""

    __slots__ = ("acknowledged", "heard", "landed", "piece", "source")

    def __init__(self, source: int, piece: Fragment) -> None:
        self.source = source
        self.piece = piece
        self.heard: Heard | None = None
        self.acknowledged = False
        self.landed: Any = None


class TdmaMechanism:
    """Rounds of slots, one head at a time; everything else is handed on to `contending`."""

    def __init__(
        self, env: simpy.Environment, fleet: Nodes, channel: Channel, contending: CsmaMechanism, bursts: Fragmentation,
        journal: EventLog, part: SlottedMac, clocks: Clocks,
    ) -> None:  # fmt: skip
        self._env = env
        self._fleet = fleet
        self._channel = channel
        self._contending = contending
        self._bursts = bursts
        self._journal = journal
        self._part = part
        self._clocks = clocks
        self._known: dict[int, dict[int, float]] = {}
        self._rounds: dict[int, simpy.Event] = {}
        self._ack = journal.code("ack")
        self.counts: Counters = channel.counts
        self.offer = contending.offer
        self.count_links = contending.count_links
        self.link_rows = contending.link_rows

    def send(self, frames: Sequence[Burst], hub: int | None = None) -> simpy.Event:
        """Bursts of a cluster, in slots; without a `hub`, or to everyone, by contention."""
        if hub is None or not frames or any(frame.to == EVERYONE for frame in frames):
            return self._contending.send(frames)
        event = self._env.process(self._round(hub, frames, self._rounds.get(hub)))
        self._rounds[hub] = event
        return event

    def silence(self, node: int) -> None:
        """A node is dead or down: it knows no schedule any more, and what it was sending is cut short."""
        self._known.pop(node, None)
        for known in self._known.values():
            known.pop(node, None)
        self._contending.silence(node)

    def _round(self, hub: int, frames: Sequence[Burst], before: simpy.Event | None) -> Round:
        """One slot a frame; what was not acknowledged has another slot at the end."""
        if before is not None and not before.processed:
            yield before
        members = {node for frame in frames for node in (frame.source, frame.to)} - {hub}
        if not members <= self._known.get(hub, {}).keys():
            yield from self._announce(hub, members)
        turns = deque(self._turns(hub, frames))
        asleep = np.array(sorted(members & self._known[hub].keys()), dtype=np.int64)
        length = self._length([turn.piece for turn in turns])
        while turns:
            turn = turns.popleft()
            yield from self._slot(turn, asleep, length)
            piece = turn.piece
            again = self._part.acks and not turn.acknowledged and piece.sends and piece.retries < self._part.max_retries
            if again and self._fleet.alive[turn.source]:
                piece.retries += 1
                self.counts.retries += 1
                turns.append(turn)
            else:
                piece.done(turn.heard)

    def _announce(self, hub: int, members: set[int]) -> Round:
        """Broadcast who has which slot; those who hear it set their clocks by it."""
        bits = self._part.schedule_bits * max(len(members), 1)
        frame = burst(hub, EVERYONE, Parcel(None, 1, bits, "schedule"), -1)
        yield self._contending.send([frame])
        known = self._known.setdefault(hub, {})
        for node in members & frame.heard.keys():
            if frame.heard[node].all():
                known[node] = self._ahead(hub, node)

    def _ahead(self, hub: int, node: int) -> float:
        """By how much a node's clock is ahead of the head's, in s."""
        member, head = self._clocks.error(np.array([node, hub]), self._env.now).tolist()
        return float(member - head)

    def _turns(self, hub: int, frames: Sequence[Burst]) -> list[_Slot]:
        turns = []
        for frame in frames:
            pieces = self._bursts.cut(frame, _ended)
            if not pieces or not self._fleet.alive[frame.source]:
                nothing_arrives(frame)
            elif frame.source != hub and frame.source not in self._known.get(hub, {}):
                self._miss(frame, "no_schedule")
            elif frame.source != hub and self._is_late(hub, frame.source):
                self._miss(frame, "out_of_slot")
                del self._known[hub][frame.source]
            else:
                turns += [_Slot(frame.source, piece) for piece in pieces]
        return turns

    def _is_late(self, hub: int, node: int) -> bool:
        return abs(self._ahead(hub, node) - self._known[hub][node]) > self._part.guard

    def _miss(self, frame: Burst, why: str) -> None:
        """A member that does not know its slot, or misses it, sends nothing that the head could hear."""
        self._journal.add(
            event(
                self._env.now, self._journal.step, frame.target, frame.source, DROP, self._journal.code(why),
                sequence=frame.sequence, peer=frame.to, packets=frame.packets,
            )
        )  # fmt: skip
        self.counts.frames_lost += 1
        nothing_arrives(frame)

    def _length(self, pieces: Sequence[Fragment]) -> float:
        """Seconds of a slot: as the scenario says, or as the longest frame needs."""
        if self._part.slot is not None:
            return self._part.slot
        return max((self._part.slot_needed(piece.bits) for piece in pieces), default=0.0)

    def _slot(self, turn: _Slot, cluster: Ints, length: float) -> Round:
        """One turn; a frame that is longer than a slot takes several."""
        seconds = length * math.ceil(self._part.slot_needed(turn.piece.bits) / length - 1e-9)
        if not self._fleet.alive[turn.source]:
            return
        others = cluster[(cluster != turn.source) & (cluster != turn.piece.to)]
        self._fleet.sleep_radios(others, seconds)
        before = max(self._part.guard - self._part.turnaround, 0.0)
        yield self._env.timeout(before)
        if self._fleet.alive[turn.source] and not self._channel.is_sending(turn.source):
            turn.landed = self._env.event()
            self._channel.transmit(turn.source, turn.piece, turn, self._landed, others)
            yield turn.landed & self._env.timeout(seconds - before)
        else:
            yield self._env.timeout(seconds - before)

    def _landed(self, one: Transmission, heard: Heard) -> None:
        turn: _Slot = one.owner
        counts = self.counts
        counts.frames_sent += 1
        counts.packets_sent += one.message.packets
        counts.frames_lost += not heard
        one.message.sends += 1
        turn.heard = bool(turn.heard) or bool(heard)
        turn.landed.succeed()
        if heard and self._part.acks and not self._channel.is_sending(one.message.to):
            ack = MacFrame(
                one.source, self._part.ack_bits, 0, one.message.target, self._ack, SEND, one.message.sequence
            )
            self._channel.transmit(one.message.to, ack, turn, _acknowledged)


def _acknowledged(one: Transmission, heard: Heard) -> None:
    one.owner.acknowledged = bool(heard)


def _ended() -> None:
    """A burst is done when its round is."""
