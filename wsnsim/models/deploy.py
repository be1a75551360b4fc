"""Where the nodes stand, and whether they cover the field: whether every point of it is within reach of a node.

draw(reach, rng) -> positions (N, 2)          field -> Field, the rectangle that is monitored
covers(positions, reach, width, height) -> bool, exactly      coverage(...) -> fraction, on a fixed lattice
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Annotated, Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.part import Quantity, part
from wsnsim.base.ports import Field
from wsnsim.base.setups import NetworkSetup, RadioSetup, Setup, TrackingSetup
from wsnsim.models.bounds import LENGTH, MOST_NODES, PLACE
from wsnsim.models.coverage import TOLERANCE, coverage, covers, nodes_needed
from wsnsim.models.csvfile import read_columns

LEAST_SIDE: Final = 1.0
"""m: of a field that is taken from places along a line, or from one place."""


@part
class Uniform:
    """Nodes uniform over the field, redrawn until every point of it is within sensing reach of a node.

    Source: Jiang, Song, Lin (2013), table 2; about 1.05 draws are needed there. The cap on draws is our choice.
    """

    nodes: Annotated[int, Quantity("", ge=1, le=MOST_NODES), "number of nodes"] = 256
    width: Annotated[float, LENGTH, "of the field, in x"] = 400.0
    height: Annotated[float, LENGTH, "of the field, in y"] = 400.0
    cover: Annotated[bool, "whether every point of the field must be within sensing reach of a node"] = True
    draws: Annotated[int, Quantity("", ge=1, le=100_000), "draws after which coverage is given up"] = 1000

    @property
    def field(self) -> Field:
        """The rectangle of `width` by `height` about (0, 0)."""
        return Field(self.width, self.height)

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions. Raises RunError if no draw covers the field."""
        size = np.array([self.width, self.height])
        return _until_covered(self, lambda: (rng.random((self.nodes, 2)) - 0.5) * size, reach)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Too few nodes to cover the field, or to make a cluster."""
        yield from _too_few(self, setup)


@part
class Grid:
    """Nodes at the centres of nearly square cells, row by row; the last row holds the rest, spread evenly."""

    nodes: Annotated[int, Quantity("", ge=1, le=MOST_NODES), "number of nodes"] = 256
    width: Annotated[float, LENGTH, "of the field, in x"] = 400.0
    height: Annotated[float, LENGTH, "of the field, in y"] = 400.0
    cover: Annotated[bool, "whether every point of the field must be within sensing reach of a node"] = True

    @property
    def field(self) -> Field:
        """The rectangle of `width` by `height` about (0, 0)."""
        return Field(self.width, self.height)

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions, row by row from the lower left; nothing is drawn."""
        return cells(self.nodes, self.width, self.height)[0]

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Too few nodes to make a cluster, or a grid that does not cover the field."""
        yield from _too_few(self, setup)
        yield from _uncovered(self, cells(self.nodes, self.width, self.height)[0], setup)


@part
class JitteredGrid:
    """Nodes on a grid as in `Grid`, each moved within a part of its cell; redrawn until the field is covered."""

    nodes: Annotated[int, Quantity("", ge=1, le=MOST_NODES), "number of nodes"] = 256
    width: Annotated[float, LENGTH, "of the field, in x"] = 400.0
    height: Annotated[float, LENGTH, "of the field, in y"] = 400.0
    jitter: Annotated[float, Quantity("", ge=0, le=1), "fraction of its cell within which a node is moved"] = 0.5
    cover: Annotated[bool, "whether every point of the field must be within sensing reach of a node"] = True
    draws: Annotated[int, Quantity("", ge=1, le=100_000), "draws after which coverage is given up"] = 1000

    @property
    def field(self) -> Field:
        """The rectangle of `width` by `height` about (0, 0)."""
        return Field(self.width, self.height)

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions. Raises RunError if no draw covers the field."""
        centres, sizes = cells(self.nodes, self.width, self.height)
        return _until_covered(self, lambda: centres + self.jitter * sizes * (rng.random((self.nodes, 2)) - 0.5), reach)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Too few nodes to cover the field, or to make a cluster."""
        yield from _too_few(self, setup)


@part
class FromFile:
    """Nodes at positions from a CSV file with the columns x and y, in m, the field's centre being (0, 0)."""

    path: Annotated[str, "CSV file with a header that names x and y; other columns are ignored"]
    width: Annotated[float, LENGTH, "of the field, in x"] = 400.0
    height: Annotated[float, LENGTH, "of the field, in y"] = 400.0
    cover: Annotated[bool, "whether every point of the field must be within sensing reach of a node"] = True

    @property
    def field(self) -> Field:
        """The rectangle of `width` by `height` about (0, 0)."""
        return Field(self.width, self.height)

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions in the file's order. Raises RunError naming file and line if it cannot be read."""
        return read_positions(self.path, self.field)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """A file that cannot be read, too few nodes in it, or nodes that do not cover the field."""
        try:
            positions = read_positions(self.path, self.field)
        except RunError as error:
            yield Issue(("deploy", "path"), str(error))
            return
        yield from _too_few_for_a_cluster(len(positions), "path", setup)
        yield from _uncovered(self, positions, setup)


