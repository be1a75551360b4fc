"""Reception: which neighbours receive a transmission, lose it to what, or overhear it; each is charged and logged.

    Reception(radio, losses, on, receivers).resolve(transmission) -> Received

A radio that receives a frame pays for it, whether it can use the frame or not. A radio that hears two frames at once
pays for the time once. A radio that sends receives nothing. `resolve` chooses one of four ways to the same result:
`_sort_out` is the general one; the others are faster and serve where no fault disturbs and nobody can die.
"""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.frames import EVERYONE, Received
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.kernels.reception import COLLIDED, FOREIGN, HEARD_OTHER, HIT, LOST, RECEIVED, outcomes, overlap
from wsnsim.network.event_log import EACH, event
from wsnsim.network.radio.capture import CapturingReceivers
from wsnsim.network.radio.topology import RadioServices
from wsnsim.network.radio.transmission import LossSamples, RadiosOn, Transmission

DROP: Final = KIND["drop"]
WHOLE: Final = 1.0
NO_MARKS: Final = np.zeros(0, dtype=np.int64)
NO_TIMES: Final = np.zeros(0)
ALL: Final = np.zeros(0, dtype=np.bool_)
NO_NUMBERS: Final = (0, 0, 0)
Numbers: TypeAlias = tuple[int, int, int]
NONE, RX, OVERHEARD = (EVENT_CAUSE[name] for name in ("none", "rx", "overhear"))
LEDGER: Final = {RX: CAUSE["rx"], OVERHEARD: CAUSE["overhear"]}
RECEIVE, COLLIDE, OVERHEAR = (KIND[name] for name in ("receive", "collide", "overhear"))
KINDS: Final = {RECEIVED: (RECEIVE, RX), COLLIDED: (COLLIDE, RX), FOREIGN: (OVERHEAR, OVERHEARD)}
"""Kind and cause of the events that follow from an outcome."""


class ReceptionCharges:
    """Books receptions in the energy ledger and in the event log."""

    def __init__(self, radio: RadioServices) -> None:
        self._env = radio.env
        self._nodes = radio.nodes
        self._log = radio.log

    def charge(self, sent: Transmission, chosen: Bools, shares: Floats | None, kind: int, cause: int) -> None:
        """Charge and log the chosen neighbours, each for the share of the frame that it listened to; None: whole."""
        ids = sent.neighbours.ids[chosen]
        if not ids.size:
            return
        if shares is None:
            self._charge_group(sent, ids, WHOLE, kind, cause)
            return
        chosen_shares = shares[chosen]
        for share in np.unique(chosen_shares).tolist():
            self._charge_group(sent, ids[chosen_shares == share], share, kind, cause)

    def _charge_group(self, sent: Transmission, ids: Ints, share: float, kind: int, cause: int) -> None:
        """Charge and log different nodes (n,) for the same share of a frame."""
        nodes = self._nodes
        bits, joules, airtime = int(sent.frame.bits * share), sent.costs[2] * share, sent.costs[3] * share
        if bits == 0 or nodes.can_all_receive(ids, joules):
            self.book_group(sent, ids, share, kind, cause)
            return
        for node in ids.tolist():
            paid = nodes.spend_receive(node, joules, bits, LEDGER[cause], airtime)
            alive = nodes.alive[node]
            spent = joules * paid / bits
            self.log_each(sent, kind if alive else DROP, np.array([node]), paid, spent, cause if paid else NONE)

    def book_group(self, sent: Transmission, ids: Ints, share: float, kind: int, cause: int) -> None:
        """Charge and log different nodes (n,) for the same share of a frame, of which none of them can die."""
        bits, joules = int(sent.frame.bits * share), sent.costs[2] * share
        if bits == 0:
            self.log_each(sent, kind, ids, 0, 0.0, NONE)
            return
        self._nodes.receive_all(ids, joules, LEDGER[cause], sent.costs[3] * share)
        self.log_each(sent, kind, ids, bits, joules, cause)

    def log_each(self, sent: Transmission, kind: int, ids: Ints, bits: int, joules: float, cause: int) -> None:
        """Log the same event at each of different nodes (n,)."""
        frame = sent.frame
        self._log.add_all(
            event(self._env.now, self._log.step, frame.target, EACH, kind, frame.code, sent.number, frame.sequence,
                  sent.source, frame.packets, bits, joules, cause),
            ids,
        )  # fmt: skip


