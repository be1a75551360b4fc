"""Counters of broadcasts per link: the table `links`."""

from __future__ import annotations

from typing import Any

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.network.radio.topology import Neighbours, Topology
from wsnsim.network.radio.transmission import Transmission


class NoLinkCounters:
    """Counts nothing: the table `links` is not recorded."""

    def count(self, transmission: Transmission, received: Ints) -> None:
        """Ignore a broadcast."""

    def columns(self) -> dict[str, Any]:
        """Return no columns."""
        return {}


class _Counts:
    """The broadcasts of one sender over one set of links: how many were sent, and `received` (n,) of them arrived."""

    __slots__ = ("neighbours", "received", "sent")

    def __init__(self, neighbours: Neighbours) -> None:
        self.neighbours = neighbours
        self.received = np.zeros(neighbours.ids.size, dtype=np.int64)
        self.sent = 0


class LinkCounters:
    """How many broadcasts were sent over each link, and how many arrived; `chance` is for the size of the last one.

    Where links change, a link's row is about all broadcasts of its sender: `chance` is their mean, 0 in rounds without
    the link, and `power` that of the last round in which it was heard.
    """

    def __init__(self, positions: Floats, topology: Topology) -> None:
        self._positions = positions
        self._topology = topology
        self._last_bits = 0
        self._counts: dict[int, list[_Counts]] = {}

    def count(self, transmission: Transmission, received: Ints) -> None:
        """Count a broadcast on each link of its sender."""
        neighbours, self._last_bits = transmission.neighbours, transmission.frame.bits
        counts = self._counts.setdefault(transmission.source, [])
        if not counts or counts[-1].neighbours is not neighbours:
            counts.append(_Counts(neighbours))
        row = counts[-1]
        row.sent += 1
        if received is neighbours.ids:
            row.received += 1
        else:
            row.received[np.searchsorted(neighbours.ids, received)] += 1

    def columns(self) -> dict[str, Any]:
        """Return the columns of the table: one row for every link of a node that sent; none if no node sent."""
        sources = sorted(self._counts)
        if not sources:
            return {}
        found = [self._of_sender(self._counts[source]) for source in sources]
        repeats = [columns["node"].size for columns in found]
        source = np.repeat(np.array(sources, dtype=np.int64), repeats)
        joined = {name: np.concatenate([columns[name] for columns in found]) for name in found[0]}
        offsets = self._positions[source] - self._positions[joined["node"]]
        return {"source": source, "distance": np.sqrt((offsets**2).sum(axis=1)), **joined}

    def _of_sender(self, counts: list[_Counts]) -> dict[str, Any]:
        """The columns of one sender, over all sets of links that it had."""
        chances = [self._topology.probabilities(each.neighbours, self._last_bits) for each in counts]
        last, sent = counts[-1], sum(each.sent for each in counts)
        if len(counts) == 1:
            ids, powers, chance, received = last.neighbours.ids, last.neighbours.powers, chances[0], last.received
        else:
            ids = np.unique(np.concatenate([each.neighbours.ids for each in counts]))
            powers, chance, received = np.zeros(ids.size), np.zeros(ids.size), np.zeros(ids.size, dtype=np.int64)
            for each, probabilities in zip(counts, chances, strict=True):
                at = np.searchsorted(ids, each.neighbours.ids)
                powers[at] = each.neighbours.powers
                chance[at] += probabilities * (each.sent / sent)
                received[at] += each.received
        sent_over_each = np.full(ids.size, sent, dtype=np.int64)
        return {"node": ids, "power": powers, "chance": chance, "sent": sent_over_each, "received": received}
