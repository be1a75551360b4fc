"""Reader of recorded links: files in the K7 format, plain or compressed with gzip.

    read_links("links.k7.gz") -> LinkRecording

The first line is JSON, the second names the columns, and each further line is what one receiver heard of one burst of
packets. A sender transmits `tx_length` packets, one every `interframe_duration` ms, while all others listen; `datetime`
is when the receiver heard the first of them. Therefore the rows of one burst may have different times, up to its length
apart. A receiver without a row heard nothing. `link_bursts` finds bursts and rounds.

Source: Brun-Laguna and others, https://github.com/keomabrun/k7 (the format). What a round is, is our reading of it.
"""

from __future__ import annotations

import functools
import json
import math
import operator
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools
from wsnsim.base.errors import RunError
from wsnsim.models import csvfile, row_checks
from wsnsim.models.link_recording import Bursts, LinkRecording, LinkRow, RecordedRows, link_recording

HIGHEST_CHANNEL: Final = 26
LEVELS: Final = (-150.0, 30.0)
"""The powers in dBm that a radio can report."""
SLACK: Final = 2.0
"""Times are whole seconds: rows of one burst may be farther apart than its length by this many s."""
LONGEST_BURST: Final = 1e9
"""s: the longest burst (our choice)."""
TYPES: Final = dict(zip(LinkRow._fields, ("i8", "f8", "i8", "i8", "i8", "f8", "f8", "i8"), strict=True))
"""The fields of rows, and their types in an array."""
A_TIME: Final = "must be a time such as 2018-01-11T16:32:22"
KEPT: Final = 4
"""Recordings that a process keeps."""


def read_links(path: str, skip_bad_rows: bool = False) -> LinkRecording:
    """Return the recorded links of a K7 file. A file that did not change is read once per process.

    Args:
        path: The file.
        skip_bad_rows: Whether rows that cannot be used are left out, and listed in the result.

    Raises:
        RunError: The file or one of its rows cannot be used. The message names file, line and what is allowed.
    """
    try:
        status = Path(path).stat()
    except (OSError, ValueError) as error:  # a name that no file can have
        raise RunError(f"{path}: cannot be read: {getattr(error, 'strerror', error)}") from error
    return _read(path, skip_bad_rows, (status.st_mtime_ns, status.st_size, status.st_ino))


class _Header(NamedTuple):
    """The first line: packets of a burst, its duration in s, the channels (empty: not stated), the number of nodes.

    `begins` and `ends` are the times of the whole recording in s since 1970; infinity and -infinity if not stated.
    """

    packets: int
    burst: float
    channels: frozenset[int]
    nodes: int
    begins: float
    ends: float


@functools.lru_cache(maxsize=KEPT)
def _read(path: str, skip_bad_rows: bool, version: tuple[int, ...]) -> LinkRecording:
    """The content of one version of a file."""
    with csvfile.open_text(path) as file:
        header = _header(path, file.readline())
        cells = csvfile.read_cells(path, file, _wanted(header), "links, only the two lines at its top", first=2)
    rows, names = _rows(cells, header)
    bad = row_checks.limited(path, row_checks.refused(cells.lines, *_checks(cells, header)))
    rows = rows[~np.isin(cells.lines, [row.line for row in bad])]
    rows = rows[np.argsort(rows["time"], kind="stable")]
    bursts = Bursts(header.burst + SLACK)
    repeated = np.zeros(len(rows), dtype=np.bool_)
    bad = row_checks.limited(path, chain(bad, _repeated(rows, names, bursts, repeated)))
    if bad and not skip_bad_rows:
        raise RunError(row_checks.bad_rows_text(path, bad, len(cells.lines)))
    kept = rows[~repeated]
    if not kept.size:
        raise RunError(f"{path}: contains no row that can be used")
    longest = header.burst + SLACK
    cut = kept["time"][0] > header.begins + longest, kept["time"][-1] < header.ends - longest
    table = RecordedRows(kept, names)
    return link_recording(path, table, bursts, _names(table, header.nodes), tuple(bad), cut)


def _repeated(rows: Any, names: Sequence[str], bursts: Bursts, repeated: Bools) -> Iterator[row_checks.BadRow]:
    """Add rows, which are in the order of their times, to bursts; mark and yield those that a burst has already."""
    for i, row in enumerate(rows):
        line, time, source, receiver, *values = row.tolist()
        if said := bursts.add(LinkRow(line, time, names[source], names[receiver], *values)):
            repeated[i] = True
            yield row_checks.BadRow(line, said)


def _header(path: str, line: str) -> _Header:
    """What the first line says.

    Raises:
        RunError: It is not a JSON object with the duration of a burst.
    """
    wanted = 'the first line must be JSON such as {"tx_length": 100, "interframe_duration": 100}'
    try:
        said = json.loads(line)
        packets, interval = int(said["tx_length"]), float(said["interframe_duration"])
        channels = frozenset(int(channel) for channel in said.get("channels", ()))
        nodes = int(said.get("node_count", 0))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError) as error:
        what = f"{error.args[0]} is missing" if isinstance(error, KeyError) else f"is {line.strip()[:80]!r}"
        raise RunError(f"{path}:1: {wanted}: packets of a burst, and ms between them; {what}") from error
    most = LONGEST_BURST
    if not (1 <= packets <= most and interval > 0.0) or (burst := packets * (interval / 1000.0)) > most:
        found = f"{str(packets)[: csvfile.LONGEST_SHOWN]} and {interval:g}"
        wanted = f"tx_length and interframe_duration must be positive, are {found}"
        raise RunError(f"{path}:1: {wanted}; a burst lasts {most:g} s at most")
    begins, ends = _date(path, said, "start_date", math.inf), _date(path, said, "stop_date", -math.inf)
    return _Header(packets, burst, channels, nodes, begins, ends)


