"""The phrases of a step's description: events, quantities and nodes in words.

energy_in_words(joules);   counted(3, 'packet');   listed(nodes);   StepContext
"""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from wsnsim.base.errors import shortened

MOST_NODES: Final = 24
"""Maximum number of nodes that a sentence lists (our choice)."""
WIDEST: Final = 100
"""Characters of the longest line in a terminal."""
NARROWEST: Final = 60
"""Columns of a terminal below which lines are longer than it."""
PARCELS: Final = {
    "announce": ("its announcement", "their announcements"),
    "join": ("its join request", "their join requests"),
    "strength": ("the strength of its reading", "the strengths of their readings"),
    "wake": ("a request to wake", "requests to wake"),
    "track": ("its wake-up message", "their wake-up messages"),
    "request": ("its request for readings", "their requests for readings"),
    "detection": ("its detection of a target", "their detections of a target"),
    "": ("a message", "messages"),
}
"""The name of a parcel of one sender and of several; other parcels keep the name that the tracker gives them."""
REASONS: Final = {
    "no_path": "no path exists", "no_channel": "channel access failed", "no_route": "no route was found in time",
    "retry_limit": "no acknowledgement up to the last retransmission", "queue_full": "the queue was full",
    "hop_limit": "it had too many hops", "void": "no neighbour is nearer to the destination",
}  # fmt: skip
"""The reasons for giving up a message."""
LOSSES: Final = {
    "empty_region": "no node is near the predicted position",
    "nobody_woken": "no node was woken near the predicted position",
    "no_readings": "no readings arrived",
    "no_successor": "there was no successor to hand over to",
    "handover_lost": "the belief was lost on its way to the next cluster head",
    "head_died": "the cluster head died",
    "expired": "the wake-up message expired on its way",
}
"""The reasons for a track loss."""
VERBS: Final = {
    "wake": (
        "woke",
        {
            "frame": ", by a message",
            "target": ", because of a detection",
            "call": ", by a wake-up call",
            "schedule": ", by its schedule",
        },
    ),
    "sleep": (
        "went to sleep",
        {"frame": ", dismissed", "target": ", without a detection", "schedule": ", by its schedule"},
    ),
    "stay": (
        "stayed awake",
        {"frame": ", because it had something to do", "target": ", because of a detection"},
    ),
    "resume": ("returned to its schedule, awake", {}),
    "compute": ("computed", {}),
    "sense": ("sensed", {"nothing": " nothing, although it was woken for the target"}),
    "drop": ("dropped a message", {"expired": " that had expired"}),
    "crash": ("crashed", {}),
    "restart": ("restarted", {}),
    "death": ("died: its battery is empty", {}),
}
"""The verb of an action of one node alone, and the words that follow it, by the event's column `what`."""
FROM_NODES: Final = ("join", "strength", "wake", "handover", "report")
"""Parcels that are sent to a cluster head by other nodes, too, not only by its members."""


class Sentence(NamedTuple):
    """A sentence with the start and end of what it describes, in s of simulated time."""

    time: float
    until: float
    text: str


@dataclass(frozen=True, slots=True)
class StepContext:
    """What the description of a step needs to know.

    Attributes:
        heads: the cluster heads of the step.
        limit: number of similar messages up to which each is described; more are summed up.
        issued: the name of each issued estimate by (target, time).
        several: whether there are several targets, so that sentences name theirs.
        owner: what events are of: a target, or a group of tracks where readings name no target.
    """

    heads: frozenset[int]
    limit: int
    issued: dict[tuple[int, float], str]
    several: bool = False
    owner: str = "target"

    def node(self, number: int) -> str:
        """A node with its role."""
        return f"{'cluster head' if number in self.heads else 'node'} {number}"

    def target(self, number: int) -> str:
        """The target, or the group, in parentheses; empty if there is only one."""
        return f" ({self.owner} {number})" if self.several and number >= 0 else ""


def energy_in_words(joules: float) -> str:
    """An energy with three digits and a fitting prefix."""
    if joules == 0:
        return "0 J"
    for factor, unit in ((1.0, "J"), (1e-3, "mJ"), (1e-6, "uJ")):
        if abs(joules) >= 0.9995 * factor:
            return f"{joules / factor:.3g} {unit}" if abs(joules) < 999.5 * factor else f"{joules / factor:,.0f} {unit}"
    return f"{joules / 1e-9:.3g} nJ"


def width() -> int:
    """Return the columns for a table or a text: those of the terminal, 100 at most, and 100 if there is none."""
    has_terminal = sys.stdout is not None and sys.stdout.isatty()
    return max(NARROWEST, min(WIDEST, shutil.get_terminal_size().columns)) if has_terminal else WIDEST


def aligned(rows: Sequence[Sequence[str]], left: int = 1, at: int = 0) -> list[str]:
    """The lines of a table for a terminal, indented by two; its first `left` columns are flush left, others right.

    A table that is wider than a terminal is split, first before the column `at`; the first columns begin each part.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    if sum(widths[:left]) + 2 * left + max(widths[left:], default=0) + 2 > width():  # cells are cut
        # to 12 characters at least, since `shortened` keeps 9 of the end
        most = (max(width() // 2 // max(left, 1) - 2, 12), width() // 2 - 2)
        rows = [[shortened(cell, most[i >= left]) for i, cell in enumerate(row)] for row in rows]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    names, parts = list(range(left)), [list(range(left))]
    for i in range(left, len(widths)):
        wide = sum(widths[j] + 2 for j in ([*parts[-1], i] if i != at else range(len(widths)))) > width()
        if wide and parts[-1] != names:
            parts.append([*names])
        parts[-1].append(i)
    shown = [[f"{row[i]:{'<' if i < left else '>'}{widths[i]}}" for i in part] for part in parts for row in rows]
    return [f"  {'  '.join(cells)}".rstrip() for cells in shown]


def wrapped(sentence: str, first: str = "", indent: str | None = None) -> list[str]:
    """The lines of a sentence for a terminal: `first` begins the first one, `indent` (else spaces) the others."""
    later = " " * len(first) if indent is None else indent
    return textwrap.wrap(
        sentence, width(), initial_indent=first, subsequent_indent=later, break_long_words=False, break_on_hyphens=False
    )


def fitting(lines: Sequence[str], indent: str) -> str:
    """Lines as a text for a terminal: what is wider is continued after an indent."""
    return "\n".join(
        piece for line in lines for piece in (wrapped(line, indent=indent) if len(line) > width() else [line])
    )


def listed(nodes: Sequence[int]) -> str:
    """The nodes as a list, at most `MOST_NODES` of them."""
    shown = ", ".join(str(node) for node in nodes[:MOST_NODES])
    return shown + (f" and {len(nodes) - MOST_NODES:,} more" if len(nodes) > MOST_NODES else "")
