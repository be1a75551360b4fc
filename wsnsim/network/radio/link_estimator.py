"""Link estimation: what a node learns of its neighbours from the beacons that it hears and from acknowledgements.

The cost of a link is its ETX, the expected number of transmissions until one is acknowledged. Beacons are numbered, so
that a node knows which ones it missed: after every BEACON_WINDOW of them, the inverse of the share that it heard goes
into a moving average. After every DATA_WINDOW transmissions of its own to a neighbour, their number per acknowledgement
does. Only beacons tell of links that a node does not use, and only acknowledgements tell of the way there.

The table has a fixed size. If it is full, a newcomer takes the place of the worst link, if that is bad; otherwise of a
random one, but only if its frame came in strong (the *white bit*), and the network layer says that it leads to a better
route than that one (the *compare bit*). Links that the network layer has pinned stay (the *pin bit*), and the *ack
bits* are the acknowledgements.

Source: Fonseca, Gnawali, Jamieson, Levis (2007), "Four-bit wireless link estimation", HotNets-VI; windows, weights and
thresholds of TinyOS 2.1 (lib/net/4bitle). Ours: costs are floating-point numbers; a newcomer never displaces a link
with a better route.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Final

BEACON_WINDOW: Final = 3
"""Beacons, heard and missed, after which the share of those heard is taken."""
DATA_WINDOW: Final = 5
"""Transmissions after which their number per acknowledgement is taken."""
KEPT: Final = 0.9
"""Weight of the old value in the moving averages."""
LONGEST_GAP: Final = 10
"""After a jump of more numbers than these, what was known of a link is out of date."""
BAD_ETX: Final = 6.5
"""ETX from which on a link makes room for any newcomer."""
WORST_ETX: Final = 6553.5
"""ETX of a link on which hardly any beacon arrives: the largest number that the header holds."""
LEAST_SHARE: Final = 1.0 / 25.0
"""Share of beacons heard below which a link has the WORST_ETX."""
NUMBERS: Final = 256
"""Beacons are numbered modulo this."""


class Link:
    """What a node knows of its link to one neighbour.

    Attributes:
        pinned: Whether it must stay in the table.
        mature: Whether there is an estimate.
        etx: The expected number of transmissions; WORST_ETX without an estimate.
    """

    __slots__ = ("_acknowledged", "_heard", "_last", "_missed", "_sent", "_share", "etx", "mature", "pinned")

    def __init__(self, number: int) -> None:
        self._last = number
        self._heard = 1
        self._missed = 0
        self._share = 0.0
        self._sent = 0
        self._acknowledged = 0
        self.pinned = False
        self._forget()

    def hear(self, number: int) -> None:
        """Note a beacon by its number."""
        gap = (number - self._last) % NUMBERS
        self._last = number
        if gap > LONGEST_GAP:
            self._heard, self._missed = 1, 0
            self._forget()
            return
        self._heard += 1
        self._missed += max(gap - 1, 0)
        if self._heard + self._missed >= BEACON_WINDOW:
            self._close_beacon_window()

    def note_sent(self, attempts: int, acknowledged: bool) -> None:
        """Note transmissions to the neighbour, of which the last was acknowledged or none was."""
        for attempt in range(attempts):
            self._sent += 1
            self._acknowledged += acknowledged and attempt == attempts - 1
            if self._sent >= DATA_WINDOW:
                self._close_data_window()

    def forget_sent(self) -> None:
        """Begin a new window of transmissions: the neighbour has just become the parent."""
        self._sent = self._acknowledged = 0

    def _forget(self) -> None:
        self.mature, self.etx = False, WORST_ETX

    def _close_beacon_window(self) -> None:
        share = self._heard / (self._heard + self._missed)
        self._heard = self._missed = 0
        if not self.mature:
            self.mature, self._share, self.etx = True, share, _inverse(share)
        self._share = KEPT * self._share + (1.0 - KEPT) * share
        self._average(_inverse(self._share))

    def _close_data_window(self) -> None:
        """Average the window. One without any acknowledgement goes on: its cost is the number of failures so far."""
        if not self._acknowledged:
            self._average(float(self._sent))
            return
        self._average(self._sent / self._acknowledged)
        self.forget_sent()

    def _average(self, etx: float) -> None:
        if self.mature:
            self.etx = KEPT * self.etx + (1.0 - KEPT) * etx


class LinkTable:
    """The links of one node to at most `size` neighbours.

    Args:
        size: The number of links that it holds.
        uniform: Returns a random number in [0, 1).
    """

    __slots__ = ("_links", "_size", "_uniform")

    def __init__(self, size: int, uniform: Callable[[], float]) -> None:
        self._size = size
        self._uniform = uniform
        self._links: dict[int, Link] = {}

    def etx(self, neighbour: int) -> float:
        """The expected number of transmissions to a neighbour; infinity without an estimate."""
        link = self._links.get(neighbour)
        return link.etx if link is not None and link.mature else inf

    def hear(
        self, neighbour: int, number: int, displaces: Callable[[int], bool] | None = None, force: bool = False
    ) -> tuple[bool, int | None]:
        """Note a beacon.

        Args:
            neighbour: Its sender.
            number: Its number.
            displaces: If the table is full, whether the sender may take the place of another, unpinned neighbour; asked
                only if no link is bad. None: it may not.
            force: Whether the sender is to be in the table at any price, and to stay.

        Returns:
            Whether the sender is in the table, and the neighbour that had to leave, or None.
        """
        link, evicted = self._links.get(neighbour), None
        if link is not None:
            link.hear(number)
        else:
            if len(self._links) >= self._size:
                evicted = self._worst(0.0 if force else BAD_ETX)
                if evicted is None and displaces is not None:
                    evicted = self._any(displaces)
                if evicted is None:
                    return False, None
                del self._links[evicted]
            link = self._links[neighbour] = Link(number)
        link.pinned |= force
        return True, evicted

    def note_sent(self, neighbour: int, attempts: int, acknowledged: bool) -> None:
        """Note transmissions to a neighbour, of which the last was acknowledged or none was."""
        if neighbour in self._links:
            self._links[neighbour].note_sent(attempts, acknowledged)

    def pin(self, neighbour: int) -> None:
        """Keep a neighbour in the table, and begin a new window of transmissions to it."""
        link = self._links[neighbour]
        link.pinned = True
        link.forget_sent()

    def unpin(self, neighbour: int) -> None:
        """Let a neighbour leave the table, if it is there."""
        if neighbour in self._links:
            self._links[neighbour].pinned = False

    def _worst(self, least: float) -> int | None:
        """The neighbour with the worst estimate that need not stay, if its ETX is at least this; None for none."""
        etx, worst = max(
            ((link.etx, node) for node, link in self._links.items() if link.mature and not link.pinned),
            default=(-inf, None),
        )
        return worst if etx >= least else None

    def _any(self, displaces: Callable[[int], bool]) -> int | None:
        """A random neighbour among those that need not stay and that may be displaced; None for none."""
        possible = [node for node, link in self._links.items() if not link.pinned and displaces(node)]
        return possible[int(self._uniform() * len(possible))] if possible else None


def _inverse(share: float) -> float:
    return 1.0 / share if share > LEAST_SHARE else WORST_ETX
