"""The strategies of the frontier: those that follow the target as a table, and all as rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from tests.papers.frontier_merge import of_row
from tests.papers.studies import module

_settings = module("frontier", "settings")
SWEPT_RADIOS, stored = _settings.SWEPT_RADIOS, _settings.stored
_strategies = module("frontier", "strategies")
RADIOS, Strategy = _strategies.RADIOS, _strategies.Strategy
CHOSEN = _settings.CHOSEN

HEAD = ("radio", "strategy", "setting", "RMSE, m [95 %]", "x bound", "energy, J")
NEAR = 1.5
"""Median RMSE over the median bound up to which the page shows a strategy."""


def followers(part: Mapping[str, Any]) -> str:
    """The strategies of docs/frontier.json that follow the target within NEAR times the bound, by radio and error."""
    found = sorted(map(of_row, part["strategies"]), key=lambda one: one.rmse)
    rows = [(one.air, *_name(one.variant), *_figures(one, part["bound"])) for radio in RADIOS for one in found
            if one.radio == radio and one.follows and one.rmse <= NEAR * part["bound"]]  # fmt: skip
    return "\n".join(f"| {' | '.join(row)} |" for row in (HEAD, ["---"] * len(HEAD), *rows))


def rows_of(part: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield every strategy on either radio, with its setting and its error over the bound, for the CSV file."""
    for row in part["strategies"]:
        one, (strategy, setting) = of_row(row), _name(row["variant"])
        named = {"radio": one.air, "strategy": strategy.strip("`"), "setting": setting}
        figures = {key: row[key] for key in ("rmse", "low", "high", "energy", "lost", "in_time", "runs")}
        yield {**named, **figures, "rmse over bound": one.rmse / part["bound"], "follows": one.follows}


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


def _figures(one: Strategy, bound: float) -> list[str]:
    return [f"{one.rmse:.2f} [{one.low:.2f}, {one.high:.2f}]", f"{one.rmse / bound:.2f}", f"{one.energy:.3g}"]
