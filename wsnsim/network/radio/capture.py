"""Capture: on which frame each receiver is locked where overlapping frames add to the noise, and what that frame faces.

    receivers.expect(transmission)      receivers.lock_started()
    receivers.locked(transmission), receivers.probabilities(transmission) -> (n,)

A receiver that listens locks on the first frame whose synchronisation header it can receive. A later frame that is
stronger by the link's `capture_margin` takes over while that header is on the air; after it, later frames are lost
whatever their power, and are interference for as long as they overlap. A receiver that begins to send loses its frame.
Therefore no node ever receives two overlapping frames.

Source: TI SWRS041 (CC2420): a radio in receive mode searches for preamble and delimiter, and then receives one frame
to its end (figure 25); co-channel rejection. IEEE 802.15.4-2006, 6.3: preamble of 4 bytes, delimiter of 1.
"""

from __future__ import annotations

import itertools
from collections import deque
from typing import Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats
from wsnsim.kernels.reception import add_common, take_over
from wsnsim.network.radio.radio_services import RadioServices
from wsnsim.network.radio.transmission import Transmission

HEADER_BITS: Final = 40
"""Bits of the synchronisation header: preamble and delimiter."""
LEAST_SYNCHRONISATION: Final = 1e-3
"""A receiver locks on a frame whose header arrives with at least this probability (our choice)."""
MARGIN: Final = 3.0
"""The capture margin in dB of a link that states none: the CC2420's co-channel rejection."""


class CapturingReceivers:
    """The locks of all receivers. `header` is the duration of the synchronisation header in s.

    Locks are found in the order in which frames start, at the first end of a frame after that.
    """

    def __init__(self, radio: RadioServices, header: float) -> None:
        self._env = radio.env
        self._nodes = radio.nodes
        self._topology = radio.topology
        self._link = radio.topology.link
        self._margin = float(getattr(self._link, "capture_margin", MARGIN))
        self._header = header
        self._started: deque[Transmission] = deque()

    def expect(self, sent: Transmission) -> None:
        """Note a transmission, in the order of their starts."""
        self._started.append(sent)

    def lock_started(self) -> None:
        """Find the locks on the frames that have started until now."""
        now, started = self._env.now, self._started
        while started and started[0].start <= now:
            sent = started.popleft()
            if sent.overlapping is not None:
                self._lock(sent)

    def locked(self, sent: Transmission) -> Bools:
        """(n,) which neighbours are locked on a frame that has started and overlaps others; changed by later frames."""
        if sent.locks is None:
            sent.locks = self._listening(sent) & self._synchronisable(sent)
        return sent.locks

    def probabilities(self, sent: Transmission) -> Floats:
        """(n,) probability that a frame arrives at neighbours locked on it, with interference where it overlaps.

        The frame is cut where another one begins or ends. The probabilities of a bit in all pieces are found together.
        They are 0 at the other neighbours.
        """
        neighbours, arrives = sent.neighbours, np.zeros(sent.neighbours.ids.size)
        at = np.flatnonzero(self.locked(sent))
        if not at.size:
            return arrives
        others = [other for other in sent.overlapping or () if other.end > max(other.start, sent.start)]
        ends = [min(max(time, sent.start), sent.end) for other in others for time in (other.start, other.end)]
        pieces = list(itertools.pairwise(sorted({sent.start, sent.end, *ends})))
        ids, interference = neighbours.ids[at], np.zeros((len(pieces), at.size))
        for other in others:
            for piece, (since, until) in enumerate(pieces):
                if other.start < until and other.end > since:
                    add_common(ids, other.neighbours.ids, other.neighbours.milliwatts, interference[piece])
        powers = np.concatenate([neighbours.powers[at]] * len(pieces))
        each = self._link.reception(powers, 1.0, interference.ravel()).reshape(interference.shape)
        bits = [sent.frame.bits * (until - since) / (sent.end - sent.start) for since, until in pieces]
        arrives[at] = np.prod(each ** np.array(bits)[:, None], axis=0)
        return arrives

    def _lock(self, sent: Transmission) -> None:
        """Lock the neighbours that listen, synchronise and are not locked on an earlier frame; take others over."""
        neighbours, on_air = sent.neighbours, [other for other in sent.overlapping or () if _is_earlier(other, sent)]
        locks = self._listening(sent) & self._synchronisable(sent)
        interference = np.zeros(locks.size)
        for other in on_air:
            add_common(neighbours.ids, other.neighbours.ids, other.neighbours.milliwatts, interference)
            at = neighbours.index(other.source)
            if at >= 0:
                locks[at] = False
            self._release(other, sent.source)
        disturbed = np.flatnonzero(locks & (interference > 0.0))
        if disturbed.size:
            probability = self._link.reception(neighbours.powers[disturbed], HEADER_BITS, interference[disturbed])
            locks[disturbed] = probability >= LEAST_SYNCHRONISATION
        for other in on_air:
            others, margin = other.neighbours, self._margin
            if sent.start >= other.start + self._header:
                margin = np.inf
            take_over(neighbours.ids, neighbours.powers, locks, others.ids, others.powers, self.locked(other), margin)
        sent.locks = locks

    def _release(self, sent: Transmission, node: int) -> None:
        """A node begins to send, and is no longer locked on a frame."""
        at = sent.neighbours.index(node)
        if at >= 0:
            self.locked(sent)[at] = False

    def _listening(self, sent: Transmission) -> Bools:
        """(n,) which neighbours listened when a frame began."""
        nodes, ids = self._nodes, sent.neighbours.ids
        if sent.end <= sent.start:
            return np.zeros(ids.size, dtype=np.bool_)
        listening = nodes.living[ids] if nodes.all_listen else nodes.hears(ids, sent.start)
        return listening if sent.asleep is None else listening & ~np.isin(ids, sent.asleep)

    def _synchronisable(self, sent: Transmission) -> Bools:
        """(n,) whether the header of a frame can be received where nothing interferes."""
        probabilities = self._topology.probabilities(sent.neighbours, HEADER_BITS)
        return np.asarray(probabilities >= LEAST_SYNCHRONISATION)


def _is_earlier(other: Transmission, sent: Transmission) -> bool:
    """Whether another frame began before this one and is on the air when this one begins."""
    return other.number < sent.number and other.end > max(other.start, sent.start)
