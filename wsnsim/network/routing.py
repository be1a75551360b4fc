"""The path that a message takes where its destination is out of reach. networkx lives here.

Router(fleet, energy, weight).path(source, to) -> [source, ..., to], or None where there is none
"""

from __future__ import annotations

import networkx as nx
import numpy as np

from wsnsim.base.ports import EnergyModel
from wsnsim.network.fleet import Fleet


class Router:
    """Shortest paths among living nodes, by energy a bit ('energy') or hops ('hop'), on a graph made when needed."""

    def __init__(self, fleet: Fleet, energy: EnergyModel, weight: str) -> None:
        self._fleet = fleet
        self._energy = energy
        self._weight = weight
        self._graph: nx.Graph | None = None
        self._known: dict[tuple[int, int], list[int] | None] = {}

    def path(self, source: int, to: int) -> list[int] | None:
        """The cheapest path over living nodes, both ends included; looked for once, until a node dies."""
        ends = (source, to)
        if ends not in self._known:
            self._known[ends] = self._search(source, to)
        return self._known[ends]

    def _search(self, source: int, to: int) -> list[int] | None:
        graph = self._graph if self._graph is not None else self._build()
        for end in (source, to):
            if end not in graph:
                return None
        try:
            return list(nx.bidirectional_dijkstra(graph, source, to, weight="cost")[1])
        except nx.NetworkXNoPath:
            return None

    def bury(self, node: int) -> None:
        """A dead node relays nothing."""
        self._known.clear()
        if self._graph is not None and node in self._graph:
            self._graph.remove_node(node)

    def _build(self) -> nx.Graph:
        fleet = self._fleet
        graph = nx.Graph()
        graph.add_nodes_from(node for node in range(fleet.size) if fleet.alive[node])
        pairs = fleet.tree.query_pairs(fleet.reach, output_type="ndarray")
        pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
        distances = np.linalg.norm(fleet.positions[pairs[:, 0]] - fleet.positions[pairs[:, 1]], axis=1)
        costs = map(self._cost, distances.tolist())
        links = zip(*pairs.T.tolist(), costs, strict=True) if len(pairs) else ()
        graph.add_weighted_edges_from(
            [link for link in links if fleet.alive[link[0]] and fleet.alive[link[1]]], weight="cost"
        )
        self._graph = graph
        return graph

    def _cost(self, distance: float) -> float:
        if self._weight == "hop":
            return 1.0
        return sum(self._energy.transmit(1.0, distance)) + self._energy.receive(1.0)
