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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.errors import RunError
from wsnsim.models.csvfile import BadRow, bad_rows_text, open_text
from wsnsim.models.link_bursts import Bursts, LinkRow

COLUMNS: Final = ("datetime", "src", "dst", "channel", "mean_rssi", "pdr")
"""The columns that a file must have; `tx_count` may be missing, others are ignored."""
HIGHEST_CHANNEL: Final = 26
LEVELS: Final = (-150.0, 30.0)
"""The powers in dBm that a radio can report."""
SLACK: Final = 2.0
"""Times are whole seconds: rows of one burst may be farther apart than its length by this many s."""
KEPT: Final = 4
"""Recordings that a process keeps."""


@dataclass(frozen=True, slots=True)
class LinkRecording:
    """What was recorded of the links between N nodes: n rows in the order of their times.

    Attributes:
        path: The file.
        nodes: Names of the N nodes, numbers in ascending order before texts.
        origin: Time of the first row, in s since 1970.
        times: (n,) s since the first row.
        sources: (n,) senders, as indices into `nodes`.
        receivers: (n,) receivers, as indices into `nodes`.
        channels: (n,) channels.
        rounds: (n,) numbers of the rounds of the channel, from 0.
        powers: (n,) mean received power in dBm; NaN where nothing arrived.
        ratios: (n,) packet delivery ratio.
        packets: (n,) packets that were sent.
        starts: {channel: (R,) s at which each of its rounds begins}.
        sent: {channel: (R, N) whether the node's burst was heard by any other in the round}.
        complete: {channel: (R,) whether the whole round was recorded}. The first and the last round of a channel are
            incomplete if a sender of the round beside them is missing. So is the round of the file's first burst if the
            file may begin within that burst: its first row is later than `start_date` in the first line by more than a
            burst lasts. The same holds for the last burst and `stop_date`. Without these dates, both bursts are taken
            for whole. If one of these two rounds is the only one of its channel, every node that sent on any channel
            must have sent in it.
        bad: Rows that were skipped.
    """

    path: str
    nodes: tuple[str, ...]
    origin: float
    times: Floats
    sources: Ints
    receivers: Ints
    channels: Ints
    rounds: Ints
    powers: Floats
    ratios: Floats
    packets: Ints
    starts: Mapping[int, Floats]
    sent: Mapping[int, Bools]
    complete: Mapping[int, Bools]
    bad: tuple[BadRow, ...]


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
    with open_text(path) as file:
        header = _header(path, file.readline())
        rows, bad = _rows(path, csv.reader(file), header)
    total = len(rows) + len(bad)
    rows.sort(key=lambda row: row.time)
    bursts = Bursts(header.burst + SLACK)
    kept = []
    for row in rows:
        if said := bursts.add(row):
            bad.append(BadRow(row.line, said))
        else:
            kept.append(row)
    bad.sort(key=lambda row: row.line)
    if bad and not skip_bad_rows:
        raise RunError(bad_rows_text(path, bad, total))
    if not kept:
        raise RunError(f"{path}: contains no row that can be used")
    longest = header.burst + SLACK
    cut = kept[0].time > header.begins + longest, kept[-1].time < header.ends - longest
    return _recording(path, kept, bursts, _names(kept, header.nodes), tuple(bad), cut)


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
    burst = packets * interval / 1000.0
    if packets < 1 or not 0.0 < burst < math.inf:
        raise RunError(f"{path}:1: tx_length and interframe_duration must be positive, are {packets} and {interval:g}")
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


def _rows(path: str, lines: Any, header: _Header) -> tuple[list[LinkRow], list[BadRow]]:
    """The rows in the order of the file, and those that cannot be used."""
    names = [name.strip() for name in next(lines, [])]
    if missing := [name for name in COLUMNS if name not in names]:
        wanted = ",".join((*COLUMNS, "tx_count"))
        raise RunError(
            f"{path}:2: the columns must be '{wanted}'; {', '.join(missing)} not found in '{','.join(names)[:200]}'"
        )
    at = [names.index(name) for name in COLUMNS]
    counted = names.index("tx_count") if "tx_count" in names else len(names)
    good, bad = [], []
    for cells in lines:
        if not any(cells):
            continue
        line = lines.line_num + 1
        try:
            packets = cells[counted].strip() if len(cells) > counted else ""
            good.append(_row(line, [cells[i].strip() for i in at], packets, header))
        except IndexError:
            bad.append(BadRow(line, f"must have {len(names)} columns, has {len(cells)}"))
        except ValueError as error:
            bad.append(BadRow(line, str(error)))
    if not good and not bad:
        raise RunError(f"{path}: contains no links, only the two lines at its top")
    return good, bad


