"""The tables of a result: which columns they have in a scenario, which are metrics, and recorders of their rows.

A category column holds small unsigned integers, and the words that they stand for are written with it. The words of
`events.what` and `tracker_state.name` grow at run time, since a tracker names its own parcels and quantities: a
recorder holds them as `Words`, and writes them when it closes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from wsnsim.base.files import read_sections

KINDS: Final = (
    "wake", "sleep", "sense", "elect", "join", "announce", "allocate", "send", "receive", "drop", "collide", "compute",
    "estimate", "handover", "relay", "lost", "reacquire", "crash", "restart", "death", "overhear", "fault", "report",
    "acquire", "call", "called", "leave", "return", "stay", "resume", "begin", "end", "merge", "split", "initiate",
    "confirm", "delete",
)  # fmt: skip
SPENT: Final = ("tx_electronics", "tx_amplifier", "rx", "overhear", "cpu", "sense", "idle", "sleep", "switch", "leak")
LOSSES: Final = ("self_discharge", "stranded", "unstored", "surplus")
"""What batteries lose without spending it; stranded: what cannot be drawn from one that is empty."""
CAUSES: Final = SPENT + LOSSES
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


_CATEGORIES: Final = {"KINDS": KINDS, "CAUSES": CAUSES, "EVENT_CAUSES": EVENT_CAUSES, "STATUSES": STATUSES}
_SECTIONS: Final = read_sections(Path(__file__).with_name("columns.table"))


def _column(name: str, dtype: str, units: str, description: str, flag: str = "") -> Column:
    """A row of columns.table."""
    return Column(name, dtype, units, description, _CATEGORIES.get(flag, ()), flag == "smooth", flag == "position")


TABLES: Final = {heading[0]: tuple(_column(*row) for row in rows) for heading, rows in _SECTIONS}
"""The columns of each table."""
TABLE_MEANINGS: Final = {heading[0]: heading[1] for heading, _ in _SECTIONS}
"""What a row of each table stands for: "one row per ..."."""
OFF_BY_DEFAULT: Final = (
    "clocks", "covariances", "detections", "links", "particles", "readings", "reports", "tracker_state",
)  # fmt: skip
RECORDED_BY_DEFAULT: Final = {name: name not in OFF_BY_DEFAULT for name in TABLES}
STATE_AFTER: Final = {"truth": "time", "estimates": "issued", "particles": "node"}
"""Tables with the motion model's state columns: the column after which they stand."""
METRICS: Final = tuple(
    column.name
    for column in TABLES["runs"]
    if column.name not in (
        "replicate", "status", "nees_median", "lost_window", "lost_limit", "fingerprint", "event_fingerprint",
        "cpu_seconds",
    )
)  # fmt: skip
"""The columns of `runs` that are metrics: the same each time that a run is repeated."""
ONE_IS_BEST: Final = ("nees", "nis")
"""The metrics of consistency: neither more nor less is better."""
MORE_IS_BETTER: Final = (
    "delivered", "tracked", "tracked_three", "alive", "first_death", "half_dead", "coverage", "completeness",
    "track_life",
)  # fmt: skip
"""The metrics of which more is better."""

DUTY_CYCLED: Final = ("radio_on", "hurried")
"""Columns of `runs` about MACs that switch radios off."""
ABSENCES: Final = ("time_present", "false_time")
"""Columns of `tracks` about targets that may be absent."""
LATE: Final = ("late_readings", "overtaken")
"""Columns of `tracks` about what arrives out of order, where the tracker uses late readings."""
OF_TARGETS: Final = ("target", "error", "woken", "ineffective", "nees", "nis", "nis_dof", "gaussian")
OF_TRACKS: Final = ("track", "confirmed", "existence")
"""Columns of `estimates`: those of labelled readings alone, and those of readings that name no target."""
WITHOUT_HEAD: Final = ("network_error", "disagreement")
"""Columns of `estimates` about participants of a network without a head."""
UNLABELLED: Final = (
    "gospa", "gospa_localisation", "gospa_missed", "gospa_false", "ospa2", "completeness", "switches", "fragments",
    "time_to_confirm", "track_life", "confirmed_tracks", "false_tracks",
)  # fmt: skip
"""Columns of `runs` about tracks of which no reading says whose they are."""


