"""Routing: the path of a datagram, whether its destination is a neighbour or not, and forwarding along such paths.

    PathForwarding(...).path(source, to) -> [source, ..., to], or None without a path

In a small network one graph holds every usable link; it is built on first use, and again after a round of recorded
links. In a large one the graph holds a
corridor: the nodes in an ellipse around both ends, wide enough that no path outside can be cheaper. SciPy's graphs are
imported where a corridor holds many nodes: most runs need none.

Proof. A path over a node v is at least |source - v| + |v - to| long, so a path that leaves the ellipse of string length
s is longer than s. Let u be the least cost of a metre, over all lengths of a hop. A path outside then costs more than
u s. A path of cost C that is found inside is therefore the cheapest of all if C <= u s. Otherwise s = C / u is long
enough, in a second search. If that s is too long, the path is the cheapest of its corridor: see WIDEST.

Where nodes follow sleep schedules, a path leads over nodes that are awake now; only its end may have to be woken. That
neighbours know each other's schedules is our choice: they exchange a seed once.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
import simpy

from wsnsim.base.arrays import Floats, Ints, scalars
from wsnsim.base.cell_grid import CellGrid
from wsnsim.base.frames import Burst
from wsnsim.base.requests import PACKET_BITS
from wsnsim.network.event_log import Acting
from wsnsim.network.radio.datagrams import A_SINK, Datagram, Hops
from wsnsim.network.radio.link_graph import SMALL, LinkGraph, Links, cheapest_of, matrix_of
from wsnsim.network.radio.topology import RadioServices

WIDEST: Final = 2.0
"""The second search is left out if its corridor would be longer by more than this factor (our choice). This happens
with the fewest hops over random links, where one strong link in thousands spans several ranges, and where electronics
cost almost nothing.
"""
LENGTHS: Final = 1000
"""Lengths of a hop at which the cost of a metre is computed."""
ROUNDING: Final = 1e-9


class PathForwarding:
    """Datagrams take the cheapest path over living nodes and usable links; those for a sink, the cheapest to any.

    Every node knows all usable links of the network at every moment, and no frame was sent to find them. Paths are
    cached until a node goes down or comes back. Where nodes follow sleep schedules they are not cached.

    Args:
        radio: The services of the radio.
        hops: Sends bursts.
        weight: What a path minimises. 'energy': the joules of a bit for sender and receiver, divided by the
            probability of a packet on the link. 'hop': the number of hops. 'greedy': each hop goes to the neighbour
            nearest to the destination, by the positions that nodes assume; the others know their links (our choice).
        longest: The distance in m beyond which no link is usable; infinity if links do not depend on distance. Then
            there are no corridors: one graph holds all links.
        sinks: The sinks.
    """

    def __init__(
        self, radio: RadioServices, hops: Hops, weight: str, longest: float, sinks: Sequence[int] = ()
    ) -> None:
        self._env, self._nodes, self._topology, self._energy, *_ = radio
        self._weight = weight
        self._longest = longest
        self._hops, self._sinks = hops, sinks
        self._graph: LinkGraph | None = None
        self._paths: dict[tuple[int, int], list[int] | None] = {}
        self._least_per_metre: float | None = None

    def path(self, source: int, to: int) -> list[int] | None:
        """Return the path, both ends included; None if there is none, or if the greedy one ends at a void."""
        if self._nodes.follows_schedules:
            return self._search(source, to)
        ends = (source, to)
        if ends not in self._paths:
            self._paths[ends] = self._search(source, to)
        return self._paths[ends]

    def cheapest_end(self, source: int, ends: Sequence[int]) -> int | None:
        """The end with the cheapest path from a node, the first of equally cheap ones; None without a path."""
        if self._weight == "greedy":
            return self._nearest_end(source, ends)
        paths = [(end, self.path(source, end)) for end in ends]
        costs = [(self._cost(path), i, end) for i, (end, path) in enumerate(paths) if path is not None]
        return min(costs)[2] if costs else None

    def remove(self, node: int) -> None:
        """Remove a node that died or crashed."""
        self._paths.clear()
        if self._graph is not None:
            self._graph.remove(node)

    def restore(self, node: int) -> None:
        """Forget all paths: those over the node may be cheaper."""
        self.forget_links()

    def forget_links(self) -> None:
        """Forget all paths, because links have changed."""
        self._paths.clear()
        self._graph = None

    def start(self) -> None:
        """Do nothing: nothing is sent to find paths."""

    def sink_of(self, source: int) -> int:
        """The sink with the cheapest path; the first one if no path leads to any."""
        if source in self._sinks:
            return source
        if len(self._sinks) == 1:
            return self._sinks[0]
        cheapest = self.cheapest_end(source, self._sinks)
        return self._sinks[0] if cheapest is None else cheapest

    def is_one_hop(self, source: int, to: int) -> bool:
        """Whether the path is one hop. A neighbour without a path has died: its sender does not know, and sends."""
        path = self.path(source, to)
        return path is None or len(path) == 2

    def forward(self, datagram: Datagram, target: int) -> simpy.Event:
        """Send a datagram along its path."""
        return self._env.process(self._relay(datagram, target))

    def _relay(self, datagram: Datagram, target: int) -> Acting[None]:
        """Send a datagram over several hops; each hop sends what arrived over the one before."""
        assert datagram.to != A_SINK, "the sink of a datagram is chosen before it is sent"
        source, parcel = datagram.source, datagram.parcel
        path = self.path(source, datagram.to)
        if path is None:
            datagram.lose()
            self._hops.drop(datagram, source, target, "no_path")
            return
        sequence, mask, packets = 0, datagram.mask, parcel.packets
        for node, to in itertools.pairwise(path):
            waking = self._hops.waking(node, to, target) if to == datagram.to else None
            if waking is not None:
                yield waking
            burst = Burst(node, to, parcel, target, mask, packets, sequence, relayed=node != source)
            datagram.hops += 1
            datagram.last_hop = burst if to == datagram.to else None
            yield self._hops.send([burst])
            datagram.bits += burst.sent
            sequence, mask, packets = burst.sequence, burst.mask, burst.packets
            if packets == 0:
                break
        datagram.end(mask, packets > 0, self._env.now)

    def _nearest_end(self, source: int, ends: Sequence[int]) -> int | None:
        """The nearest end, by the assumed positions, to which a greedy path leads."""
        places = self._nodes.assumed.positions
        away = _lengths(places[list(ends)] - places[source])
        order = np.argsort(away, kind="stable").tolist()
        return next((ends[i] for i in order if self.path(source, ends[i]) is not None), None)

    def _cost(self, path: Sequence[int]) -> float:
        """What the router minimises, of one path."""
        hops = [*pairwise(path)]
        if self._weight == "hop":
            return float(len(hops))
        probability = self._topology.probability
        joules = [self._joules(self._nodes.distance(a, b)) for a, b in hops]
        if self._topology.distance_only:
            return sum(joules)
        return sum(each / probability(a, b) for each, (a, b) in zip(joules, hops, strict=True))

    def _search(self, source: int, to: int) -> list[int] | None:
        if not (self._nodes.alive[source] and self._nodes.alive[to]):
            return None
        if self._weight != "energy" and self._topology.connected(source, to):
            return [source, to]
        if self._weight == "greedy":
            return self._greedy(source, to)
        if np.isinf(self._longest) and self._nodes.follows_schedules:
            return self._among_awake(source, to)
        if np.isfinite(self._longest) and (self._nodes.size > SMALL or self._nodes.follows_schedules):
            return self._through_corridor(source, to)
        if self._graph is None:
            self._graph = LinkGraph(self._links(np.flatnonzero(self._nodes.living)))
        found = self._graph.cheapest(source, to)
        return None if found is None else found[1]

    def _among_awake(self, source: int, to: int) -> list[int] | None:
        """The cheapest path over all nodes that are awake now."""
        network = self._nodes
        nodes = np.arange(network.size)
        awake = network.hears(nodes, self._env.now)
        awake[[source, to]] = True
        found = cheapest_of(self._links(nodes[awake]), source, to)
        return None if found is None else found[1]

    def _greedy(self, source: int, to: int) -> list[int] | None:
        """The path over the living neighbours nearest to the destination; of equally near ones, the lowest id.

        None if no neighbour is nearer than the node itself, though a longer path may exist: a void.
        """
        path = [source]
        while path[-1] != to:
            here = path[-1]
            following = to if self._topology.connected(here, to) else self._nearest(here, to)
            if following is None:
                return None
            path.append(following)
        return path

    def _nearest(self, here: int, to: int) -> int | None:
        """The usable neighbour nearest to the destination, if it is nearer than the node itself."""
        nodes = self._nodes
        ids = self._topology.neighbours(here).ids
        ids = ids[nodes.hears(ids, self._env.now)]
        places = nodes.assumed.positions
        away = _lengths(places[ids] - places[to])
        limit = _lengths(places[[here]] - places[to])[0]
        candidates = ids[np.argsort(away, kind="stable")[: np.count_nonzero(away < limit)]].tolist()
        return next((node for node in candidates if self._topology.connected(here, node)), None)

    def _through_corridor(self, source: int, to: int) -> list[int] | None:
        """The cheapest path. The corridor is doubled until it holds a path, then made long enough for the proof."""
        length, found = self._nodes.distance(source, to) + self._nodes.reach, None
        while found is None:
            nodes, detours = self._corridor(source, to, length)
            links = self._links(nodes)
            found = cheapest_of(links, source, to)
            if found is None and self._is_cut_off(links, detours, length, source, to):
                return None
            length *= 2.0
        length /= 2.0
        cost, path = found
        least = self._cost_of_a_metre()
        needed = cost / least * (1.0 + ROUNDING) if least else np.inf
        if length < needed <= WIDEST * length:
            nodes, _ = self._corridor(source, to, needed)
            wider = cheapest_of(self._links(nodes), source, to)
            assert wider is not None, "a longer corridor holds every path of a shorter one"
            path = wider[1]
        return path

    def _corridor(self, source: int, to: int, length: float) -> tuple[Ints, Floats]:
        """The living nodes v with |source - v| + |v - to| <= length, ascending, and this sum of each."""
        network = self._nodes
        one, other = network.positions[source], network.positions[to]
        nodes = network.grid.within((one + other) / 2, length / 2 * (1.0 + ROUNDING))
        ends = (nodes == source) | (nodes == to)
        nodes = nodes[network.hears(nodes, self._env.now) | (network.living[nodes] & ends)]
        detours = _lengths(network.positions[nodes] - one) + _lengths(network.positions[nodes] - other)
        inside = detours <= length
        return nodes[inside], detours[inside]

    def _is_cut_off(self, links: Links, detours: Floats, length: float, source: int, to: int) -> bool:
        """Whether no wider corridor can hold a path.

        It cannot if no node is outside, or if the component of one end lies so deep inside that no link leads out of
        the corridor: a link is at most `longest`, and adds at most twice that to a detour.
        """
        if links.nodes.size == np.count_nonzero(self._nodes.living):
            return True
        from scipy.sparse.csgraph import connected_components

        _, component = connected_components(matrix_of(links), directed=False)
        edge = detours + 2.0 * self._longest > length
        return any(not edge[component == component[np.searchsorted(links.nodes, end)]].any() for end in (source, to))

    def _links(self, nodes: Ints) -> Links:
        """The usable links among living nodes, sorted."""
        sources, ends, probabilities = (
            self._disk_links(nodes) if self._topology.distance_only else self._random_links(nodes)
        )
        if self._weight == "hop":
            return Links(nodes, sources, ends, np.ones(sources.size))
        positions = self._nodes.positions[nodes]
        lengths, which = np.unique(np.linalg.norm(positions[sources] - positions[ends], axis=1), return_inverse=True)
        costs = np.fromiter(map(self._joules, scalars(lengths)), np.float64, lengths.size)
        return Links(nodes, sources, ends, costs[which] / probabilities)

    def _disk_links(self, nodes: Ints) -> tuple[Ints, Ints, Floats | float]:
        """The links between nodes within range of each other, with probability 1."""
        network = self._nodes
        grid = network.grid if nodes.size == network.size else CellGrid(network.positions[nodes])
        return *grid.links(network.reach), 1.0

    def _random_links(self, nodes: Ints) -> tuple[Ints, Ints, Floats]:
        """The links that are usable in both directions, with the probability of a packet on each."""
        topology, size = self._topology, max(nodes.size, 1)
        keys, probabilities = [np.empty(0, dtype=np.int64)], [np.empty(0)]
        for index, node in enumerate(nodes.tolist()):
            neighbours = topology.neighbours(node)
            at = np.minimum(np.searchsorted(nodes, neighbours.ids), size - 1)
            usable = topology.reliable(neighbours, PACKET_BITS) & (nodes[at] == neighbours.ids)
            keys.append(index * size + at[usable])
            probabilities.append(topology.probabilities(neighbours, PACKET_BITS)[usable])
        key, probability = np.concatenate(keys), np.concatenate(probabilities)
        sources, ends = np.divmod(key, size)
        both = np.isin(ends * size + sources, key, assume_unique=True)
        return sources[both], ends[both], probability[both]

    def _joules(self, distance: float) -> float:
        """The joules of a bit over a hop, for sender and receiver."""
        return sum(self._energy.transmit(1.0, distance)) + self._energy.receive(1.0)

    def _cost_of_a_metre(self) -> float:
        """A lower bound on the cost of a metre of a path.

        A hop whose length is between a < b costs at least as much as one of length a, and a metre of it at least that
        divided by b. This holds for every energy model in which a longer hop is not cheaper.
        """
        if self._least_per_metre is None:
            lengths = np.linspace(0.0, self._longest, LENGTHS + 1)
            costs = [1.0 if self._weight == "hop" else self._joules(length) for length in lengths.tolist()]
            self._least_per_metre = float((np.array(costs[:-1]) / lengths[1:]).min())
        return self._least_per_metre


def _lengths(apart: Floats) -> Floats:
    """(n,) lengths of vectors (n, 2)."""
    result: Floats = np.sqrt((apart**2).sum(axis=1))
    return result
