"""The links between all nodes: who receives whom, with which power and probability, and losses in bursts.

    topology.neighbours(node).ids      topology.connected(a, b)      topology.probability(a, b)

The neighbours of a node are looked up in a grid of cells on first use, and cached. The random part of a link is a
function of the stream's key and of its two nodes. Recorded links come from the link model instead, and are looked up
again after the end of each round.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import simpy

from wsnsim.base.arrays import Bools, Floats, Ints, Keys
from wsnsim.base.frames import Counters
from wsnsim.base.radio import BurstyLosses, EnergyModel, LinkModel, RecordsLinks
from wsnsim.base.rng import derive, derive_all, uniforms
from wsnsim.kernels.reception import advance, find_links
from wsnsim.network.event_log import EventLog
from wsnsim.network.nodes import Nodes

USABLE: Final = 0.5
"""A link is usable as a hop if the probability of a packet, in both directions, is at least this share of the
probability over the best link (our choice)."""
BEST: Final = 0.0
"""Received power of the best link, in dBm."""
SAMPLE: Final = 64
"""Nodes around which others are counted to estimate all pairs that may be linked."""
MOST_PAIRS: Final = 4_000_000
"""If more pairs may be linked, neighbours are found on first use: all of them may take 200 MB and a second."""
PAIRS_AT_ONCE: Final = 50_000
"""Pairs whose powers are computed together: 10 MB."""
PAIR, DIRECTION, BURSTS = 0, 1, 2


class LinkStates:
    """The states of links (n,), good or bad, whose stationary mean is a given ratio.

        LinkStates(keys, ratios, losses, since).ratios(time) -> (n,) probability that a frame arrives now

    The share of time in a good state is (ratio - bad) / (good - bad), and a bad state lasts `bad_time` on average. A
    link whose ratio is not between `bad` and `good` has one state, in which frames arrive with that ratio. The states
    are stationary from the first instant on, and a function of key and time.

    Args:
        keys: (n,) random keys.
        ratios: (n,) mean probability that a frame arrives.
        losses: The model.
        since: The time in s from which on the states are known.
    """

    def __init__(self, keys: Keys, ratios: Floats, losses: BurstyLosses, since: float) -> None:
        shares = (ratios - losses.bad) / (losses.good - losses.bad)
        changing = (shares > 0.0) & (shares < 1.0)
        shares = np.where(changing, shares, 0.5)
        self._keys = keys
        self._durations = np.column_stack([np.ones(keys.size), shares / (1.0 - shares)]) * losses.bad_time
        self._when_good = np.where(changing, losses.good, ratios)
        self._when_bad = np.where(changing, losses.bad, ratios)
        self._good = uniforms(keys, 0) < shares
        first = np.where(self._good, self._durations[:, 1], self._durations[:, 0])
        self._until = np.where(changing, since - first * np.log1p(-uniforms(keys, 1)), np.inf)
        self._counts = np.full(keys.size, 2)
        self._next = -np.inf
        self._ratios = ratios

    def ratios(self, time: float) -> Floats:
        """(n,) probability that a frame arrives that begins at `time` (s), not before that of an earlier call."""
        if time >= self._next:
            self._next = advance(self._keys, self._durations, time, self._good, self._until, self._counts)
            self._ratios = np.where(self._good, self._when_good, self._when_bad)
        return self._ratios


@dataclass(eq=False)
class Neighbours:
    """The nodes that the transmissions of one node may reach, dead nodes included.

    Attributes:
        ids: (n,) the nodes, ascending.
        powers: (n,) received power in dBm.
        senses: (n,) whether the node takes the channel for busy during a transmission.
        probabilities: {bits: (n,) probability that a frame of this length arrives}, filled on demand.
        thresholds: {bits: (n,) one less that, and (n,) whether the link is usable}, filled on demand.
        ratios: (n,) recorded packet delivery ratios; None: the link model says with which probability a frame arrives.
        states: The states of links whose losses come in bursts; None: losses are independent.
    """

    ids: Ints
    powers: Floats
    senses: Bools
    ratios: Floats | None = None
    states: LinkStates | None = None
    probabilities: dict[int, Floats] = field(default_factory=dict)
    thresholds: dict[int, tuple[Floats, Bools]] = field(default_factory=dict)

    @cached_property
    def id_list(self) -> list[int]:
        """The ids as a list."""
        result: list[int] = self.ids.tolist()
        return result

    @cached_property
    def members(self) -> frozenset[int]:
        """The ids as a set."""
        return frozenset(self.id_list)

    @cached_property
    def sensing(self) -> frozenset[int]:
        """The nodes that take the channel for busy, as a set."""
        return self.members if self.senses.all() else frozenset(self.ids[self.senses].tolist())

    @cached_property
    def milliwatts(self) -> Floats:
        """(n,) received power in mW."""
        result: Floats = 10.0 ** (self.powers / 10.0)
        return result

    def index(self, node: int) -> int:
        """The index of a node in `ids`, or -1."""
        at = int(self.ids.searchsorted(node))
        return at if at < self.ids.size and self.ids[at] == node else -1


class Topology:
    """The graph of links between all nodes.

    Args:
        nodes: The nodes.
        link: The link model of the scenario.
        key: The key of the random part of the links.
        packet_bits: Length of the frame by which a link is judged usable.

    Attributes:
        link: The link model.
        distance_only: Whether reception depends on distance alone: within range every undisturbed frame arrives.
        on_change: Called when the links have changed, after a round of recorded ones.
    """

    def __init__(self, nodes: Nodes, link: LinkModel, key: int, packet_bits: int) -> None:
        self._nodes = nodes
        self._key = key
        self._keys = np.uint64(derive(key, PAIR)), np.uint64(derive(key, DIRECTION))
        self._packet_bits = packet_bits
        self._neighbours: dict[int, Neighbours] = {}
        self._usable = USABLE * float(link.reception(np.array([BEST]), packet_bits, 0.0)[0])
        self._recorded = link if isinstance(link, RecordsLinks) else None
        self._round, self._round_began = 0, 0.0
        self.link = link
        self.distance_only = link.perfect and not link.captures
        self.on_change: Callable[[], None] = lambda: None

    def follow_rounds(self, env: simpy.Environment) -> None:
        """Look up recorded links again at the end of each round; other links do not change."""
        if self._recorded is None or math.isinf(end := self._recorded.round_end(self._round)):
            return

        def begin(_: simpy.Event) -> None:
            self._round, self._round_began = self._round + 1, end
            self._neighbours.clear()
            self.follow_rounds(env)
            self.on_change()

        timeout = env.timeout(end - env.now)
        timeout.callbacks.append(begin)

    def neighbours(self, node: int) -> Neighbours:
        """The neighbours of a node."""
        found = self._neighbours.get(node)
        if found is None and self._recorded is not None:
            found = self._neighbours[node] = self._look_up(node, self._recorded)
        elif found is None:
            ids = self._nodes.grid.within(self._nodes.positions[node], self.link.audible)
            found = self._neighbours[node] = self._find(node, ids[ids != node])
        return found

    def find_all(self) -> None:
        """Find the neighbours of all nodes together, which is faster than one by one, unless they may be too many."""
        if self._recorded is not None:
            return
        size, sample = self._nodes.size, self._nodes.positions[:: max(self._nodes.size // SAMPLE, 1)]
        near = self._nodes.grid.within_each(sample, self.link.audible)[0].size / len(sample)
        if near * size > MOST_PAIRS:
            return
        together = max(int(PAIRS_AT_ONCE / near), 1)
        for first in range(0, size, together):
            self._find_range(first, min(first + together, size))

    def _find_range(self, first: int, end: int) -> None:
        """Find the neighbours of the nodes from `first` to `end`, without the latter."""
        rows, ids = self._nodes.grid.within_each(self._nodes.positions[first:end], self.link.audible)
        others = rows + first != ids
        rows, ids = rows[others], ids[others]
        powers = self._powers(rows + first, ids)
        heard = np.isfinite(powers)
        ids, powers = ids[heard], powers[heard]
        senses = self.link.senses(powers)
        ends = np.concatenate(([0], np.cumsum(np.bincount(rows[heard], minlength=end - first)))).tolist()
        for node, (a, b) in enumerate(itertools.pairwise(ends), first):
            self._neighbours[node] = Neighbours(ids[a:b], powers[a:b], senses[a:b])

    def reliable(self, neighbours: Neighbours, bits: int) -> Bools:
        """(n,) which neighbours receive an undisturbed frame of this length over a usable link."""
        if self.distance_only:
            return np.ones(neighbours.ids.size, dtype=np.bool_)
        return self.probabilities(neighbours, bits) >= self._usable

    def connected(self, a: int, b: int) -> bool:
        """Whether two nodes can exchange frames over one hop, in both directions."""
        if self.distance_only:
            return self._nodes.distance(a, b) <= self.link.reach
        return min(self.probability(a, b), self.probability(b, a)) >= self._usable

    def is_reliable(self, source: int, to: int) -> bool:
        """Whether a link is usable in this direction, so that a loss on it is logged."""
        return self.distance_only or self.probability(source, to) >= self._usable

    def probability(self, source: int, to: int, time: float | None = None) -> float:
        """The probability that an undisturbed packet arrives over a link; at a time in s, or on average."""
        neighbours = self.neighbours(source)
        at = neighbours.index(to)
        if at < 0:
            return 0.0
        bits = self._packet_bits
        found = self.probabilities(neighbours, bits) if time is None else self.momentary(neighbours, bits, time)
        return float(found[at])

    def probabilities(self, neighbours: Neighbours, bits: int) -> Floats:
        """(n,) the probability that each neighbour receives an undisturbed frame of this length."""
        found = neighbours.probabilities.get(bits)
        if found is None:
            found = neighbours.ratios
            if found is None:
                found = self.link.reception(neighbours.powers, bits, 0.0)
            neighbours.probabilities[bits] = found
        return found

    def momentary(self, neighbours: Neighbours, bits: int, time: float) -> Floats:
        """(n,) `probabilities` for a frame that begins at a time in s, given the states of the links."""
        return self.probabilities(neighbours, bits) if neighbours.states is None else neighbours.states.ratios(time)

    def thresholds(self, neighbours: Neighbours, bits: int, time: float) -> tuple[Floats, Bools]:
        """What a uniform random number must reach for an undisturbed frame to arrive (n,), and `reliable` (n,).

        `time` is when the frame begins, in s.
        """
        found = neighbours.thresholds.get(bits)
        if found is None:
            thresholds = np.asarray(1.0 - self.probabilities(neighbours, bits), dtype=np.float64)
            found = neighbours.thresholds[bits] = (thresholds, self.reliable(neighbours, bits))
        return found if neighbours.states is None else (1.0 - neighbours.states.ratios(time), found[1])

    def _find(self, node: int, ids: Ints) -> Neighbours:
        powers = self._powers(np.full(ids.size, node), ids)
        heard = np.isfinite(powers)
        return Neighbours(ids[heard], powers[heard], self.link.senses(powers[heard]))

    def _look_up(self, node: int, recorded: RecordsLinks) -> Neighbours:
        """The neighbours of a node in the present round of a recording."""
        ids, powers, ratios = recorded.heard(self._round, node)
        found = Neighbours(ids, powers, self.link.senses(powers), ratios)
        if recorded.losses is not None:
            keys = derive_all(derive(self._key, BURSTS, self._round, node), ids)
            found.states = LinkStates(keys, ratios, recorded.losses, self._round_began)
        return found

    def _powers(self, sources: Ints, ids: Ints) -> Floats:
        distances, pairs, directions = np.empty(ids.size), *(np.empty(ids.size, dtype=np.uint64) for _ in range(2))
        find_links(self._nodes.positions, sources, ids, *self._keys, distances, pairs, directions)
        return self.link.powers(distances, pairs, directions)


class RadioServices(NamedTuple):
    """Services shared by media, channel, MAC, routing and transport of one run."""

    env: simpy.Environment
    nodes: Nodes
    topology: Topology
    energy: EnergyModel
    log: EventLog
    counters: Counters
