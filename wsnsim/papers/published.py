"""The published values of a simulation set-up that a paper describes.

published(resolved scenario) -> (values, source)

Values are 'rmse' (the time-averaged RMSE over runs), 'energy', 'clusters', and 'rmse_px' and the like for the root mean
square error of a state column. A paper's set-up matches whatever the variant of its tracker.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from wsnsim.papers.document import SetUp
from wsnsim.papers.paper import paper

WITH_SET_UPS: Final = ("jiang2013", "wei2022", "ruan2020")


def published(resolved: Mapping[str, Any]) -> tuple[dict[str, float], str]:
    """The published values for a resolved scenario, and the paper; ({}, '') for a set-up that is in no paper."""
    for name in WITH_SET_UPS:
        for set_up in paper(name).set_ups:
            if values := _values(resolved, set_up, paper(name).published):
                return values, paper(name).source
    return {}, ""


def _values(resolved: Mapping[str, Any], set_up: SetUp, tables: Mapping[str, Any]) -> dict[str, float]:
    if not _fits(resolved, set_up.equal) or not _fits(resolved, set_up.default, lenient=True):
        return {}
    tracker = resolved.get("tracker") or {}
    keys = [str(tracker.get(key)) for key in ("kind", "particles")]
    found = {name: _entry(tables[table], keys) for name, table in set_up.values.items()}
    return {name: float(value) for name, value in found.items() if value is not None}


def _entry(table: Any, keys: list[str]) -> Any:
    """The value of a table by the tracker's kind, and by its number of particles if the table has those; or None."""
    for key in keys:
        table = table.get(key) if isinstance(table, Mapping) else table
    return table


def _fits(found: Any, wanted: Any, lenient: bool = False) -> bool:
    """Whether the values found are those wanted (None: nothing); `lenient`: a missing key is as good."""
    if not isinstance(wanted, Mapping):
        return not found if wanted is None else bool(found == wanted)
    held = found if isinstance(found, Mapping) else {}
    return all(
        _fits(held[key], value, lenient) if key in held else lenient or value is None for key, value in wanted.items()
    )
