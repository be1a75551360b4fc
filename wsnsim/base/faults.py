"""The port of injected faults: when a fault begins, how long it lasts, and which nodes it hits."""

from __future__ import annotations

from typing import Protocol


class FaultEvent(Protocol):
    """An injected fault: its `mechanism`, its beginning (`at`, s), its `duration` (s; None: until the end of the run).

    The nodes it hits are given by exactly one of `nodes` (ids), `fraction` (of all, sampled), `region` (x, y, radius in
    m) and `head` (the cluster head of that target when the fault begins). A plug-in also offers `start`: see
    `StartsFault`; with a class attribute `standalone = True` it acts without a network, too, on readings alone.
    """

    @property
    def mechanism(self) -> str:
        """Name of the mechanism, used in the log."""

    @property
    def at(self) -> float:
        """Beginning in s."""

    @property
    def duration(self) -> float | None:
        """Duration in s; None: until the end of the run."""

    @property
    def nodes(self) -> tuple[int, ...] | None:
        """The nodes it hits."""

    @property
    def fraction(self) -> float | None:
        """The share of all nodes that it hits."""

    @property
    def region(self) -> tuple[float, float, float] | None:
        """The circle (x, y, radius) in m whose nodes it hits."""

    @property
    def head(self) -> int | None:
        """The target whose cluster head it hits."""
