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
from wsnsim.kernels.reception import add_common, take_over, unlock
from wsnsim.network.radio.topology import RadioServices
from wsnsim.network.radio.transmission import RadiosOn, Transmission

HEADER_BITS: Final = 40
"""Bits of the synchronisation header: preamble and delimiter."""
LEAST_SYNCHRONISATION: Final = 1e-3
"""A receiver locks on a frame whose header arrives with at least this probability (our choice)."""
MARGIN: Final = 3.0
"""The capture margin in dB of a link that states none: the CC2420's co-channel rejection."""


class CapturingReceivers:
    """The locks of all receivers. `header` is the duration of the synchronisation header in s; `on`: who listens.

    Locks are found in the order in which frames start, at the first end of a frame after that.
    """

    def __init__(self, radio: RadioServices, header: float, on: RadiosOn) -> None:
        self._env = radio.env
        self._nodes, self._on = radio.nodes, on
        self._topology = radio.topology
        self._link = radio.topology.link
        self._margin = float(getattr(self._link, "capture_margin", MARGIN))
        self._header = header
        self._started: deque[Transmission] = deque()
        self._synchronise: dict[int, Bools] = {}
        """{sender: which of its neighbours can receive the header of its frames where nothing interferes}"""

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
        start, end = sent.start, sent.end
        spans = [
            (min(max(other.start, start), end), min(max(other.end, start), end), other.neighbours)
            for other in sent.overlapping or ()
            if other.end > max(other.start, start)
        ]
        edges = sorted({start, end, *(span[0] for span in spans), *(span[1] for span in spans)})
        ids, interference = neighbours.ids[at], np.zeros((len(edges) - 1, at.size))
        for since, until, others in spans:
            part = interference[edges.index(since) : edges.index(until)]
            add_common(ids, others.ids, others.milliwatts, part)
        powers = np.concatenate([neighbours.powers[at]] * len(interference))
        each = self._link.reception(powers, 1.0, interference.ravel()).reshape(interference.shape)
        bits = [sent.frame.bits * (until - since) / (end - start) for since, until in itertools.pairwise(edges)]
        arrives[at] = np.multiply.reduce(each ** np.array(bits)[:, None])
        return arrives

    def _lock(self, sent: Transmission) -> None:
        """Lock the neighbours that listen, synchronise and are not locked on an earlier frame; take others over."""
        neighbours, on_air = sent.neighbours, [other for other in sent.overlapping or () if _is_earlier(other, sent)]
        locks = self._listening(sent) & self._synchronisable(sent)
        ids, interference = neighbours.ids, np.zeros((1, locks.size))
        for other in on_air:
            add_common(ids, other.neighbours.ids, other.neighbours.milliwatts, interference)
            unlock(ids, locks, other.source)
            unlock(other.neighbours.ids, self.locked(other), sent.source)
        disturbed = np.flatnonzero(locks & (interference[0] > 0.0))
        if disturbed.size:
            noise = interference[0, disturbed]
            locks[disturbed] = (
                self._link.reception(neighbours.powers[disturbed], HEADER_BITS, noise) >= LEAST_SYNCHRONISATION
            )
        for other in on_air:
            others, margin = other.neighbours, self._margin
            if sent.start >= other.start + self._header:
                margin = np.inf
            take_over(ids, neighbours.powers, locks, others.ids, others.powers, self.locked(other), margin)
        sent.locks = locks

    def _listening(self, sent: Transmission) -> Bools:
        """(n,) which neighbours listened when a frame began."""
        nodes, ids = self._nodes, sent.neighbours.ids
        if sent.end <= sent.start:
            return np.zeros(ids.size, dtype=np.bool_)
        hears = self._on.hears(ids, sent.start)
        listening = nodes.living[ids] if hears is None else hears
        return listening if sent.asleep is None else listening & ~np.isin(ids, sent.asleep)

    def _synchronisable(self, sent: Transmission) -> Bools:
        """(n,) whether the header of a frame can be received where nothing interferes. Not to be changed."""
        found = self._synchronise.get(sent.source)
        if found is None:
            probabilities = self._topology.probabilities(sent.neighbours, HEADER_BITS)
            found = self._synchronise[sent.source] = np.asarray(probabilities >= LEAST_SYNCHRONISATION)
        return found


def _is_earlier(other: Transmission, sent: Transmission) -> bool:
    """Whether another frame began before this one and is on the air when this one begins."""
    return other.number < sent.number and other.end > max(other.start, sent.start)
