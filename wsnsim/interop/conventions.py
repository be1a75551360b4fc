"""Conventions of field data: how files name columns, write times, units and angles, and where on the Earth they are.

column_roles(names, wanted, given) -> {our name: the file's}        seconds, converted, turned, local_metres
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from wsnsim.base.arrays import LONG_AGO, Bools, Floats
from wsnsim.base.errors import UsageError, did_you_mean
from wsnsim.base.files import read_sections
from wsnsim.interop.tables import listed, numeric
from wsnsim.models.bearing import TURN, wrapped
from wsnsim.scenario.units import UnitError, parse, si

USUAL: Final = {
    ours: names.split() for ours, names in read_sections(Path(__file__).with_name("column_names.table"))[0].rows
}
"""{our name of a column: its usual names in files}; names count without case, and without a unit in brackets."""
NAMING: Final = {name for ours in ("node", "id", "src", "dst", "target") for name in (ours, *USUAL[ours])}
"""Columns that hold names."""
ANGLES: Final = {
    "counterclockwise-from-east": (1.0, 0.0), "clockwise-from-north": (-1.0, TURN / 4.0),
    "counterclockwise-from-north": (1.0, TURN / 4.0), "clockwise-from-east": (-1.0, 0.0),
}  # fmt: skip
"""(sign, angle of zero from the x-axis) of each convention; the x-axis points east."""
STATED: Final = re.compile(r"[\[(]([^\[\]()]*+)[\])]$|(?<=.)_(mm|cm|m|km|s|ms|us|ns|deg|rad|dBm|mW)$")
"""The unit at the end of a header."""
EPOCH: Final = pd.Timestamp(0, tz="UTC")


@dataclass(frozen=True)
class Conventions:
    """How the files of a kind are to be read.

    Attributes:
        columns: Names of the columns in their order, for files without a header.
        names: {our name of a column: its name in the files}, where it is not one of `USUAL`; '' if they have none.
        unit: Unit of readings, of coordinates or of delivery ratios; '': SI, dBm, or what the header says in brackets.
        time_format: '' for s or ISO 8601; a unit such as 'ms'; a format of `strptime` such as '%d.%m.%Y %H:%M:%S'.
        time_origin: Time, written as the file writes it, that becomes 0; '': times stay, dates count from 1970 (UTC).
        span: First and last time of a track or of readings, written as `time_origin`; '': all of it.
        angle: One of `ANGLES`.
        missing: Values that stand for no reading, such as '100' or 'nan'.
        crs: 'wgs84' for longitudes and latitudes in degrees; '': local metres.
        origin: Longitude, latitude and perhaps height that become (0, 0, 0); None: the middle of the places.
        node_prefix: Wide tables: what the names of nodes' columns begin with, which is no part of the names.
        repeated: Which of several readings of a node at one time counts: 'first', 'last', 'mean'; '': none may repeat.
        table: The variable of a .mat file, the sheet of a spreadsheet or the list of a JSON file that is read.
        where: {a column of the files: the cell that rows which are used have there}.
        rate: Rows per second, of files without times; 0: times are demanded.
        skip_bad_rows: Whether rows that cannot be used are left out and counted, instead of refused.
    """

    columns: Sequence[str] = ()
    names: Mapping[str, str] = field(default_factory=dict)
    unit: str = ""
    time_format: str = ""
    time_origin: str = ""
    span: tuple[str, str] = ("", "")
    angle: str = ""
    missing: Sequence[str] = ()
    crs: str = ""
    origin: tuple[float, ...] | None = None
    node_prefix: str = ""
    repeated: str = ""
    table: str = ""
    where: Mapping[str, str] = field(default_factory=dict)
    rate: float = 0.0
    skip_bad_rows: bool = False

    def __post_init__(self) -> None:
        """Raises UsageError for an unknown column."""
        for name in self.names:
            if name not in USUAL:
                raise UsageError(f"--column {name}: unknown ({did_you_mean(name, USUAL)})")

    def is_text(self, column: str) -> bool:
        """Whether the cells of a column of a file are read as they are written."""
        return plain(column) in NAMING or column in self.names.values() or column in self.where


USUALLY: Final = Conventions()
"""SI units, and the usual names of columns."""


def plain(name: str) -> str:
    """A column's name without case and without its unit; blanks and points become underscores."""
    return re.sub(r"[\s.\-]+", "_", STATED.split(name, maxsplit=1)[0].strip().casefold())


def unit_in(name: str) -> str:
    """The unit that a header states, such as 'range [mm]' or 'range_mm'; '' if it states none that we know."""
    found = STATED.search(name)
    unit = (found[1] or found[2]).strip() if found else ""
    return unit if unit and parse(unit) is not None else ""


