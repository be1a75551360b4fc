"""Sweeps and comparisons from Python: many points of a scenario, trackers side by side, and the result of a sweep.

A result holds its points, their tables, what failed or is missing, and a comparison that shows itself: as the table and
sentences of `wsnsim compare`, and as HTML in a notebook.
"""

from __future__ import annotations

import contextlib
import html
import os
import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias, Unpack, final

import pandas as pd

from wsnsim.analysis import comparison, comparison_text, error_bounds
from wsnsim.api import arguments
from wsnsim.api.arguments import Changes, demand_sweep, demand_trackers, of_campaign, overrides_of, renamed, shown
from wsnsim.base.errors import RunError, UsageError, did_you_mean, shown_value
from wsnsim.base.runs import run_count
from wsnsim.campaign import describe_failed, prepare, run_campaign
from wsnsim.campaign.engines import CampaignOutcome, CampaignProgress
from wsnsim.campaign.sweeping import engine_of, needs_main_guard
from wsnsim.recording.folder import Folder
from wsnsim.scenario import Overrides
from wsnsim.scenario.registry import Plugins, access
from wsnsim.scenario.sweep import load_sweep

TrackersText: TypeAlias = str | Sequence[Any] | Mapping[str, Any] | None
"""Trackers to compare: 'pf:particles=1000,ekf', a list of names, components and mappings, or a mapping by names."""


@final
@dataclass(frozen=True, repr=False)
class ShownComparison(comparison.Comparison):
    """What `wsnsim.compare` returns: a `Comparison` that `print` and notebooks show as the command does."""

    def __str__(self) -> str:
        return comparison_text.text(self)

    def to_latex(self) -> str:
        """Return the table as LaTeX for a paper, as `wsnsim compare --latex` does; it needs the package booktabs."""
        return comparison_text.latex(self)

    def __repr__(self) -> str:
        return f"<Comparison {self.name}: {self.metric} of {len(self.table)} points>"

    def _repr_html_(self) -> str:
        heads, rows = comparison_text.columns(self)
        body = "".join(f"<tr>{_cells(row, 'td')}</tr>" for row in rows)
        table = f"<table><thead><tr>{_cells(heads, 'th')}</tr></thead><tbody>{body}</tbody></table>"
        sentences = _cells(comparison_text.conclusions(self), "li")
        answer, notes = (_cells(texts, "p") for texts in ([comparison_text.answer(self)], comparison_text.notes(self)))
        return f"<div>{answer}{table}<ul>{sentences}</ul>{notes}</div>"


def _compared(
    folder: Folder, metric: str, chosen: tuple[Sequence[str] | None, str | None], bound: bool, plugins: Plugins
) -> ShownComparison:
    """The comparison of a campaign. `chosen`: keys and baseline; `plugins`: which ones bounds may import."""
    found = comparison.compare(folder, metric, *chosen)
    values: dict[str, Any] = vars(error_bounds.with_bounds(found, folder, plugins) if bound else found)
    return ShownComparison(**values)


def _cells(texts: Iterable[str], tag: str) -> str:
    return "".join(f"<{tag}>{html.escape(text)}</{tag}>" for text in texts)


@final
class SweepResult:
    """The runs of a sweep: `.runs` has a row per run, with the swept parameters in front; `.compare()` a row per point.

    Args:
        out: folder of the campaign.
        outcome: what this session ran, what failed and what is missing.
        temporary: whether the parent of the folder is removed with the result.
    """

    def __init__(self, out: Path, outcome: CampaignOutcome, temporary: bool = False) -> None:
        self.out = out
        self.outcome = outcome
        self._temporary = temporary
        if temporary:
            weakref.finalize(self, _remove, out.parent, os.getpid())

    @property
    def complete(self) -> bool:
        """Whether every run is there and none failed."""
        return self.outcome.complete

    @property
    def failed(self) -> Mapping[str, str]:
        """{run: reason} of the runs that failed."""
        return self.outcome.failed

    @property
    def missing(self) -> Mapping[str, list[int]]:
        """{point: numbers of the runs that are not there}."""
        return self.outcome.missing

    @property
    def runs(self) -> pd.DataFrame:
        """The table `runs` of all points: the swept parameters, then errors (m), energy (J) and counts of each run."""
        return self.table("runs")

    def table(self, name: str) -> pd.DataFrame:
        """Return a table of all points, with the swept parameters as its first columns.

        Args:
            name: name of the table; `runs`, `tracks`, and those that `keep` named.

        Raises:
            ResultError: the table was not recorded.
        """
        from wsnsim.analysis import campaigns

        return campaigns.read(self.out, name)

    def compare(self, metric: str = "rmse", baseline: str | None = None, *, bound: bool = True) -> ShownComparison:
        """Return the points side by side: medians, intervals, energy and paired differences.

        Args:
            metric: a column of the table `runs`.
            baseline: the point that differences are from.
            bound: whether to compute the CRLB beside an RMSE.

        Raises:
            UsageError: there is no such metric or baseline.
            ResultError: there are no results.
        """
        return _compared(Folder(self.out), metric, (None, baseline), bound, Plugins.ANY)

    def __repr__(self) -> str:
        runs = self.outcome.done + self.outcome.found
        failed = f", {len(self.failed)} failed" if self.failed else ""
        place = "temporary" if self._temporary else str(self.out)
        return f"<Sweep: {runs} runs{failed}, {place}>"

    def _repr_html_(self) -> str:
        return f"<div><p>{html.escape(repr(self))}</p>{self.compare(bound=False)._repr_html_()}</div>"

    def __getattr__(self, name: str) -> Any:
        known = ("compare", "complete", "failed", "missing", "out", "outcome", "runs", "table")
        raise AttributeError(f"the result of a sweep has no attribute '{name}' ({did_you_mean(name, known)})")


