"""The event log of a result: the events of one step, or of a range of rows.

rows_at(path, replicate, step) -> [LoggedEvent]        read_rows(path, slice) -> (replicate, LoggedEvent), ...
ranges(path, table) -> {replicate: slice}
in_other_steps(path, replicate, step, rows) -> {sequence: OtherSteps}  for messages with events in other steps
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from wsnsim.analysis.phrases import energy_in_words
from wsnsim.analysis.plot_data import StateLayout, layout
from wsnsim.base.errors import counted
from wsnsim.recording import attributes, meanings, read_table, row_count

BLOCK: Final = 1 << 22
"""Rows that are read at once in the search for the rows of a step."""
ACKS: Final = ("ack", "early_ack")
STROBE: Final = "strobe"
"""Contents of control frames: they have the sequence number of the message, but do not tell what it carried."""


class LoggedEvent(NamedTuple):
    """One row of the event log; the fields are its columns. Fields of categories hold words, '' for none."""

    time: float
    step: int
    target: int
    node: int
    kind: str
    what: str
    frame: int
    sequence: int
    peer: int
    packets: int
    bits: int
    joules: float
    cause: str


def row_in_words(row: LoggedEvent) -> str:
    """One event with all of its columns."""
    joules = f"{energy_in_words(row.joules)} ({row.cause})" if row.joules else ""
    facts = [
        f"'{row.what}'" if row.what else "",
        f"peer {row.peer}" if row.peer >= 0 else "to everyone" if row.kind in ("send", "relay") else "",
        f"target {row.target}" if row.target >= 0 else "",
        f"frame {row.frame} of message {row.sequence}" if row.frame else "",
        counted(row.packets, "packet") if row.packets else "",
        counted(row.bits, "bit") if row.bits else "",
        joules,
    ]
    who = f"node {row.node}" if row.node >= 0 else "the target" if row.kind in ("leave", "return") else "nobody"
    return f"{who}: {row.kind} {', '.join(filter(None, facts))}".rstrip()


class OtherSteps(NamedTuple):
    """Whether a message has events in earlier and in later steps, and what it carried according to them."""

    before: bool = False
    after: bool = False
    what: str = ""


def rows_at(path: str | Path, replicate: int, step: int) -> list[LoggedEvent]:
    """The events of one step. Two columns are searched block by block, then only the step's rows are read."""
    first, last = None, 0
    for start, columns in _blocks(path, ["replicate", "step"]):
        at = np.flatnonzero((columns["replicate"] == replicate) & (columns["step"] == step))
        if at.size:
            first, last = (start + int(at[0]) if first is None else first), start + int(at[-1]) + 1
    if first is None:
        return []
    return [row for number, row in read_rows(path, slice(first, last)) if number == replicate and row.step == step]


def ranges(path: str | Path, table: str = "events") -> dict[int, slice]:
    """{replicate: the range of its rows} in a table."""
    found: dict[int, slice] = {}
    for start, columns in _blocks(path, ["replicate"], table):
        numbers = columns["replicate"]
        for number in np.unique(numbers).tolist():
            at = np.flatnonzero(numbers == number)
            first = found[number].start if number in found else start + int(at[0])
            found[number] = slice(first, start + int(at[-1]) + 1)
    return found


def in_other_steps(path: str | Path, replicate: int, step: int, rows: Sequence[LoggedEvent]) -> dict[int, OtherSteps]:
    """{sequence number: OtherSteps} of those messages of these rows that have events in other steps."""
    wanted = np.array(sorted({row.sequence for row in rows if row.sequence}), dtype=np.int64)
    words = meanings(path, "events", "what")
    known: dict[int, OtherSteps] = {}
    for _, columns in _blocks(path, ["replicate", "step", "sequence", "frame", "what"]) if wanted.size else ():
        at = (columns["replicate"] == replicate) & (columns["step"] != step) & np.isin(columns["sequence"], wanted)
        for i in np.flatnonzero(at).tolist():
            sequence, later = int(columns["sequence"][i]), bool(columns["step"][i] > step)
            old = known.get(sequence, OtherSteps())
            word = _word(words, int(columns["what"][i])) if columns["frame"][i] else ""
            what = old.what or (word if word not in (*ACKS, STROBE) else "")
            known[sequence] = OtherSteps(old.before or not later, old.after or later, what)
    return known


def layout_or_empty(path: str | Path) -> StateLayout:
    """The state columns of a file; empty if it has no targets."""
    return layout(path) if attributes(path)["states"] else StateLayout({}, ())


def _blocks(
    path: str | Path, columns: Sequence[str], table: str = "events"
) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    """(first row, columns) of each block in turn."""
    for start in range(0, row_count(path, table), BLOCK):
        yield start, read_table(path, table, columns, slice(start, start + BLOCK))


def read_rows(path: str | Path, rows: slice) -> Iterator[tuple[int, LoggedEvent]]:
    """(replicate, event) of each row of a range."""
    columns = read_table(path, "events", ["replicate", *LoggedEvent._fields], rows)
    lists = [columns["replicate"].tolist()]
    for name in LoggedEvent._fields:
        words = meanings(path, "events", name)
        values = columns[name].tolist()
        lists.append([_word(words, code) for code in values] if words else values)
    return ((replicate, LoggedEvent(*values)) for replicate, *values in zip(*lists, strict=True))


def _word(words: Sequence[str], code: int) -> str:
    word = words[code] if code < len(words) else f"unknown_{code}"
    return "" if word == "none" else word
