"""Reasons are format strings over rows: '{rmse[pf, 50].measured:.1f} m', or '{row.lost:.0f}' of the row itself.

problems(reason, keys) -> [message, ...]          checked when the paper's file is loaded
rendered(reason, row, rows) -> str                once the rows are measured
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from string import Formatter
from typing import Final

from wsnsim.base.errors import did_you_mean
from wsnsim.papers.reproduction import ClaimRow

FIELD: Final = re.compile(r"(row|(?P<id>\w+)\[(?P<key>[^\]]+)\])\.(?P<value>\w+)")
VALUES: Final = ("published", "measured", "low", "high", "replicates", "lost", "lost_fraction", "bound", "reacquired")


def problems(reason: str, keys: Mapping[str, Collection[str]]) -> Iterator[str]:
    """What is wrong with a reason, given the keys (variants, or orders) of the rows of each id."""
    try:
        fields = [(name, spec or "") for _, name, spec, _ in Formatter().parse(reason) if name is not None]
    except ValueError as error:
        yield f"not a format string: {error}"
        return
    for name, spec in fields:
        found = FIELD.fullmatch(name)
        if found is None:
            yield f"'{{{name}}}' is not of the form 'row.measured' or 'id[variant].measured'"
            continue
        if found["id"] and found["id"] not in keys:
            yield f"no row has the id '{found['id']}' ({did_you_mean(found['id'], keys)})"
        elif found["id"] and found["key"] not in keys[found["id"]]:
            yield f"no row is '{found['id']}[{found['key']}]' ({did_you_mean(found['key'], keys[found['id']])})"
        if found["value"] not in VALUES:
            yield f"a row has no number '{found['value']}' ({did_you_mean(found['value'], VALUES)})"
        try:
            format(1.0, spec)
        except ValueError as error:
            yield f"'{{{name}:{spec}}}': {error}"


def rendered(reason: str, row: ClaimRow, rows: Mapping[str, Mapping[str, ClaimRow]]) -> str:
    """The reason of a row with the numbers of the rows that it names, by id and key."""
    return _Numbers().vformat(reason, (), {"row": row, **rows})


class _Numbers(Formatter):
    """Formats numbers; those that no run has are unknown."""

    def format_field(self, value: float, spec: str) -> str:
        return "unknown" if math.isnan(value) else format(value, spec)
