"""The cheapest path over links, ties included, against networkx."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest

from wsnsim.network.radio.link_graph import LinkGraph, Links

NODES = np.array([2, 3, 5, 8, 9, 12, 20, 21, 34, 40, 41, 50])


def links(seed: int, costs: int) -> Links:
    """Random links, which need not lead back; few different costs make many paths equally cheap."""
    draw = np.random.default_rng(seed)
    sources, ends = np.nonzero(draw.random((NODES.size, NODES.size)) < 0.25)
    return Links(NODES, sources, ends, draw.integers(1, costs + 1, sources.size).astype(np.float64))


def graph_of(made: Links) -> nx.DiGraph:
    """The same links in networkx, in the same order."""
    graph = nx.DiGraph()
    graph.add_nodes_from(made.nodes.tolist())
    ends = made.nodes[made.sources].tolist(), made.nodes[made.ends].tolist()
    graph.add_weighted_edges_from(zip(*ends, made.costs.tolist(), strict=True), weight="cost")
    return graph


def answer(graph: nx.DiGraph, source: int, to: int) -> tuple[float, list[int]] | None:
    try:
        return nx.bidirectional_dijkstra(graph, source, to, weight="cost")
    except nx.NetworkXNoPath:
        return None


@pytest.mark.thorough(fast=["removed2-1"])
@pytest.mark.parametrize("costs", [1, 3, 1000])
@pytest.mark.parametrize("removed", [(), (5,), (5, 41, 7)])
def test_the_path_is_that_of_networkx_among_equally_cheap_ones_too(costs, removed):
    none = 0
    for seed in range(6):
        made = links(seed, costs)
        graph, twin = LinkGraph(made), graph_of(made)
        for node in removed:
            graph.remove(node)
            twin.remove_nodes_from([node])
        for source in twin:
            for to in twin:
                found = graph.cheapest(source, to)
                assert found == answer(twin, source, to), (seed, source, to)
                none += found is None
    assert none, "some nodes are not connected"
