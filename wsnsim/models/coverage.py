"""Coverage of the field by sensing ranges: nodes cover it if every point is within the range of at least one node.

covers(positions (N, 2), reach, width, height) -> bool, exactly      coverage(...) -> fraction, on a fixed lattice

Positions are relative to the field's centre. The range `reach` may be infinite: one node then covers any field.

`outside`, `too_few` and `uncovered` say what is wrong with a deployment.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.cell_grid import CellGrid, ranges
from wsnsim.base.errors import Issue
from wsnsim.base.network_ports import Deployment, Field
from wsnsim.base.setups import NetworkSetup, RadioSetup, Setup, TrackingSetup

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

TURN = 2.0 * math.pi
TOLERANCE = 1e-9
"""Gaps between arcs below this angle (rad) are rounding error, as where circles touch exactly."""
NEAREST = 16
"""Number of nearest neighbours tried first. They usually hide a circle, and further neighbours cannot uncover it."""
AT_ONCE = 20_000
"""Circles examined together: bounds the memory for sorting."""
DISCS: Final = 5_000
"""Nodes whose discs are laid over the lattice together: bounds the memory."""
SMALL: Final = 1000
"""Nodes up to which SciPy's k-d tree is not used: its import takes longer than all the rest."""


def nodes_needed(reach: float, width: float, height: float) -> int:
    """A lower bound on the number of nodes that cover the field.

    In a covering, a disc accounts for at most the area of its inscribed regular hexagon:
    N >= 2 / (3 sqrt(3)) · area / reach² (Kershner 1939; for a convex polygon of at most six sides, Fejes Tóth 1953).
    """
    hexagons = 2.0 / (3.0 * math.sqrt(3.0)) * width * height / (reach * reach)
    return max(math.ceil(hexagons - TOLERANCE), 1)


def covers(positions: Floats, reach: float, width: float, height: float) -> bool:
    """Whether every point of the field, its edge included, is within range of a node. Exact up to 1e-9 rad.

    If the field is covered in part only, the border between the parts includes an arc of a node's circle that lies in
    the field and in no other disc. So the field is covered if every circle is hidden: each of its points lies in
    another disc or outside the field. Positions (N, 2) must be in the field. The cost is O(N log N) where the nearest
    neighbours hide the circles.

    Source: the perimeter coverage of Huang and Tseng (2003), "The coverage problem in a wireless sensor network".
    """
    centres = np.unique(positions, axis=0)
    if not len(centres) or math.isinf(reach):
        return len(centres) > 0
    few = len(centres) <= SMALL
    return (_covers_with_few if few else _covers_with_many)(centres, reach, width, height)


def _covers_with_few(centres: Floats, reach: float, width: float, height: float) -> bool:
    """What `covers` returns for different nodes, so few that all their pairs fit into memory."""
    grid, circles = CellGrid(centres), np.arange(len(centres))
    near = math.sqrt(NEAREST * width * height / (math.pi * len(centres)))
    for radius in (min(near, 2 * reach), 2 * reach):
        owner, neighbour = grid.within_each(centres[circles], radius)
        others = circles[owner] != neighbour
        hidden = _hidden(centres, circles, owner[others], neighbour[others], reach, width, height)
        circles = circles[~hidden]
    return not circles.size


def _covers_with_many(centres: Floats, reach: float, width: float, height: float) -> bool:
    """What `covers` returns for different nodes."""
    from scipy.spatial import cKDTree  # slow to import, and needed in large networks only

    tree = cKDTree(centres)
    some = (np.arange(first, min(first + AT_ONCE, len(centres))) for first in range(0, len(centres), AT_ONCE))
    doubtful = (
        circles[~_hidden(centres, circles, *_nearest_pairs(tree, circles, reach), reach, width, height)]
        for circles in some
    )
    return all(
        _hidden(centres, np.array([i]), *_all_pairs(tree, int(i), reach), reach, width, height)[0]
        for circles in doubtful
        for i in circles
    )


