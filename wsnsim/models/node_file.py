"""The deployment whose nodes stand in a CSV file: positions, names and heights."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, ClassVar, Final

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import Issue, RunError
from wsnsim.base.network_ports import Field
from wsnsim.base.part import Quantity, part
from wsnsim.base.sensing import HEIGHT
from wsnsim.base.setups import Setup, TrackingSetup
from wsnsim.models.bounds import LENGTH, PLACE, POSITION_ERROR
from wsnsim.models.coverage import ASSUMED, outside, too_few_for_a_cluster, uncovered
from wsnsim.models.csvfile import Wanted, demand_good, identifiers, only_rows, read_rows
from wsnsim.models.deploy import field_around
from wsnsim.models.row_checks import more_like_it
from wsnsim.models.unit_checks import degrees_said

MARGIN: Final = Quantity("m", ge=0, le=1e6)
EVERYWHERE: Final = Field(2e7, 2e7)
"""The places that a coordinate may have: see `bounds.PLACE`."""


@part
class PlaceColumns:
    """The names of the columns of a file of positions."""

    sheet: ClassVar[str] = ""

    x: Annotated[str, "the coordinate x, in m"] = "x"
    y: Annotated[str, "the coordinate y, in m"] = "y"
    z: Annotated[str, "the height, in m; a file may lack it"] = "z"
    id: Annotated[str, "the name of the node; a file may lack it"] = "id"


@part
class FromFile:
    """Nodes at positions from a CSV file with the columns x and y, in m; optionally names (id) and heights (z).

    Coordinates may have any origin, such as that of a map grid: `centre` says where the field is, or `fit: true` takes
    the field from the nodes. Trajectories are in the same coordinates.

    Recorded readings and links refer to nodes by these names. Heights count in the law of a sensor that has them.
    """

    fixed: ClassVar[bool] = True

    path: Annotated[str, "CSV file, also .gz, with a header that names x and y; further columns are ignored"]
    columns: Annotated[PlaceColumns, "the names of the file's columns, where they differ"] = PlaceColumns()
    width: Annotated[float, LENGTH, "width of the field, in x"] = 400.0
    height: Annotated[float, LENGTH, "height of the field, in y"] = 400.0
    centre: Annotated[tuple[float, float], PLACE, "x and y of the field's centre"] = (0.0, 0.0)
    fit: Annotated[bool, "whether the field is the smallest rectangle that contains the nodes, wherever they stand"] = (
        False
    )
    count_from: Annotated[
        int | None, Quantity("", ge=0), "number of the first row, where rows have no names; none: no names then"
    ] = None
    margin: Annotated[float, MARGIN, "by which a fitted field extends beyond the outermost nodes, on every side"] = 0.0
    cover: Annotated[bool, "whether every point of the field must be within sensing range of a node"] = True
    position_error: Annotated[float, POSITION_ERROR, ASSUMED] = 0.0

    def __post_init__(self) -> None:
        """Raises ValueError if the field is both fitted and given."""
        if self.fit and (self.width, self.height, self.centre) != (400.0, 400.0, (0.0, 0.0)):
            raise ValueError("fit: width, height and centre come from the nodes then: leave them out")
        if self.margin and not self.fit:
            raise ValueError("margin goes with fit: true")

    @cached_property
    def field(self) -> Field:
        """The rectangle of `width` by `height` around `centre`, or that of the nodes if it is fitted.

        If the file cannot be read, it is the former: `check` and `draw` say why.
        """
        given = Field(self.width, self.height, self.centre)
        if not self.fit:
            return given
        with contextlib.suppress(RunError):
            return field_around(self._places(EVERYWHERE), self.margin)
        return given

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each node, in the file's order: its id, or its number if `count_from` says how rows count.

        Raises:
            RunError: the file cannot be read, nodes have no name, or two have the same. The message names file and
                line, or what names them.
        """
        wanted = Wanted({"id": self.columns.id}, {"x": self.columns.x}, optional=("id",))
        rows = read_rows(self.path, wanted, "positions")
        if "id" not in rows.texts:
            if self.count_from is None:
                raise RunError(self._nameless(len(rows.lines)))
            return tuple(str(self.count_from + node) for node in range(len(demand_good(rows).lines)))
        return demand_good(rows.without(rows.nodes_once("id"))).texts["id"].names

    def _nameless(self, nodes: int) -> str:
        """A sentence on positions without names, and on what may name them."""
        columns = identifiers(self.path, (self.columns.x, self.columns.y, self.columns.z))
        like = [name for name, cells in columns.items() if len(set(cells)) == nodes]
        hint = f"the column '{like[0]}' looks like names: columns: {{id: {like[0]}}}; " if like else ""
        said = f"{self.path}: the positions have no names, by which recorded data could refer to them"
        return f"{said}: {hint}count_from: 0 takes the numbers of rows, from 0"

    @property
    def heights(self) -> Floats | None:
        """(N,) the height of each node in m, in the file's order; None if the file has no such column.

        Raises:
            RunError: the file cannot be read, or a height is not a finite number. The message names file and line.
        """
        wanted = Wanted(numbers={"x": self.columns.x, "z": self.columns.z}, optional=("z",))
        return only_rows(self.path, wanted, "positions").numbers.get("z")

    def draw(self, reach: float, rng: np.random.Generator) -> Floats:
        """(N, 2) positions in the file's order. Raises RunError with file and line if it cannot be read."""
        return self._places(EVERYWHERE if self.fit else self.field)

    def _places(self, field: Field) -> Floats:
        """(N, 2) positions in the file's order; several nodes may share one.

        Raises:
            RunError: the file cannot be read, or a position is outside the field. The message names file and line.
        """
        rows = only_rows(self.path, Wanted(numbers={"x": self.columns.x, "y": self.columns.y}), "positions")
        positions = np.column_stack([rows.numbers["x"], rows.numbers["y"]])
        beyond = np.flatnonzero(~field.contains(positions)).tolist()
        for row in beyond[:1]:
            x, y = positions[row].tolist()
            more = more_like_it(len(beyond) - 1)
            raise RunError(f"{self.path}:{rows.lines[row]}: {outside((x, y), field)}{more}")
        return positions

    def check(self, setup: Setup) -> Iterator[Issue]:
        """Yield an issue for a file that cannot be read or holds degrees, and nodes too few to cover the field."""
        if said := degrees_said(self.path, "nodes", self.columns.x, self.columns.y):
            yield Issue(("deploy", "columns"), said)
            return
        try:
            positions = self.draw(0.0, np.random.default_rng(0))
            _ = self.heights if isinstance(setup, TrackingSetup) and HEIGHT in setup.sensor.trait_names else None
        except RunError as error:
            yield Issue(("deploy", "path"), str(error))
            return
        yield from too_few_for_a_cluster(len(positions), "path", setup)
        yield from uncovered(self, positions, setup)
