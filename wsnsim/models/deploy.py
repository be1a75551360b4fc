"""Deployments: where the nodes stand, and which rectangle they monitor.

draw(reach, rng) -> positions (N, 2)          field -> Field, the monitored rectangle

Every deployment has `position_error`: the standard deviation, per axis, by which the positions that filters, cluster
heads and wake-up messages assume differ from those where the nodes stand. See `base.initial_conditions`.
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
from wsnsim.models.bounds import LENGTH, MOST_NODES, PLACE, POSITION_ERROR
from wsnsim.models.coverage import TOLERANCE, coverage, covers, nodes_needed
from wsnsim.models.csvfile import read_columns

ASSUMED: Final = "sd per axis of the nodes' assumed positions, which filters and heads use; 0: known exactly"

LEAST_SIDE: Final = 1.0
"""Least side (m) of a field that is derived from the positions of the nodes, as with one node or nodes on a line."""


@part
class Uniform:
    """Nodes uniform over the field, sampled again until every point of it is within sensing range of a node.

    Source: Jiang, Song, Lin (2013), table 2; about 1.05 samples are needed there. The limit on samples is our choice.
    """

    nodes: Annotated[int, Quantity("", ge=1, le=MOST_NODES), "number of nodes"] = 256
    width: Annotated[float, LENGTH, "of the field, in x"] = 400.0
    height: Annotated[float, LENGTH, "of the field, in y"] = 400.0
    cover: Annotated[bool, "whether every point of the field must be within sensing range of a node"] = True
    draws: Annotated[int, Quantity("", ge=1, le=100_000), "most deployments sampled until one covers the field"] = 1000
    position_error: Annotated[float, POSITION_ERROR, ASSUMED] = 0.0

    @property
    def field(self) -> Field:
        """The rectangle of `width` by `height`, centred at (0, 0)."""
        return Field(self.width, self.height)

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions. Raises RunError if no sample covers the field."""
        size = np.array([self.width, self.height])
        return _until_covered(self, lambda: (rng.random((self.nodes, 2)) - 0.5) * size, reach)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if the nodes are too few to cover the field or to form a cluster."""
        yield from _too_few(self, setup)


@part
class Grid:
    """Nodes at the centres of nearly square cells, row by row; an incomplete last row is spread evenly."""

    nodes: Annotated[int, Quantity("", ge=1, le=MOST_NODES), "number of nodes"] = 256
    width: Annotated[float, LENGTH, "of the field, in x"] = 400.0
    height: Annotated[float, LENGTH, "of the field, in y"] = 400.0
    cover: Annotated[bool, "whether every point of the field must be within sensing range of a node"] = True
    position_error: Annotated[float, POSITION_ERROR, ASSUMED] = 0.0

    @property
    def field(self) -> Field:
        """The rectangle of `width` by `height`, centred at (0, 0)."""
        return Field(self.width, self.height)

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions, row by row from the lower left; `rng` is not used."""
        return cells(self.nodes, self.width, self.height)[0]

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if the nodes are too few to form a cluster or do not cover the field."""
        yield from _too_few(self, setup)
        yield from _uncovered(self, cells(self.nodes, self.width, self.height)[0], setup)


@part
class JitteredGrid:
    """Nodes on a grid as in `Grid`, each moved at random in its cell; sampled again until the field is covered."""

    nodes: Annotated[int, Quantity("", ge=1, le=MOST_NODES), "number of nodes"] = 256
    width: Annotated[float, LENGTH, "of the field, in x"] = 400.0
    height: Annotated[float, LENGTH, "of the field, in y"] = 400.0
    jitter: Annotated[float, Quantity("", ge=0, le=1), "fraction of its cell over which a node is spread"] = 0.5
    cover: Annotated[bool, "whether every point of the field must be within sensing range of a node"] = True
    draws: Annotated[int, Quantity("", ge=1, le=100_000), "most deployments sampled until one covers the field"] = 1000
    position_error: Annotated[float, POSITION_ERROR, ASSUMED] = 0.0

    @property
    def field(self) -> Field:
        """The rectangle of `width` by `height`, centred at (0, 0)."""
        return Field(self.width, self.height)

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions. Raises RunError if no sample covers the field."""
        centres, sizes = cells(self.nodes, self.width, self.height)
        return _until_covered(self, lambda: centres + self.jitter * sizes * (rng.random((self.nodes, 2)) - 0.5), reach)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if the nodes are too few to cover the field or to form a cluster."""
        yield from _too_few(self, setup)


@part
class FromFile:
    """Nodes at positions from a CSV file with the columns x and y, in m."""

    path: Annotated[str, "CSV file with a header that names x and y; other columns are ignored"]
    width: Annotated[float, LENGTH, "of the field, in x"] = 400.0
    height: Annotated[float, LENGTH, "of the field, in y"] = 400.0
    centre: Annotated[tuple[float, float], PLACE, "x and y of the field's centre"] = (0.0, 0.0)
    cover: Annotated[bool, "whether every point of the field must be within sensing range of a node"] = True
    position_error: Annotated[float, POSITION_ERROR, ASSUMED] = 0.0

    @property
    def field(self) -> Field:
        """The rectangle of `width` by `height`, centred at `centre`."""
        return Field(self.width, self.height, self.centre)

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions in the file's order. Raises RunError with file and line if it cannot be read."""
        return read_positions(self.path, self.field)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue if the file cannot be read, or its nodes are too few or do not cover the field."""
        try:
            positions = read_positions(self.path, self.field)
        except RunError as error:
            yield Issue(("deploy", "path"), str(error))
            return
        yield from _too_few_for_a_cluster(len(positions), "path", setup)
        yield from _uncovered(self, positions, setup)


@part
class Anchors:
    """Nodes at the positions that the scenario lists.

    The field is `width` by `height`, centred at `centre`. The default of each is that of the smallest rectangle that
    contains the nodes, with sides of at least 1 m (our choice).
    """

    places: Annotated[tuple[tuple[float, float], ...], PLACE, "x and y of each node"] = ((0.0, 0.0),)
    width: Annotated[float | None, LENGTH, "of the field, in x; default: the extent of the nodes"] = None
    height: Annotated[float | None, LENGTH, "of the field, in y; default: the extent of the nodes"] = None
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
        low, high = places.min(axis=0), places.max(axis=0)
        sides, middle = np.maximum(high - low, LEAST_SIDE).tolist(), ((low + high) / 2).tolist()
        return Field(
            sides[0] if self.width is None else self.width,
            sides[1] if self.height is None else self.height,
            (middle[0], middle[1]) if self.centre is None else self.centre,
        )

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions in the order of the scenario; `rng` is not used."""
        return np.array(self.places, dtype=np.float64)

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for nodes outside the field, too few for a cluster, or not covering the field."""
        positions = np.array(self.places, dtype=np.float64)
        inside = self.field.contains(positions)
        for i in np.nonzero(~inside)[0].tolist():
            yield Issue(("deploy", "places", i), _outside(self.places[i], self.field))
        yield from _too_few_for_a_cluster(len(positions), "places", setup)
        if inside.all():
            yield from _uncovered(self, positions, setup)


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


def read_positions(path: str, field: Field) -> Floats:
    """(N, 2) positions in the file's order; several nodes may share one.

    Raises:
        RunError: the file cannot be read, or a position is outside the field. The message names file and line.
    """
    positions = []
    for place, (x, y) in read_columns(path, ("x", "y"), "positions"):
        if not field.contains(np.array([[x, y]]))[0]:
            raise RunError(f"{place}: {_outside((x, y), field)}")
        positions.append((x, y))
    return np.array(positions)


def _outside(place: tuple[float, float], field: Field) -> str:
    """The message about a position outside the field."""
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
        f"deploy: none of {part.draws} sampled deployments of {part.nodes} nodes with a sensing range of {reach:g} m "
        f"covered the field of {part.width:g} m by {part.height:g} m; use more nodes, a longer range, or cover: false"
    )


def _covering(setup: Setup) -> tuple[str, float]:
    """The name and length of the range that must cover the field: of the sensors, or of the links without sensors."""
    if isinstance(setup, TrackingSetup):
        return "a sensing range", setup.sensor.reach
    assert isinstance(setup, RadioSetup)
    return "a communication range", setup.link.reach


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
    """Yield an issue if a network has fewer nodes than a cluster needs."""
    minimum = setup.clusters.minimum_active if isinstance(setup, NetworkSetup) else 0
    if nodes < minimum:
        yield Issue(
            ("deploy", key), f"{nodes} nodes cannot form a cluster of clusters.minimum_active = {minimum} members"
        )


def _uncovered(part: Grid | FromFile | Anchors, positions: Floats, setup: Setup) -> Iterator[Issue]:
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