def _row(line: int, cells: Sequence[str], packets: str, header: _Header) -> LinkRow:
    """One row. Raises ValueError with what is wrong and what is allowed."""
    when, source, receiver, channel, power, ratio = cells
    if not source or not receiver or source == receiver:
        raise ValueError(f"src and dst must name two nodes, are {source!r} and {receiver!r}")
    number = _number("channel", channel, 0, HIGHEST_CHANNEL)
    if number != int(number) or (header.channels and int(number) not in header.channels):
        raise ValueError(f"channel must be one of those of the first line, {_listed(header.channels)}, is {channel!r}")
    share = _number("pdr", ratio, 0.0, 1.0)
    level = _number("mean_rssi", power, *LEVELS) if share else math.nan
    count = _number("tx_count", packets, 1, 1e9) if packets else header.packets
    return LinkRow(line, _seconds(when), source, receiver, int(number), level, share, int(count))


def _number(name: str, cell: str, least: float, most: float) -> float:
    try:
        value = float(cell) if "_" not in cell else math.nan
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise ValueError(f"{name} must be a number from {least:g} to {most:g}, is {cell!r}")
    return value


def _seconds(cell: str, name: str = "datetime") -> float:
    """A time in s since 1970; times without a zone are taken for UTC."""
    try:
        moment = datetime.fromisoformat(cell)
    except ValueError:
        raise ValueError(f"{name} must be a time such as 2018-01-11T16:32:22, is {cell!r}") from None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _names(rows: Sequence[LinkRow], count: int) -> tuple[str, ...]:
    """The names of all nodes: 0, 1, ... if the first line counts so many and no row names another; else those named."""
    found = {row.source for row in rows} | {row.receiver for row in rows}
    numbered = [str(node) for node in range(min(count, 10 * len(found)))]
    if found <= set(numbered):
        return tuple(numbered)
    return tuple(sorted(found, key=lambda name: (0, int(name), name) if name.isdecimal() else (1, 0, name)))


def _recording(
    path: str,
    rows: Sequence[LinkRow],
    bursts: Bursts,
    names: tuple[str, ...],
    bad: tuple[BadRow, ...],
    cut: tuple[bool, bool],
) -> LinkRecording:
    """The recording of good rows; `cut`: whether the first and the last burst of the file may be cut."""
    index = {name: i for i, name in enumerate(names)}
    channels, numbers = np.array(bursts.channels), bursts.rounds()
    starts, senders = np.array(bursts.starts), np.array([index[name] for name in bursts.sources])
    begin, sent = {}, {}
    for channel in np.unique(channels).tolist():
        on = channels == channel
        begin[channel] = (
            np.array([starts[on & (numbers == i)].min() for i in range(numbers[on].max() + 1)]) - rows[0].time
        )
        sent[channel] = np.zeros((begin[channel].size, len(names)), dtype=np.bool_)
        sent[channel][numbers[on], senders[on]] = True
    return LinkRecording(
        path=path,
        nodes=names,
        origin=rows[0].time,
        times=np.array([row.time for row in rows]) - rows[0].time,
        sources=np.array([index[row.source] for row in rows], dtype=np.int64),
        receivers=np.array([index[row.receiver] for row in rows], dtype=np.int64),
        channels=np.array([row.channel for row in rows], dtype=np.int64),
        rounds=numbers[np.array(bursts.of_rows)],
        powers=np.array([row.power for row in rows]),
        ratios=np.array([row.ratio for row in rows]),
        packets=np.array([row.packets for row in rows], dtype=np.int64),
        starts=begin,
        sent=sent,
        complete=_complete(sent, [(bursts.channels[i], int(numbers[i]), cut[i]) for i in (0, -1)]),
        bad=bad,
    )


def _complete(sent: Mapping[int, Bools], edges: Sequence[tuple[int, int, bool]]) -> dict[int, Bools]:
    """{channel: (R,) which rounds were recorded as a whole}.

    Args:
        sent: {channel: (R, N) who sent}.
        edges: Channel and round of the first and the last burst of the file, and whether that burst may be cut.
    """
    complete = {channel: np.ones(len(each), dtype=np.bool_) for channel, each in sent.items()}
    for channel, each in sent.items():
        if len(each) > 1:
            complete[channel][0] = (each[0] | ~each[1]).all()
            complete[channel][-1] = (each[-1] | ~each[-2]).all()
    anywhere = np.any([each.any(axis=0) for each in sent.values()], axis=0)
    for channel, number, cut in edges:
        alone = len(sent[channel]) == 1
        if cut or (alone and not sent[channel][number][anywhere].all()):
            complete[channel][number] = False
    return complete


def _listed(channels: frozenset[int]) -> str:
    return ", ".join(map(str, sorted(channels))) or f"0 to {HIGHEST_CHANNEL}"