def column_roles(path: str, names: Sequence[str], wanted: Sequence[str], given: Mapping[str, str]) -> dict[str, str]:
    """{our name: the file's} of the wanted columns that a file has.

    Raises:
        UsageError: A given column does not exist, or several columns may be the one that is wanted.
    """
    roles: dict[str, str] = {}
    for ours in wanted:
        if (theirs := given.get(ours)) is not None:
            if not theirs:
                continue
            if theirs not in names:
                raise UsageError(f"{path}: no column '{theirs}' ({did_you_mean(theirs, names)})")
            roles[ours] = theirs
            continue
        free = [name for name in names if name not in given.values()]
        exact = [name for name in free if plain(name) == ours]
        found = exact or [name for name in free if plain(name) in USUAL[ours]]
        if len(found) > 1:
            raise UsageError(f"{path}: {listed(found)} may all be the {ours}: say which, such as "
                             f"--column {ours}={listed(found[:1])}")  # fmt: skip
        if found:
            roles[ours] = found[0]
    return roles


def seconds(times: pd.Series, form: str) -> tuple[Floats, bool]:
    """(n,) times in s, NaN where one cannot be read, and whether they were dates, which count from 1970 in UTC.

    Raises:
        UsageError: The format is neither a unit of time nor one of `strptime`.
    """
    dated = pd.api.types.is_datetime64_any_dtype(times)
    texts = times if dated else times.astype(str).str.strip()
    if not dated and "%" not in form:
        factor = converted(np.ones(1), form or "s", ("s",), "--time-format")[0][0]
        numbers = numeric(texts)
        if form or numbers.notna().any():
            return numbers.to_numpy() * factor, False
        if texts.str.fullmatch(r"\d+:\d\d(:\d\d([.]\d+)?)?").all():
            return pd.to_timedelta(texts, errors="coerce").dt.total_seconds().to_numpy(), False
    texts = texts if dated or "%" in form else texts.str.replace(",", ".")  # which ISO 8601 allows too
    dates = pd.to_datetime(texts, format=form if "%" in form else "ISO8601", utc=True, errors="coerce")
    whole = dates.dt.floor("s")  # apart: a float of ns since 1970 would be wrong by 100 ns
    parts = [(each / pd.Timedelta(nanoseconds=1)).to_numpy(np.float64) for each in (whole - EPOCH, dates - whole)]
    return parts[0] / 1e9 + parts[1] / 1e9, True


def converted(values: Floats, unit: str, bases: Sequence[str], option: str = "--unit") -> tuple[Floats, str]:
    """Values in the first base unit of which `unit` is a multiple, and this base; unchanged without a unit.

    Args:
        values: The values; watts become dBm, and no finite level if they are not positive.
        unit: Their unit.
        bases: Units of the result.
        option: What gave the unit, for the message.

    Raises:
        UsageError: The unit has another dimension than the bases.
    """
    if not unit or unit in bases:
        return values, unit
    for base in bases:
        with contextlib.suppress(UnitError), np.errstate(divide="ignore", invalid="ignore"):
            one = si(f"1 {unit}", base)
            return (10.0 * np.log10(values) + one if base == "dBm" else values * one), base
    raise UsageError(f"{option} {unit}: expected {' or '.join(base or '%' for base in bases)}, or a multiple of it")


def turned(angles: Floats, convention: str) -> Floats:
    """Angles (rad) of a convention, in ±π counterclockwise from the x-axis, which points east."""
    sign, zero = ANGLES[convention or "counterclockwise-from-east"]
    return wrapped(zero + sign * angles)


def decimal(value: float) -> str:
    """A number as text, with 15 digits; a great one with 16, which are the µs of seconds since 1970."""
    return f"{value:.{16 if abs(value) > LONG_AGO else 15}g}"


def origin_note(origin: Sequence[float]) -> str:
    """The sentence that names the origin of projected places."""
    place = ",".join(f"{each:.10g}" for each in origin)
    return f"the origin is --origin {place} (degrees): give it to all files of this place"


def local_metres(
    longitudes: Floats, latitudes: Floats, used: Bools, origin: tuple[float, ...] | None = None
) -> tuple[Floats, Floats, tuple[float, ...]]:
    """x (east) and y (north) in m, and the origin in degrees: azimuthal equidistant about it, on the WGS 84 ellipsoid.

    Without an origin it is the middle of the places that are used, rounded to 1e-6 degrees. Distances from the origin
    are exact; within 10 km of it, others are wrong by less than 1e-6 of their length.

    Raises:
        UsageError: pyproj is not installed.
    """
    try:
        from pyproj import Transformer
    except ImportError:
        raise UsageError("longitudes and latitudes are projected by pyproj: pip install 'wsnsim[geo]'") from None
    if origin is None:
        ends = ((each[used].min(), each[used].max()) if used.any() else (0.0, 0.0) for each in (longitudes, latitudes))
        origin = tuple(round(float(least + most) / 2.0, 6) for least, most in ends)
    about = f"+proj=aeqd +lon_0={origin[0]!r} +lat_0={origin[1]!r} +datum=WGS84 +units=m"
    places = Transformer.from_crs("EPSG:4326", about, always_xy=True).transform(longitudes, latitudes)
    x, y = (np.round(each, 9) for each in places)
    return x, y, origin
