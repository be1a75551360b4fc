"""Routing: paths compared with a graph of all pairs, corridors with whole networks, greedy paths by hand; crashes."""

import itertools

import networkx as nx
import numpy as np
import pytest

import wsnsim.network.radio.routing as routing
from tests.helpers.thorough import first
from tests.network.radio_network import RadioNetwork
from wsnsim.models.access import IdealMac
from wsnsim.models.energy import FirstOrder, FirstOrder2002
from wsnsim.models.links import Disk, LogNormal


class Routes:
    """Nodes, their links, and a router over them."""

    def __init__(self, positions, link=None, weight="energy", energy=None):
        network = RadioNetwork(
            positions, mac=IdealMac(), link=link or Disk(reach=75.0), energy=energy or FirstOrder(), weight=weight
        )
        self.energy, self.weight = network.radio.energy, weight
        self.nodes, self.topology, self.router = network.nodes, network.topology, network.router

    def cost(self, a, b):
        """The cost of a link, by its definition."""
        if self.weight == "hop":
            return 1.0
        distance = float(np.hypot(*(self.nodes.positions[a] - self.nodes.positions[b])))
        bit = sum(self.energy.transmit(1.0, distance)) + self.energy.receive(1.0)
        return bit / (1.0 if self.topology.distance_only else self.topology.probability(a, b))

    def everything(self):
        """The graph of all living pairs that are connected."""
        graph = nx.DiGraph()
        living = np.flatnonzero(self.nodes.living).tolist()
        graph.add_nodes_from(living)
        for a, b in itertools.permutations(living, 2):
            if self.topology.connected(a, b):
                graph.add_edge(a, b, w=self.cost(a, b))
        return graph

    def down(self, node):
        self.nodes.crash(node)
        self.router.remove(node)

    def up(self, node):
        self.nodes.restart(node, 0.0)
        self.router.forget_links()


def uniform(seed, nodes, side):
    return np.random.default_rng(seed).uniform(-side / 2, side / 2, (nodes, 2))


def true_cost(graph, a, b):
    try:
        return nx.shortest_path_length(graph, a, b, weight="w")
    except nx.NetworkXNoPath:
        return None


def disagreements(net, pairs):
    """Pairs for which the router finds no cheapest path, or finds a path although none exists."""
    graph, wrong = net.everything(), []
    for a, b in pairs:
        found, truth = net.router.path(a, b), true_cost(graph, a, b)
        cost = None if found is None else sum(net.cost(x, y) for x, y in itertools.pairwise(found))
        if found is not None:
            assert (found[0], found[-1]) == (a, b) and all(graph.has_edge(x, y) for x, y in itertools.pairwise(found))
        if (cost is None) != (truth is None) or (truth is not None and cost != pytest.approx(truth, rel=1e-12)):
            wrong.append((a, b, cost, truth))
    return wrong


LINKS = {"disk": Disk(reach=75.0), "lossy": Disk(reach=75.0, loss=0.2), "log_normal": LogNormal(power=3.0)}
ENERGIES = {"first": FirstOrder(), "2002": FirstOrder2002(), "cheap": FirstOrder(electronics=1e-9)}


@pytest.mark.thorough(fast=["disk-hop-False"])
@pytest.mark.parametrize("corridor", [False, True])
@pytest.mark.parametrize("weight", ["energy", "hop"])
@pytest.mark.parametrize("link", first(1, list(LINKS)))
def test_a_path_is_the_cheapest_in_a_corridor_and_in_the_whole_network(link, weight, corridor, monkeypatch):
    """Sparse fields, where some nodes are cut off and paths make long detours; every proof is carried out."""
    if corridor:
        monkeypatch.setattr(routing, "SMALL", 3)
        monkeypatch.setattr(routing, "WIDEST", 1e9)
    draw = np.random.default_rng(1)
    for seed in range(3):
        net = Routes(uniform(seed, 90, 500.0), LINKS[link], weight)
        assert disagreements(net, draw.integers(0, 90, (25, 2)).tolist()) == []


