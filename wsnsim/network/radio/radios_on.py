"""Which neighbours of a sender have their radios on, and which of them listened to a frame."""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.base.arrays import Bools, Ints
from wsnsim.base.mac_mechanisms import Listening
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.transmission import Transmission

NOBODY: Final = np.zeros(0, dtype=np.int64)


class RadiosOn:
    """Which radios are on: here those of all nodes that are awake."""

    def __init__(self, nodes: Nodes) -> None:
        self._nodes = nodes

    def hears(self, ids: Ints, since: float) -> Bools | None:
        """(n,) which of the nodes have been listening since a time that is not in the future; None: all of them."""
        return None if self._nodes.all_heard(since) else self._nodes.hears(ids, since)

    def paid_until(self, other: Transmission, sent: Transmission) -> float:
        """Until when a node that hears both of two frames pays for the other one, when the result of one is found."""
        return other.end if other.end <= sent.end and not other.cut else sent.start

    def note(self, sent: Transmission, ids: Ints) -> None:
        """The nodes (m,) listened to a frame that ends now, unless they were sending."""


class SomeRadiosOn(RadiosOn):
    """The radios of a duty-cycled MAC, which knows which of those of awake nodes are on."""

    def __init__(self, nodes: Nodes, listening: Listening) -> None:
        super().__init__(nodes)
        self._listening = listening

    def hears(self, ids: Ints, since: float) -> Bools | None:
        """(n,) which of the nodes have been awake, with the radio on, since a time that is not in the future."""
        awake, on = super().hears(ids, since), self._listening.hears(ids, since)
        return on if awake is None else awake & on

    def paid_until(self, other: Transmission, sent: Transmission) -> float:
        """See `RadiosOn`. Of two frames that end together, the one whose result is found first is paid for whole."""
        return sent.start if other.listeners is None else super().paid_until(other, sent)

    def note(self, sent: Transmission, ids: Ints) -> None:
        """Write into a transmission that ends now which nodes listened to it: those of `ids` that were not sending."""
        senders = [other.source for other in sent.overlapping or () if other.end > max(other.start, sent.start)]
        sent.listeners = np.sort(ids[~np.isin(ids, senders)] if senders else ids)
