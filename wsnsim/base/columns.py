"""A column of a table, and the words of the columns that hold categories."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

KINDS: Final = (
    "wake", "sleep", "sense", "elect", "join", "announce", "allocate", "send", "receive", "drop", "collide", "compute",
    "estimate", "handover", "relay", "lost", "reacquire", "crash", "restart", "death", "overhear", "fault", "report",
    "acquire", "call", "called", "leave", "return", "stay", "resume",
)  # fmt: skip
CAUSES: Final = ("tx_electronics", "tx_amplifier", "rx", "overhear", "cpu", "sense", "idle", "sleep", "switch", "leak")
EVENT_CAUSES: Final = ("none", "tx", "rx", "overhear", "cpu", "sense", "idle", "sleep", "switch", "leak")
STATUSES: Final = ("complete", "partial", "failed")
KIND: Final = {name: code for code, name in enumerate(KINDS)}
CAUSE: Final = {name: code for code, name in enumerate(CAUSES)}
EVENT_CAUSE: Final = {name: code for code, name in enumerate(EVENT_CAUSES)}


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a table.

    Attributes:
        name: Its name.
        dtype: NumPy type.
        units: SI unit; '1' for a count, '' for an identifier.
        description: What it holds.
        meanings: Words of a category column, in the order of their codes.
        smooth: Whether neighbouring values are similar, so that shuffling bytes compresses them.
        of_position: Whether it has the unit of the motion model's position, usually metres.
    """

    name: str
    dtype: str
    units: str
    description: str
    meanings: tuple[str, ...] = ()
    smooth: bool = False
    of_position: bool = False
