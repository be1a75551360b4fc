"""The path that a message takes where its destination is out of reach. networkx lives here.

    Router(env, fleet, wiring, energy, weight, longest).path(source, to) -> [source, ..., to], or None without a path

Small networks: one networkx graph of every usable link, made when first needed. Large ones: a graph of a corridor, of
the nodes in an ellipse about both ends, never of all pairs; wide enough that no path outside can be cheaper.

Why that is certain. A path by way of a node v is at least |source - v| + |v - to| long, so one that leaves the ellipse
of string length s is longer than s. Let u be the least that a metre costs, over all lengths of a hop: then it costs
more than u s. A path found inside for C is therefore the cheapest of all if C <= u s, and if it is not, s = C / u is
long enough, in a second search. Where that is out of proportion the path is the cheapest of its corridor: see WIDEST.

Where nodes sleep by a schedule a path leads over nodes that are awake now, but for its end, which may have to be
woken. That neighbours know each other's schedules is our choice: they need only exchange a seed once.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import networkx as nx
import numpy as np
import simpy
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import KDTree

from wsnsim.base.arrays import Floats, Ints, scalars
from wsnsim.base.radio import EnergyModel
from wsnsim.base.requests import PACKET_BITS
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.topology import Topology

SMALL: Final = 2000
"""Nodes up to which a graph is networkx's; the graph of a larger corridor is a sparse matrix, a tenth of the memory."""
WIDEST: Final = 2.0
"""A proof that needs a corridor longer by more than this factor is not sought (our choice). It is so with fewest hops
over drawn links, where one lucky link in thousands spans several reaches, and where electronics cost next to nothing.
"""
LENGTHS: Final = 1000
"""Lengths of a hop that the cost of a metre is bounded on."""
ROUNDING: Final = 1e-9


class Links(NamedTuple):
    """Usable links among `nodes` (ascending ids), by (sources, ends), indices into `nodes`; what each costs."""

    nodes: Ints
    sources: Ints
    ends: Ints
    costs: Floats


