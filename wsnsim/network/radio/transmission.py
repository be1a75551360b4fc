"""A transmission: one MAC frame on the air, who has the radio on for it, its number in a step, and counts by link."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.frames import MacFrame, Received
from wsnsim.base.mac_mechanisms import Listening
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.topology import Neighbours, Topology

FREE: Final = (0.0, 0.0, 0.0, 0.0)
"""The `costs` of a transmission before they are computed."""
NOBODY: Final = np.zeros(0, dtype=np.int64)


@dataclass(slots=True, eq=False)
class Transmission:
    """One MAC frame on the air.

    Attributes:
        source: The sender.
        frame: What is sent.
        neighbours: The nodes that it may reach.
        number: Its number in the event log.
        start: When its first bit is sent, in s.
        end: When its last bit is sent, in s.
        on_end: Called at the end, with the transmission and the result.
        overlapping: The transmissions that overlap it; None for none.
        cut: Whether its sender stopped before the end.
        missed: Whether a node that it was meant for did not receive it.
        asleep: Ids of nodes that have the radio off because they know that the frame is not for them.
        costs: (electronics J, amplifier J, reception J, airtime s).
        locks: (n,) which neighbours are locked on it (see `capture`); None until they are first needed.
        listeners: (m,) the nodes whose radios listened from its start and paid for it: they received or overheard it,
            or lost it to another frame. Ascending. None until its end, and where all radios listen.
    """

    source: int
    frame: MacFrame
    neighbours: Neighbours
    number: int
    start: float
    end: float
    on_end: OnEnd
    costs: tuple[float, float, float, float] = FREE
    asleep: Ints | None = None
    overlapping: list[Transmission] | None = None
    cut: bool = False
    missed: bool = False
    locks: Bools | None = None
    listeners: Ints | None = None


OnEnd = Callable[[Transmission, Received], None]


def overlap(a: Transmission, b: Transmission) -> None:
    """Note that two transmissions overlap in time."""
    if a.overlapping is None:
        a.overlapping = []
    if b.overlapping is None:
        b.overlapping = []
    a.overlapping.append(b)
    b.overlapping.append(a)


class RadiosOn:
    """Which radios are on: here those of all nodes that are awake."""

    def __init__(self, nodes: Nodes) -> None:
        self._nodes = nodes

    def hears(self, ids: Ints, since: float) -> Bools | None:
        """(n,) which of the nodes have been listening since a time that is not in the future; None: all of them."""
        return None if self._nodes.all_heard(since) else self._nodes.hears(ids, since)

    def paid_until(self, other: Transmission, sent: Transmission) -> float:
        """The time (s) until which a node that hears both has already paid for `other` when `sent` ends."""
        return other.end if other.end <= sent.end and not other.cut else sent.start

    def note(self, sent: Transmission, ids: Ints) -> None:
        """Do nothing: it need not be noted which nodes (m,) listened to a frame if all radios listen."""


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
        """See `RadiosOn`. Of two frames that end together, the one that is processed first is paid for as a whole."""
        return sent.start if other.listeners is None else super().paid_until(other, sent)

    def note(self, sent: Transmission, ids: Ints) -> None:
        """Write into a transmission that ends now which nodes listened to it: those of `ids` that were not sending."""
        senders = [other.source for other in sent.overlapping or () if other.end > max(other.start, sent.start)]
        sent.listeners = np.sort(ids[~np.isin(ids, senders)] if senders else ids)


class UseCounter:
    """Counts how often each link or sender was used in the present step.

    Random numbers of a frame are derived from `key`, the step and this number, and so do not depend on earlier steps.
    """

    def __init__(self, key: int) -> None:
        self.key = key
        self._uses: dict[Hashable, tuple[int, int]] = {}

    def next(self, user: Hashable, step: int) -> int:
        """Return 1 for the first use in a step, 2 for the second, and so on."""
        last_step, count = self._uses.get(user, (-1, 0))
        count = count + 1 if last_step == step else 1
        self._uses[user] = step, count
        return count


class _Counts:
    """The broadcasts of one sender over one set of links: how many were sent, and `received` (n,) of them arrived."""

    __slots__ = ("neighbours", "received", "sent")

    def __init__(self, neighbours: Neighbours) -> None:
        self.neighbours = neighbours
        self.received = np.zeros(neighbours.ids.size, dtype=np.int64)
        self.sent = 0


class LinkCounters:
    """How many broadcasts were sent over each link, how many arrived, and the probability of arrival, `chance`.

    `chance` is for a frame as long as the last one. Where links change, the row of a link counts all broadcasts of its
    sender: `chance` is the mean over them, with 0 while there was no link, and `power` that of the link's last period.
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
        """Return the columns of the table, with a row per link of each node that sent; {} if no node sent."""
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
        """The columns of one sender, merged over all sets of links that it had."""
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
