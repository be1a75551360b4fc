"""Reception by array operations: the slow, independent form of `Reception.resolve`, with the same result.

resolve(reception, sent) -> Received
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.frames import EVERYONE, Received
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.network.radio.reception import COLLIDE, DROP, NONE, OVERHEAR, OVERHEARD, RECEIVE, RX, WHOLE, Reception
from wsnsim.network.radio.topology import Neighbours
from wsnsim.network.radio.transmission import Transmission


class PlainReception(Reception):
    """What transmissions do at the neighbours of their senders, in one way for all frames."""

    def resolve(self, sent: Transmission) -> Received:
        """The result of a frame."""
        listening = self._on.hears(sent.neighbours.ids, sent.start)
        if self._receivers is not None:
            self._receivers.lock_started()
        return self._sort_out(sent, listening)

    def _charge_shares(self, sent: Transmission, chosen: Bools, shares: Floats | None, kind: int, cause: int) -> None:
        """Charge and log the chosen neighbours, each for the share of the frame that it listened to; None: whole."""
        ids = sent.neighbours.ids[chosen]
        if shares is None and ids.size:
            self._charge(sent, ids, WHOLE, kind, cause, lasting=False)
        elif ids.size:
            chosen_shares = shares[chosen]
            for share in np.unique(chosen_shares).tolist():
                self._charge(sent, ids[chosen_shares == share], share, kind, cause, lasting=False)

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
        self._charge_shares(sent, got, share, RECEIVE, RX)
        if not quiet:
            self._charge_shares(sent, collided & meant, share, COLLIDE, RX)
        if not everyone:
            self._charge_shares(sent, (arrived | collided) & ~meant, share, OVERHEAR, OVERHEARD)
        living = nodes.living[ids]
        self._on.note(sent, ids[(arrived | collided) & living])
        if everyone and listening is not None:
            meant = meant & listening
        lost = meant & ~(arrived | collided)
        if everyone:
            lost &= living
        if lost.any():
            self._log_each(sent, DROP, ids[lost], 0, 0.0, NONE)
        got &= living
        meant = meant & living
        self._count(sent, int(meant.sum()), int((got & meant).sum()), int((collided & meant).sum()))
        return ids[got] if everyone else bool(got.any())

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
            here = common(neighbours, other.neighbours)
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
        samples = uniforms(derive_all(derive(int(self._key), *self._numbers(sent.source)), neighbours.ids), 0)
        return np.asarray(samples >= 1.0 - probabilities)

    def _numbers(self, source: int) -> tuple[int, int, int]:
        step = self._log.step
        return source, step, self._uses.next(source, step)


def common(neighbours: Neighbours, others: Neighbours) -> Ints:
    """Indices of the common neighbours in the ids of the first."""
    return np.flatnonzero(np.isin(neighbours.ids, others.ids))
