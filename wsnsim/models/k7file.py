"""Reader of recorded links: files in the K7 format, plain or compressed with gzip.

    read_links("links.k7.gz") -> LinkRecording

The first line is JSON, the second names the columns, and each further line is what one receiver heard of one burst of
packets. A sender transmits `tx_length` packets, one every `interframe_duration` ms, while all others listen; `datetime`
is when the receiver heard the first of them. Therefore the rows of one burst may have different times, up to its length
apart. A receiver without a row heard nothing. `link_bursts` finds bursts and rounds.

Source: Brun-Laguna and others, https://github.com/keomabrun/k7 (the format). What a round is, is our reading of it.
"""

from __future__ import annotations

import csv
import functools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools
from wsnsim.base.errors import RunError
from wsnsim.models import csvfile
from wsnsim.models.link_recording import Bursts, LinkRecording, LinkRow, RecordedRows, link_recording

COLUMNS: Final = ("datetime", "src", "dst", "channel", "mean_rssi", "pdr")
"""The columns that a file must have; `tx_count` may be missing, others are ignored."""
HIGHEST_CHANNEL: Final = 26
LEVELS: Final = (-150.0, 30.0)
"""The powers in dBm that a radio can report."""
SLACK: Final = 2.0
"""Times are whole seconds: rows of one burst may be farther apart than its length by this many s."""
LONGEST_BURST: Final = 1e9
"""s: the longest burst (our choice)."""
TYPES: Final = dict(zip(LinkRow._fields, ("i8", "f8", "i8", "i8", "i8", "f8", "f8", "i8"), strict=True))
"""The fields of rows, and their types in an array."""
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
        (rows, names), bad = _rows(path, csv.reader(file), header)
    total = len(rows) + len(bad)
    rows = rows[np.argsort(rows["time"], kind="stable")]
    bursts = Bursts(header.burst + SLACK)
    repeated = np.zeros(len(rows), dtype=np.bool_)
    bad = csvfile.limited(path, chain(bad, _repeated(rows, names, bursts, repeated)))
    if bad and not skip_bad_rows:
        raise RunError(csvfile.bad_rows_text(path, bad, total))
    kept = rows[~repeated]
    if not kept.size:
        raise RunError(f"{path}: contains no row that can be used")
    longest = header.burst + SLACK
    cut = kept["time"][0] > header.begins + longest, kept["time"][-1] < header.ends - longest
    table = RecordedRows(kept, names)
    return link_recording(path, table, bursts, _names(table, header.nodes), tuple(bad), cut)


def _repeated(rows: Any, names: Sequence[str], bursts: Bursts, repeated: Bools) -> Iterator[csvfile.BadRow]:
    """Add rows, which are in the order of their times, to bursts; mark and yield those that a burst has already."""
    for i, row in enumerate(rows):
        line, time, source, receiver, *values = row.tolist()
        if said := bursts.add(LinkRow(line, time, names[source], names[receiver], *values)):
            repeated[i] = True
            yield csvfile.BadRow(line, said)


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
    try:
        return _seconds(str(said[name]), name)
    except ValueError as error:
        raise RunError(f"{path}:1: {error}") from error


def _rows(path: str, lines: Any, header: _Header) -> tuple[RecordedRows, list[csvfile.BadRow]]:
    """The rows in the order of the file, and those that cannot be used."""
    columns = [name.strip() for name in next(lines, [])]
    if missing := [name for name in COLUMNS if name not in columns]:
        wanted = ",".join((*COLUMNS, "tx_count"))
        raise RunError(
            f"{path}:2: the columns must be '{wanted}'; {', '.join(missing)} not found in '{','.join(columns)[:200]}'"
        )
    csvfile.demand_once(f"{path}:2", columns, (*COLUMNS, "tx_count"))
    codes: dict[str, int] = {}
    bad: list[csvfile.BadRow] = []
    rows = np.fromiter(_good_rows(path, lines, columns, header, codes, bad), dtype=list(TYPES.items()))
    if not rows.size and not bad:
        raise RunError(f"{path}: contains no links, only the two lines at its top")
    return RecordedRows(rows, tuple(codes)), bad


