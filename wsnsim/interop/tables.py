"""Tables as people have them, read by pandas, SciPy, gpxpy and Python's parsers: text, spreadsheets, JSON, GPX, Cooja.

read_table(path, columns) -> RawTable           numeric(column) -> numbers

Text may be separated by commas, semicolons, tabs, bars or blanks, with decimal points or commas, LF or CRLF, with a
byte order mark, and compressed with gzip. XML with a document type is refused: it could define entities.
"""

from __future__ import annotations

import itertools
import json
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from wsnsim.base.errors import RunError, UsageError, WsnsimError, shortened
from wsnsim.base.files import MOST_BYTES, why_not_regular
from wsnsim.models.csvfile import MOST_ROWS, cells_in, number_in, open_text

SAMPLE: Final = 50
"""Lines from which separator, decimal sign and header are recognised."""
SEPARATORS: Final = (";", "\t", ",", "|", r"\s+")
COMMENTS: Final = ("#", "%", "//")
DECIMAL_COMMA: Final = re.compile(r"[-+]?\d+,\d+")
DECIMAL_POINT: Final = re.compile(r"[-+]?\d*\.\d+")
WIDTHS: Final = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")
"""What pandas says of a row that is longer than others."""
NUMBER: Final = re.compile(
    r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)|(\d{4}-\d\d-\d\d[T ]?\S*)", re.I
)
"""A number or a date, as the first line of a file without a header has them."""
INSTALLED_BY: Final = {"pyarrow": "'wsnsim[parquet]'", "gpxpy": "'wsnsim[geo]'", "pyproj": "'wsnsim[geo]'"}


class RawTable(NamedTuple):
    """A table as it stands in a file.

    Attributes:
        path: The file.
        frame: Its columns, by their names in the file; the index is the line, or the number of the row, from 1.
        by_line: Whether the index is a line.
        degrees: Whether the format says that places are longitudes and latitudes (GPX and GeoJSON).
    """

    path: str
    frame: pd.DataFrame
    by_line: bool = False
    degrees: bool = False


def read_table(
    path: str, columns: Sequence[str] = (), texts: Callable[[str], bool] = lambda name: False, part: str = ""
) -> RawTable:
    """The table of a file; the ending of its name says the format, any other than those of `READERS` is a text.

    Args:
        path: The file.
        columns: The names of the columns of a file without a header.
        texts: Whether a column holds names, which are read as they are written (`007`).
        part: The variable, sheet or list that is read, of files that have several; '': the only one.

    Raises:
        UsageError: The file has no header and no columns are given, or what reads this format is not installed.
        RunError: The file cannot be read.
    """
    if irregular := why_not_regular(path) or ("" if Path(path).exists() else "No such file or directory"):
        raise RunError(f"{path}: cannot be read: {irregular}")
    reader = READERS.get(Path(path.lower().removesuffix(".gz")).suffix)
    try:
        table = reader(path, columns, part) if reader else _of_text(path, columns, texts)
    except WsnsimError:
        raise
    except ImportError as error:
        name = error.name or next((word for word in ("openpyxl", *INSTALLED_BY) if word in str(error)), "a reader")
        raise UsageError(f"{path}: {name} reads it: pip install {INSTALLED_BY.get(name, name)}") from None
    except Exception as error:  # what the libraries raise of damaged files is not documented
        said = getattr(error, "strerror", None) or str(error).partition("\n")[0][:200] or type(error).__name__
        raise RunError(f"{path}: cannot be read: {said}") from error
    frame = table.frame
    frame.columns = [str(name).strip() for name in frame.columns]
    if twice := [name for name in frame.columns if re.sub(r"\.\d+$", "", name) in set(frame.columns) - {name}]:
        raise RunError(f"{path}: the header names the column {listed([twice[0].rpartition('.')[0]])} twice: rename one")
    if not len(frame):
        raise RunError(f"{path}: contains no rows")
    if len(frame) > MOST_ROWS:
        raise RunError(f"{path}: has more than {MOST_ROWS:,} rows: split it, or thin it out")
    return table


