"""The arguments of `simulate`, `run`, `sweep`, `compare` and of a result's methods: their checks, and what they change.

changes_of({"tracker": "ekf", "link": {"reach": "60 m"}}) -> [("tracker.kind", "ekf"), ("link.reach", "60 m")]
with shown(True, "run", "runs", of_runs) as report: report(progress)     a widget in Jupyter, a line on a terminal

A check raises UsageError: which argument, what is allowed, what was given.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import inspect
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeAlias, TypedDict

from wsnsim.base.errors import ScenarioError, StorageError, UsageError, did_you_mean, shown_value
from wsnsim.base.tables import TABLES
from wsnsim.scenario.load import Override, Overrides, demand_scenario, listed
from wsnsim.scenario.registry import AT_TOP

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
    with renamed():
        choices = choices_of([trackers] if isinstance(trackers, str) else trackers)
    if len(choices) < 2:
        raise UsageError(f"trackers: expected at least two to compare, {TRACKERS}, got {shown_value(trackers)}")


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
def renamed(names: Mapping[str, str] = OPTIONS) -> Iterator[None]:
    """Replace names in error messages, by default those of options by those of arguments."""

    def said(text: str) -> str:
        for name, other in names.items():
            text = text.replace(name, other)
        return text

    try:
        yield
    except UsageError as error:
        raise UsageError(said(str(error))) from error.__cause__
    except ScenarioError as error:
        issues = [replace(one, place=said(one.place), message=said(one.message)) for one in error.issues]
        raise ScenarioError(issues) from error.__cause__


Choice: TypeAlias = Any
"""A component (`PsoMhpf(particles=200)`), the name of a kind ('pso_mhpf'), or values to change ({'particles': 200})."""


class Changes(TypedDict, total=False):
    """The keyword arguments that change a scenario: one per key at its top.

    A component replaces the whole role. The name of a kind replaces the kind, with its default values, unless the
    scenario has that kind already. A mapping replaces the values that it names, as a scenario does that `extends`
    another one.
    """

    prior: Choice
    deploy: Choice
    motion: Choice
    targets: Choice
    sensor: Choice
    energy: Choice
    link: Choice
    mac: Choice
    packing: Choice
    routing: Choice
    sleep: Choice
    cpu: Choice
    clock: Choice
    sync: Choice
    detection: Choice
    sink: Choice
    workload: Choice
    faults: Choice
    wakeup: Choice
    clusters: Choice
    acquire: Choice
    tracker: Choice
    name: str
    step: float | str
    duration: float | str
    network: str
    lost: Mapping[str, Any]
    until: Mapping[str, Any]
    record: Mapping[str, bool]
    lifetime: Mapping[str, Any]


KEYS: Final = frozenset(Changes.__annotations__)
"""The names of these arguments."""


def overrides_of(
    function: str, changes: Mapping[str, Any], overrides: Overrides | None, seed: int | None, keep: Iterable[str] | None
) -> tuple[Override, ...]:
    """Return everything that the arguments of a function change in a scenario, the most specific last.

    Raises:
        UsageError: there is no such argument or no such table, or a value is given twice.
    """
    unknown = next((key for key in changes if key not in KEYS), None)
    if unknown is not None:
        known = {*KEYS, *_arguments_of(function)}
        raise UsageError(f"{function}() has no argument '{unknown}' ({did_you_mean(unknown, known)})")
    seeded: list[Override] = [] if seed is None else [("seed", seed)]
    given = (*_changes_of(changes), *(() if overrides is None else listed(overrides)), *seeded)
    keys = [(each.partition("=")[0] if isinstance(each, str) else str(each[0])).strip() for each in given]
    if twice := next((key for key in keys if keys.count(key) > 1), ""):
        raise UsageError(f"{function}(): '{twice}' is given twice, by arguments or in overrides")
    return (*given, *_kept(keep))


def _arguments_of(function: str) -> list[str]:
    """The arguments that a function of this package names itself, without those that change a scenario."""
    modules = map(importlib.import_module, ("wsnsim.api.running", "wsnsim.api.sweeping", "wsnsim.api.lifetime"))
    called = next(getattr(module, function) for module in modules if hasattr(module, function))
    parameters = inspect.signature(called).parameters.values()
    return [each.name for each in parameters if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)]


def _changes_of(changes: Mapping[str, Any]) -> Iterator[Override]:
    for key, value in changes.items():
        if value is None:
            continue
        if key in AT_TOP and isinstance(value, str):
            yield f"{key}.kind", value
        else:
            yield from _leaves(key, value)


def _leaves(key: str, value: Any) -> Iterator[Override]:
    if not isinstance(value, Mapping):
        yield key, value
        return
    for name, inner in value.items():
        yield from _leaves(f"{key}.{name}", inner)


def _kept(keep: Any) -> Iterator[Override]:
    """The overrides that record the tables named in `keep`; None means none."""
    names: Any = () if keep is None else (keep,) if isinstance(keep, str) else keep
    names = tuple(names) if isinstance(names, Iterable) else (None,)
    if not all(isinstance(each, str) for each in names):
        raise UsageError(f"keep: expected names of tables, such as ['events'], got {shown_value(keep)}")
    for table in names:
        if table not in TABLES:
            raise UsageError(f"keep: there is no table '{table}' ({did_you_mean(table, TABLES)})")
        yield f"record.{table}", True


WAIT: Final = 1.0
"""Seconds before a bar appears: shorter work needs none."""
BAR: Final = "{desc}: {percentage:3.0f}%|{bar}| {n:.3g}/{total:g} {unit} [{elapsed}<{remaining}]"

Share = Callable[[Any], tuple[float, float]]


def of_runs(now: Any) -> tuple[float, float]:
    """How many runs are done, and how many there are."""
    return now.replicate + now.time / now.duration, now.replicates


def of_campaign(now: Any) -> tuple[float, float]:
    """How many runs of a campaign are done, and how many there are."""
    return now.done, now.total


def in_notebook() -> bool:
    """Return whether this is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return type(shell).__name__ == "ZMQInteractiveShell"


