"""The comparison of a campaign's results in the terminal: what can be chosen, checked before any run, and printed."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from wsnsim.base.errors import UsageError, printable
from wsnsim.base.regular_files import why_not_regular
from wsnsim.cli.shared import echo, echo_json, echo_lines

if TYPE_CHECKING:
    from wsnsim.recording.folder import Folder, Manifest
    from wsnsim.scenario.plugin_access import Plugins
    from wsnsim.scenario.sweep_schema import Plan

INCOMPLETE: Final = 3
"""Exit code of a campaign with missing runs."""
METRIC: Final = "rmse"
"""The metric that is compared by default."""


class ComparisonOptions(NamedTuple):
    """What is compared in a campaign's results, and where the table goes."""

    metric: str
    by: tuple[str, ...]
    baseline: str | None
    csv: Path | None
    as_json: bool
    bound: bool


def check_comparison(options: ComparisonOptions, plan: Plan | Manifest, by: Sequence[str]) -> None:
    """Raise UsageError, before anything runs, if the comparison would fail or could not be written."""
    from wsnsim.analysis import baselines  # not comparison: pandas may start a thread, and workers would be spawned
    from wsnsim.base.errors import did_you_mean
    from wsnsim.base.tables import METRICS

    if options.metric not in METRICS:
        nearest = did_you_mean(options.metric, METRICS)
        raise UsageError(f"--metric: table runs has no metric '{options.metric}' ({nearest})")
    for key in options.by:
        if key not in plan.keys:
            raise UsageError(f"--by: the campaign does not vary '{key}' ({did_you_mean(key, plan.keys)})")
    baselines.demand_baseline(plan, by, options.baseline)
    if options.csv and options.csv.is_dir():
        raise UsageError(f"--csv {options.csv} is a folder, not a file")
    if options.csv and (reason := why_not_regular(options.csv)):
        raise UsageError(f"--csv {options.csv} {reason}")
    if options.csv and not options.csv.parent.is_dir():
        raise UsageError(f"--csv {options.csv}: folder does not exist: {options.csv.parent}")


def print_comparison(folder: Folder, options: ComparisonOptions, plugins: Plugins | None = None) -> int:
    """Print the comparison of what is on disk. `plugins`: which ones its scenarios may name, if bounds are shown.

    Returns:
        The exit code: 1 if there are no results, 3 if a damaged file was set aside.
    """
    from wsnsim.analysis import campaign_info, comparison, comparison_text
    from wsnsim.base.errors import ResultError
    from wsnsim.campaign import needs_permission

    try:
        found = comparison.compare(folder, options.metric, options.by or None, options.baseline)
    except ResultError as error:
        damaged = [path for point in folder.manifest().points for path in folder.set_aside(point.id)]
        if not damaged:
            echo_lines([f"wsnsim: error: {error}"])
            return error.exit_code
        echo_lines([f"wsnsim: {path}: is damaged and was set aside; its runs are missing now" for path in damaged])
        allowed = " --plugins" * needs_permission(folder)
        echo_lines([f"wsnsim: resume with: wsnsim sweep {shlex.quote(str(folder.path))}{allowed}"])
        return INCOMPLETE
    if options.bound:
        from wsnsim.analysis import comparison_bounds

        found = comparison_bounds.with_bounds(found, folder, plugins)
    if options.csv:
        _write_csv(found.table, options.csv)
    if options.as_json:
        answer = {"answer": comparison_text.answer(found), "folder": str(folder.path)}
        echo_json({**comparison.as_json(found), **answer, **campaign_info.code_json(folder)})
    else:
        echo("\n".join([comparison_text.text(found), *campaign_info.code_lines(folder)]))
    return 0


def _write_csv(table: Any, path: Path) -> None:
    unsafe = [name for name in table if any(printable(value) != value for value in _texts(table[name]))]
    escaped = {name: [printable(str(value)) for value in table[name]] for name in unsafe}
    try:
        table.assign(**escaped).to_csv(path, index=False)
    except OSError as error:
        raise UsageError(f"cannot write {path}: {error.strerror or error}") from None


def _texts(values: Any) -> list[str]:
    return [value for value in values if isinstance(value, str)]
