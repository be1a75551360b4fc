"""Bursts of packets in recorded links, and the rounds that they form.

    bursts = Bursts(longest); bursts.add(row), in the order of times; bursts.rounds()

Rows of one sender on one channel that are not farther apart than a burst lasts belong together. A round of a channel is
one burst of every sender on it. A new round begins with the second burst of any sender, or after a pause of more than
half the usual time between two bursts of a sender.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from wsnsim.base.arrays import Ints


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