@contextlib.contextmanager
def shown(wanted: Any, what: str, unit: str, share: Share) -> Iterator[Callable[[Any], None] | None]:
    """The function that is called with the progress: that of the caller, one that moves a bar, or None.

    Args:
        wanted: a function; True or False: whether there is a bar; None: in a notebook.
        what: the text in front of the bar.
        unit: what is counted.
        share: gives how much is done, and how much there is.
    """
    if callable(wanted) or not (in_notebook() if wanted is None else wanted):
        yield wanted if callable(wanted) else None
        return
    bar: Any = _bar_class()(total=1.0, desc=what, unit=unit, delay=WAIT, leave=False, bar_format=BAR)

    def step(now: Any) -> None:
        done, bar.total = share(now)
        bar.update(min(done, bar.total) - bar.n)

    try:
        yield step
    finally:
        bar.close()


def _bar_class() -> Any:
    """The widget where Jupyter can show it, else a line of text."""
    from tqdm import tqdm

    if not in_notebook() or not importlib.util.find_spec("ipywidgets"):
        return tqdm
    from tqdm.notebook import tqdm as widget

    show = importlib.import_module("IPython.display").display

    class NotebookBar(widget):  # type: ignore[misc]
        """A widget that leaves nothing in a saved notebook, also if the work fails."""

        handle: Any = None

        def display(self, *texts: Any, check_delay: bool = True, **options: Any) -> None:
            self.container.children[1].max = self.total
            super().display(*texts, check_delay=False, **options)
            if check_delay and self.handle is None:
                self.handle = show(self.container, display_id=True)

        def close(self) -> None:
            super().close()
            if self.handle is not None:
                self.container.close()
                self.handle.update({"text/plain": ""}, raw=True)

    return NotebookBar
