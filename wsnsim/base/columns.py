"""A column of a table, the words of the columns that hold categories, and the columns that several tables have."""

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


def column(
    name: str, dtype: str, units: str, description: str, meanings: tuple[str, ...] = (), smooth: bool = False
) -> Column:
    """A column whose unit does not depend on the motion model."""
    return Column(name, dtype, units, description, meanings, smooth)


def position_column(name: str, description: str) -> Column:
    """A column of floats in the unit of the position, usually metres."""
    return Column(name, "f8", "m", description, of_position=True)


REPLICATE: Final = column("replicate", "u4", "", "number of the Monte Carlo run")
TARGET: Final = column("target", "u2", "", "number of the target")
STEP: Final = column("step", "u4", "", "number of the step; step 0 is the start")
TIME: Final = column("time", "f8", "s", "simulated time", smooth=True)
NODE: Final = column("node", "i4", "", "number of the node")