class Reception:
    """What transmissions do at the neighbours of their senders, whose radios may be `on`.

    `receivers` know which frame each receiver is locked on, where frames are captured; elsewhere they are None.
    """

    def __init__(
        self, radio: RadioServices, losses: LossSamples, on: RadiosOn, receivers: CapturingReceivers | None = None
    ) -> None:
        self._nodes = radio.nodes
        self._log = radio.log
        self._charges = ReceptionCharges(radio)
        self._topology = radio.topology
        self._on = on
        self._receivers = receivers
        self._counters = radio.counters
        self._key, self._uses = losses
        self._key_of_all = np.uint64(losses.key)
        self._groups = np.empty((0, 4))

    def resolve(self, sent: Transmission) -> Received:
        """Return the result of a frame that was sent completely."""
        nodes, ids = self._nodes, sent.neighbours.ids
        listening = self._on.hears(ids, sent.start)
        if self._receivers is not None:
            self._receivers.lock_started()
        if nodes.disturbed or not nodes.can_all_receive(ids, sent.costs[2]):
            return self._sort_out(sent, listening)
        if sent.frame.to == EVERYONE and self._topology.distance_only and (listening is None or listening.all()):
            return self._broadcast_alone(sent) if sent.overlapping is None else self._broadcast_overlapped(sent)
        return self._in_one_pass(sent, listening)

    def _in_one_pass(self, sent: Transmission, listening: Bools | None) -> Received:
        """The result of a frame that no fault disturbs and of which nobody can die: that of `_sort_out`."""
        nodes, ids, frame = self._nodes, sent.neighbours.ids, sent.frame
        hears, everyone = ALL if listening is None else listening, frame.to == EVERYONE
        if sent.asleep is not None:
            hears = ~np.isin(ids, sent.asleep) & (True if listening is None else listening)
        marks, until = self._marks(sent)
        thresholds, usable, numbers = self._chances(sent)
        order = np.empty(ids.size, dtype=np.int64)
        if len(self._groups) < ids.size:
            self._groups = np.empty((2 * ids.size, 4))
        count, in_range, delivered = outcomes(
            self._key_of_all, numbers, ids, thresholds, usable, hears, marks, until, frame.to, order, self._groups
        )
        received, collided, paying = 0, 0, 0
        for outcome, begin, end, paid_until in self._groups[:count].tolist():
            group = order[int(begin) : int(end)]
            if outcome == LOST:
                self._charges.log_each(sent, DROP, group, 0, 0.0, NONE)
                continue
            share = WHOLE if sent.overlapping is None else (sent.end - paid_until) / (sent.end - sent.start)
            self._charges.book_group(sent, group, share, *KINDS[outcome])
            paying = int(end)  # the kernel puts those who lost the frame and pay nothing last
            received += group.size if outcome == RECEIVED else 0
            collided += group.size if outcome == COLLIDED else 0
        self._count(sent, in_range if everyone or nodes.alive[frame.to] else 0, delivered, collided)
        self._on.note(sent, order[:paying])
        if received == ids.size or not everyone:
            return ids if everyone else bool(received)
        return order[:received] if sent.overlapping is None else np.sort(order[:received])

    def _marks(self, sent: Transmission) -> tuple[Ints, Floats]:
        """What overlapping frames do at each neighbour (see `kernels.reception.overlap`); empty if there are none."""
        if sent.overlapping is None:
            return NO_MARKS, NO_TIMES
        ids, until = sent.neighbours.ids, np.empty(sent.neighbours.ids.size)
        until.fill(sent.start)
        if self._receivers is None:
            marks, mark = np.zeros(ids.size, dtype=np.int64), HIT
        else:
            marks, mark = np.where(self._receivers.locked(sent), 0, HIT), HEARD_OTHER
        for other in sent.overlapping:
            if other.end > max(other.start, sent.start):
                paid = self._on.paid_until(other, sent)
                if other.listeners is not None:
                    overlap(ids, other.listeners, other.source, mark, paid, sent.end, marks, until)
                    paid = sent.start
                overlap(ids, other.neighbours.ids, other.source, mark, paid, sent.end, marks, until)
        return marks, until

    def _chances(self, sent: Transmission) -> tuple[Floats, Bools, Numbers]:
        """(thresholds, usable, numbers) of a frame, as `kernels.reception.outcomes` takes them."""
        if self._topology.distance_only:
            return NO_TIMES, ALL, NO_NUMBERS
        thresholds, usable = self._topology.thresholds(sent.neighbours, sent.frame.bits, sent.start)
        if self._receivers is not None and sent.overlapping:
            thresholds = 1.0 - self._receivers.probabilities(sent)
        return thresholds, usable, self._numbers(sent.source)

    def _numbers(self, source: int) -> Numbers:
        """What the key of a frame is derived with: its sender, the step, and its number in the step."""
        step = self._log.step
        return source, step, self._uses.next(source, step)

    def _broadcast_alone(self, sent: Transmission) -> Received:
        """The result of an undisturbed broadcast: all neighbours receive it."""
        ids = sent.neighbours.ids
        if ids.size:
            self._charges.book_group(sent, ids, WHOLE, RECEIVE, RX)
        self._count(sent, ids.size, ids.size, 0)
        self._on.note(sent, ids)
        return ids

    def _broadcast_overlapped(self, sent: Transmission) -> Received:
        """The result of a broadcast that overlaps others, if distance alone decides; events are in another order."""
        neighbours = sent.neighbours
        collided = self._collided_until(sent)
        self._count(sent, len(neighbours.id_list), len(neighbours.id_list) - len(collided), len(collided))
        groups: dict[float, list[int]] = {}
        airtime = sent.end - sent.start
        for node, until in collided.items():
            groups.setdefault((sent.end - until) / airtime, []).append(node)
        for share, group in groups.items():
            self._charges.book_group(sent, np.array(group), share, COLLIDE, RX)
        received = neighbours.ids
        if collided:
            received = np.array([node for node in neighbours.id_list if node not in collided], dtype=np.int64)
        if received.size:
            self._charges.book_group(sent, received, WHOLE, RECEIVE, RX)
        self._on.note(sent, neighbours.ids)
        return received

    def _collided_until(self, sent: Transmission) -> dict[int, float]:
        """The neighbours that lose the frame to another one: {node: time until which it pays for that one}."""
        collided: dict[int, float] = {}
        for other in sent.overlapping or ():
            if other.end <= max(other.start, sent.start):
                continue
            members, sender = other.neighbours.members, other.source
            until = self._on.paid_until(other, sent)
            payers = members if other.listeners is None else set(other.listeners.tolist())
            for node in sent.neighbours.id_list:
                if node in members:
                    collided[node] = max(collided.get(node, sent.start), until if node in payers else sent.start)
                elif node == sender:
                    collided[node] = sent.end
        return collided

    def _sort_out(self, sent: Transmission, listening: Bools | None) -> Received:
        """The result of any frame. `listening` (n,): which neighbours are awake; None: all.

        A broadcast is meant for the neighbours that are awake: those asleep do not count as missed.
        """
        nodes, neighbours, frame = self._nodes, sent.neighbours, sent.frame
        ids, everyone = neighbours.ids, frame.to == EVERYONE
        hears = nodes.living[ids] if listening is None else listening
        if sent.asleep is not None:
            hears = hears & ~np.isin(ids, sent.asleep)
        quiet = sent.overlapping is None and not nodes.disturbed
        hit, overlapped, share = (None, None, None) if quiet else self._disturbances(sent)
        arrived = hears if hit is None else hears & ~hit
        reliable = self._topology.reliable(neighbours, frame.bits)
        if not self._topology.distance_only or nodes.disturbed:
            arrived = arrived & self._survives(sent)
        collided: Any = np.False_
        if hit is not None and overlapped is not None:
            collided = hears & ~arrived & (hit | overlapped) & reliable
        meant = reliable if everyone else ids == frame.to
        got = arrived if everyone else arrived & meant
        self._charges.charge(sent, got, share, RECEIVE, RX)
        if not quiet:
            self._charges.charge(sent, collided & meant, share, COLLIDE, RX)
        if not everyone:
            self._charges.charge(sent, (arrived | collided) & ~meant, share, OVERHEAR, OVERHEARD)
        living = nodes.living[ids]
        self._on.note(sent, ids[(arrived | collided) & living])
        if everyone and listening is not None:
            meant = meant & listening
        lost = meant & ~(arrived | collided)
        if everyone:
            lost &= living
        if lost.any():
            self._charges.log_each(sent, DROP, ids[lost], 0, 0.0, NONE)
        got &= living
        meant = meant & living
        self._count(sent, int(meant.sum()), int((got & meant).sum()), int((collided & meant).sum()))
        return ids[got] if everyone else bool(got.any())

    def _count(self, sent: Transmission, in_range: int, delivered: int, collided: int) -> None:
        """Count the receptions of a frame."""
        sent.missed = delivered < in_range
        if sent.frame.packets and not sent.frame.is_copy:
            self._counters.in_range += in_range
            self._counters.delivered += delivered
            self._counters.collided += collided

    def _disturbances(self, sent: Transmission) -> tuple[Bools, Bools, Floats]:
        """What overlapping transmissions and faults do at each neighbour, as three arrays (n,).

        hit: the frame is lost. overlapped: another frame was heard meanwhile. share: the part of the airtime that the
        radio has not paid for yet; 0 if it was sending itself.
        """
        nodes, neighbours, receivers = self._nodes, sent.neighbours, self._receivers
        ids = neighbours.ids
        hit, overlapped = np.zeros(ids.size, dtype=np.bool_), np.zeros(ids.size, dtype=np.bool_)
        paid_until = np.full(ids.size, sent.start)
        for other in sent.overlapping or ():
            if other.end <= max(other.start, sent.start):
                continue
            here, _ = neighbours.common(other.neighbours)
            overlapped[here] = True
            if other.listeners is not None:
                here = here[np.isin(ids[here], other.listeners)]
            paid_until[here] = np.maximum(paid_until[here], self._on.paid_until(other, sent))
            at = neighbours.index(other.source)
            if at >= 0:
                hit[at], paid_until[at] = True, sent.end
        if receivers is None:
            hit |= overlapped
        elif sent.overlapping:
            hit |= ~receivers.locked(sent)
        if nodes.disturbed:
            hit |= nodes.jammed[ids] | nodes.jammed[sent.source]
        return hit, overlapped, (sent.end - paid_until) / (sent.end - sent.start)

    def _survives(self, sent: Transmission) -> Bools:
        """(n,) sample at which neighbours the frame arrives in spite of noise and interference."""
        nodes, neighbours, bits = self._nodes, sent.neighbours, sent.frame.bits
        if self._receivers is not None and sent.overlapping:
            probabilities = self._receivers.probabilities(sent)
        else:
            probabilities = self._topology.momentary(neighbours, bits, sent.start)
        if nodes.disturbed:
            probabilities = probabilities * (1.0 - nodes.loss[sent.source]) * (1.0 - nodes.loss[neighbours.ids])
        samples = uniforms(derive_all(derive(self._key, *self._numbers(sent.source)), neighbours.ids), 0)
        return np.asarray(samples >= 1.0 - probabilities)