def columns_of(  # noqa: PLR0913
    table: str,
    states: Sequence[tuple[str, str]] = (),
    position: Sequence[int] | None = None,
    components: int = 1,
    duty_cycled: bool = False,
    absences: bool = False,
    unlabelled: bool = False,
    harvests: bool = False,
    headless: bool = False,
    late_readings: bool = False,
) -> tuple[Column, ...]:
    """The columns of a table for one motion model and one sensor model.

    Args:
        table: Name of the table.
        states: (name, unit) of the model's state columns, which are inserted after `STATE_AFTER[table]`.
        position: Which state columns are the position. Its unit replaces metres; if it is one column, there is no
            `sd_y` and no `cov_xy`.
        components: Number of components of a reading. If it is one, `readings` has no column `component`.
        duty_cycled: Whether a MAC switches radios off. If not, `runs` has none of the columns of `DUTY_CYCLED`.
        absences: Whether a target may be absent. If not, `tracks` has none of the columns of `ABSENCES`.
        unlabelled: Whether readings name no target: rows of `estimates` are then of tracks. If not, `runs` has none of
            the columns of `UNLABELLED`.
        harvests: Whether nodes harvest energy. If not, `nodes` has no column `harvested`.
        headless: Whether there is no cluster head. If not, `estimates` has none of the columns of `WITHOUT_HEAD`.
        late_readings: Whether the tracker uses late readings. If not, `tracks` has none of the columns of `LATE`.
    """
    of_one_component = () if components > 1 else ("component",)
    absent = {
        "estimates": (OF_TARGETS if unlabelled else OF_TRACKS) + (() if headless else WITHOUT_HEAD),
        "readings": of_one_component,
        "detections": of_one_component,
        "runs": (() if duty_cycled else DUTY_CYCLED) + (() if unlabelled else UNLABELLED),
        "tracks": (() if absences else ABSENCES) + (() if late_readings else LATE),
        "nodes": () if harvests else ("harvested",),
    }.get(table, ())
    columns = tuple(column for column in TABLES[table] if column.name not in absent)
    if table == "covariances":
        return columns + covariance_columns(states)
    if position is not None:
        unit = states[position[0]][1]
        units = {"m": unit, "m2": product_unit(unit, unit)}
        columns = tuple(replace(c, units=units[c.units]) if c.of_position else c for c in columns)
        columns = tuple(c for c in columns if c.name not in ("sd_y", "cov_xy") or len(position) > 1)
    if table not in STATE_AFTER:
        return columns
    cut = 1 + next(i for i, column in enumerate(columns) if column.name == STATE_AFTER[table])
    state = tuple(Column(name, "f8", unit, "state of the target", smooth=True) for name, unit in states)
    return columns[:cut] + state + columns[cut:]


def covariance_columns(states: Sequence[tuple[str, str]]) -> tuple[Column, ...]:
    """The columns of the upper triangle of a state's covariance, row by row: cov_px_px, cov_px_vx, ..."""
    return tuple(
        Column(f"cov_{one}_{other}", "f8", product_unit(unit, per), "estimated covariance of the state", smooth=True)
        for i, (one, unit) in enumerate(states)
        for other, per in states[i:]
    )


def product_unit(one: str, other: str) -> str:
    """The unit of a product: 'm2' of 'm' and 'm', 'm m/s' of 'm' and 'm/s', one of them if the other is a number."""
    if one == other and one.isalpha():
        return f"{one}2"
    return " ".join(unit for unit in (one, other) if unit)


class Words:
    """The words of a category column that grows at run time, with their codes; at most 256.

    Args:
        words: The words that have a code from the start.
    """

    def __init__(self, words: Iterable[str] = ("",)) -> None:
        self._codes = {word: code for code, word in enumerate(words)}

    def code(self, what: str) -> int:
        """The code of a word; a new word gets the next one."""
        code = self._codes.setdefault(what, len(self._codes))
        assert code < 256, f"more than 256 different words in a category column, the last being {what!r}"
        return code

    def all(self) -> tuple[str, ...]:
        """All words in the order of their codes."""
        return tuple(self._codes)


class Recorder(Protocol):
    """The destination of the rows of the tables. Columns are those of the tables of a result, with `replicate`.

    Two category columns get new values at run time: `words` holds the codes of `events.what`, `state_names` those of
    `tracker_state.name` (used only where that table is wanted).
    """

    words: Words
    state_names: Words

    def wants(self, table: str) -> bool:
        """Whether a table is recorded."""

    def write(self, table: str, columns: Mapping[str, Any]) -> None:
        """Append rows; a scalar stands for equal values in all rows."""


class Memory:
    """A recorder that keeps all rows in memory, for notebooks and tests: `memory.table('estimates')['error']`.

    Args:
        wanted: {table: whether it is recorded}; by default the tables that scenarios record by default.
    """

    def __init__(self, wanted: Mapping[str, bool] | None = None) -> None:
        self._wanted = dict(RECORDED_BY_DEFAULT if wanted is None else wanted)
        self._pieces: dict[str, list[Mapping[str, Any]]] = {}
        self.words = Words()
        self.state_names = Words(())

    def wants(self, table: str) -> bool:
        """Whether a table is recorded."""
        return self._wanted.get(table, False)

    def write(self, table: str, columns: Mapping[str, Any]) -> None:
        """Append rows; a scalar stands for equal values in all rows."""
        self._pieces.setdefault(table, []).append(columns)

    def table(self, name: str) -> dict[str, np.ndarray]:
        """{column: (rows,)} of all rows of a table that were written so far; empty if there are none."""
        pieces = [equally_long(piece) for piece in self._pieces.get(name, [])]
        return {key: np.concatenate([piece[key] for piece in pieces]) for key in (pieces[0] if pieces else ())}


def equally_long(columns: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The columns of one `write` as arrays of equal length; scalars are repeated."""
    arrays = np.broadcast_arrays(*(np.atleast_1d(values) for values in columns.values()))
    return dict(zip(columns, arrays, strict=True))
