"""Deployments: where the nodes stand, and which rectangle they monitor.

draw(reach, rng) -> positions (N, 2)          field -> Field, the monitored rectangle

Every deployment has `position_error`: the standard deviation, per axis, by which the positions that filters, cluster
heads and wake-up messages assume differ from those where the nodes stand. See `base.initial_conditions`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.network_ports import LEAST_SIDE, Field
from wsnsim.base.part import Quantity, part
from wsnsim.base.setups import Setup
from wsnsim.models.bounds import LENGTH, MOST_NODES, PLACE, POSITION_ERROR
from wsnsim.models.coverage import ASSUMED, TOLERANCE, covers, outside, too_few, too_few_for_a_cluster, uncovered


@part
class Centred:
    """Nodes in a field that is given its sides. `fixed`: whether all runs have the same positions."""

    fixed: ClassVar[bool] = False

    nodes: Annotated[int, Quantity("", ge=1, le=MOST_NODES), "number of nodes"] = 256
    width: Annotated[float, LENGTH, "width of the field, in x"] = 400.0
    height: Annotated[float, LENGTH, "height of the field, in y"] = 400.0
    cover: Annotated[bool, "whether every point of the field must be within sensing range of a node"] = True
    position_error: Annotated[float, POSITION_ERROR, ASSUMED] = 0.0

    @property
    def field(self) -> Field:
        """The rectangle of `width` by `height`, centred at (0, 0)."""
        return Field(self.width, self.height)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if the nodes are too few to cover the field or to form a cluster."""
        yield from too_few(self, setup)


@part
class Uniform(Centred):
    """Nodes uniform over the field, sampled again until every point of it is within sensing range of a node.

    Source: Jiang, Song, Lin (2013), table 2; about 1.05 samples are needed there. The limit on samples is our choice.
    """

    draws: Annotated[int, Quantity("", ge=1, le=100_000), "most deployments sampled until one covers the field"] = 1000

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions. Raises RunError if no sample covers the field."""
        size = np.array([self.width, self.height])
        return _until_covered(self, lambda: (rng.random((self.nodes, 2)) - 0.5) * size, reach)


@part
class Grid(Centred):
    """Nodes at the centres of nearly square cells, row by row; an incomplete last row is spread evenly."""

    fixed: ClassVar[bool] = True

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions, row by row from the lower left; `rng` is not used."""
        return cells(self.nodes, self.width, self.height)[0]

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if the nodes are too few to form a cluster or do not cover the field."""
        yield from too_few(self, setup)
        yield from uncovered(self, cells(self.nodes, self.width, self.height)[0], setup)


@part
class JitteredGrid(Centred):
    """Nodes on a grid as in `Grid`, each moved at random in its cell; sampled again until the field is covered."""

    jitter: Annotated[float, Quantity("", ge=0, le=1), "fraction of its cell over which a node is spread"] = 0.5
    draws: Annotated[int, Quantity("", ge=1, le=100_000), "most deployments sampled until one covers the field"] = 1000

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions. Raises RunError if no sample covers the field."""
        centres, sizes = cells(self.nodes, self.width, self.height)
        return _until_covered(self, lambda: centres + self.jitter * sizes * (rng.random((self.nodes, 2)) - 0.5), reach)


@part
class Anchors:
    """Nodes at the positions that the scenario lists.

    The field is `width` by `height`, centred at `centre`. The default of each is that of the smallest rectangle that
    contains the nodes, with sides of at least 1 m (our choice).
    """

    fixed: ClassVar[bool] = True

    places: Annotated[tuple[tuple[float, float], ...], PLACE, "x and y of each node"] = ((0.0, 0.0),)
    width: Annotated[float | None, LENGTH, "width of the field, in x; default: the extent of the nodes"] = None
    height: Annotated[float | None, LENGTH, "height of the field, in y; default: the extent of the nodes"] = None
    centre: Annotated[
        tuple[float, float] | None, PLACE, "x and y of the field's centre; default: the centre of the nodes' extent"
    ] = None
    cover: Annotated[bool, "whether every point of the field must be within sensing range of a node"] = False
    position_error: Annotated[float, POSITION_ERROR, ASSUMED] = 0.0

    def __post_init__(self) -> None:
        """Raises ValueError if no node is listed."""
        if not self.places:
            raise ValueError("places must list at least one node, such as [[0, 0]]")

    @cached_property
    def field(self) -> Field:
        """The monitored rectangle: as the scenario gives it, with defaults from the positions."""
        places = np.array(self.places, dtype=np.float64)
        around = field_around(places)
        return Field(
            around.width if self.width is None else self.width,
            around.height if self.height is None else self.height,
            around.centre if self.centre is None else self.centre,
        )

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions in the order of the scenario; `rng` is not used."""
        return np.array(self.places, dtype=np.float64)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for nodes outside the field, too few for a cluster, or not covering the field."""
        positions = np.array(self.places, dtype=np.float64)
        inside = self.field.contains(positions)
        for i in np.nonzero(~inside)[0].tolist():
            yield Issue(("deploy", "places", i), outside(self.places[i], self.field))
        yield from too_few_for_a_cluster(len(positions), "places", setup)
        if inside.all():
            yield from uncovered(self, positions, setup)


def cells(nodes: int, width: float, height: float) -> tuple[Floats, Floats]:
    """Centres (N, 2) and sizes (N, 2) of the cells of a grid.

    A row has ceil(sqrt(N width / height)) cells; the last row has the remaining ones, which are wider.
    """
    columns = min(nodes, math.ceil(math.sqrt(nodes * width / height) - TOLERANCE))
    rows = math.ceil(nodes / columns)
    number = np.arange(nodes)
    row, column = number // columns, number % columns
    in_row = np.where(row == rows - 1, nodes - columns * (rows - 1), columns)
    sizes = np.stack([width / in_row, np.full(nodes, height / rows)], axis=1)
    return (np.stack([column, row], axis=1) + 0.5) * sizes - np.array([width, height]) / 2, sizes


def _until_covered(part: Uniform | JitteredGrid, draw: Callable[[], Floats], reach: float) -> Floats:
    for _ in range(part.draws if part.cover else 1):
        positions = draw()
        if not part.cover or covers(positions, reach, part.width, part.height):
            return positions
    raise RunError(
        f"deploy: none of {part.draws} sampled deployments of {part.nodes} nodes with a sensing range of {reach:g} m "
        f"covered the field of {part.width:g} m by {part.height:g} m; use more nodes, a longer range, or cover: false"
    )


def field_around(places: Floats, margin: float = 0.0) -> Field:
    """The smallest rectangle with sides of at least 1 m that contains places (N, 2) m, extended by a margin."""
    low, high = places.min(axis=0), places.max(axis=0)
    middle = (low + high) / 2
    # the centre is rounded: without the second term, an outermost node could be outside by a rounding error
    extents = np.maximum(high - low, 2.0 * np.abs(places - middle).max(axis=0))
    width, height = (np.maximum(extents, LEAST_SIDE) + 2.0 * margin).tolist()
    return Field(width, height, (float(middle[0]), float(middle[1])))