def listed(names: Sequence[str]) -> str:
    """The first names of columns, as messages list them."""
    return ", ".join(repr(shortened(str(name), 40)) for name in names[:12]) + ", ..." * (len(names) > 12)


def numeric(column: pd.Series) -> pd.Series:
    """A column as numbers, NaN for cells that are none."""
    try:
        return pd.to_numeric(column, errors="coerce").astype(np.float64)
    except OverflowError:  # more digits than a float has
        return column.map(lambda cell: number_in(str(cell)))


def _of_text(path: str, columns: Sequence[str], texts: Callable[[str], bool]) -> RawTable:
    with open_text(path) as file:
        head = [line.strip("\r\n") for line in itertools.islice(file, SAMPLE)]
    data = [i for i, line in enumerate(head) if line.strip() and not line.lstrip().startswith(COMMENTS)]
    first = data[0] if data else len(head)
    separator, rows = _split([line for line in head[first:] if line.strip()], len(columns))
    commas, points = (
        any(form.fullmatch(cell) for row in rows for cell in row) for form in (DECIMAL_COMMA, DECIMAL_POINT)
    )
    if not columns and _is_headless(rows):
        raise UsageError(_headless(f"{path}:{first + 1}", rows))
    names = list(columns) or [name.strip() for name in (rows[0] if rows else [])]
    with open_text(path) as file, warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            frame = pd.read_csv(
                file, sep=separator, decimal="," if commas and not points else ".",
                header=None if columns else 0, names=columns or None,
                skiprows=first, index_col=False, skip_blank_lines=False, skipinitialspace=True, low_memory=False,
                keep_default_na=False, na_values=[""], dtype=dict.fromkeys(filter(texts, names), str),
            )  # fmt: skip
        except pd.errors.ParserWarning:
            row = next((i for i in range(first + 1, len(head)) if "," in head[i]), first)
            raise RunError(
                f"{path}:{row + 1}: has more than the {len(names)} columns of the header: {head[row][:80]!r}; "
                "a comma in a number or a time? Separate columns by semicolons"
            ) from None
        except (pd.errors.ParserError, pd.errors.EmptyDataError) as error:
            raise _not_a_table(path, error) from None
    frame.index = np.arange(len(frame)) + first + (1 if columns else 2)
    return RawTable(path, frame.dropna(how="all"), by_line=True)


def _is_headless(rows: Sequence[Sequence[str]]) -> bool:
    """Whether the first row has numbers, and the second one in the same columns."""
    flags = [[NUMBER.fullmatch(cell) is not None for cell in row] for row in rows[:2]]
    return bool(flags) and any(flags[0]) and flags[0] == flags[-1]


def _headless(place: str, rows: Sequence[Sequence[str]]) -> str:
    such = "such as --columns time,node,reading (links: src,dst,prr; of a matrix of ratios, its nodes)"
    return f"{place}: the file has no header: name its {len(rows[0])} columns in their order, {such}"


def _not_a_table(path: str, error: Exception) -> RunError:
    found = WIDTHS.search(str(error))
    if isinstance(error, pd.errors.EmptyDataError):
        return RunError(f"{path}: contains no rows, the file is empty")
    if not found:
        return RunError(f"{path}: contains no table ({str(error).strip()[:120]})")
    return RunError(f"{path}:{found[2]}: has {found[3]} columns, the lines above have {found[1]}")


def _split(lines: Sequence[str], width: int) -> tuple[str, list[list[str]]]:
    """The separator of lines, and their cells: as many in each line as in the first, and as many numbers as possible.

    Args:
        lines: The lines.
        width: The number of columns, if it is known, else 0.
    """
    best: tuple[tuple[float, float], str, list[list[str]]] = ((0.0, 0.0), ",", [[line] for line in lines])
    for sign in SEPARATORS:
        rows = [line.split() for line in lines] if sign == r"\s+" else [*cells_in(lines, sign)]
        counts = [len(row) for row in rows]
        if not counts or (wanted := width or counts[0]) < 2:
            continue
        numbers = sum(NUMBER.fullmatch(cell) is not None for row in rows for cell in row)
        score = counts.count(wanted) / len(counts), numbers / sum(counts)
        if score > best[0]:
            best = score, sign, rows
    return best[1], best[2]


