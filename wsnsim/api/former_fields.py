"""Fields that the results of `simulate` and `run` had before they were a `Result`: each works, with a warning."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any, Final

from wsnsim.base.errors import did_you_mean
from wsnsim.base.tables import TABLES

if TYPE_CHECKING:
    from wsnsim.experiment import Report

OF_SUMMARY: Final = {
    "run": "result.runs.iloc[0]",
    "tracks": "result.table('tracks')",
    "errors": "result.estimates.error",
    "column_rmse": "result.to_dict()['column_rmse']",
    "joules": "result.to_dict()['joules']",
    "clusters": "result.to_dict()['clusters']",
}
"""Fields of `Summary`, which `simulate` returned, and what replaces them."""
OF_REPORT: Final = {
    "summaries": "result.runs",
    "wall": "result.to_dict()['wall_seconds']",
    "states": "the columns of result.estimates",
    "position": "the columns of result.estimates",
    "compiled": "wsnsim.experiment.run",
}
"""Fields of `Report`, which `run` returned, and what replaces them."""
ATTRIBUTES: Final = (
    "answer", "energy", "estimates", "events", "name", "out", "plot", "replicates", "report", "runs", "save",
    "scenario", "seed", "summary", "table", "tables", "to_dict",
)  # fmt: skip
"""The attributes of a result, for suggestions."""


def former_field(report: Report, name: str) -> Any:
    """Return a former field of a result, with a DeprecationWarning.

    Raises:
        AttributeError: there never was one of this name, or the result holds many runs and it belonged to one.
    """
    if name in OF_REPORT:
        _warn(name, OF_REPORT[name])
        return getattr(report, name)
    if name in OF_SUMMARY and len(report.summaries) == 1:
        _warn(name, OF_SUMMARY[name])
        return getattr(report.summaries[0], name)
    if name in TABLES:
        raise AttributeError(
            f"a result has no attribute '{name}': the table is result.table({name!r}), recorded with keep=[{name!r}]"
        )
    raise AttributeError(f"a result has no attribute '{name}' ({did_you_mean(name, ATTRIBUTES)})")


def _warn(name: str, instead: str) -> None:
    warnings.warn(f"Result.{name} is deprecated: use {instead}", DeprecationWarning, stacklevel=4)