class Router:
    """Cheapest paths among living nodes over usable links, looked for once, until a node goes down or comes back.

    Where nodes sleep they are looked for anew each time, among those who are awake.

    `weight`: 'energy', the joules that a bit costs its sender and its receiver, over the link's chance of a packet;
    'hop', 1 a link; 'greedy', always to the neighbour nearest to the goal. `longest`: m beyond which no link is usable.
    """

    def __init__(
        self, env: simpy.Environment, fleet: Nodes, wiring: Topology, energy: EnergyModel, weight: str, longest: float
    ) -> None:
        self._env = env
        self._fleet = fleet
        self._wiring = wiring
        self._energy = energy
        self._weight = weight
        self._longest = longest
        self._graph: nx.DiGraph | None = None
        self._known: dict[tuple[int, int], list[int] | None] = {}
        self._least_a_metre: float | None = None

    def path(self, source: int, to: int) -> list[int] | None:
        """The path over living nodes, both ends included; None if there is none, or if a greedy one gets stuck."""
        if self._fleet.follows_schedules:
            return self._search(source, to)
        ends = (source, to)
        if ends not in self._known:
            self._known[ends] = self._search(source, to)
        return self._known[ends]

    def bury(self, node: int) -> None:
        """A node that is dead or down relays nothing."""
        self._known.clear()
        if self._graph is not None and node in self._graph:
            self._graph.remove_node(node)

    def revive(self, node: int) -> None:
        """A node is back: every path may be another."""
        self._known.clear()
        self._graph = None

    def _search(self, source: int, to: int) -> list[int] | None:
        if not (self._fleet.alive[source] and self._fleet.alive[to]):
            return None
        if self._weight == "greedy":
            return self._greedy(source, to)
        if self._fleet.size > SMALL or self._fleet.follows_schedules:
            return self._through_corridor(source, to)
        if self._graph is None:
            self._graph = _graph(self._links(np.flatnonzero(self._fleet.living)))
        found = _cheapest(self._graph, source, to)
        return None if found is None else found[1]

    def _greedy(self, source: int, to: int) -> list[int] | None:
        """Hop by hop to the living neighbour nearest to the goal, of equally near ones the lowest id.

        None where no neighbour is nearer than the node itself, though there may be a way around: the known weakness.
        """
        path = [source]
        while path[-1] != to:
            here = path[-1]
            following = to if self._wiring.connected(here, to) else self._nearer(here, to)
            if following is None:
                return None
            path.append(following)
        return path

    def _nearer(self, here: int, to: int) -> int | None:
        fleet = self._fleet
        ids = self._wiring.audience(here).ids
        ids = ids[fleet.hears(ids, self._env.now)]
        away = _lengths(fleet.positions[ids] - fleet.positions[to])
        limit = _lengths(fleet.positions[[here]] - fleet.positions[to])[0]
        candidates = ids[np.argsort(away, kind="stable")[: np.count_nonzero(away < limit)]].tolist()
        return next((node for node in candidates if self._wiring.connected(here, node)), None)

    def _through_corridor(self, source: int, to: int) -> list[int] | None:
        """The cheapest path: the corridor is doubled until there is one, and then made long enough for the proof."""
        length, found = self._fleet.distance(source, to) + self._fleet.reach, None
        while found is None:
            nodes, detours = self._corridor(source, to, length)
            links = self._links(nodes)
            found = _cheapest_of(links, source, to)
            if found is None and self._is_cut_off(links, detours, length, source, to):
                return None
            length *= 2.0
        length /= 2.0
        cost, path = found
        least = self._per_metre()
        needed = cost / least * (1.0 + ROUNDING) if least else np.inf
        if length < needed <= WIDEST * length:
            nodes, _ = self._corridor(source, to, needed)
            wider = _cheapest_of(self._links(nodes), source, to)
            assert wider is not None, "a longer corridor holds every path of a shorter one"
            path = wider[1]
        return path

    def _corridor(self, source: int, to: int, length: float) -> tuple[Ints, Floats]:
        """Living nodes v, ascending, with |source - v| + |v - to| <= length, and that sum for each."""
        fleet = self._fleet
        one, other = fleet.positions[source], fleet.positions[to]
        near = fleet.tree.query_ball_point((one + other) / 2, length / 2 * (1.0 + ROUNDING), return_sorted=True)
        nodes = np.array(near, dtype=np.int64)
        ends = (nodes == source) | (nodes == to)
        nodes = nodes[fleet.hears(nodes, self._env.now) | (fleet.living[nodes] & ends)]
        detours = _lengths(fleet.positions[nodes] - one) + _lengths(fleet.positions[nodes] - other)
        inside = detours <= length
        return nodes[inside], detours[inside]

    def _is_cut_off(self, links: Links, detours: Floats, length: float, source: int, to: int) -> bool:
        """Whether no wider corridor can help: there is nobody outside, or nobody there can hear the one end's island.

        A link is no longer than `longest`, so it adds no more than twice that to a detour.
        """
        if links.nodes.size == np.count_nonzero(self._fleet.living):
            return True
        _, islands = connected_components(_matrix(links), directed=False)
        edge = detours + 2.0 * self._longest > length
        return any(not edge[islands == islands[np.searchsorted(links.nodes, end)]].any() for end in (source, to))

    def _links(self, nodes: Ints) -> Links:
        """Every usable link among living nodes, sorted."""
        sources, ends, chances = self._disk_links(nodes) if self._wiring.sharp else self._drawn_links(nodes)
        if self._weight == "hop":
            return Links(nodes, sources, ends, np.ones(sources.size))
        positions = self._fleet.positions[nodes]
        lengths = np.linalg.norm(positions[sources] - positions[ends], axis=1)
        costs = np.fromiter(map(self._joules, scalars(lengths)), np.float64, lengths.size)
        return Links(nodes, sources, ends, costs / chances)

    def _disk_links(self, nodes: Ints) -> tuple[Ints, Ints, Floats | float]:
        """Whoever is within reach."""
        fleet = self._fleet
        tree = fleet.tree if nodes.size == fleet.size else KDTree(fleet.positions[nodes])
        pairs = tree.query_pairs(fleet.reach, output_type="ndarray")
        both = np.concatenate([pairs, pairs[:, ::-1]])
        both = both[np.lexsort((both[:, 1], both[:, 0]))]
        return both[:, 0], both[:, 1], 1.0

    def _drawn_links(self, nodes: Ints) -> tuple[Ints, Ints, Floats]:
        """Whoever may hear each node, where both directions are good enough; the chance of a packet in this one."""
        wiring, size = self._wiring, max(nodes.size, 1)
        keys, chances = [np.empty(0, dtype=np.int64)], [np.empty(0)]
        for index, node in enumerate(nodes.tolist()):
            audience = wiring.audience(node)
            at = np.minimum(np.searchsorted(nodes, audience.ids), size - 1)
            usable = wiring.reliable(audience, PACKET_BITS) & (nodes[at] == audience.ids)
            keys.append(index * size + at[usable])
            chances.append(wiring.chances(audience, PACKET_BITS)[usable])
        key, chance = np.concatenate(keys), np.concatenate(chances)
        sources, ends = np.divmod(key, size)
        both = np.isin(ends * size + sources, key, assume_unique=True)
        return sources[both], ends[both], chance[both]

    def _joules(self, distance: float) -> float:
        """What a bit costs over a hop, both ends together."""
        return sum(self._energy.transmit(1.0, distance)) + self._energy.receive(1.0)

    def _per_metre(self) -> float:
        """A lower bound on what a metre of a path costs.

        Between two lengths a < b a hop costs what it does over a or more, so a metre of it that over b or more: true of
        every model in which a longer hop is not cheaper.
        """
        if self._least_a_metre is None:
            lengths = np.linspace(0.0, self._longest, LENGTHS + 1)
            costs = [1.0 if self._weight == "hop" else self._joules(length) for length in lengths.tolist()]
            self._least_a_metre = float((np.array(costs[:-1]) / lengths[1:]).min())
        return self._least_a_metre


