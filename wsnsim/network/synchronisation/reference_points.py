"""A node's estimate of another clock: a line through reference points (own clock, other clock), by least squares."""

from __future__ import annotations

from collections import deque


class ReferencePoints:
    """The last `most` reference points of a node, and the line through them. Without any, the other clock is its own.

    The line runs through the offset over the own clock, both relative to their means: numbers of microseconds beside
    numbers of seconds lose no digits. Source: Maróti et al. (2004), section 6; TimeSyncP.nc, calculateConversion.
    """

    __slots__ = ("_offset", "_own", "_points", "_skew")

    def __init__(self, most: int) -> None:
        self._points: deque[tuple[float, float]] = deque(maxlen=most)
        self._own = self._offset = self._skew = 0.0

    def __len__(self) -> int:
        return len(self._points)

    @property
    def rate(self) -> float:
        """Seconds on the own clock per second on the other clock."""
        return 1.0 / (1.0 + self._skew)

    def other(self, own: float) -> float:
        """What the other clock shows when the own clock shows `own`, in s."""
        return own + self._offset + self._skew * (own - self._own)

    def add(self, own: float, other: float) -> None:
        """Note what both clocks showed at one instant. The oldest of `most` points is forgotten."""
        self._points.append((own, other - own))
        self._fit()

    def clear(self) -> None:
        """Forget the points. The line stays until there are new ones."""
        self._points.clear()

    def restart(self) -> None:
        """Forget the points and the line."""
        self._points.clear()
        self._own = self._offset = self._skew = 0.0

    def _fit(self) -> None:
        """The line by least squares. Through one point goes the line with the slope of before."""
        count, points = len(self._points), self._points
        self._own = sum([own for own, _ in points]) / count
        self._offset = sum([offset for _, offset in points]) / count
        spread = sum([(own - self._own) ** 2 for own, _ in points])
        if spread > 0.0:
            self._skew = sum([(own - self._own) * (offset - self._offset) for own, offset in points]) / spread
