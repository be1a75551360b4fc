"""The Trickle timer of RFC 6206: intervals that double while nothing changes, and one transmission in each.

    timer.begin() -> s until `advance`      timer.advance() -> (transmit now?, s until the next `advance`)

It knows no clock: the caller counts the seconds. Names in brackets are those of the RFC, section 4.
"""

from __future__ import annotations

from collections.abc import Callable


class TrickleTimer:
    """The Trickle timer of one node.

    Args:
        shortest: The shortest interval in s (Imin).
        longest: The longest interval in s (Imax; the RFC gives it as a number of doublings).
        uniform: Returns a random number in [0, 1).
        redundancy: A transmission is suppressed if this many consistent ones were heard in the interval (k); None: no
            transmission is.

    Attributes:
        interval: The present interval in s (I).
    """

    __slots__ = ("_heard", "_longest", "_redundancy", "_rest", "_shortest", "_transmits", "_uniform", "interval")

    def __init__(
        self, shortest: float, longest: float, uniform: Callable[[], float], redundancy: int | None = None
    ) -> None:  # fmt: skip
        self._shortest = shortest
        self._longest = longest
        self._uniform = uniform
        self._redundancy = redundancy
        self._heard = 0
        self._rest = 0.0
        self._transmits = False
        self.interval = shortest

    def begin(self) -> float:
        """Start the shortest interval; returns the seconds until `advance` is due."""
        self.interval = self._shortest
        return self._start()

    def advance(self) -> tuple[bool, float]:
        """Do what is due: half of the calls are about a transmission, the others end an interval.

        Returns:
            Whether to transmit now, and the seconds until `advance` is due again.
        """
        if self._transmits:
            self._transmits = False
            return self._redundancy is None or self._heard < self._redundancy, self._rest
        self.interval = min(2.0 * self.interval, self._longest)
        return False, self._start()

    def hear_consistent(self) -> None:
        """Count a transmission of another node that agrees with what this one knows."""
        self._heard += 1

    def reset(self) -> float | None:
        """Start the shortest interval because something is inconsistent, unless the timer is in one.

        Returns:
            The seconds until `advance` is due, in place of what was said before; None: that still holds.
        """
        return self.begin() if self.interval > self._shortest else None

    def _start(self) -> float:
        """Begin an interval: transmit at a random time of its second half (t)."""
        self._heard = 0
        until = 0.5 * self.interval * (1.0 + self._uniform())
        self._rest, self._transmits = self.interval - until, True
        return until