def coverage(positions: Floats, reach: float, width: float, height: float, side: int = 200) -> float:
    """The fraction of the field within range of a node, evaluated at the centres of side² cells.

    Args:
        positions: (N, 2) in m, relative to the field's centre.
        reach: range of a node, in m.
        width: width of the field, in x, in m.
        height: height of the field, in y, in m.
        side: cells along each side.
    """
    x, y = (length * ((np.arange(side) + 0.5) / side - 0.5) for length in (width, height))
    changes = np.zeros(side * (side + 1), dtype=np.int64)  # of the number of discs from cell to cell along a row
    radius = reach * (1 + TOLERANCE)
    for first in range(0, len(positions), DISCS):
        centre_x, centre_y = positions[first : first + DISCS].T
        low, high = np.searchsorted(y, centre_y - radius), np.searchsorted(y, centre_y + radius, side="right")
        node, row = ranges(low, high)
        half = np.sqrt(np.maximum(radius**2 - (y[row] - centre_y[node]) ** 2, 0.0))
        begin = np.searchsorted(x, centre_x[node] - half, side="right")
        end = np.searchsorted(x, centre_x[node] + half, side="left")
        changes += np.bincount(row * (side + 1) + begin, minlength=changes.size)
        changes -= np.bincount(row * (side + 1) + end, minlength=changes.size)
    return float((changes.reshape(side, side + 1).cumsum(axis=1)[:, :-1] > 0).mean())


def coverage_of_living(deploy: Deployment, reach: float, positions: Floats, living: Bools) -> float:
    """The fraction of a deployment's field within sensing range (`reach`, m) of a living node.

    Args:
        deploy: The deployment. If its `cover` is true, it has checked that all nodes together cover the field.
        reach: The sensing range in m.
        positions: (N, 2) positions of the nodes in m, not relative to the field's centre.
        living: (N,) which nodes live.
    """
    all_live, field = bool(living.all()), deploy.field
    if all_live and getattr(deploy, "cover", False):
        return 1.0
    if all_live and field.centre == (0.0, 0.0):
        return coverage(positions, reach, field.width, field.height)
    return coverage(positions[living] - np.array(field.centre), reach, field.width, field.height)


def _nearest_pairs(tree: cKDTree, circles: Ints, reach: float) -> tuple[Ints, Ints]:
    """(index into circles, neighbour) pairs: each circle with the nearest nodes whose discs overlap its disc."""
    near = tree.query(tree.data[circles], k=min(NEAREST + 1, tree.n), distance_upper_bound=2 * reach)
    distances, neighbours = (np.reshape(values, (circles.size, -1)) for values in near)
    chosen = np.isfinite(distances) & (neighbours != circles[:, None])
    return np.nonzero(chosen)[0], neighbours[chosen]


def _all_pairs(tree: cKDTree, node: int, reach: float) -> tuple[Ints, Ints]:
    """(circle, neighbour) pairs of one node with all nodes whose discs overlap its disc; the circle's index is 0."""
    neighbours = np.array([i for i in tree.query_ball_point(tree.data[node], 2 * reach) if i != node], dtype=np.int64)
    return np.zeros(neighbours.size, dtype=np.int64), neighbours


def _hidden(
    centres: Floats, circles: Ints, owner: Ints, neighbour: Ints, reach: float, width: float, height: float
) -> Bools:
    """(n,) whether each circle is hidden, from pairs of `owner` (index into circles) and `neighbour` (into centres)."""
    apart = centres[neighbour] - centres[circles[owner]]
    middle = np.arctan2(apart[:, 1], apart[:, 0])
    half = np.arccos(np.minimum(np.hypot(apart[:, 0], apart[:, 1]) / (2 * reach), 1.0))
    outer, outer_middle, outer_half = _outside(centres[circles], reach, width, height)
    return _closed(
        np.concatenate([owner, outer]),
        np.concatenate([middle, outer_middle]),
        np.concatenate([half, outer_half]),
        len(circles),
    )