def _good_rows(
    path: str, lines: Any, columns: Sequence[str], header: _Header, codes: dict[str, int], bad: list[csvfile.BadRow]
) -> Iterator[tuple[Any, ...]]:
    """Yield the values of each row that can be used, nodes as codes; add to `codes` and `bad`."""
    at = [columns.index(name) for name in COLUMNS]
    counted = columns.index("tx_count") if "tx_count" in columns else len(columns)
    for number, cells in enumerate(filter(any, lines)):
        line = lines.line_num + 1
        if number >= csvfile.MOST_ROWS:
            raise RunError(f"{path}:{line}: has more than {csvfile.MOST_ROWS:,} rows: split it")
        try:
            packets = cells[counted].strip() if len(cells) > counted else ""
            row = _row(line, [cells[i].strip() for i in at], packets, header)
        except (IndexError, ValueError) as error:
            columns_missing = f"must have {len(columns)} columns, has {len(cells)}"
            bad.append(csvfile.BadRow(line, columns_missing if isinstance(error, IndexError) else str(error)))
            if len(bad) > csvfile.MOST_BAD:
                csvfile.limited(path, bad)
        else:
            nodes = [codes.setdefault(name, len(codes)) for name in (row.source, row.receiver)]
            yield row.line, row.time, *nodes, *row[4:]


def _row(line: int, cells: Sequence[str], packets: str, header: _Header) -> LinkRow:
    """One row. Raises ValueError with what is wrong and what is allowed."""
    when, source, receiver, channel, power, ratio = cells
    if not source or not receiver or source == receiver:
        pair = f"{source[: csvfile.LONGEST_SHOWN]!r} and {receiver[: csvfile.LONGEST_SHOWN]!r}"
        raise ValueError(f"src and dst must name two nodes, are {pair}")
    if max(len(source), len(receiver)) > csvfile.LONGEST_NAME:
        raise ValueError(f"src and dst must have at most {csvfile.LONGEST_NAME} characters")
    number = _number("channel", channel, 0, HIGHEST_CHANNEL)
    if number != int(number) or (header.channels and int(number) not in header.channels):
        listed = ", ".join(map(str, sorted(header.channels))) or f"0 to {HIGHEST_CHANNEL}"
        allowed = f"channel must be one of those of the first line, {listed}"
        raise ValueError(f"{allowed}, is {channel[: csvfile.LONGEST_SHOWN]!r}")
    share = _number("pdr", ratio, 0.0, 1.0)
    level = _number("mean_rssi", power, *LEVELS) if share else math.nan
    count = _number("tx_count", packets, 1, 1e9) if packets else header.packets
    return LinkRow(line, _seconds(when), source, receiver, int(number), level, share, int(count))


def _number(name: str, cell: str, least: float, most: float) -> float:
    value = csvfile.number_in(cell)
    if not least <= value <= most:
        raise ValueError(f"{name} must be a number from {least:g} to {most:g}, is {cell[: csvfile.LONGEST_SHOWN]!r}")
    return value


def _seconds(cell: str, name: str = "datetime") -> float:
    """A time in s since 1970; times without a zone are taken for UTC."""
    try:
        moment = datetime.fromisoformat(cell)
    except ValueError:
        raise ValueError(
            f"{name} must be a time such as 2018-01-11T16:32:22, is {cell[: csvfile.LONGEST_SHOWN]!r}"
        ) from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _names(table: RecordedRows, count: int) -> tuple[str, ...]:
    """The names of all nodes: 0, 1, ... if the first line counts so many and no row names another; else those named."""
    found = {table.names[code] for code in np.union1d(table.rows["source"], table.rows["receiver"])}
    numbered = [str(node) for node in range(min(count, 10 * len(found)))]
    if found <= set(numbered):
        return tuple(numbered)
    return tuple(sorted(found, key=lambda name: (0, int(name), name) if name.isdecimal() else (1, 0, name)))
