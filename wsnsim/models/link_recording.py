"""The recorded links between nodes: what was heard, in which bursts and rounds, and which rounds are complete.

link_recording(path, table, bursts, names, bad, cut) -> LinkRecording
bursts = Bursts(longest); bursts.add(row), in the order of times; bursts.rounds()

Rows of one sender on one channel that are not farther apart than a burst lasts belong together. A round of a channel is
one burst of every sender on it. A new round begins with the second burst of any sender, or after a pause of more than
half the usual time between two bursts of a sender.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints, since
from wsnsim.models.row_checks import BadRow


class LinkRow(NamedTuple):
    """What one receiver heard of one burst; time in s, power in dBm."""

    line: int
    time: float
    source: str
    receiver: str
    channel: int
    power: float
    ratio: float
    packets: int


class Bursts:
    """The bursts to which rows belong, which are given in the order of their times. `longest`: s of one burst.

    Attributes:
        of_rows: The burst of each row that was added.
        sources: The sender of each burst.
        channels: The channel of each burst.
        starts: The time of the first row of each burst, in s; ascending.
    """

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._last: dict[tuple[str, int], int] = {}
        self._lines: dict[tuple[str, int], dict[str, int]] = {}
        self.of_rows = array("q")
        self.sources: list[str] = []
        self.channels: list[int] = []
        self.starts: list[float] = []

    def add(self, row: LinkRow) -> str:
        """Add a row; returns what is wrong if its receiver has a row in this burst already."""
        sender = (row.source, row.channel)
        burst = self._last.get(sender, -1)
        if burst < 0 or row.time > self.starts[burst] + self._longest:
            burst, self._lines[sender] = len(self.starts), {}
            self._last[sender] = burst
            self.sources.append(row.source)
            self.channels.append(row.channel)
            self.starts.append(row.time)
        first = self._lines[sender].setdefault(row.receiver, row.line)
        if first != row.line:
            return (
                f"a burst has one row for each receiver, but line {first} has what {row.receiver} heard of "
                f"{row.source} on channel {row.channel} less than {self._longest:g} s before"
            )
        self.of_rows.append(burst)
        return ""

    def rounds(self) -> Ints:
        """(B,) the number of the round of its channel to which each burst belongs."""
        numbers = np.zeros(len(self.starts), dtype=np.int64)
        channels = np.array(self.channels)
        for channel in np.unique(channels).tolist():
            bursts = np.flatnonzero(channels == channel).tolist()
            longest = self._revisit(bursts) / 2.0
            seen: set[str] = set()
            number, before = 0, self.starts[bursts[0]]
            for burst in bursts:
                if self.sources[burst] in seen or self.starts[burst] - before > longest:
                    number, seen = number + 1, set()
                numbers[burst], before = number, self.starts[burst]
                seen.add(self.sources[burst])
        return numbers

    def _revisit(self, bursts: Sequence[int]) -> float:
        """Median time in s between two bursts of one sender; infinite if none has two."""
        starts: dict[str, list[float]] = {}
        for burst in bursts:
            starts.setdefault(self.sources[burst], []).append(self.starts[burst])
        between = [later - earlier for each in starts.values() for earlier, later in pairwise(each)]
        return float(np.median(between)) if between else math.inf


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
            incomplete if a sender of the round beside them is missing. If the round of the file's first or last burst
            is the only one of its channel, every node that sent on any channel must have sent in it.
        cut: Channel, round and sender of the first and the last burst, if the file may begin or end within it: its
            first row is later than `start_date` in the first line by more than a burst lasts, or its last row is so
            much earlier than `stop_date`. Rows of such a burst are left out, and the sender is not missed in the round.
            Without these dates, both bursts are taken for whole.
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
    cut: tuple[tuple[int, int, str], ...]
    bad: tuple[BadRow, ...]

    def left_out(self, channel: int) -> list[str]:
        """A sentence on each burst and round of a channel that is left out."""
        part = "may be cut by the file's beginning or end: left out, no frame of it arrives"
        notes = [f"the burst of node {sender} in round {number} of channel {channel} {part}"
                 for on, number, sender in self.cut if on == channel and self.complete[channel][number]]  # fmt: skip
        for number in np.flatnonzero(~self.complete[channel]).tolist():
            sent = f"{self.sent[channel][number].sum()} of {len(self.nodes)} senders"
            notes.append(f"round {number} of channel {channel} was recorded in part, with {sent}: left out")
        return notes


class RecordedRows(NamedTuple):
    """Rows of links: a structured array (n,) with the fields of `LinkRow`, whose nodes are indices into `names`."""

    rows: Any
    names: tuple[str, ...]


def link_recording(
    path: str,
    table: RecordedRows,
    bursts: Bursts,
    names: tuple[str, ...],
    bad: tuple[BadRow, ...],
    cut: tuple[bool, bool],
) -> LinkRecording:
    """The recording that rows form.

    Args:
        path: The file.
        table: The rows that can be used, in the order of their times.
        bursts: The bursts of these rows.
        names: The names of all nodes.
        bad: Rows that were skipped.
        cut: Whether the first and the last burst of the file may be cut.
    """
    index = {name: i for i, name in enumerate(names)}
    of_rows = np.array(bursts.of_rows)
    ends = [burst for burst, may_be in zip((0, len(bursts.starts) - 1), cut, strict=True) if may_be]
    whole = ~np.isin(of_rows, ends)
    rows, codes = table.rows[whole], np.array([index.get(name, -1) for name in table.names])
    origin = float(table.rows["time"][0])
    channels, numbers = np.array(bursts.channels), bursts.rounds()
    starts, senders = np.array(bursts.starts), np.array([index[name] for name in bursts.sources])
    begin, sent = {}, {}
    for channel in np.unique(channels).tolist():
        on = channels == channel
        begins = np.array([starts[on & (numbers == i)].min() for i in range(numbers[on].max() + 1)])
        begin[channel] = since(begins, origin)
        sent[channel] = np.zeros((begin[channel].size, len(names)), dtype=np.bool_)
        sent[channel][numbers[on], senders[on]] = True
    complete = _complete(sent, [(bursts.channels[i], int(numbers[i])) for i in (0, -1)])
    for burst in ends:
        sent[bursts.channels[burst]][numbers[burst], senders[burst]] = False
    for channel in complete:
        complete[channel] &= sent[channel].any(axis=1)
    return LinkRecording(
        path=path,
        nodes=names,
        origin=origin,
        times=since(rows["time"], origin),
        sources=codes[rows["source"]],
        receivers=codes[rows["receiver"]],
        channels=np.ascontiguousarray(rows["channel"]),
        rounds=numbers[of_rows[whole]],
        powers=np.ascontiguousarray(rows["power"]),
        ratios=np.ascontiguousarray(rows["ratio"]),
        packets=np.ascontiguousarray(rows["packets"]),
        starts=begin,
        sent=sent,
        complete=complete,
        cut=tuple((bursts.channels[i], int(numbers[i]), bursts.sources[i]) for i in ends),
        bad=bad,
    )


def _complete(sent: Mapping[int, Bools], edges: Sequence[tuple[int, int]]) -> dict[int, Bools]:
    """{channel: (R,) which rounds were recorded as a whole}.

    Args:
        sent: {channel: (R, N) who sent}.
        edges: Channel and round of the first and the last burst of the file.
    """
    complete = {channel: np.ones(len(each), dtype=np.bool_) for channel, each in sent.items()}
    for channel, each in sent.items():
        if len(each) > 1:
            complete[channel][0] = (each[0] | ~each[1]).all()
            complete[channel][-1] = (each[-1] | ~each[-2]).all()
    anywhere = np.any([each.any(axis=0) for each in sent.values()], axis=0)
    for channel, number in edges:
        if len(sent[channel]) == 1 and not sent[channel][number][anywhere].all():
            complete[channel][number] = False
    return complete
