"""Coverage of the field by sensing ranges: nodes cover it if every point is within the range of at least one node.

covers(positions (N, 2), reach, width, height) -> bool, exactly      coverage(...) -> fraction, on a fixed lattice

Positions are relative to the field's centre. The range `reach` may be infinite: one node then covers any field.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import KDTree, cKDTree

from wsnsim.base.arrays import Bools, Floats, Ints

TURN = 2.0 * math.pi
TOLERANCE = 1e-9
"""Gaps between arcs below this angle (rad) are rounding error, as where circles touch exactly."""
NEAREST = 16
"""Number of nearest neighbours tried first. They usually hide a circle, and further neighbours cannot uncover it."""
AT_ONCE = 20_000
"""Circles examined together: bounds the memory for sorting."""


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


def coverage(
    positions: Floats, reach: float, width: float, height: float, side: int = 200, tree: KDTree | None = None
) -> float:
    """The fraction of the field within range of a node, evaluated at the centres of side² cells.

    Args:
        positions: (N, 2) in m, relative to the field's centre.
        reach: range of a node, in m.
        width: width of the field, in x, in m.
        height: height of the field, in y, in m.
        side: cells along each side.
        tree: a tree of the same positions, if the caller has one.
    """
    if not len(positions):
        return 0.0
    x, y = np.meshgrid(*(length * ((np.arange(side) + 0.5) / side - 0.5) for length in (width, height)))
    distances, _ = (tree or cKDTree(positions)).query(
        np.stack([x.ravel(), y.ravel()], axis=1), distance_upper_bound=reach * (1 + TOLERANCE)
    )
    return float(np.isfinite(distances).mean())


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
