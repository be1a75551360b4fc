"""What a driver is told and tells: the part of a campaign that is its own, how far it is, and how it ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple


class Part(NamedTuple):
    """The share of a campaign that a driver takes: the `number`-th (from 1) of `of`."""

    number: int
    of: int

    def has(self, place: int, block: int) -> bool:
        """Whether this part has a block (from 0) of the point that is the `place`-th (from 0)."""
        return (place + block) % self.of == self.number - 1


ALL: Final = Part(1, 1)


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a campaign is, in replicates; `left` is an estimate of the seconds to come, None before there is one."""

    done: int
    failed: int
    total: int
    wall: float
    left: float | None


@dataclass(frozen=True)
class Ended:
    """How a driver ended: replicates done and found done before, tasks that failed and why, and what is missing.

    `stopped`: why it ended before everything was tried; '' if it was.
    """

    done: int
    found: int
    failed: Mapping[str, str]
    missing: Mapping[str, list[int]]
    stopped: str
    seconds: float

    @property
    def complete(self) -> bool:
        """Whether every replicate of this part is on disk, and could be read where the rule asked."""
        return not self.missing and not self.failed
