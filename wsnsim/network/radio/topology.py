"""Who may hear whom, and how well: looked up in the k-d tree when first asked, and kept.

    wiring.audience(node).ids      wiring.connected(a, b)      wiring.success(a, b)

The random part of a link belongs to the link alone: a function of the stream's key and the two nodes.
"""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.radio import LinkModel
from wsnsim.base.rng import derive, derive_all, derive_each
from wsnsim.network.nodes import Nodes

USABLE: Final = 0.5
"""Chance of a packet, of what the best link gives, that a link must give in both directions to be used as one hop
(our choice)."""
BEST: Final = 0.0
"""Received power of the best link, in dBm."""
PAIR, DIRECTION = 0, 1


class Neighbours:
    """Everybody who may hear a node: `ids` ascending, received `powers` in dBm, who takes it for a busy channel."""

    __slots__ = ("_members", "chances", "ids", "listed", "powers", "senses")

    def __init__(self, ids: Ints, powers: Floats, senses: Bools) -> None:
        self.ids = ids
        self.powers = powers
        self.senses = senses
        self.listed: list[int] = ids.tolist()
        self.chances: dict[int, Floats] = {}
        self._members: frozenset[int] | None = None

    @property
    def members(self) -> frozenset[int]:
        """The ids as a set, made when first needed."""
        if self._members is None:
            self._members = frozenset(self.listed)
        return self._members

    def common(self, other: Neighbours) -> tuple[Ints, Ints]:
        """Where those who may hear both stand in this audience, and where in the other."""
        at = np.minimum(np.searchsorted(other.ids, self.ids), max(other.ids.size - 1, 0))
        here = np.flatnonzero(other.ids[at] == self.ids) if other.ids.size else at[:0]
        return here, at[here]

    def index(self, node: int) -> int:
        """Where a node stands in `ids`; -1 if it hears nothing."""
        at = int(np.searchsorted(self.ids, node))
        return at if at < len(self.listed) and self.listed[at] == node else -1


class Topology:
    """The links of a network. `packet_bits`: of the frame by which a link is judged usable."""

    def __init__(self, fleet: Nodes, link: LinkModel, key: int, packet_bits: int) -> None:
        self._fleet = fleet
        self._link = link
        self._pairs = derive(key, PAIR)
        self._directions = derive(key, DIRECTION)
        self._packet_bits = packet_bits
        self._known: dict[int, Neighbours] = {}
        self._usable = USABLE * float(link.reception(np.array([BEST]), packet_bits, 0.0)[0])
        self.sharp = link.perfect and not link.captures
        """Whether who hears whom is a matter of distance alone: within reach everything arrives."""

    def audience(self, node: int) -> Neighbours:
        """Who may hear a node, the dead included."""
        found = self._known.get(node)
        if found is None:
            near = self._fleet.tree.query_ball_point(self._fleet.positions[node], self._link.audible)
            ids = np.array(sorted(near), dtype=np.int64)
            found = self._known[node] = self._made(node, ids[ids != node])
        return found

    def neighbours(self, node: int) -> list[int]:
        """Ids of who may hear a node, ascending, itself left out, the dead included."""
        return self.audience(node).listed

    def survey(self) -> None:
        """Look everybody's audience up at once: cheaper than one by one where all will send."""
        fleet = self._fleet
        pairs = fleet.tree.query_pairs(self._link.audible, output_type="ndarray")
        both = np.concatenate([pairs, pairs[:, ::-1]])
        both = both[np.lexsort((both[:, 1], both[:, 0]))]
        powers = self._powers(both[:, 0], both[:, 1])
        heard = np.isfinite(powers)
        sources, ids, powers = both[heard, 0], np.ascontiguousarray(both[heard, 1]), powers[heard]
        senses = self._link.senses(powers)
        ends = np.concatenate(([0], np.cumsum(np.bincount(sources, minlength=fleet.size)))).tolist()
        self._known = {
            node: Neighbours(ids[a:b], powers[a:b], senses[a:b]) for node, (a, b) in enumerate(itertools.pairwise(ends))
        }

    def reliable(self, audience: Neighbours, bits: int) -> Bools:
        """(n,) of an audience, those whom a frame of so many bits reaches more often than not, undisturbed."""
        if self.sharp:
            return np.ones(audience.ids.size, dtype=np.bool_)
        return self.chances(audience, bits) >= self._usable

    def connected(self, a: int, b: int) -> bool:
        """Whether two nodes can talk over one hop: the same in both directions."""
        if self.sharp:
            return self._fleet.distance(a, b) <= self._link.reach
        return min(self.success(a, b), self.success(b, a)) >= self._usable

    def expects(self, source: int, to: int) -> bool:
        """Whether a frame over a link is more likely to arrive than not, so that its loss is worth a word."""
        return self.sharp or self.success(source, to) >= self._usable

    def success(self, source: int, to: int) -> float:
        """The chance that a packet arrives over a link."""
        audience = self.audience(source)
        at = audience.index(to)
        return float(self.chances(audience, self._packet_bits)[at]) if at >= 0 else 0.0

    def chances(self, audience: Neighbours, bits: int) -> Floats:
        """(n,) the chance of a frame of so many bits at each of the audience, undisturbed."""
        found = audience.chances.get(bits)
        if found is None:
            found = audience.chances[bits] = self._link.reception(audience.powers, bits, 0.0)
        return found

    def _made(self, node: int, ids: Ints) -> Neighbours:
        powers = self._powers(np.full(ids.size, node), ids)
        heard = np.isfinite(powers)
        return Neighbours(ids[heard], powers[heard], self._link.senses(powers[heard]))

    def _powers(self, sources: Ints, ids: Ints) -> Floats:
        positions = self._fleet.positions
        apart = positions[sources] - positions[ids]
        distances = np.sqrt(apart[:, 0] ** 2 + apart[:, 1] ** 2)
        low, high = np.minimum(sources, ids), np.maximum(sources, ids)
        pairs = derive_each(derive_all(self._pairs, low), high.astype(np.uint64))
        directions = derive_each(derive_all(self._directions, sources), ids.astype(np.uint64))
        return self._link.powers(distances, pairs, directions)