def _remove(folder: Path, process: int) -> None:
    """Remove a temporary folder, unless this is a copy of the process that made it."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)


SHOWN: Final = 3
"""Failed runs that a message names."""
TRACKER_KEYS: Final = ("tracker", "tracker.kind")


def sweep(  # noqa: PLR0913
    source: Any,
    vary: Sequence[str] | Mapping[str, Any] = (),
    *,
    out: str | Path | None = None,
    replicates: int | None = None,
    trackers: TrackersText = None,
    seed: int | None = None,
    overrides: Overrides | None = (),
    keep: Iterable[str] | None = (),
    workers: int | None = None,
    scheduler: str | None = None,
    batch: bool = True,
    progress: bool | Callable[[CampaignProgress], None] | None = None,
    accept_code_change: bool = False,
    **changes: Unpack[Changes],
) -> SweepResult:
    """Run a sweep, or resume it.

    Example::

        sweep("pso_mhpf", {"tracker.particles": [100, 400]}, replicates=20, out="results/particles")

    A script calls it under `if __name__ == "__main__":`, since worker processes may import it, or with `workers=0`.

    Args:
        source: a scenario (a name, a file, a dict, what `load` returned), several names, or a sweep (a name, a file, or
            a dict with the same keys).
        vary: axes, as a mapping of keys to values, {"tracker.particles": [100, 400]}, or as texts,
            ["tracker.particles=100,400"]. Values may be components.
        out: folder of the campaign, which makes it resumable; None: a temporary one, which goes with the result.
        replicates: Monte Carlo runs per point, if not those of the sweep or scenario.
        trackers: trackers to run at every point: a list, a mapping by names in tables, or "pf:particles=1000,ekf".
        seed: the seed, if not that of the scenario.
        overrides: values to change at every point, {"duration": "10 s"} or ["duration=10 s"].
        keep: tables to record beside `runs` and `tracks`.
        workers: number of processes, all cores by default; 0: the runs are made in this process.
        scheduler: address of a Dask scheduler, on whose workers to run instead.
        batch: whether standalone runs are made many at once where the tracker offers it.
        progress: whether to show a progress bar (by default in notebooks), or a function of a `CampaignProgress`.
        accept_code_change: whether runs may be added to those that other code made.
        changes: roles and other keys of the scenario, as in `simulate`.

    Returns:
        The points, their tables, and what failed or is missing.

    Raises:
        ScenarioError: the scenario or the sweep is invalid.
        UsageError: there is no such argument or table, the campaign cannot be started, or a script calls the function
            without a main guard. Runs that fail later are part of the result.
    """
    chosen = overrides_of("sweep", changes, overrides, seed, keep)
    _check_arguments(source, vary, out, trackers, replicates, scheduler is None and workers != 0)
    with shown(progress, "campaign", "runs", of_campaign) as report, renamed(), _folder_of(out) as place:
        plan = load_sweep(source, vary, chosen, trackers, replicates=replicates)
        by = [key for key in TRACKER_KEYS if trackers and key in plan.keys]
        folder = prepare(plan, place, by=by, command_line="wsnsim.sweep", accept_code_change=accept_code_change)
        engine = engine_of(folder.path, workers, scheduler)
        outcome = run_campaign(folder, engine, on_progress=report, batch=batch, access=access(Plugins.ANY))
    return SweepResult(place, outcome, out is None)


def _check_arguments(source: Any, vary: Any, out: Any, trackers: Any, replicates: Any, spawns: bool) -> None:
    """Raise UsageError if an argument is of a wrong type, or workers that import the script would call `sweep`."""
    demand_sweep(source, vary, out)
    demand_trackers(trackers)
    if replicates is not None:
        run_count(replicates)
    if spawns and needs_main_guard():
        raise UsageError(
            'a script must call wsnsim.sweep under if __name__ == "__main__": workers import the script; workers=0'
            " makes the runs without workers"
        )


@contextlib.contextmanager
def _folder_of(out: str | Path | None) -> Iterator[Path]:
    """The folder of a campaign; without `out`, a temporary one, which stays unless there is an error."""
    if out is not None:
        yield Path(out)
        return
    temporary = Path(tempfile.mkdtemp(prefix="wsnsim-"))
    try:
        yield temporary / "sweep"
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def compare(  # noqa: PLR0913
    source: Any,
    metric: str = "rmse",
    by: Sequence[str] | None = None,
    baseline: str | None = None,
    *,
    trackers: TrackersText = None,
    replicates: int | None = None,
    out: str | Path | None = None,
    seed: int | None = None,
    overrides: Overrides | None = (),
    workers: int | None = None,
    progress: bool | Callable[[CampaignProgress], None] | None = None,
    bound: bool = True,
    **changes: Unpack[Changes],
) -> ShownComparison:
    """Compare trackers on a scenario, or the points of a campaign that has been run.

    Examples::

        compare("pso_mhpf", trackers=["ekf", PsoMhpf(particles=200)], replicates=20)
        compare("results/particles", metric="energy")

    All trackers meet the same targets, networks and noise, so that their differences are paired.

    Args:
        source: a scenario (with `trackers`), the folder of a campaign, or what `sweep` returned.
        metric: a column of the table `runs`, such as 'rmse' (m) or 'energy' (J).
        by: the keys whose values are compared, within each combination of the other keys.
        baseline: what differences are from, by its name; by default the first one.
        trackers: a list of names and components, a mapping from names in tables to these, or "pf:particles=1000,ekf".
        replicates: Monte Carlo runs of each, if not those of the scenario.
        out: folder of the campaign; None: the runs are not kept.
        seed: the seed, if not that of the scenario.
        overrides: values to change, {"duration": "10 s"} or ["duration=10 s"].
        workers: number of processes, all cores by default; 0, or a script without a main guard: this process.
        progress: whether to show a progress bar (by default in notebooks), or a function of a `CampaignProgress`.
        bound: whether to compute the CRLB beside an RMSE.
        changes: roles and other keys of the scenario, as in `simulate`.

    Returns:
        The comparison: `.table` is a DataFrame with a row per tracker or point; `print` shows it with conclusions.

    Raises:
        ScenarioError: the scenario is invalid, or a tracker is none.
        UsageError: there is no such metric, key, baseline or argument, or fewer than two trackers.
        ResultError, RunError: there are no results, or they cannot be read; runs of the comparison failed.
    """
    if trackers is None:
        if changes or replicates is not None or overrides or seed is not None or out is not None:
            raise UsageError("compare() runs a scenario only with trackers, such as trackers=['ekf', 'pf']")
        return _compared(_campaign(source), metric, (by, baseline), bound, Plugins.NONE)
    overrides_of("compare", changes, (), None, ())  # which names this function in what it raises
    arguments.demand_several(trackers)
    found = sweep(
        source, out=out, replicates=replicates, trackers=trackers, seed=seed, overrides=overrides, progress=progress,
        workers=0 if workers is None and needs_main_guard() else workers, **changes,
    )  # fmt: skip
    _demand_complete(found)
    return _compared(Folder(found.out), metric, (by, baseline), bound, Plugins.ANY)


def _demand_complete(found: SweepResult) -> None:
    """Raise RunError if runs failed or are missing, with the first reasons."""
    if not found.complete:
        reasons = describe_failed(found.failed, Folder(found.out).manifest())
        said = "; ".join(reasons[:SHOWN]) or found.outcome.stopped or "runs are missing"
        raise RunError(f"the comparison is not complete: {said}")


def _campaign(folder: Any) -> Folder:
    """The folder of a campaign, or of what `sweep` returned. Raises UsageError for what is none."""
    folder = folder.out if isinstance(folder, SweepResult) else folder
    if not isinstance(folder, str | Path) or not os.path.isdir(folder):  # noqa: PTH112 - long names
        raise UsageError(
            f"compare(): {shown_value(folder)} is not the folder of a campaign; a scenario needs trackers to compare,"
            " such as trackers=['ekf', 'pf']"
        )
    return Folder(folder)
