"""The scenario that a result file stores.

scenario_of_result(path, plugins) -> Scenario      rerun_source(path) -> {key: value}, which `load` takes
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from wsnsim.base.errors import Issue, ResultError, ScenarioError
from wsnsim.recording import read_json
from wsnsim.scenario import Overrides, Plugins, listed, load


def scenario_of_result(path: Path, plugins: Plugins, overrides: Overrides = ()) -> Any:
    """The checked Scenario that a result file stores.

    Args:
        path: The file.
        plugins: Which plug-ins the scenario may name.
        overrides: Values that replace those of the file.

    Raises:
        ResultError: The file cannot be read.
        ScenarioError: With every issue found; those of the stored scenario name the file.
    """
    resolved, written = rerun_source(path), listed(overrides)
    own = ("--set", *(each[0] for each in written if not isinstance(each, str)))
    try:
        return load(resolved, written, plugins)
    except ScenarioError as error:
        places = [issue.place if issue.place.startswith(own) else _joined(path, issue) for issue in error.issues]
        issues = [replace(issue, place=place) for issue, place in zip(error.issues, places, strict=True)]
        raise ScenarioError(issues) from error


def _joined(path: Path, issue: Issue) -> str:
    return ": ".join(filter(None, (str(path), issue.place)))


def rerun_source(path: Path) -> dict[str, Any]:
    """The resolved scenario of a result file, ready for `run`.

    Raises:
        ResultError: The file cannot be read, or its scenario extends a file, as none does that a run has stored.
    """
    resolved = read_json(path, "scenario/resolved_json")
    if "extends" in resolved:
        raise ResultError(f"{path}: its stored scenario extends another file, which no run stores")
    return resolved
