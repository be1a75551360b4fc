"""Mobility traces as streams of entries.

read(path, format, ids) -> Trace

A format is a module with `entries(path)`, which yields the entries of a file in its order, and `track(path, kept,
end)`, which makes the points of one node from its entries. Memory grows with the entries of the chosen nodes, not with
the file.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.errors import MOST_PRINTED, RunError, UsageError, did_you_mean
from wsnsim.models.csvfile import LONGEST_NAME, LONGEST_SHOWN, number_in

MOST_LISTED = 10
"""Nodes that a message about a missing choice names."""
MOST_KEPT = 1_000_000
"""Entries of the chosen nodes, and nodes of a file (our choice)."""


class TraceEntry(NamedTuple):
    """What a line of a trace says of a node.

    Attributes:
        line: Line in the file.
        node: Name of the node or vehicle.
        time: In the file's unit; NaN for a command that holds from the beginning.
        word: What is said, in the format's own word.
        values: Its numbers.
    """

    line: int
    node: str
    time: float
    word: str
    values: tuple[float, ...]


class TraceFormat(Protocol):
    """A format of mobility traces."""

    def entries(self, path: str) -> Iterator[TraceEntry]:
        """Yield the entries of a file. Raises RunError with file and line if one cannot be read."""

    def track(self, path: str, kept: Sequence[TraceEntry], end: float) -> Floats:
        """(n, 4) time, x, y and z of one node, with ascending times; z is NaN where the file has none."""


@dataclass(slots=True)
class NodeSummary:
    """What a trace holds of one node: the number of its entries, and the first and last time."""

    entries: int
    first: float
    last: float


@dataclass(frozen=True, slots=True)
class Trace:
    """The chosen nodes of a file.

    Attributes:
        path: The file.
        tracks: {node: (n, 4) time, x, y, z}, in the order of the choice.
        nodes: A summary of every node, in the file's order.
    """

    path: str
    tracks: dict[str, Floats]
    nodes: dict[str, NodeSummary]


def summarised(path: str, format_: TraceFormat) -> dict[str, NodeSummary]:
    """A summary of every node of a file. Raises RunError with file and line if it cannot be read."""
    nodes: dict[str, NodeSummary] = {}
    for entry in format_.entries(path):
        _count(nodes, entry, path)
    if not nodes:
        raise RunError(f"{path}: contains no positions")
    return nodes


def read(path: str, format_: TraceFormat, ids: Collection[str] = ()) -> Trace:
    """The tracks of the nodes `ids` of a file; without any, of the only node that it has.

    Raises:
        UsageError: The file has no such node, or several and none was chosen.
        RunError: The file cannot be read; the message names file and line.
    """
    nodes: dict[str, NodeSummary] = {}
    kept: dict[str, list[TraceEntry]] = {node: [] for node in ids}
    total = 0
    for entry in format_.entries(path):
        _count(nodes, entry, path)
        total += entry.node in ids or not ids
        if total > MOST_KEPT and (ids or len(nodes) == 1):
            raise RunError(f"{path}:{entry.line}: more than {MOST_KEPT:,} entries of the chosen nodes: split it")
        if not ids and len(nodes) == 1:
            kept.setdefault(entry.node, []).append(entry)
        elif entry.node in kept and ids:
            kept[entry.node].append(entry)
    if not nodes:
        raise RunError(f"{path}: contains no positions")
    demand_choice(path, nodes, ids)
    end = max(summary.last for summary in nodes.values())
    return Trace(path, {node: format_.track(path, entries, end) for node, entries in kept.items()}, nodes)


def _count(nodes: dict[str, NodeSummary], entry: TraceEntry, path: str) -> None:
    """Add an entry to the summary of its node. Raises RunError for a name that is too long, and too many nodes."""
    time = 0.0 if entry.time != entry.time else entry.time
    known = nodes.get(entry.node)
    if known is None:
        if len(entry.node) > LONGEST_NAME:
            raise RunError(
                f"{path}:{entry.line}: a name must have at most {LONGEST_NAME} characters, has {len(entry.node):,}"
            )
        if len(nodes) == MOST_KEPT:
            raise RunError(f"{path}:{entry.line}: more than {MOST_KEPT:,} different names: split it")
        nodes[entry.node] = NodeSummary(1, time, time)
        return
    known.entries += 1
    known.first, known.last = min(known.first, time), max(known.last, time)


def demand_choice(path: str, nodes: dict[str, NodeSummary], ids: Collection[str]) -> None:
    """Raise UsageError unless the choice of nodes is clear."""
    for node in ids:
        if node not in nodes:
            known = sorted(nodes)[: MOST_PRINTED * 20]
            hint = did_you_mean(node, known)
            raise UsageError(f"{path}: no node '{node}' ({hint if len(hint) < 200 else f'{hint[:200]}...'})")
    if not ids and len(nodes) > 1:
        first = ", ".join(f"'{node}'" for node in list(nodes)[:MOST_LISTED])
        more = ", ..." if len(nodes) > MOST_LISTED else ""
        raise UsageError(f"{path}: holds {len(nodes)} nodes ({first}{more}): choose with --id, or see --list")


def ascending(rows: Sequence[tuple[float, float, float, float]] | Floats) -> Floats:
    """(n, 4) the rows with distinct times, the last of each time, in ascending order."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    order = np.argsort(table[:, 0], kind="stable")
    table = table[order]
    distinct: Floats = table[np.append(table[1:, 0] != table[:-1, 0], True)]
    return distinct


def finite_number(text: str, place: str) -> float:
    """A finite number. Raises RunError if the text is none; `place` begins the message."""
    value = number_in(text)
    if not math.isfinite(value):
        raise RunError(f"{place} must be a finite number, is {text[:LONGEST_SHOWN]!r}")
    return value