@part
class Anchors:
    """Nodes at the places that the scenario names.

    The field is `width` by `height` about `centre`. What is left out is taken from the places: the sides and the
    middle of the smallest rectangle that holds them, sides of less than 1 m being taken as 1 m (our choice).
    """

    places: Annotated[tuple[tuple[float, float], ...], PLACE, "x and y of each node"] = ((0.0, 0.0),)
    width: Annotated[float | None, LENGTH, "of the field, in x; left out: what the places span"] = None
    height: Annotated[float | None, LENGTH, "of the field, in y; left out: what the places span"] = None
    centre: Annotated[
        tuple[float, float] | None, PLACE, "x and y of the field's middle; left out: that of what the places span"
    ] = None
    cover: Annotated[bool, "whether every point of the field must be within sensing reach of a node"] = False

    def __post_init__(self) -> None:
        """Refuse a list without places: there is no field about them. Raises ValueError."""
        if not self.places:
            raise ValueError("places must name at least one node, such as [[0, 0]]")

    @cached_property
    def field(self) -> Field:
        """The rectangle that is monitored: what the scenario says of it, the rest from the places."""
        places = np.array(self.places, dtype=np.float64)
        low, high = places.min(axis=0), places.max(axis=0)
        sides, middle = np.maximum(high - low, LEAST_SIDE).tolist(), ((low + high) / 2).tolist()
        return Field(
            sides[0] if self.width is None else self.width,
            sides[1] if self.height is None else self.height,
            (middle[0], middle[1]) if self.centre is None else self.centre,
        )

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions in the order of the places; nothing is drawn."""
        return np.array(self.places, dtype=np.float64)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Nodes outside the field, too few to make a cluster, or nodes that do not cover the field."""
        positions = np.array(self.places, dtype=np.float64)
        inside = self.field.contains(positions)
        for i in np.nonzero(~inside)[0].tolist():
            yield Issue(("deploy", "places", i), _outside(self.places[i], self.field))
        yield from _too_few_for_a_cluster(len(positions), "places", setup)
        if inside.all():
            yield from _uncovered(self, positions, setup)


def cells(nodes: int, width: float, height: float) -> tuple[Floats, Floats]:
    """Centres (N, 2) and sizes (N, 2) of a grid's cells: ceil(sqrt(N width / height)) a row, the last what is left."""
    columns = min(nodes, math.ceil(math.sqrt(nodes * width / height) - TOLERANCE))
    rows = math.ceil(nodes / columns)
    number = np.arange(nodes)
    row, column = number // columns, number % columns
    in_row = np.where(row == rows - 1, nodes - columns * (rows - 1), columns)
    sizes = np.stack([width / in_row, np.full(nodes, height / rows)], axis=1)
    return (np.stack([column, row], axis=1) + 0.5) * sizes - np.array([width, height]) / 2, sizes


def read_positions(path: str, field: Field) -> Floats:
    """(N, 2) positions in the file's order; several nodes may share one.

    Raises:
        RunError: the file cannot be read, or a line of it is no position in the field: names file and line.
    """
    positions = []
    for place, (x, y) in read_columns(path, ("x", "y"), "positions"):
        if not field.contains(np.array([[x, y]]))[0]:
            raise RunError(f"{place}: {_outside((x, y), field)}")
        positions.append((x, y))
    return np.array(positions)


def _outside(place: tuple[float, float], field: Field) -> str:
    """What a message says of a place that is not in the field."""
    return (
        f"({place[0]:g}, {place[1]:g}) m is outside the field of {field.width:g} m by {field.height:g} m around "
        f"({field.centre[0]:g}, {field.centre[1]:g})"
    )


def _until_covered(part: Uniform | JitteredGrid, draw: Callable[[], Floats], reach: float) -> Floats:
    for _ in range(part.draws if part.cover else 1):
        positions = draw()
        if not part.cover or covers(positions, reach, part.width, part.height):
            return positions
    raise RunError(
        f"deploy: none of {part.draws} draws of {part.nodes} nodes with a sensing reach of {reach:g} m covered the "
        f"field of {part.width:g} m by {part.height:g} m; use more nodes, a longer reach, or cover: false"
    )


def _covering(setup: Setup) -> tuple[str, float]:
    """What covers the field: the sensors; without any, the links."""
    if isinstance(setup, TrackingSetup):
        return "a sensing reach", setup.sensor.reach
    assert isinstance(setup, RadioSetup)
    return "a link's reach", setup.link.reach


def _too_few(part: Uniform | Grid | JitteredGrid, setup: Setup) -> Iterator[Issue]:
    what, reach = _covering(setup)
    needed = nodes_needed(reach, part.width, part.height)
    if part.cover and part.nodes < needed:
        yield Issue(
            ("deploy", "cover"),
            f"{part.nodes:g} nodes with {what} of {reach:g} m cannot cover {part.width:g} m by "
            f"{part.height:g} m: at least {needed:g} are needed, or cover: false",
        )
    yield from _too_few_for_a_cluster(part.nodes, "nodes", setup)


def _too_few_for_a_cluster(nodes: int, key: str, setup: Setup) -> Iterator[Issue]:
    """Fewer nodes than a cluster needs, where there is a network and so are clusters."""
    minimum = setup.clusters.minimum_active if isinstance(setup, NetworkSetup) else 0
    if nodes < minimum:
        yield Issue(
            ("deploy", key), f"{nodes} nodes cannot make a cluster of clusters.minimum_active = {minimum} members"
        )


def _uncovered(part: Grid | FromFile | Anchors, positions: Floats, setup: Setup) -> Iterator[Issue]:
    """Fixed positions that leave a part of the field out of reach, unless their number alone is too small."""
    (what, reach), width, height = _covering(setup), part.field.width, part.field.height
    about = positions - np.array(part.field.centre)
    if part.cover and len(about) >= nodes_needed(reach, width, height) and not covers(about, reach, width, height):
        share = coverage(about, reach, width, height)
        yield Issue(
            ("deploy", "cover"),
            f"these {len(about)} nodes with {what} of {reach:g} m leave about "
            f"{100 * (1 - share):.2g} % of the field uncovered; use more nodes, a longer reach, or cover: false",
        )
