"""The tables of a result: which columns they have in a scenario, and which columns are metrics.

A category column holds small unsigned integers, and the words that they stand for are written with it. The words of
`events.what` and `tracker_state.name` grow at run time, since a tracker names its own parcels and quantities: a
recorder holds them as `Words`, and writes them when it closes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from wsnsim.base.columns import CAUSE, CAUSES, EVENT_CAUSE, EVENT_CAUSES, KIND, KINDS, STATUSES, Column
from wsnsim.base.recorders import Memory, Words, equally_long
from wsnsim.base.table_columns import RECORDED_BY_DEFAULT, TABLES

__all__ = [
    "CAUSE", "CAUSES", "EVENT_CAUSE", "EVENT_CAUSES", "KIND", "KINDS", "METRICS", "MORE_IS_BETTER", "ONE_IS_BEST",
    "RECORDED_BY_DEFAULT", "STATE_AFTER", "STATUSES", "TABLES", "Column", "Memory", "Words", "columns_of",
    "equally_long",
]  # fmt: skip

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
MORE_IS_BETTER: Final = ("delivered", "tracked", "tracked_three", "alive", "first_death", "half_dead", "coverage")
"""The metrics of which more is better."""

DUTY_CYCLED: Final = ("radio_on", "hurried")
"""Columns of `runs` about MACs that switch radios off."""


def columns_of(
    table: str,
    states: Sequence[tuple[str, str]] = (),
    position: Sequence[int] | None = None,
    components: int = 1,
    duty_cycled: bool = False,
) -> tuple[Column, ...]:
    """The columns of a table for one motion model and one sensor model.

    Args:
        table: Name of the table.
        states: (name, unit) of the model's state columns, which are inserted after `STATE_AFTER[table]`.
        position: Which state columns are the position. Its unit replaces metres; if it is one column, there is no
            `sd_y` and no `cov_xy`.
        components: Number of components of a reading. If it is one, `readings` has no column `component`.
        duty_cycled: Whether a MAC switches radios off. If not, `runs` has none of the columns of `DUTY_CYCLED`.
    """
    columns = TABLES[table]
    if table == "readings" and components == 1:
        return tuple(column for column in columns if column.name != "component")
    if table == "runs" and not duty_cycled:
        columns = tuple(column for column in columns if column.name not in DUTY_CYCLED)
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