def _only(path: str, found: Mapping[str, Any], part: str) -> Any:
    """The part of a file that is asked for, or its only one. Raises UsageError unless there is one."""
    if part in found or (len(found) == 1 and not part):
        return found[part or next(iter(found))]
    raise UsageError(f"{path}: holds {listed(list(found))}: choose one with --table")


def _of_spreadsheet(path: str, columns: Sequence[str], part: str) -> RawTable:
    import zipfile

    with zipfile.ZipFile(path) as packed:
        if sum(entry.file_size for entry in packed.infolist()) > MOST_BYTES:
            raise RunError(f"{path}: has more than {MOST_BYTES // 10**6} MB when decompressed: save it as CSV")
    sheets = pd.read_excel(path, header=None, sheet_name=None)
    frame = _only(path, {name: rows.dropna(how="all") for name, rows in sheets.items() if rows.size}, part)
    rows = [[str(cell) for cell in row] for row in frame.head(2).to_numpy().tolist()]
    if not columns and _is_headless(rows):
        raise UsageError(_headless(path, rows))
    names, data = (columns, frame) if columns else (frame.iloc[0], frame[1:])
    if len(names) != frame.shape[1]:
        raise RunError(f"{path}: has {frame.shape[1]} columns, {len(names)} names are given")
    return _numbered(path, data.set_axis(list(names), axis=1).infer_objects())


def _of_parquet(path: str, columns: Sequence[str], part: str) -> RawTable:
    return _numbered(path, pd.read_parquet(path))


def _of_matlab(path: str, columns: Sequence[str], part: str) -> RawTable:
    """The vectors of equal length of a file, the fields of its only struct, or the columns of its only matrix."""
    from scipy.io import loadmat

    try:
        found = loadmat(path, squeeze_me=True)
    except NotImplementedError:
        raise RunError(f"{path}: is a file of version 7.3: save it with '-v7'") from None
    found = {name: np.asarray(value) for name, value in found.items() if not name.startswith("__")}
    if part or len(found) == 1:
        only = _only(path, found, part)
        if only.dtype.names:
            found = {name: np.asarray(only[name].item() if not only.ndim else only[name]) for name in only.dtype.names}
        elif only.ndim == 2:
            names = list(columns) or [str(number) for number in range(only.shape[1])]
            if len(names) != only.shape[1]:
                raise RunError(f"{path}: has {only.shape[1]} columns, {len(names)} names are given")
            return _numbered(path, pd.DataFrame(only, columns=names))
    lengths = {name: value.shape for name, value in found.items()}
    if len(set(lengths.values())) != 1 or any(len(shape) != 1 for shape in lengths.values()):
        said = ", ".join(f"{name} {'×'.join(map(str, shape)) or 'scalar'}" for name, shape in lengths.items())
        raise RunError(f"{path}: must hold vectors of equal length, one struct of them or one matrix, "
                       f"holds {said}: choose one with --table")  # fmt: skip
    return _numbered(path, pd.DataFrame({name: value.tolist() for name, value in found.items()}))


def _of_json(path: str, columns: Sequence[str], part: str) -> RawTable:
    """The records of a file: a list, one a line, or the only list in a mapping; or a mapping of lists; or GeoJSON."""
    text = _whole(path)
    try:
        said = json.loads(text)
    except json.JSONDecodeError:
        said = [json.loads(line) for line in text.splitlines() if line.strip()]
    if isinstance(said, dict) and str(said.get("type")).startswith("Feature"):
        features = said.get("features", [said])
        if not (isinstance(features, list) and all(isinstance(each, dict) for each in features)):
            raise RunError(f"{path}: features must be a list of features, is {str(features)[:60]!r}")
        return _numbered(path, pd.DataFrame(_features(path, features)))._replace(degrees=True)
    if isinstance(said, dict):
        lists = {
            name: each for name, each in said.items() if isinstance(each, list) and each and isinstance(each[0], dict)
        }
        said = _only(path, lists, part) if lists or part else said
    if isinstance(said, list) and all(isinstance(record, dict) for record in said):
        return _numbered(path, pd.json_normalize(said))
    if isinstance(said, dict) and all(isinstance(value, list) for value in said.values()):
        return _numbered(path, pd.DataFrame(said))
    raise RunError(f'{path}: must hold a list of records, such as [{{"time": 0, "node": "a", "reading": -60}}]')


