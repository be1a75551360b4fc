"""The table of the frontier: every strategy on either radio, by its error."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from tests.papers.frontier_merge import of_row
from tests.papers.studies import module

_settings = module("frontier", "settings")
SWEPT_RADIOS, stored = _settings.SWEPT_RADIOS, _settings.stored
_strategies = module("frontier", "strategies")
RADIOS, Strategy = _strategies.RADIOS, _strategies.Strategy
CHOSEN = _settings.CHOSEN

HEAD = {
    "ideal": ("strategy", "setting", "RMSE, m [95 %]", "x bound", "energy, J", "lost", "in time", "follows"),
    "realistic": ("radio", "strategy", "setting", "RMSE, m [95 %]", "x bound", "energy, J", "lost", "in time",
                  "follows"),
}  # fmt: skip
TITLES = {
    "ideal": "On the ideal radio:",
    "realistic": "On a realistic radio (CC2420):",
}
FAR = 100.0
"""From here on an error (m) has no decimals."""


def frontier_table(part: Mapping[str, Any]) -> str:
    """A table for each radio, of the rows that docs/frontier.json has of the frontier."""
    rows = [(of_row(row), int(row["runs"])) for row in part["strategies"]]
    return "\n\n".join("\n".join(_table(radio, rows, part["bound"])) for radio in RADIOS)


def _table(radio: str, rows: list[tuple[Strategy, int]], bound: float) -> Iterator[str]:
    yield f"{TITLES[radio]}\n"
    here = [row for row in rows if row[0].radio == radio]
    yield _line(HEAD[radio])
    yield _line(["---"] * len(HEAD[radio]))
    for one, runs in sorted(here, key=lambda row: row[0].rmse if math.isfinite(row[0].rmse) else math.inf):
        first = [one.air] if radio != RADIOS[0] else []
        yield _line([*first, *_name(one.variant), *_figures(one, runs, bound)])


def _name(variant: str) -> tuple[str, str]:
    """The strategy and its setting: the defaults, those that the sweep chose, or both."""
    name, _, word = variant.rpartition(", ")
    strategy = name if word in CHOSEN else variant
    shown = f"`{strategy.partition(': ')[2]}`"
    if word in CHOSEN:
        return shown, word
    chosen = {pair.fair for radio in SWEPT_RADIOS.values() if radio in stored()
              for pair in stored()[radio].choices.values()}  # fmt: skip
    return shown, "defaults = fair" if variant in chosen else "defaults"


def _figures(one: Strategy, runs: int, bound: float) -> list[str]:
    lost = f"{round(one.lost * runs)} of {runs}"
    error = f"{_short(one.rmse)} [{_short(one.low)}, {_short(one.high)}]"
    follows = "**yes**" if one.follows else "no"
    return [error, f"{one.rmse / bound:.2f}", f"{one.energy:.3g}", lost, f"{one.in_time:.0%}", follows]


def _short(metres: float) -> str:
    return f"{metres:.2f}" if metres < FAR else f"{metres:.0f}"


def _line(cells: Any) -> str:
    return "| " + " | ".join(cells) + " |"
