"""How many broadcasts went over each link, and how many of them arrived: the table `links`."""

from __future__ import annotations

from typing import Any

import numpy as np

from wsnsim.base.arrays import Floats, Ints
from wsnsim.network.radio.topology import Topology
from wsnsim.network.radio.transmission import Transmission


class LinkCounters:
    """A count a link, kept for senders only."""

    def __init__(self, positions: Floats, wiring: Topology) -> None:
        self._positions = positions
        self._wiring = wiring
        self._bits = 0
        self._received: dict[int, Ints] = {}
        self._sent: dict[int, int] = {}

    def note(self, one: Transmission, heard: Ints) -> None:
        """Count a broadcast on each of its links."""
        source, audience, self._bits = one.source, one.audience, one.message.bits
        row = self._received.get(source)
        if row is None:
            row = self._received[source] = np.zeros(audience.ids.size, dtype=np.int64)
        self._sent[source] = self._sent.get(source, 0) + 1
        if heard is audience.ids:
            row += 1
        else:
            row[np.searchsorted(audience.ids, heard)] += 1

    def rows(self) -> dict[str, Any]:
        """The columns of the table: every link of a node that sent."""
        sources = sorted(self._received)
        audiences = [self._wiring.audience(source) for source in sources]
        repeats = [len(audience.listed) for audience in audiences]
        nothing, nobody = np.zeros(0), np.zeros(0, dtype=np.int64)
        ids = np.concatenate([nobody, *(audience.ids for audience in audiences)])
        source = np.repeat(np.array(sources, dtype=np.int64), repeats)
        apart = self._positions[source] - self._positions[ids]
        return {
            "source": source,
            "node": ids,
            "distance": np.sqrt((apart**2).sum(axis=1)),
            "power": np.concatenate([nothing, *(audience.powers for audience in audiences)]),
            "chance": np.concatenate([nothing, *(self._wiring.chances(one, self._bits) for one in audiences)]),
            "sent": np.repeat(np.array([self._sent[one] for one in sources], dtype=np.int64), repeats),
            "received": np.concatenate([nobody, *(self._received[one] for one in sources)]),
        }
