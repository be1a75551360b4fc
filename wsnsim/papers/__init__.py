"""The source papers and studies: what each prints and claims (a YAML file), its own measures and figures (Python).

The published values of a simulation set-up that a paper describes, the paper, and why runs differ from it:
published(resolved scenario) -> (values, source, reason)

Values are 'rmse' (the time-averaged RMSE over runs), 'energy', 'clusters', and 'rmse_px' and the like for the root mean
square error of a state column. A paper's set-up matches whatever the variant of its tracker.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

from wsnsim.scenario.messages import DocumentModel, read_document
from wsnsim.scenario.texts import shipped_studies


class SetUp(DocumentModel):
    """A simulation set-up of a paper, and the published values of the tracker that runs in it.

    `values` names, for each value, a table of the paper's `published` by the tracker's kind, and by its number of
    particles where that matters. `differs` says why runs differ from them. `equal` is what a resolved scenario has to
    have (null: nothing). `default` is what it has to have wherever it says anything.
    """

    paper: str
    differs: str
    values: dict[str, str]
    equal: dict[str, Any]
    default: dict[str, Any]


class SetUps(DocumentModel):
    """The set-ups of all papers."""

    set_ups: tuple[SetUp, ...]


@functools.cache
def set_ups() -> tuple[SetUp, ...]:
    """The set-ups of all papers, in the order in which they are looked at."""
    return read_document(shipped_studies()["jiang2013"].parent / "set_ups.yaml", SetUps).content.set_ups


def published(resolved: Mapping[str, Any]) -> tuple[dict[str, float], str, str]:
    """The published values for a resolved scenario, the paper and why runs differ; empty if no paper has the set-up."""
    for set_up in set_ups():
        if _fits(resolved, set_up.equal) and _fits(resolved, set_up.default, lenient=True):
            from wsnsim.papers.study import study  # takes long to import and to read

            found = study(set_up.paper)
            if values := _values(resolved, set_up, found.published):
                return values, found.source, set_up.differs
    return {}, "", ""


def _values(resolved: Mapping[str, Any], set_up: SetUp, tables: Mapping[str, Any]) -> dict[str, float]:
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