@pytest.mark.thorough
@pytest.mark.parametrize("energy", ENERGIES)
def test_a_corridor_is_widened_until_its_path_is_proved_the_cheapest(energy, monkeypatch):
    """With cheap electronics a detour with short hops is the cheapest path; the first corridor is too narrow for it."""
    monkeypatch.setattr(routing, "WIDEST", 1e9)
    net = Routes(uniform(5, 150, 400.0), energy=ENERGIES[energy])
    pairs = np.random.default_rng(2).integers(0, 150, (40, 2)).tolist()
    monkeypatch.setattr(routing, "SMALL", 149)
    assert disagreements(net, pairs) == []


@pytest.mark.thorough
def test_the_fewest_hops_over_random_links_are_seldom_outside_the_corridor(monkeypatch):
    """The one case without proof: a strong link spans several ranges, and only a huge corridor is sure to hold it."""
    net = Routes(uniform(20, 200, 350.0), LINKS["log_normal"], "hop")
    pairs = np.random.default_rng(0).integers(0, 200, (150, 2)).tolist()
    monkeypatch.setattr(routing, "SMALL", 3)
    wrong = disagreements(net, pairs)
    assert len(wrong) <= 0.05 * len(pairs)
    assert all(cost == truth + 1 for _, _, cost, truth in wrong)


def test_a_path_around_a_void_is_found_outside_the_first_corridor(monkeypatch):
    monkeypatch.setattr(routing, "SMALL", 2)
    angles = np.linspace(0.0, np.pi, 13)
    ring = np.column_stack([200.0 * np.cos(angles), 200.0 * np.sin(angles)])
    net = Routes(np.vstack([ring, [[0.0, -150.0]]]), weight="hop", link=Disk(reach=60.0))
    assert net.router.path(0, 12) == list(range(13))
    assert net.router.path(0, 13) is None


def test_an_isolated_component_is_found_without_searching_the_whole_network(monkeypatch):
    """Two nodes apart from 3,000 others: links at the other end of the field are not computed."""
    others = uniform(3, 3000, 2000.0)
    others = others[np.hypot(*(others - [400.0, 400.0]).T) > 200.0]
    net = Routes(np.vstack([others, [[400.0, 400.0], [410.0, 400.0]]]))
    sizes, links = [], routing.PathForwarding._links
    monkeypatch.setattr(
        routing.PathForwarding, "_links", lambda self, nodes: sizes.append(nodes.size) or links(self, nodes)
    )
    near = int(np.argmin(np.hypot(*(others - [150.0, 400.0]).T)))
    assert net.router.path(near, len(others)) is None
    assert max(sizes) < 1000


@pytest.mark.thorough
@pytest.mark.parametrize("weight", ["energy", "hop"])
def test_a_corridor_of_many_nodes_gives_the_same_paths_as_one_of_few(weight, monkeypatch):
    positions = uniform(8, 400, 600.0)
    whole, corridor, sparse = (Routes(positions, weight=weight) for _ in range(3))
    pairs = np.random.default_rng(3).integers(0, 400, (20, 2)).tolist()

    def costs(net):
        paths = [net.router.path(a, b) for a, b in pairs]
        return [path and sum(net.cost(x, y) for x, y in itertools.pairwise(path)) for path in paths]

    truth = costs(whole)
    monkeypatch.setattr(routing, "SMALL", 399)
    assert costs(corridor) == pytest.approx(truth, rel=1e-12)
    monkeypatch.setattr(routing, "SMALL", 0)
    assert costs(sparse) == pytest.approx(truth, rel=1e-12)