def _graph(links: Links) -> nx.DiGraph:
    graph = nx.DiGraph()
    graph.add_nodes_from(links.nodes.tolist())
    sources, ends = links.nodes[links.sources].tolist(), links.nodes[links.ends].tolist()
    graph.add_weighted_edges_from(zip(sources, ends, links.costs.tolist(), strict=True), weight="cost")
    return graph


def _matrix(links: Links) -> csr_array:
    """Costs as a sparse matrix. A link that costs nothing would be none there: it costs next to nothing."""
    costs = np.maximum(links.costs, np.finfo(np.float64).tiny)
    return csr_array((costs, (links.sources, links.ends)), shape=(links.nodes.size, links.nodes.size))


def _cheapest(graph: nx.DiGraph, source: int, to: int) -> tuple[float, list[int]] | None:
    """(cost, path), None without a path."""
    try:
        cost, path = nx.bidirectional_dijkstra(graph, source, to, weight="cost")
    except nx.NetworkXNoPath:
        return None
    return float(cost), list(path)


def _cheapest_of(links: Links, source: int, to: int) -> tuple[float, list[int]] | None:
    """The same among links that are looked at once."""
    if links.nodes.size <= SMALL:
        return _cheapest(_graph(links), source, to)
    first, last = np.searchsorted(links.nodes, (source, to)).tolist()
    costs, before = dijkstra(_matrix(links), indices=first, return_predecessors=True)
    if not np.isfinite(costs[last]):
        return None
    backwards = [last]
    while backwards[-1] != first:
        backwards.append(int(before[backwards[-1]]))
    return float(costs[last]), links.nodes[backwards[::-1]].tolist()


def _lengths(apart: Floats) -> Floats:
    """(n,) of vectors (n, 2)."""
    return np.sqrt((apart**2).sum(axis=1))