def _outside(centres: Floats, reach: float, width: float, height: float) -> tuple[Ints, Floats, Floats]:
    """The arcs of circles that lie outside the field, up to four per circle: (circle, middle, half angle)."""
    corner = np.array([width, height]) / 2
    gaps = np.concatenate([corner - centres, corner + centres], axis=1)
    circle, edge = np.nonzero(gaps < reach)
    middle = edge.astype(np.float64) * (math.pi / 2)
    return circle, middle, np.arccos(np.clip(gaps[circle, edge] / reach, 0.0, 1.0))


def _closed(owner: Ints, middle: Floats, half: Floats, circles: int) -> Bools:
    """(circles,) whether the closed arcs [middle - half, middle + half] of each circle leave no gap."""
    first = np.mod(middle - half, TURN)
    last = first + 2 * half
    wrapped = last > TURN
    owner = np.concatenate([owner, owner[wrapped], np.arange(circles)])
    first = np.concatenate([first, first[wrapped] - TURN, np.full(circles, TURN)])
    last = np.concatenate([last, last[wrapped] - TURN, np.full(circles, TURN)])
    order = np.lexsort((first, owner))
    owner, first, last = owner[order], first[order], last[order]
    base = owner * (3 * TURN)
    reached = np.maximum.accumulate(np.concatenate([[0.0], np.maximum(last, 0.0) + base])[:-1])
    gaps = first + base > np.maximum(reached, base) + 2 * TOLERANCE
    hidden = np.ones(circles, dtype=np.bool_)
    hidden[owner[gaps]] = False
    return hidden


ASSUMED: Final = "sd per axis of the nodes' assumed positions, which filters and heads use; 0: known exactly"


def outside(place: tuple[float, float], field: Field) -> str:
    """The message about a position outside the field."""
    return (
        f"({place[0]:g}, {place[1]:g}) m is outside the field of {field.width:g} m by {field.height:g} m around "
        f"({field.centre[0]:g}, {field.centre[1]:g})"
    )


def _covering(setup: Setup) -> tuple[str, float]:
    """The name and length of the range that must cover the field: of the sensors, or of the links without sensors."""
    if isinstance(setup, TrackingSetup):
        return "a sensing range", setup.sensor.reach
    assert isinstance(setup, RadioSetup)
    return "a communication range", setup.link.reach


def too_few(part: Any, setup: Setup) -> Iterator[Issue]:
    """Yield an issue if a deployment has fewer nodes than its field or a cluster needs."""
    what, reach = _covering(setup)
    needed = nodes_needed(reach, part.width, part.height)
    if part.cover and part.nodes < needed:
        yield Issue(
            ("deploy", "cover"),
            f"{part.nodes:g} nodes with {what} of {reach:g} m cannot cover {part.width:g} m by "
            f"{part.height:g} m: at least {needed:g} are needed, or cover: false",
        )
    yield from too_few_for_a_cluster(part.nodes, "nodes", setup)


def too_few_for_a_cluster(nodes: int, key: str, setup: Setup) -> Iterator[Issue]:
    """Yield an issue if a network has fewer nodes than a cluster needs."""
    minimum = setup.clusters.minimum_active if isinstance(setup, NetworkSetup) else 0
    if nodes < minimum:
        yield Issue(
            ("deploy", key), f"{nodes} nodes cannot form a cluster of clusters.minimum_active = {minimum} members"
        )


def uncovered(part: Any, positions: Floats, setup: Setup) -> Iterator[Issue]:
    """Yield an issue if fixed positions do not cover the field, though their number might suffice."""
    (what, reach), width, height = _covering(setup), part.field.width, part.field.height
    about = positions - np.array(part.field.centre)
    if part.cover and len(about) >= nodes_needed(reach, width, height) and not covers(about, reach, width, height):
        share = coverage(about, reach, width, height)
        yield Issue(
            ("deploy", "cover"),
            f"these {len(about)} nodes with {what} of {reach:g} m leave about "
            f"{100 * (1 - share):.2g} % of the field uncovered; use more nodes, a longer range, or cover: false",
        )
