"""Floating car data of SUMO (`--fcd-output`): XML, and CSV as SUMO or its tool xml2csv.py writes it.

    <timestep time="4.00"><vehicle id="bus.1" x="12.5" y="80.0" .../></timestep>       also person and container
    timestep_time;vehicle_id;vehicle_x;vehicle_y         also time;id;x;y or t id x y; commas, tabs, blanks

The first character tells them apart; XML is read in pieces. Positions are in metres: with `--fcd-output.geo` SUMO
writes degrees, which are refused where a file says so or its speeds contradict the positions, unless they are expected.
A person with the id of a vehicle becomes a node of its own, `person:ID`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final
from xml.parsers import expat

import numpy as np
import pandas as pd

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import RunError
from wsnsim.interop.tables import numeric, read_table
from wsnsim.interop.traces import TraceEntry, ascending, finite_number
from wsnsim.models.csvfile import open_text
from wsnsim.models.unit_checks import other_than_stated, other_units, remedy, slower_than_stated

MOVERS: Final = ("vehicle", "person", "container")
PIECE: Final = 1 << 16
"""Characters that the XML parser is given at once."""
TIMES: Final = ("timestep_time", "time", "t")
DEGREES: Final = 'fcd-output.geo value="true"'


def entries(path: str, degrees: bool = False) -> Iterator[TraceEntry]:
    """Yield the entries of a file: x, y, z and speed (NaN where there is none).

    Args:
        path: The file.
        degrees: Whether positions are longitudes and latitudes.

    Raises:
        RunError: It cannot be read, or holds degrees though none are expected; the message names file and line.
    """
    with open_text(path) as file:
        head = file.read(PIECE)
        if head.lstrip().startswith("<"):
            yield from _separated(_of_xml(path, itertools.chain([head], iter(lambda: file.read(PIECE), "")), degrees))
            return
    yield from _separated(_of_csv(path))


def _separated(found: Iterator[TraceEntry]) -> Iterator[TraceEntry]:
    """Yield entries, in which a mover with the id of another kind of mover has its kind in front of its name."""
    kinds: dict[str, str] = {}
    for entry in found:
        kind = kinds.setdefault(entry.node, entry.word)
        yield entry if kind == entry.word else entry._replace(node=f"{entry.word}:{entry.node}")


def track(path: str, kept: Sequence[TraceEntry], end: float, notes: list[str] | None = None) -> Floats:
    """(n, 4) time, x, y, z of one vehicle: its samples; one that was seen once stays there until the end.

    Args:
        path: The file.
        kept: The entries of the vehicle.
        end: The last time of the file.
        notes: Gets a sentence if places hardly fit the vehicle's speed; None: units are converted later.

    Raises:
        RunError: It is at two places at one time, or, with `notes`, too slow for its speed.
    """
    rows = np.array([(entry.time, *entry.values) for entry in kept])
    order = np.argsort(rows[:, 0], kind="stable")
    ordered = rows[order]
    jumps = (np.diff(ordered[:, 0]) == 0.0) & (np.diff(ordered[:, 1:3], axis=0) != 0.0).any(axis=1)
    for row in order[1:][jumps][:1]:
        raise RunError(f"{path}:{kept[row].line}: '{kept[row].node}' is at another place at the same time, "
                       f"{kept[row].time:g} s: remove one, or give one of two movers another id")  # fmt: skip
    moves = ordered[:, [0, 1, 2, 4]].T
    if notes is not None and (said := slower_than_stated(*moves)):
        raise RunError(f"{path}:{kept[0].line}: '{kept[0].node}' {said}, {other_units(path, 'sumo')}")
    if notes is not None and (said := other_than_stated(*moves)):
        notes.append(f"'{kept[0].node}' {said}")
    table = ascending(rows[:, :4])
    if len(table) == 1:
        still = table.copy()
        still[0, 0] = max(end, table[0, 0] + 1.0)
        table = np.concatenate([table, still])
    return table


class _Samples:
    """Collects the samples of an XML file while it is parsed."""

    def __init__(self, path: str, degrees: bool) -> None:
        self.path, self.degrees = path, degrees
        self.found: list[TraceEntry] = []
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CommentHandler = self._comment
        self.parser.StartDoctypeDeclHandler = self._doctype
        self._time: float | None = None
        self._depth = 0

    def _start(self, tag: str, given: Mapping[str, str]) -> None:
        self._depth += 1
        if self._depth == 1 and tag != "fcd-export":
            raise RunError(f"{self._place}: the root element must be fcd-export, is {tag[:60]!r}")
        if tag == "timestep":
            self._time = self._number(given, "time", tag)
        elif tag in MOVERS and self._time is not None:
            self._sample(tag, given)

    def _sample(self, tag: str, given: Mapping[str, str]) -> None:
        if not given.get("id"):
            raise RunError(f"{self._place}: {tag} needs an id")
        assert self._time is not None
        optional = [self._number(given, name, tag) if name in given else math.nan for name in ("z", "speed")]
        values = (self._number(given, "x", tag), self._number(given, "y", tag), *optional)
        self.found.append(TraceEntry(self.parser.CurrentLineNumber, given["id"], self._time, tag, values))

    def _end(self, tag: str) -> None:
        self._depth -= 1
        if tag == "timestep":
            self._time = None

    def _comment(self, text: str) -> None:
        if DEGREES in text and not self.degrees:
            raise RunError(f"{self._place}: positions are degrees (fcd-output.geo), must be metres. Write: "
                           f"{remedy(self.path, 'sumo', '--crs wgs84')}")  # fmt: skip

    def _doctype(self, *_: Any) -> None:
        raise RunError(f"{self._place}: a document type is not allowed in floating car data")

    def _number(self, given: Mapping[str, str], name: str, tag: str) -> float:
        if name not in given:
            raise RunError(f"{self._place}: {tag} needs {name}")
        return finite_number(given[name], f"{self._place}: {name}")

    @property
    def _place(self) -> str:
        return f"{self.path}:{self.parser.CurrentLineNumber}"


def _of_xml(path: str, pieces: Iterator[str], degrees: bool) -> Iterator[TraceEntry]:
    """Yield the samples of an XML file, piece by piece."""
    samples = _Samples(path, degrees)
    try:
        for piece in pieces:
            samples.parser.Parse(piece, False)
            yield from samples.found
            samples.found.clear()
        samples.parser.Parse("", True)
    except expat.ExpatError as error:
        words = expat.ErrorString(error.code)
        raise RunError(f"{path}:{error.lineno}: cannot be read: XML: {words}") from error


def _of_csv(path: str) -> Iterator[TraceEntry]:
    """Yield the samples of a CSV file; rows without a vehicle, as xml2csv writes for empty steps, are left out."""
    frame = read_table(path, texts=lambda name: name.endswith("id")).frame
    time = next((name for name in TIMES if name in frame), None)
    movers = [tag for tag in (*MOVERS, "") if {f"{tag}_{name}".strip("_") for name in ("id", "x", "y")} <= set(frame)]
    if time is None or not movers:
        raise RunError(
            f"{path}:1: the header must name time, id, x and y, as timestep_time;vehicle_id;vehicle_x;vehicle_y, is "
            f"{', '.join(frame)[:120]!r}"
        )
    for tag in movers:
        names = [time, *(f"{tag}_{name}".strip("_") for name in ("id", "x", "y", "z", "speed"))]
        part = frame.reindex(columns=names).set_axis(["time", "id", "x", "y", "z", "speed"], axis=1).dropna(subset="id")
        for name in ("time", "x", "y", "z", "speed"):
            part[name] = _numbers(path, part[name], optional=name in ("z", "speed"))
        for line, when, node, *values in part.itertuples():
            yield TraceEntry(line, node.strip(), when, tag or "sample", tuple(values))


def _numbers(path: str, column: pd.Series, optional: bool) -> pd.Series:
    """A column of finite numbers; an optional one may have empty cells. Raises RunError with file and line."""
    values = numeric(column)
    for line, cell in column[~np.isfinite(values) & ~(column.isna() & optional)].iloc[:1].items():
        finite_number("" if pd.isna(cell) else str(cell), f"{path}:{line}: {column.name}")
    return values