@pytest.mark.parametrize("small", [0, 2000])
@pytest.mark.parametrize("weight", ["energy", "hop", "greedy"])
def test_a_node_that_is_down_relays_nothing_and_relays_again_when_it_is_back(weight, small, monkeypatch):
    monkeypatch.setattr(routing, "SMALL", small)
    net = Routes([(0, 0), (60, 0), (50, 40), (120, 0), (90, 50)], weight=weight)
    assert net.router.path(0, 3) == [0, 1, 3]
    net.down(1)
    assert net.router.path(0, 3) == [0, 2, 4, 3]
    net.down(2)
    assert net.router.path(0, 3) is None
    net.up(1)
    assert net.router.path(0, 3) == [0, 1, 3]
    net.down(3)
    assert net.router.path(0, 3) is None and net.router.path(3, 0) is None
    net.up(3)
    assert net.router.path(3, 0) == [3, 1, 0]


def test_a_greedy_path_goes_nearest_to_the_destination_at_each_hop():
    """From 0 at the origin to 4 at 200 m: 2 is nearer to the destination than 1, then 3; 1 is never used."""
    net = Routes([(0, 0), (50, 0), (70, 10), (135, 0), (200, 0)], weight="greedy")
    assert net.router.path(0, 4) == [0, 2, 3, 4]


def test_a_greedy_path_ends_at_a_void_though_another_path_exists():
    """All neighbours of 0 are farther from the destination than 0 is, though a path leads over them."""
    round_it = [(0, 0), (-20, 60), (30, 110), (90, 110), (140, 60), (150, 0)]
    assert Routes(round_it, weight="hop").router.path(0, 5) == [0, 1, 2, 3, 4, 5]
    assert Routes(round_it, weight="greedy").router.path(0, 5) is None


def test_a_greedy_path_between_nodes_at_one_point_is_direct():
    net = Routes([(0, 0), (100, 0), (60, 0), (100, 0), (60, 0)], weight="greedy")
    assert net.router.path(0, 3) == [0, 2, 3]
    assert net.router.path(0, 1) == [0, 2, 1]


@pytest.mark.parametrize("link", LINKS)
def test_every_hop_of_a_greedy_path_is_usable_alive_and_nearer(link):
    net = Routes(uniform(6, 250, 400.0), LINKS[link], "greedy")
    for node in range(0, 250, 10):
        net.down(node)
    stuck = 0
    for a, b in np.random.default_rng(4).integers(0, 250, (60, 2)).tolist():
        found = net.router.path(a, b)
        if found is None:
            stuck += 1
            continue
        away = [net.nodes.distance(node, b) for node in found]
        assert all(x > y for x, y in itertools.pairwise(away)) and found[-1] == b
        assert all(net.topology.connected(x, y) and net.nodes.alive[x] for x, y in itertools.pairwise(found))
    assert 0 < stuck < 30, "the dead are never reached, most of the living are"


def test_a_link_that_loses_packets_is_avoided_where_a_good_one_costs_less():
    """The expected energy of a bit is divided by its probability of arrival: a bad link costs more per metre."""
    net = Routes(uniform(9, 80, 220.0), LogNormal())
    graph = net.everything()
    bad = [(a, b) for a, b in graph.edges if net.topology.probability(a, b) < 0.9]
    assert bad, "no weak link in this field: the test says nothing"
    used = [hop for a, b in bad for hop in itertools.pairwise(net.router.path(a, b))]
    assert sum(net.topology.probability(*hop) > 0.99 for hop in used) > len(used) / 2


def test_the_least_cost_of_a_metre_belongs_to_the_best_length_of_a_hop():
    """First order: (e + a d²) / d is least at d = sqrt(e / a), 2 sqrt(e a); with hops it is 1 / range."""
    bound = Routes([(0, 0)]).router._cost_of_a_metre()
    assert 0.99 < bound / (2.0 * np.sqrt(100e-9 * 100e-12)) <= 1.0
    assert Routes([(0, 0)], weight="hop").router._cost_of_a_metre() == pytest.approx(1 / 75.0)
