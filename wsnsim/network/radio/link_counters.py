"""Counters of broadcasts per link: the table `links`."""

from __future__ import annotations

from typing import Any

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.network.radio.topology import Topology
from wsnsim.network.radio.transmission import Transmission


class NoLinkCounters:
    """Counts nothing: the table `links` is not recorded."""

    def count(self, transmission: Transmission, received: Ints) -> None:
        """Ignore a broadcast."""

    def columns(self) -> dict[str, Any]:
        """Return no columns."""
        return {}


class LinkCounters:
    """How many broadcasts were sent over each link, and how many arrived; `chance` is for the size of the last one."""

    def __init__(self, positions: Floats, topology: Topology) -> None:
        self._positions = positions
        self._topology = topology
        self._last_bits = 0
        self._received: dict[int, Ints] = {}
        self._sent: dict[int, int] = {}

    def count(self, transmission: Transmission, received: Ints) -> None:
        """Count a broadcast on each link of its sender."""
        source, neighbours, self._last_bits = transmission.source, transmission.neighbours, transmission.frame.bits
        row = self._received.get(source)
        if row is None:
            row = self._received[source] = np.zeros(neighbours.ids.size, dtype=np.int64)
        self._sent[source] = self._sent.get(source, 0) + 1
        if received is neighbours.ids:
            row += 1
        else:
            row[np.searchsorted(neighbours.ids, received)] += 1

    def columns(self) -> dict[str, Any]:
        """Return the columns of the table: one row for every link of a node that sent; none if no node sent."""
        sources = sorted(self._received)
        if not sources:
            return {}
        neighbours = [self._topology.neighbours(source) for source in sources]
        repeats = [len(one.id_list) for one in neighbours]
        ids = np.concatenate([one.ids for one in neighbours])
        source = np.repeat(np.array(sources, dtype=np.int64), repeats)
        offsets = self._positions[source] - self._positions[ids]
        return {
            "source": source,
            "node": ids,
            "distance": np.sqrt((offsets**2).sum(axis=1)),
            "power": np.concatenate([one.powers for one in neighbours]),
            "chance": np.concatenate([self._topology.probabilities(one, self._last_bits) for one in neighbours]),
            "sent": np.repeat(np.array([self._sent[source] for source in sources], dtype=np.int64), repeats),
            "received": np.concatenate([self._received[source] for source in sources]),
        }