def _features(path: str, features: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield a row for each place of GeoJSON features; those of a line have its times, where it states them."""
    for number, feature in enumerate(features, 1):
        shape, own = feature.get("geometry") or {}, dict(feature.get("properties") or {})
        kind, places = shape.get("type"), shape.get("coordinates", [])
        if kind is None:
            raise RunError(f"{path}: feature {number} has no geometry: remove it")
        if kind not in ("Point", "MultiPoint", "LineString"):
            raise RunError(f"{path}: feature {number} must be a Point, MultiPoint or LineString, is {str(kind)[:60]}")
        times = own.pop("coordTimes", None) or (own.pop("coordinateProperties", None) or {}).get("times", [])
        named = {"id": feature["id"]} if "id" in feature else {}
        for i, place in enumerate([places] if kind == "Point" else places):
            time = {"time": times[i]} if i < len(times) else {}
            yield {**own, **named, **time, **dict(zip(("lon", "lat", "z"), place, strict=False))}


def _of_gpx(path: str, columns: Sequence[str], part: str) -> RawTable:
    import gpxpy

    found, stem = gpxpy.parse(_xml(path)), Path(path).name.split(".")[0]
    points: list[tuple[str, Any]] = [
        (track.name or f"{stem}_{number}".removesuffix("_0"), point) for number, track in enumerate(found.tracks)
        for segment in track.segments for point in segment.points
    ]  # fmt: skip
    points = points or [(point.name or str(number), point) for number, point in enumerate(found.waypoints)]
    rows = [{"id": name, "time": point.time, "lon": point.longitude, "lat": point.latitude, "z": point.elevation}
            for name, point in points]  # fmt: skip
    return _numbered(path, pd.DataFrame(rows).dropna(axis=1, how="all"))._replace(degrees=True)


def _of_cooja(path: str, columns: Sequence[str], part: str) -> RawTable:
    """The motes of a simulation: attributes of `pos` (Cooja of Contiki-NG), or elements x, y and z (Contiki)."""
    rows = []
    for mote in filter(len, ElementTree.fromstring(_xml(path)).iter("mote")):  # plug-ins name motes by numbers
        place = next((dict(found.attrib) for found in mote.iter("pos")), {})
        place |= {found.tag: (found.text or "").strip() for found in mote.iter() if found.tag in ("id", "x", "y", "z")}
        rows.append(place)
    return _numbered(path, pd.DataFrame(rows))


def _xml(path: str) -> str:
    """The text of an XML file. Raises RunError if it has a document type, which could define entities."""
    text = _whole(path)
    if re.search(r"<!\s*(DOCTYPE|ENTITY)", text, re.I):
        raise RunError(f"{path}: a document type is not allowed")
    return text


def _whole(path: str) -> str:
    with open_text(path) as file:
        text: str = file.read(MOST_BYTES + 1)
    if len(text) > MOST_BYTES:
        raise RunError(f"{path}: has more than {MOST_BYTES // 10**6} million characters: split it")
    return text


def _numbered(path: str, frame: pd.DataFrame) -> RawTable:
    return RawTable(path, frame.set_axis(np.arange(len(frame)) + 1))


READERS: Final[Mapping[str, Callable[[str, Sequence[str], str], RawTable]]] = {
    ".xlsx": _of_spreadsheet, ".parquet": _of_parquet, ".mat": _of_matlab, ".json": _of_json, ".jsonl": _of_json,
    ".geojson": _of_json, ".gpx": _of_gpx, ".csc": _of_cooja,
}  # fmt: skip
