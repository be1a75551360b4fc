"""Whether a network is in one piece: parts of a deployment that no link joins.

    parts(positions, reach) -> [node numbers of each part], the largest first
    note(setup, positions) -> a sentence        nobody(positions, reach) -> a sentence

A disk of the communication range stands for the links, lossy ones included: beyond it no frame is received. Recorded
links are those that deliver half of the frames in both directions, in the first round.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.radio import RecordsLinks
from wsnsim.base.setups import BeaconSetup, NetworkSetup

MOST: Final = 20_000
"""Nodes above which nothing is said: a graph of more takes seconds [our choice]."""
USABLE: Final = 0.5
"""Ratio of frames that a recorded link must deliver in both directions."""
SHOWN: Final = 4
"""Parts whose sizes are given."""


def parts(positions: Floats, reach: float) -> list[Ints]:
    """The nodes of each connected part of a network, the largest first.

    Args:
        positions: (N, 2) positions in m.
        reach: communication range in m.
    """
    from scipy.spatial import KDTree  # slow to import; for `wsnsim check` alone

    return _joined(len(positions), KDTree(positions).query_pairs(reach))


def recorded_parts(link: RecordsLinks, nodes: int) -> list[Ints]:
    """The nodes of each connected part of a network of recorded links, the largest first."""
    found = [link.heard(0, source) for source in range(nodes)]
    usable = {(i, to) for i, (ids, _, ratios) in enumerate(found) for to in ids[ratios >= USABLE].tolist()}
    return _joined(nodes, {(a, b) for a, b in usable if (b, a) in usable})


def _joined(nodes: int, pairs: Iterable[tuple[int, int]]) -> list[Ints]:
    """The nodes of each part that pairs of linked nodes join, the largest first."""
    import networkx as nx  # slow to import; for `wsnsim check` alone

    graph = nx.empty_graph(nodes)
    graph.add_edges_from(pairs)
    found = sorted(nx.connected_components(graph), key=lambda part: (-len(part), min(part)))
    return [np.array(sorted(part)) for part in found]


def note(setup: NetworkSetup | BeaconSetup, positions: Floats) -> str:
    """A sentence on the parts of a network, '' if it is in one piece or too large to be looked at."""
    reach = setup.link.reach
    if not 1 < len(positions) <= MOST or not np.isfinite(reach):
        return ""
    if isinstance(setup.link, RecordsLinks):
        found, links = recorded_parts(setup.link, len(positions)), "recorded link that delivers half of the frames"
    elif said := nobody(positions, reach):
        return said
    else:
        found, links = parts(positions, reach), f"link of {reach:g} m"
    if len(found) == 1:
        return ""
    sizes = ", ".join(str(len(part)) for part in found[:SHOWN]) + (", ..." if len(found) > SHOWN else "")
    alone = sum(len(part) == 1 for part in found)
    lonely = f"; {alone} nodes have no neighbour" if alone else ""
    said = f"the network is in {len(found)} parts, of {sizes} nodes, that no {links} joins{lonely}"
    return said + _cut_off(setup.sink_points, positions, found)


def _cut_off(points: Sequence[tuple[float, float]], positions: Floats, found: Sequence[Ints]) -> str:
    """How many nodes are in parts without a sink, in words; '' if there is no sink, or none is.

    Args:
        points: (x, y) in m of each sink, which is the node nearest to it.
        positions: (N, 2) positions in m.
        found: the nodes of each part.
    """
    sinks = {int(np.hypot(*(positions - point).T).argmin()) for point in points}
    count = sum(len(part) for part in found if sinks.isdisjoint(part.tolist()))
    if not sinks or not count:
        return ""
    which = f"the sink, node {next(iter(sinks))}" if len(sinks) == 1 else "a sink, nodes " + ", ".join(map(str, sinks))
    return f"; {count} of {len(positions)} nodes have no path to {which}"


def nobody(positions: Floats, reach: float) -> str:
    """A sentence on a network of several nodes of which none is within `reach` m of another, '' for any other."""
    from scipy.spatial import KDTree

    nearest = float(KDTree(positions).query(positions, k=2)[0][:, 1].min())
    if nearest <= reach:
        return ""
    return (
        f"no node is within the communication range of {reach:g} m of another: no frame can be received; the two "
        f"nearest are {nearest:.4g} m apart"
    )
