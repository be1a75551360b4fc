"""TDMA inside clusters, CSMA/CA elsewhere: a cluster head schedules its members, as in LEACH.

When a head expects other members to send, it broadcasts a schedule. A member that receives it knows the slots, and
turns the radio off in those of others. A round has one slot per member, used or not, in the order of the schedule, with
a guard at both ends of each slot, and takes its time even if nobody sends. A member without a slot sends after the
round. One whose clock has drifted by more than the guard misses its slot. With `idle_slots: skipped`,
a round has one slot per frame instead, and the head announces a schedule whenever a sender does not know it. Elections,
announcements, joins, relayed datagrams and handovers belong to no schedule and use CSMA/CA, with acknowledgements and
retransmissions. They keep out of the slots: see `mac_services`.

Source: Heinzelman, Chandrakasan, Balakrishnan (2002), sections III-B and III-C; acknowledgements, guards and contention
periods are ours. LEACH gives each cluster a spreading code of its own; here the slots of two clusters may collide.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np
import simpy

from wsnsim.base.arrays import Ints
from wsnsim.base.frames import EVERYONE, Burst, MacFrame, Received, full_burst
from wsnsim.base.requests import PACKET_BITS, Parcel
from wsnsim.models.access import Tdma
from wsnsim.network.event_log import Acting
from wsnsim.network.radio.csma import CsmaMechanism
from wsnsim.network.radio.mac_services import ContentionPeriods, MacPart, NetworkMacServices, control_frame
from wsnsim.network.radio.transmission import Transmission


@dataclass(slots=True, eq=False)
class _Slot:
    """The slot of one frame.

    Attributes:
        source: The sender.
        frame: The frame.
        received: The result of its last transmission; None before the first.
        acknowledged: Whether the sender received an acknowledgement.
        sent: Fires at the end of its transmission; set when that begins.
    """

    source: int
    frame: MacFrame
    received: Received | None = None
    acknowledged: bool = False
    sent: simpy.Event = field(init=False)


class TdmaMechanism(MacPart):
    """Rounds of slots, one at a time for each cluster head; all other bursts use CSMA/CA."""

    def __init__(self, mac: Tdma, services: NetworkMacServices) -> None:
        super().__init__(services)
        self._mac = mac
        self.keeps_idle_slots = mac.idle_slots == "kept"
        self._periods = ContentionPeriods(self._env)
        self._csma = CsmaMechanism(mac, services, self._periods)
        self._channel = self._csma.channel
        self._schedules: dict[int, dict[int, float]] = {}
        """{head: {member that knows the schedule: how far its clock was ahead of the head's, in s}}"""
        self._orders: dict[int, tuple[int, ...]] = {}
        """{head: the members in the order of the slots of its last schedule}; of kept slots only"""
        self._expected: dict[int, set[int]] = {}
        """{head: nodes for which the next schedule has slots, beside those that have something to send}"""
        self._members: dict[int, set[int]] = {}
        """{head: nodes that it takes for members, once it has said so}"""
        self._contended: dict[int, set[int]] = {}
        """{head: nodes without a slot whose frames arrived since its last schedule}"""
        self._rounds: dict[int, simpy.Event] = {}
        self._ack = self._log.code("ack")
        self.offer = self._csma.offer

    def send(self, bursts: Sequence[Burst], head: int | None = None) -> simpy.Event:
        """Send bursts of a cluster in slots; without a head, or to everyone, by CSMA/CA."""
        empty = not bursts and not self.keeps_idle_slots
        if head is None or empty or any(burst.to == EVERYONE for burst in bursts):
            return self._csma.send(bursts)
        event = self._env.process(self._round(head, bursts, self._rounds.get(head)))
        self._rounds[head] = event
        return event

    def expect(self, head: int, members: Sequence[int]) -> None:
        """Give members slots with the next schedule of their head, before they have something to send."""
        self._members[head] = set(members) - {head}
        self.schedule(head, members)

    def schedule(self, head: int, nodes: Sequence[int]) -> None:
        """Give these nodes slots, and no others.

        Kept slots need no other schedule if the last one has all of them, they are at least half of it, and nobody has
        contended since, as one that missed it does.
        """
        order, contended = self._orders.get(head, ()), self._contended.get(head, set())
        self._expected[head] = contended.union(nodes) - {head}
        if not contended and self._expected[head] <= set(order) and 2 * len(self._expected[head]) >= len(order) > 0:
            del self._expected[head]

    def silence(self, node: int) -> None:
        """Stop a node that died or crashed: it forgets every schedule, and its transmission is cut."""
        for kept in (self._schedules, self._orders, self._expected, self._members, self._contended):
            kept.pop(node, None)
        for schedule in self._schedules.values():
            schedule.pop(node, None)
        self._csma.silence(node)

    def _round(self, head: int, bursts: Sequence[Burst], previous: simpy.Event | None) -> Acting[None]:
        """One round: after the one before, its contention period, and the schedule if another one is needed."""
        if previous is not None and not previous.processed:
            yield previous
        members = {node for burst in bursts for node in (burst.source, burst.to)} - {head}
        if self.keeps_idle_slots:  # the head knows to whom it sends, but not who has something to send
            members = {burst.to for burst in bursts if burst.source == head}
            outdated = head in self._expected or not members <= set(self._orders.get(head, ()))
        else:
            outdated = not members <= self._schedules.get(head, {}).keys()
        if outdated:
            yield from self._announce(head, self._listed(head, members))
        if left := self._periods.left(head, self._mac.contention):
            yield self._env.timeout(left)
        if exchanges := self._periods.close(head):
            yield self._env.timeout(exchanges)
        if self.keeps_idle_slots:
            contending = self._without_slots(head, bursts)
            slotted = [burst for burst in bursts if burst.source not in {each.source for each in contending}]
            yield from self._full_rounds(head, self._slots(head, slotted))
        else:
            knowing = self._schedules.get(head, {}).keys()
            slots = deque(self._slots(head, bursts))
            yield from self._all_slots(slots, np.array(sorted(members & knowing), dtype=np.int64))
        self._periods.reopen(head)
        if not self.keeps_idle_slots:
            return
        if head in self._members and self._members[head] <= set(self._orders.get(head, ())):
            self._env.process(self._contend_late(head, contending))
        else:
            yield from self._contend(head, contending)

    def _without_slots(self, head: int, bursts: Sequence[Burst]) -> list[Burst]:
        """Those of members that have no slot, or did not receive the schedule."""
        known = self._schedules.get(head, {}).keys() & set(self._orders.get(head, ()))
        return [burst for burst in bursts if burst.source != head and burst.source not in known]

    def _contend(self, head: int, bursts: Sequence[Burst]) -> Acting[None]:
        """Have members without a slot send; the head listens for as long as a frame takes, since it knows of none.

        Those whose frames arrive have slots in its next schedule.
        """
        sent = self._csma.send(bursts)
        yield sent & self._env.timeout(self._mac.latency(PACKET_BITS).unicast)
        if arrived := {burst.source for burst in bursts if burst.packets}:
            self._contended.setdefault(head, set()).update(arrived)
            self._expected.setdefault(head, set(self._orders.get(head, ()))).update(arrived)

    def _contend_late(self, head: int, bursts: Sequence[Burst]) -> Acting[None]:
        """Have members without a slot send, for which the head does not wait; it has what arrives after the round."""
        copies = [_late(burst) for burst in bursts]
        yield from self._contend(head, copies)
        for burst, copy in zip(bursts, copies, strict=True):
            burst.heard, burst.heard_at = copy.heard, copy.heard_at

    def _listed(self, head: int, members: set[int]) -> set[int]:
        """Who has a slot in the next schedule.

        Where idle slots are kept, a schedule replaces the last one: it has all members that the head expects, or
        those of the last one and who is new.
        """
        expected = self._expected.pop(head, None)
        earlier = self._orders.get(head, ()) if expected is None else ()
        return members.union(expected or (), earlier)

    def _all_slots(self, slots: deque[_Slot], scheduled: Ints) -> Acting[None]:
        """One slot per frame; a frame without acknowledgement gets another slot at the end."""
        length = self._slot_length([slot.frame for slot in slots])
        while slots:
            slot = slots.popleft()
            yield from self._slot(slot, scheduled, length)
            if self._goes_again(slot):
                slots.append(slot)

    def _full_rounds(self, head: int, slots: Sequence[_Slot]) -> Acting[None]:
        """One slot for each member in the order of the schedule, used or not.

        Frames of the head stand in the slot of their destination. A member has one frame in a round: its next ones, and
        those without an acknowledgement, go into further rounds of the same length.
        """
        order = self._orders.get(head, ())
        length = self._slot_length([slot.frame for slot in slots])
        waiting: dict[int, deque[_Slot]] = {}
        for slot in slots:
            waiting.setdefault(slot.frame.to if slot.source == head else slot.source, deque()).append(slot)
        assert waiting.keys() <= set(order), "who has a slot is in the schedule"
        listens = any(slot.source == head for slot in slots)
        while True:
            for used, members in groupby(order, waiting.__contains__):
                if not used:
                    yield from self._idle_slots(head, tuple(members), length, listens)
                    continue
                for node in members:
                    queue = waiting[node]
                    if self._nodes.alive[queue[0].source]:
                        yield from self._slot(queue[0], self._who_know(head), length)
                    else:
                        yield from self._idle_slots(head, (node,), length, listens)
                    if not self._goes_again(queue[0]):
                        queue.popleft()
            waiting = {node: queue for node, queue in waiting.items() if queue}
            if not waiting:
                return

    def _idle_slots(self, head: int, members: Sequence[int], length: float, listens: bool) -> Acting[None]:
        """Slots of members that have nothing to send: the head listens, the others have the radio off.

        `listens`: whether the head sends in this round, so that those members listen, too.
        """
        knowing = self._who_know(head)
        self._nodes.sleep_radios(knowing[~np.isin(knowing, members)] if listens else knowing, length * len(members))
        yield self._env.timeout(length * len(members))

    def _who_know(self, head: int) -> Ints:
        """(n,) the members that know the schedule and are awake, ascending."""
        known = sorted(self._schedules.get(head, ()))
        return np.array([node for node in known if self._nodes.is_awake(node)], dtype=np.int64)

    def _goes_again(self, slot: _Slot) -> bool:
        """Whether a frame needs another slot, for want of an acknowledgement; otherwise it is finished."""
        frame = slot.frame
        unacknowledged = self._mac.acks and not slot.acknowledged and frame.sends
        if unacknowledged and self._nodes.alive[slot.source] and self._repeats(frame, self._mac.max_retries):
            return True
        frame.finish(slot.received)
        return False

    def _announce(self, head: int, members: set[int]) -> Acting[None]:
        """Broadcast the schedule; the members that receive it set their clocks by it."""
        bits = self._mac.schedule_bits * max(len(members), 1)
        burst = full_burst(head, EVERYONE, Parcel(None, 1, bits, "schedule"), -1)
        yield self._csma.send([burst])
        if self.keeps_idle_slots:
            self._orders[head] = tuple(sorted(members))
            self._contended.pop(head, None)
            self._schedules.pop(head, None)
        schedule = self._schedules.setdefault(head, {})
        for node in members & burst.received.keys():
            if burst.received[node].all():
                schedule[node] = self._clock_offset(head, node)
        neighbours = self._topology.neighbours
        self._periods.inform(head, set().union(*(neighbours(node).id_list for node in [head, *schedule])))

    def _clock_offset(self, head: int, node: int) -> float:
        """By how much a node's clock is ahead of the head's, in s, without the corrections of offset that both know of.

        Slots stay where they are when a clock is put right; a rate that is corrected keeps them there for longer.
        """
        member, reference = self._clocks.error(np.array([node, head]), self._env.now).tolist()
        return float(member - self._clocks.corrected(node) - reference + self._clocks.corrected(head))

    def _slots(self, head: int, bursts: Sequence[Burst]) -> list[_Slot]:
        """The slots of a round. Bursts whose senders do not know their slots, or miss them, are lost."""
        slots = []
        for burst in bursts:
            source = burst.source
            fragments = self._csma.fragmentation.split(burst, lambda: None)
            if not fragments or not self._nodes.alive[source]:
                burst.lose()
            elif (source != head and source not in self._schedules.get(head, {})) or (
                self.keeps_idle_slots and source == head and burst.to not in self._orders.get(head, ())
            ):  # the latter: the head crashed after its schedule and is back, without it
                self._miss(burst, "no_schedule")
            elif source != head and self._is_off(head, source):
                self._miss(burst, "out_of_slot")
                del self._schedules[head][source]
            else:
                slots += [_Slot(source, fragment) for fragment in fragments]
        return slots

    def _is_off(self, head: int, node: int) -> bool:
        """Whether a member's clock has drifted by more than the guard since it received the schedule."""
        return abs(self._clock_offset(head, node) - self._schedules[head][node]) > self._mac.guard

    def _miss(self, burst: Burst, reason: str) -> None:
        self._services.log_drop(burst.source, burst, reason)
        self._counters.frames_lost += 1
        burst.lose()

    def _slot_length(self, frames: Sequence[MacFrame]) -> float:
        """Seconds of a slot: as the scenario says, or as long as the longest frame needs."""
        if self._mac.slot is not None:
            return self._mac.slot
        packet = self._mac.slot_needed(self._mac.bits(PACKET_BITS)) if self.keeps_idle_slots else 0.0
        return max((self._mac.slot_needed(frame.bits) for frame in frames), default=packet)

    def _slot(self, slot: _Slot, scheduled: Ints, length: float) -> Acting[None]:
        """One slot, or several for a frame that is longer; the other members have the radio off."""
        seconds = length * math.ceil(self._mac.slot_needed(slot.frame.bits) / length - 1e-9)
        if not self._nodes.alive[slot.source]:
            return
        others = scheduled[(scheduled != slot.source) & (scheduled != slot.frame.to)]
        self._nodes.sleep_radios(others, seconds)
        before = max(self._mac.guard - self._mac.turnaround, 0.0)
        yield self._env.timeout(before)
        if self._nodes.alive[slot.source] and not self._channel.is_sending(slot.source):
            slot.sent = self._env.event()
            slot.frame.owner = slot
            self._channel.transmit(slot.source, slot.frame, self._sent, others)
            yield slot.sent & self._env.timeout(seconds - before)
        else:
            if self._nodes.alive[slot.source]:  # it sends in the slot of another cluster
                self._services.log_drop(slot.source, slot.frame, "slot_taken")
                self._counters.frames_lost += 1
            yield self._env.timeout(seconds - before)

    def _sent(self, transmission: Transmission, received: Received) -> None:
        frame = transmission.frame
        slot: _Slot = frame.owner
        slot.received = bool(slot.received) or bool(received)
        slot.sent.succeed()
        if received and self._mac.acks and not self._channel.is_sending(frame.to):
            ack = control_frame(frame, transmission.source, self._mac.ack_bits, self._ack, slot)
            self._channel.transmit(frame.to, ack, _acknowledge)


def _late(burst: Burst) -> Burst:
    """The burst of a member for which the head does not wait: a copy, which is sent, while the burst itself is lost.

    The event log calls it late: a tracker does not use what it brings, unless it uses late readings.
    """
    copy = replace(burst, parcel=replace(burst.parcel, what=f"late {burst.parcel.what}"))
    burst.lose()
    return copy


def _acknowledge(transmission: Transmission, received: Received) -> None:
    transmission.frame.owner.acknowledged = bool(received)
