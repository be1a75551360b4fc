"""Floating car data of SUMO (`--fcd-output`): XML, and CSV as SUMO or its tool xml2csv.py writes it.

    <timestep time="4.00"><vehicle id="bus.1" x="12.5" y="80.0" .../></timestep>       also person and container
    timestep_time;vehicle_id;vehicle_x;vehicle_y         also time;id;x;y or t id x y; commas, tabs, blanks

Both are read in pieces. The first character tells them apart. Positions must be in metres: with `--fcd-output.geo`
SUMO writes degrees, which are refused where a file says so.
"""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final
from xml.parsers import expat

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import RunError
from wsnsim.interop import TraceEntry, ascending
from wsnsim.models.csvfile import open_text

SAMPLE: Final = "sample"
MOVERS: Final = ("vehicle", "person", "container")
PIECE: Final = 1 << 16
"""Characters that the XML parser is given at once."""
TIMES: Final = ("timestep_time", "time", "t")
DEGREES: Final = 'fcd-output.geo value="true"'


def entries(path: str) -> Iterator[TraceEntry]:
    """Yield the entries of a file. Raises RunError with file and line if it cannot be read."""
    with open_text(path) as file:
        head = file.read(PIECE)
        if head.lstrip().startswith("<"):
            yield from _of_xml(path, itertools.chain([head], iter(lambda: file.read(PIECE), "")))
        else:
            yield from _of_csv(path, _lines(head, file))


def track(path: str, kept: Sequence[TraceEntry], end: float) -> Floats:
    """(n, 4) time, x, y, z of one vehicle: its samples; one that was seen once stays there until the end."""
    rows = [(entry.time, *entry.values[:3]) for entry in kept]
    table = ascending([(time, x, y, z) for time, x, y, z in rows])
    if len(table) == 1:
        still = table.copy()
        still[0, 0] = max(end, table[0, 0] + 1.0)
        table = np.concatenate([table, still])
    return table


def _lines(head: str, file: Any) -> Iterator[str]:
    """The lines of a text whose beginning was read already."""
    *whole, rest = head.split("\n")
    yield from (f"{line}\n" for line in whole)
    for line in itertools.chain([rest + file.readline()], file):
        if line:
            yield line


class _Samples:
    """Collects the samples of an XML file while it is parsed."""

    def __init__(self, path: str) -> None:
        self.path = path
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
        height = self._number(given, "z", tag) if "z" in given else math.nan
        values = (self._number(given, "x", tag), self._number(given, "y", tag), height)
        self.found.append(TraceEntry(self.parser.CurrentLineNumber, given["id"], self._time, SAMPLE, values))

    def _end(self, tag: str) -> None:
        self._depth -= 1
        if tag == "timestep":
            self._time = None

    def _comment(self, text: str) -> None:
        if DEGREES in text:
            raise RunError(
                f"{self._place}: positions are degrees (fcd-output.geo), must be metres: run SUMO without it"
            )

    def _doctype(self, *_: Any) -> None:
        raise RunError(f"{self._place}: a document type is not allowed in floating car data")

    def _number(self, given: Mapping[str, str], name: str, tag: str) -> float:
        if name not in given:
            raise RunError(f"{self._place}: {tag} needs {name}")
        return _finite(given[name], f"{self._place}: {name}")

    @property
    def _place(self) -> str:
        return f"{self.path}:{self.parser.CurrentLineNumber}"


def _of_xml(path: str, pieces: Iterator[str]) -> Iterator[TraceEntry]:
    """Yield the samples of an XML file, piece by piece."""
    samples = _Samples(path)
    try:
        for piece in pieces:
            samples.parser.Parse(piece, False)
            yield from samples.found
            samples.found.clear()
        samples.parser.Parse("", True)
    except expat.ExpatError as error:
        words = expat.ErrorString(error.code)
        raise RunError(f"{path}:{error.lineno}: cannot be read: XML: {words}") from error


def _of_csv(path: str, lines: Iterator[str]) -> Iterator[TraceEntry]:
    """Yield the samples of a CSV file; rows without a vehicle, as xml2csv writes for empty steps, are left out."""
    first = next(lines, "")
    sign = max((";", ",", "\t"), key=first.count)
    sign = sign if sign in first else " "
    names = first.split() if sign == " " else first.rstrip("\r\n").split(sign)
    header = [name.strip().strip('"') for name in names]
    time = next((header.index(name) for name in TIMES if name in header), None)
    columns = [found for prefix in (*(f"{tag}_" for tag in MOVERS), "") if (found := _columns(header, prefix))]
    if time is None or not columns:
        raise RunError(
            f"{path}:1: the header must name time, id, x and y, as timestep_time;vehicle_id;vehicle_x;vehicle_y, is "
            f"{first.strip()[:120]!r}"
        )
    rows = csv.reader((" ".join(line.split()) for line in lines) if sign == " " else lines, delimiter=sign)
    for row in rows:
        for name, x, y, z in columns:
            if name < len(row) and row[name].strip():
                place = f"{path}:{rows.line_num + 1}"
                height = math.nan
                if z is not None and z < len(row) and row[z].strip():
                    height = _cell(row, z, place, "z")
                values = (_cell(row, x, place, "x"), _cell(row, y, place, "y"), height)
                yield TraceEntry(rows.line_num + 1, row[name].strip(), _cell(row, time, place, "time"), SAMPLE, values)


def _columns(header: list[str], prefix: str) -> tuple[int, int, int, int | None] | None:
    """The indices of id, x, y and z with a prefix; None if the header lacks one of the first three."""
    names = [f"{prefix}{name}" for name in ("id", "x", "y")]
    if not set(names) <= set(header):
        return None
    one, two, three = (header.index(name) for name in names)
    return one, two, three, header.index(f"{prefix}z") if f"{prefix}z" in header else None


def _cell(row: Sequence[str], column: int, place: str, name: str) -> float:
    return _finite(row[column] if column < len(row) else "", f"{place}: {name}")


def _finite(text: str, place: str) -> float:
    """A finite number. Raises RunError if the text is none; `place` begins the message."""
    try:
        value = float(text.replace("_", "no digit"))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RunError(f"{place} must be a finite number, is {text[:60]!r}")
    return value
