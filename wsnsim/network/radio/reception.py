"""Reception: which neighbours receive a transmission, lose it to what, or overhear it; each is charged and logged.

    Reception(radio, losses, on, receivers).resolve(transmission) -> Received

A radio that receives a frame pays for it, whether it can use the frame or not. A radio that hears two frames at once
pays for the time once. A radio that sends receives nothing.
"""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.frames import EVERYONE, Received
from wsnsim.base.tables import CAUSE, EVENT_CAUSE, KIND
from wsnsim.kernels.reception import COLLIDED, FOREIGN, HEARD_OTHER, HIT, LOST, RECEIVED, outcomes, overlap
from wsnsim.network.event_log import EACH, event
from wsnsim.network.radio.capture import CapturingReceivers
from wsnsim.network.radio.topology import RadioServices
from wsnsim.network.radio.transmission import RadiosOn, Transmission, UseCounter

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


class Reception:
    """What transmissions do at the neighbours of their senders, whose radios may be `on`.

    `receivers` know which frame each receiver is locked on, where frames are captured; elsewhere they are None.
    """

    def __init__(
        self, radio: RadioServices, losses: UseCounter, on: RadiosOn, receivers: CapturingReceivers | None = None
    ) -> None:
        self._env, self._nodes, self._topology, _, self._log, self._counters = radio
        self._on = on
        self._receivers = receivers
        self._uses = losses
        self._key = np.uint64(losses.key)
        self._groups = np.empty((0, 4))

    def resolve(self, sent: Transmission) -> Received:
        """Return the result of a frame that was sent completely.

        A broadcast is meant for the neighbours that are awake: those asleep do not count as missed.
        """
        nodes, ids = self._nodes, sent.neighbours.ids
        listening = self._on.hears(ids, sent.start)
        if self._receivers is not None:
            self._receivers.lock_started()
        lasting = nodes.can_all_receive(ids, sent.costs[2])
        undisturbed = lasting and not nodes.disturbed and sent.frame.to == EVERYONE and self._topology.distance_only
        if undisturbed and (listening is None or listening.all()):
            return self._broadcast(sent)
        return self._sort_out(sent, listening, lasting)

    def _sort_out(self, sent: Transmission, listening: Bools | None, lasting: bool) -> Received:
        """The result of any frame: `listening` (n,) neighbours, None for all; `lasting`: none of them can die of it."""
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
            self._key, numbers, ids, thresholds, usable, hears, marks, until, frame.to, order, self._groups
        )
        received, collided, paying = self._book(sent, order, self._groups[:count].tolist(), lasting)
        if not lasting:
            living = nodes.living[order[:paying]]
            died = ~living & self._is_meant(order[:paying], sent, usable)
            in_range -= int(died.sum())
            delivered -= int(died[:received].sum())
            collided -= int(died[received : received + collided].sum())
            received, paying = int(living[:received].sum()), int(living.sum())
            order = np.concatenate([order[: living.size][living], order[living.size :]])
        self._count(sent, in_range if everyone or nodes.alive[frame.to] else 0, delivered, collided)
        self._on.note(sent, order[:paying])
        if received == ids.size or not everyone:
            return ids if everyone else bool(received)
        return order[:received] if sent.overlapping is None else np.sort(order[:received])

    def _book(self, sent: Transmission, order: Ints, groups: list[list[Any]], lasting: bool) -> tuple[int, int, int]:
        """Charge and log groups of neighbours; how many received the frame, lost it to another one, and paid."""
        received, collided, paying = 0, 0, 0
        for outcome, begin, end, paid_until in groups:
            group = order[int(begin) : int(end)]
            if outcome == LOST:
                self._log_each(sent, DROP, group, 0, 0.0, NONE)
                continue
            share = WHOLE if sent.overlapping is None else (sent.end - paid_until) / (sent.end - sent.start)
            self._charge(sent, group, share, *KINDS[outcome], lasting)
            paying = int(end)  # the kernel puts those who lost the frame and pay nothing last
            received += group.size if outcome == RECEIVED else 0
            collided += group.size if outcome == COLLIDED else 0
        return received, collided, paying

    def _charge(self, sent: Transmission, ids: Ints, share: float, kind: int, cause: int, lasting: bool) -> None:
        """Charge and log different nodes (n,) for the same share of a frame. `lasting`: none of them can die of it."""
        nodes = self._nodes
        bits, joules, airtime = int(sent.frame.bits * share), sent.costs[2] * share, sent.costs[3] * share
        if bits == 0:
            self._log_each(sent, kind, ids, 0, 0.0, NONE)
        elif lasting or nodes.can_all_receive(ids, joules):
            nodes.receive_all(ids, joules, LEDGER[cause], airtime)
            self._log_each(sent, kind, ids, bits, joules, cause)
        else:
            for node in ids.tolist():
                paid = nodes.spend_receive(node, joules, bits, LEDGER[cause], airtime)
                alive, spent = nodes.alive[node], joules * paid / bits
                self._log_each(sent, kind if alive else DROP, np.array([node]), paid, spent, cause if paid else NONE)

    def _log_each(self, sent: Transmission, kind: int, ids: Ints, bits: int, joules: float, cause: int) -> None:
        """Log the same event at each of different nodes (n,)."""
        frame = sent.frame
        self._log.add_all(
            event(self._env.now, self._log.step, frame.target, EACH, kind, frame.code, sent.number, frame.sequence,
                  sent.source, frame.packets, bits, joules, cause),
            ids,
        )  # fmt: skip

    def _is_meant(self, ids: Ints, sent: Transmission, usable: Bools) -> Bools:
        """(m,) for which of the neighbours a frame is meant; `usable` (n,) as `kernels.reception.outcomes` takes it."""
        if sent.frame.to != EVERYONE:
            return np.asarray(ids == sent.frame.to)
        return usable[np.searchsorted(sent.neighbours.ids, ids)] if usable.size else np.ones(ids.size, dtype=np.bool_)

    def _marks(self, sent: Transmission) -> tuple[Ints, Floats]:
        """What overlapping frames do at each neighbour (see `kernels.reception.overlap`); empty if there are none."""
        nodes, receivers, ids = self._nodes, self._receivers, sent.neighbours.ids
        if sent.overlapping is None and not nodes.disturbed:
            return NO_MARKS, NO_TIMES
        until = np.empty(ids.size)
        until.fill(sent.start)
        if receivers is None or sent.overlapping is None:
            marks, mark = np.zeros(ids.size, dtype=np.int64), HIT
        else:
            marks, mark = np.where(receivers.locked(sent), 0, HIT), HEARD_OTHER
        if nodes.disturbed:
            marks[nodes.jammed[ids] | nodes.jammed[sent.source]] = HIT
        for other in sent.overlapping or ():
            if other.end > max(other.start, sent.start):
                paid = self._on.paid_until(other, sent)
                if other.listeners is not None:
                    overlap(ids, other.listeners, other.source, mark, paid, sent.end, marks, until)
                    paid = sent.start
                overlap(ids, other.neighbours.ids, other.source, mark, paid, sent.end, marks, until)
        return marks, until

    def _chances(self, sent: Transmission) -> tuple[Floats, Bools, Numbers]:
        """(thresholds, usable, numbers) of a frame, as `kernels.reception.outcomes` takes them."""
        nodes, neighbours, bits, source = self._nodes, sent.neighbours, sent.frame.bits, sent.source
        if self._topology.distance_only and not nodes.disturbed:
            return NO_TIMES, ALL, NO_NUMBERS
        thresholds, usable = self._topology.thresholds(neighbours, bits, sent.start)
        interfered = self._receivers is not None and sent.overlapping
        if interfered or nodes.disturbed:
            arrives = self._topology.momentary(neighbours, bits, sent.start)
            if self._receivers is not None and interfered:
                arrives = self._receivers.probabilities(sent)
            if nodes.disturbed:
                arrives = arrives * (1.0 - nodes.loss[source]) * (1.0 - nodes.loss[neighbours.ids])
            thresholds = 1.0 - arrives
        step = self._log.step
        return thresholds, usable, (source, step, self._uses.next(source, step))

    def _broadcast(self, sent: Transmission) -> Received:
        """The result of a broadcast if distance alone decides, and nobody can die of it."""
        received = ids = sent.neighbours.ids
        lost = 0
        if sent.overlapping is not None and (collided := self._collided_until(sent)):
            lost = len(collided)
            groups: dict[float, list[int]] = {}
            airtime = sent.end - sent.start
            for node, until in collided.items():
                groups.setdefault((sent.end - until) / airtime, []).append(node)
            for share, group in groups.items():
                self._charge(sent, np.array(group), share, COLLIDE, RX, lasting=True)
            received = np.array([node for node in sent.neighbours.id_list if node not in collided], dtype=np.int64)
        self._count(sent, ids.size, ids.size - lost, lost)
        if received.size:
            self._charge(sent, received, WHOLE, RECEIVE, RX, lasting=True)
        self._on.note(sent, ids)
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

    def _count(self, sent: Transmission, in_range: int, delivered: int, collided: int) -> None:
        """Count the receptions of a frame."""
        sent.missed = delivered < in_range
        if sent.frame.packets and not sent.frame.is_copy:
            self._counters.in_range += in_range
            self._counters.delivered += delivered
            self._counters.collided += collided