def _date(path: str, said: Mapping[str, Any], name: str, missing: float) -> float:
    """A date of the first line in s since 1970. Raises RunError if it is no time."""
    if said.get(name) is None:
        return missing
    if math.isnan(seconds := _seconds(str(said[name]))):
        raise RunError(f"{path}:1: {name} {A_TIME}, is {str(said[name])[: csvfile.LONGEST_SHOWN]!r}")
    return seconds


def _wanted(header: _Header) -> csvfile.Wanted:
    """The columns that are read: `tx_count` may be missing, and has the number of the first line where it is empty."""
    numbers = ("datetime", "channel", "mean_rssi", "pdr", "tx_count")

    def packets(cell: str) -> float:
        return csvfile.number_in(cell) if cell.strip() else header.packets

    return csvfile.Wanted(
        {name: name for name in ("src", "dst")}, {name: name for name in numbers}, ("tx_count",),
        {"datetime": _seconds, "tx_count": packets},
    )  # fmt: skip


def _rows(cells: csvfile.TextCells, header: _Header) -> RecordedRows:
    """All rows, in the order of the file."""
    source, receiver = cells.texts["src"], cells.texts["dst"]
    codes = {name: code for code, name in enumerate(dict.fromkeys(source.names + receiver.names))}
    nodes = [np.array([codes[name] for name in column.names])[column.codes] for column in (source, receiver)]
    number = cells.numbers
    ratios, counts = number["pdr"], number.get("tx_count", np.full(len(cells.lines), header.packets))
    powers = np.where(ratios > 0.0, number["mean_rssi"], np.nan)
    whole = (np.nan_to_num(each).clip(0.0, 1e9) for each in (number["channel"], counts))
    columns = [cells.lines, number["datetime"], *nodes, next(whole), powers, ratios, next(whole)]
    return RecordedRows(np.rec.fromarrays(columns, dtype=list(TYPES.items())), tuple(codes))


def _checks(cells: csvfile.TextCells, header: _Header) -> Iterator[row_checks.Check]:
    """Yield which rows cannot be used, and why."""
    (sources, source), (receivers, receiver), values = cells.texts["src"], cells.texts["dst"], cells.numbers

    def pair(row: int) -> str:
        names = (name[: csvfile.LONGEST_SHOWN] for name in (sources[source[row]], receivers[receiver[row]]))
        return "src and dst must name two nodes, are {!r} and {!r}".format(*names)

    nodes = {name: code for code, name in enumerate(sources)}
    same = np.array([nodes.get(name, -1) for name in receivers])[receiver] == source
    unnamed, long = (
        cells.texts["src"].where(holds) | cells.texts["dst"].where(holds)
        for holds in (operator.not_, lambda name: len(name) > csvfile.LONGEST_NAME)
    )
    yield same | unnamed, pair
    yield long, f"src and dst must have at most {csvfile.LONGEST_NAME} characters"
    allowed = sorted(header.channels) or range(HIGHEST_CHANNEL + 1)
    listed = ", ".join(map(str, allowed)) if header.channels else f"0 to {HIGHEST_CHANNEL}"
    said = f"channel must be one of those of the first line, {listed}"
    yield ~np.isin(values["channel"], allowed), lambda row: f"{said}, is {cells.shown('channel', row)}"
    for name, least, most in (("pdr", 0.0, 1.0), ("mean_rssi", *LEVELS), ("tx_count", 1.0, 1e9)):
        number = values.get(name, np.ones(len(source)))
        within = (least <= number) & (number <= most) | (name == "mean_rssi") & (values["pdr"] == 0.0)
        yield ~within, functools.partial(_beyond, cells, name, least, most)
    yield np.isnan(values["datetime"]), lambda row: f"datetime {A_TIME}, is {cells.shown('datetime', row)}"


def _beyond(cells: csvfile.TextCells, name: str, least: float, most: float, row: int) -> str:
    return f"{name} must be a number from {least:g} to {most:g}, is {cells.shown(name, row)}"


def _seconds(cell: str) -> float:
    """A time in s since 1970, NaN for a cell that holds none; times without a zone are taken for UTC."""
    try:
        moment = datetime.fromisoformat(cell.strip())
    except ValueError:
        return math.nan
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _names(table: RecordedRows, count: int) -> tuple[str, ...]:
    """The names of all nodes: 0, 1, ... if the first line counts so many and no row names another; else those named."""
    found = {table.names[code] for code in np.union1d(table.rows["source"], table.rows["receiver"])}
    numbered = [str(node) for node in range(min(count, 10 * len(found)))]
    if found <= set(numbered):
        return tuple(numbered)
    return tuple(sorted(found, key=lambda name: (0, int(name), name) if name.isdecimal() else (1, 0, name)))
