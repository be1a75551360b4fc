"""A sweep run from Python."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from wsnsim.base.errors import UsageError
from wsnsim.base.plugin_code import NOT_PYTHON, statements
from wsnsim.campaign.engines import CampaignOutcome, CampaignProgress, Engine
from wsnsim.campaign.folders import prepare
from wsnsim.campaign.runner import run_campaign
from wsnsim.scenario.load import Overrides
from wsnsim.scenario.plugin_access import Plugins, access

TrackersText: TypeAlias = str | Sequence[Any] | Mapping[str, Any] | None
"""Trackers to compare: 'pf:particles=1000,ekf', a list of names, components and mappings, or a mapping by names."""


def sweep(  # noqa: PLR0913
    source: Any,
    *,
    out: str | Path,
    vary: Sequence[str] | Mapping[str, Any] = (),
    overrides: Overrides = (),
    trackers: TrackersText = None,
    replicates: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    batch: bool = True,
    progress: Callable[[CampaignProgress], None] | None = None,
    accept_code_change: bool = False,
) -> CampaignOutcome:
    """Run a sweep, or resume it.

    Read the results with `wsnsim.read(out, "runs")` and compare them with `wsnsim.compare(out)`. A script must call
    this function under `if __name__ == "__main__":`, because worker processes may import the script.

    Args:
        source: file or shipped name of a sweep, a dict with the same content ({"scenario": "pso_mhpf", "grid":
            {"tracker.particles": [100, 200]}}), or scenarios (names, a dict, what `load` returned) and axes in
            `vary`.
        out: folder of the campaign.
        vary: axes, such as ["tracker.particles=100,200"] or {"tracker.particles": [100, 200]}.
        overrides: changed values, such as ["duration=10 s"] or {"duration": "10 s"}.
        trackers: trackers to compare, each with its own parameters: "pf:particles=1000,ekf", a list of names,
            components and mappings, or such a mapping by the names that tables show.
        replicates: Monte Carlo runs per point, if not those of the sweep.
        workers: number of processes, all cores by default; 0: the runs are made in this process.
        scheduler: address of a Dask scheduler, on whose workers to run instead.
        batch: whether standalone runs are made many at once where the tracker offers it.
        progress: called with the progress several times a second.
        accept_code_change: whether runs may be added to those that other code made; the folder's manifest notes it.

    Returns:
        What was done, and what failed or is missing.

    Raises:
        ScenarioError: the scenario or the sweep is invalid.
        UsageError: the campaign cannot be started, or a script calls the function without a main guard. Later
            failures are part of the outcome.
    """
    from wsnsim.scenario.sweep import load_sweep

    if scheduler is None and workers != 0:
        _demand_main_guard()
    plan = load_sweep(source, vary, overrides, trackers, replicates=replicates)
    by = [key for key in ("tracker", "tracker.kind") if trackers and key in plan.keys]
    folder = prepare(plan, out, by=by, command_line="wsnsim.sweep", accept_code_change=accept_code_change)
    allowed = access(Plugins.ANY)
    engine = _engine(folder.path, workers, scheduler)
    return run_campaign(folder, engine, on_progress=progress, batch=batch, access=allowed)


def needs_main_guard() -> bool:
    """Whether a script calls this function where a worker process that imports the script would call it, too."""
    try:
        _demand_main_guard()
    except UsageError:
        return True
    return False


def _demand_main_guard() -> None:
    """Raise UsageError if a script calls `sweep` where a worker process that imports the script would call it, too."""
    frame = inspect.currentframe()
    while frame is not None:
        name, file = frame.f_globals.get("__name__"), frame.f_globals.get("__file__")
        if frame.f_code.co_name == "<module>" and (
            name == "__mp_main__" or (name == "__main__" and file and not is_guarded(_text(file), frame.f_lineno))
        ):
            raise UsageError(
                'a script must call wsnsim.sweep under if __name__ == "__main__": workers import the script; workers=0'
                " makes the runs without workers"
            )
        frame = frame.f_back


def is_guarded(script: str, line: int) -> bool:
    """Whether a script tests `__name__` at or before a line, outside of functions; also if it cannot be read."""
    try:
        found = [one for one in statements(script.encode()) if one[0].start[0] <= line]
    except NOT_PYTHON:
        return True
    tests = [one for one in found if one[0].string == "if" and one[0].start[1] == 0]
    return any(token.string == "__name__" for test in tests for token in test)


def _text(file: str) -> str:
    try:
        return Path(file).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return "("  # no script: nothing is known


def _engine(folder: Path, workers: int | None, scheduler: str | None) -> Engine:
    if scheduler:
        from wsnsim.campaign.dask_engine import DaskEngine

        return DaskEngine(folder, scheduler)
    if workers == 0:
        from wsnsim.campaign.engines import SerialEngine

        return SerialEngine()
    from wsnsim.campaign.engines import LocalEngine, available_cores

    return LocalEngine(workers or available_cores())
