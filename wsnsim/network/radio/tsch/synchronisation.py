"""TSCH's own synchronisation: time parents, corrections, keep-alives, enhanced beacons, and nodes that lost the time.

The coordinator has the time of the network: the sink, otherwise the node nearest to the middle of the field. Each other
node has a *time parent*, the neighbour with the fewest hops to the coordinator of which it knows. Every frame, enhanced
beacon or acknowledgement that it receives from its time parent, or from another neighbour that is nearer to the
coordinator than itself, says how far their clocks are apart: see `corrections`.

Nodes begin as in a network that has run for a while (our choice): with the right time, with the rates of their clocks
if those are estimated, and knowing their neighbours' hops from the beacons before. Clocks that begin with an error
above the guard (`clock.offset`) have lost the time at the start. Each node that knows the time broadcasts an enhanced
beacon every `eb_period`, from a random phase on; it carries its hops.

A node that was not corrected for `keep_alive` (`keep_alive_compensated` once its rate is known) sends its time parent
an empty frame, to get an acknowledgement; if its time parent sleeps, it takes the best neighbour that is awake. If no
acknowledgement comes, it takes this neighbour for one hop farther away, until its next beacon. A node that was not
corrected for twice as long, and for four `keep_alive`, has lost the time: its frames are lost, it scans on one channel,
drawn at random, and joins by the first enhanced beacon that it receives. It needs no association. A node that restarts
after a crash scans, too; a coordinator that is down is not replaced.

All of this happens only where clocks err. Source: IEEE 802.15.4-2015, 6.5.4 and 6.3.6; RFC 8180, 6.1 to 6.3. The limits
for lost time, and the choice of parents, are ours.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from wsnsim.base.arrays import Ints
from wsnsim.base.frames import EVERYONE, MacFrame, Received
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.models.tsch import Tsch
from wsnsim.network.event_log import then
from wsnsim.network.radio.mac_services import MacPart, NetworkMacServices
from wsnsim.network.radio.transmission import Transmission
from wsnsim.network.radio.tsch.cell_leases import CellLeases
from wsnsim.network.radio.tsch.corrections import NOBODY, Corrections
from wsnsim.network.radio.tsch.exchanges import Exchanges
from wsnsim.network.radio.tsch.slots import SlotRadios

FARTHEST: Final = 255
"""The largest number of hops that an enhanced beacon can state (its join metric has 8 bits)."""
AGAIN: Final = 0.2
"""Share of the period after which a node asks again that was not corrected."""
BEACONS, SCANS, RATES = 0, 1, 2


class _SyncFrame(MacFrame):
    """An enhanced beacon, or an empty frame to the time parent of a node; `on_end` gets its result.

    `hops` of its sender to the coordinator are written into a beacon when it is queued.
    """

    __slots__ = ("_on_end", "hops")

    def __init__(
        self, to: int, bits: int, code: int, on_end: Callable[[Received | None], None], hops: int = 0
    ) -> None:  # fmt: skip
        super().__init__(to, bits, packets=0, code=code)
        self.hops = hops
        self._on_end = on_end

    def finish(self, received: Received | None) -> None:
        """Take the result: whether it was received, or None if it was not sent."""
        self._on_end(received)


class Synchronisation(MacPart):
    """Keeps the clocks of the nodes together.

    Attributes:
        asked: Nodes whose keep-alive is on its way.
    """

    def __init__(
        self, mac: Tsch, services: NetworkMacServices, radios: SlotRadios, air: Exchanges, leases: CellLeases
    ) -> None:
        super().__init__(services)
        self._mac = mac
        self._radios = radios
        self._exchanges = air
        self._leases = leases
        self._beacon, self._keep_alive = self._log.code("eb"), self._log.code("keep_alive")
        self._key = services.key("synchronisation")
        self._scans = 0
        self._started = False
        self._heard: dict[int, dict[int, int]] = {}
        self._coordinator = NOBODY
        self.asked: set[int] = set()
        self._beaconing: set[int] = set()
        """Nodes whose beacon waits"""
        self._parents = self._hops = np.zeros(0, dtype=np.int64)
        self._corrections: Corrections | None = None

    def start(self) -> None:
        """Find the time parents, and begin with beacons and keep-alives."""
        positions, size = self._nodes.positions, self._nodes.size
        self._started = True
        middle = (positions.min(axis=0) + positions.max(axis=0)) / 2.0
        self._coordinator = self._services.sinks[0] if self._services.sinks else self._nodes.grid.nearest(middle)
        self._hops = self._count_hops(size)
        self._parents = np.full(size, NOBODY, dtype=np.int64)
        for node in range(size):
            self._choose_parent(node)
        self._exchanges.on_frame, self._exchanges.on_answer = self._on_frame, self._correct
        ahead = self._clocks.error(np.arange(size), self._env.now)
        wrong = np.abs(ahead - ahead[self._coordinator]) > self._mac.guard
        others = np.arange(size) != self._coordinator
        self._corrections = Corrections(self._mac, self._env, self._clocks, size, derive(self._key, RATES))
        self._corrections.begin(np.flatnonzero(others & ~wrong), self._coordinator)
        if self._mac.keep_alive is not None or self._mac.eb_period is not None:
            for node in np.flatnonzero(others).tolist():
                due = max(self._corrections.period(node) - self._corrections.age(node), 0.0)
                then(self._env.timeout(due), self._ask, node)
        if self._mac.eb_period is not None:
            phases = uniforms(derive_all(derive(self._key, BEACONS), np.arange(size)), 0).tolist()
            for node, phase in enumerate(phases):
                then(self._env.timeout(phase * self._beacon_period(node)), self._send_beacon, node)
        for node in np.flatnonzero(wrong).tolist():
            self._radios.scan(node, self._draw_channel(node), self._env.now)
            then(self._env.timeout(0.0), self._begin_lost, node)

    def _beacon_period(self, node: int) -> float:
        assert self._mac.eb_period is not None, "beacons are sent only with a period"
        return self._clocks.lasts(node, self._mac.eb_period)

    def note_change(self, node: int) -> None:
        """The clock of a node was stepped or corrected: from the first time on, nodes cannot rely on their clocks."""
        if not self._started:
            self.start()

    def lose(self, node: int) -> None:
        """A node has lost the time: its frames are lost, and it scans. The coordinator has the time by definition."""
        alone = not self._started or node == self._coordinator
        if alone or not self._nodes.alive[node] or self._radios.is_scanning(node):
            return
        if self._corrections is not None:
            self._corrections.forget(node)
        self._services.log_drop(node, MacFrame(NOBODY, 0, 0, code=self._beacon), "no_time")
        self._radios.scan(node, self._draw_channel(node), self._env.now)
        for line in self._leases.forget(node):
            for frame in line.waiting():
                self._services.log_drop(node, frame, "no_time")
            self._exchanges.stop(line)
        for frame in self._leases.take_waiting(node):
            self._services.log_drop(node, frame, "no_time")
            frame.finish(None)
        self._hold(node)

    def _begin_lost(self, node: int) -> None:
        """Switch on the radio of a node whose clock is wrong from the start."""
        if self._nodes.alive[node]:
            self._hold(node)

    def _hold(self, node: int) -> None:
        self._nodes.begin_sending(node)
        self._nodes.hold_radio(node)

    def _draw_channel(self, node: int) -> int:
        """Draw a channel on which a node scans."""
        self._scans += 1
        return self._mac.channels[derive(self._key, SCANS, node, self._scans) % len(self._mac.channels)]

    def drop_parent(self, node: int, parent: int) -> None:
        """A time parent does not answer: take it for one hop farther away, and the best neighbour as time parent."""
        known = self._heard[node]
        known[parent] = min(known.get(parent, FARTHEST) + 1, FARTHEST)
        if self._parents[node] == parent:
            self._choose_parent(node)

    def _count_hops(self, size: int) -> Ints:
        """(N,) hops of each node to the coordinator over links that are usable in both directions."""
        hops = np.full(size, FARTHEST, dtype=np.int64)
        hops[self._coordinator] = 0
        topology, waiting = self._topology, deque([self._coordinator])
        while waiting:
            node = waiting.popleft()
            for other in topology.neighbours(node).id_list:
                if topology.connected(node, other):
                    self._heard.setdefault(other, {})[node] = int(hops[node])
                    if hops[other] > hops[node] + 1:
                        hops[other] = hops[node] + 1
                        waiting.append(other)
        return hops

    def _choose_parent(self, node: int, now: bool = False) -> None:
        """Take the neighbour with the fewest hops, the nearest of several; if `now`, of those that are awake."""
        known = self._heard.setdefault(node, {})
        if node == self._coordinator:
            return
        near = [other for other in known if not now or self._services.is_awake(other)]
        best = min(near, key=lambda other: (known[other], self._nodes.distance(node, other), other), default=NOBODY)
        if best == NOBODY and now:
            return
        self._parents[node] = best
        self._hops[node] = FARTHEST if best == NOBODY else min(known[best] + 1, FARTHEST)

    def _send_beacon(self, node: int) -> None:
        """Broadcast a node's enhanced beacon, if it is awake and knows the time; the next one follows."""
        then(self._env.timeout(self._beacon_period(node)), self._send_beacon, node)
        may_send = self._services.is_awake(node) and not self._radios.is_scanning(node) and node not in self._beaconing
        if may_send and self._hops[node] < FARTHEST:
            self._beaconing.add(node)
            bits, hops = self._mac.bits(8 * self._mac.eb_bytes), int(self._hops[node])
            frame = _SyncFrame(EVERYONE, bits, self._beacon, lambda _: self._beaconing.discard(node), hops)
            self._exchanges.enqueue(self._leases.shared_line(node), frame, first=True)

    def _ask(self, node: int) -> None:
        """Send a keep-alive if a node was not corrected for long; it has lost the time after too long."""
        assert self._corrections is not None, "nodes that ask are corrected"
        period, age = self._corrections.period(node), self._corrections.age(node)
        if not self._nodes.alive[node] or self._radios.is_scanning(node):
            then(self._env.timeout(period), self._ask, node)
            return
        lost = self._corrections.lost_after(node)
        if age >= lost:
            self.lose(node)
        elif self._mac.keep_alive is not None and age >= period and node not in self.asked:
            self._send_keep_alive(node)
        left = period - age if age < period else min(AGAIN * period, lost - age)
        then(self._env.timeout(max(left, self._mac.slot)), self._ask, node)

    def _send_keep_alive(self, node: int) -> None:
        """Send an empty frame to the time parent of a node, if it is awake, or another neighbour that is."""
        if self._parents[node] == NOBODY or not self._services.is_awake(int(self._parents[node])):
            self._choose_parent(node, now=True)
        parent = int(self._parents[node])
        if parent != NOBODY and self._services.is_awake(parent):
            self.asked.add(node)
            frame = _SyncFrame(parent, self._mac.bits(0), self._keep_alive, partial(self._note_answer, node, parent))
            self._exchanges.enqueue(self._leases.shared_line(node), frame, first=True)

    def _note_answer(self, node: int, parent: int, received: Received | None) -> None:
        """Note whether a time parent has answered; None: the node is down."""
        if received is False:
            self.drop_parent(node, parent)
        self.asked.discard(node)

    def _on_frame(self, sent: Transmission, received: Received) -> None:
        """Correct the nodes that received a frame from their time parent; learn from a beacon."""
        source, frame = sent.source, sent.frame
        if frame.to != EVERYONE:
            if received:
                self._correct(frame.to, source)
            return
        if isinstance(frame, _SyncFrame):
            for node in received.tolist():
                self._learn(node, source, frame.hops)
        for node in received.tolist():
            self._correct(node, source)

    def _learn(self, node: int, source: int, hops: int) -> None:
        """A node knows how far a neighbour is from the coordinator; a node that scans joins."""
        if node == self._coordinator:
            return
        known = self._heard.setdefault(node, {})
        if self._radios.is_scanning(node):
            known.clear()
            self._join(node)
        known[source] = hops
        parent = int(self._parents[node])
        if parent in (NOBODY, source) or known.get(parent, FARTHEST) > hops or not known.keys() - {source}:
            self._choose_parent(node)

    def _join(self, node: int) -> None:
        """A node that scanned follows slots again."""
        self._radios.end_scan(node)
        self._nodes.release_radio(node)
        self._nodes.end_sending(node)

    def _correct(self, node: int, source: int) -> None:
        """Set the clock of a node by that of its time parent, or of another neighbour nearer to the coordinator."""
        if self._corrections is None:
            return
        hops = self._heard.get(node, {}).get(source, FARTHEST)
        if self._parents[node] == source or hops < self._hops[node]:
            self._corrections.correct(node, source)
