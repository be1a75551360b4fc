"""Checks of the arguments of `simulate`, `run`, `sweep`, `compare`, `Result.save` and `Result.report`.

Each raises UsageError: which argument, what is allowed, what was given.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from wsnsim.base.errors import Issue, ScenarioError, StorageError, UsageError, shown_value
from wsnsim.scenario.build import demand_scenario
from wsnsim.scenario.load import Override, Overrides, listed

OPTIONS: Final = {"--set": "overrides", "--trackers": "trackers", "--replicates": "replicates", "--vary": "vary"}
"""Options of the command line, and the arguments of Python with the same meaning."""
TRACKERS: Final = "a list such as ['ekf', 'pf'], a mapping by names, or a text such as 'pf:particles=1000,ekf'"


def demand_sweep(source: Any, vary: Any, out: Any) -> None:
    """Refuse a source, axes or a folder of a sweep that are of a wrong type."""
    names = isinstance(source, list | tuple) and source and all(isinstance(each, str | Path) for each in source)
    if not names:
        demand_scenario(source)
    texts = isinstance(vary, list | tuple) and all(isinstance(each, str) for each in vary)
    if not texts and not isinstance(vary, Mapping):
        allowed = "a mapping such as {'tracker.particles': [100, 400]}, or a list such as ['tracker.particles=100,400']"
        raise UsageError(f"vary: expected {allowed}, got {shown_value(vary)}")
    if out is not None and not isinstance(out, str | os.PathLike):
        raise UsageError(f"out: expected the path of a folder, got {shown_value(out)}")


def demand_trackers(trackers: Any) -> None:
    """Refuse what names no trackers; None stands for the scenario's own."""
    if trackers is not None and not (isinstance(trackers, str | Mapping | list | tuple) and trackers):
        raise UsageError(f"trackers: expected {TRACKERS}, got {shown_value(trackers)}")


def demand_several(trackers: Any) -> None:
    """Refuse fewer than two trackers."""
    from wsnsim.scenario.tracker_choices import choices_of

    demand_trackers(trackers)
    with named_as_in_python():
        choices = choices_of([trackers] if isinstance(trackers, str) else trackers)
    if len(choices) < 2:
        raise UsageError(f"trackers: expected at least two to compare, {TRACKERS}, got {shown_value(trackers)}")


def overrides_given(overrides: Overrides | None) -> tuple[Override, ...]:
    """Return the overrides as a tuple; None means none."""
    if overrides is None:
        return ()
    return listed(overrides)


def tables_given(keep: Any) -> tuple[str, ...]:
    """Return the names in `keep`; None means none."""
    if keep is None:
        return ()
    if isinstance(keep, str):
        return (keep,)
    found = tuple(keep) if isinstance(keep, Iterable) else (None,)
    if not all(isinstance(each, str) for each in found):
        raise UsageError(f"keep: expected names of tables, such as ['events'], got {shown_value(keep)}")
    return found


def file_given(argument: str, value: Any, *suffixes: str, hint: str = "") -> Path:
    """Return the path of a file to be written.

    Raises:
        UsageError: it is no path, it names no file, or it has another suffix.
        StorageError: its folder does not exist.
    """
    if not isinstance(value, str | os.PathLike) or not Path(value).name:
        raise UsageError(f"{argument}: expected the path of a file with the suffix {suffixes[0]}, got {value!r:.80}")
    path = Path(value)
    if path.suffix.lower() not in suffixes:
        raise UsageError(f"{argument}: expected a file with the suffix {suffixes[0]}, got {str(path)!r:.120}{hint}")
    if not path.parent.is_dir():
        raise StorageError(f"{path}: cannot be written: folder does not exist: {path.parent}")
    return path


def result_file(argument: str, value: Any) -> Path:
    """Return the path of a result file to be written. Raises as `file_given` does."""
    return file_given(argument, value, ".h5", hint="; `wsnsim export` writes tables in other formats")


@contextmanager
def named_as_in_python() -> Iterator[None]:
    """Name arguments of Python in error messages, in place of options of the command line."""
    try:
        yield
    except UsageError as error:
        raise UsageError(_renamed(str(error))) from error.__cause__
    except ScenarioError as error:
        raise ScenarioError([_renamed_issue(issue) for issue in error.issues]) from error.__cause__


def _renamed_issue(issue: Issue) -> Issue:
    return replace(issue, place=_renamed(issue.place), message=_renamed(issue.message))


def _renamed(text: str) -> str:
    for option, argument in OPTIONS.items():
        text = text.replace(option, argument)
    return text
