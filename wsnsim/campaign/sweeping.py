"""A sweep run from Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from wsnsim.base.errors import UsageError
from wsnsim.campaign.engines import Engine
from wsnsim.campaign.folders import prepare
from wsnsim.campaign.runner import run_campaign
from wsnsim.campaign.status import CampaignOutcome, CampaignProgress


def sweep(  # noqa: PLR0913
    source: str | Path | Mapping[str, Any] | Sequence[str],
    *,
    out: str | Path,
    vary: Sequence[str] = (),
    overrides: Sequence[str] = (),
    trackers: str | None = None,
    replicates: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    batch: bool = True,
    progress: Callable[[CampaignProgress], None] | None = None,
    accept_code_change: bool = False,
) -> CampaignOutcome:
    """Run a sweep, or resume it.

    Read the results with `wsnsim.read(out, "runs")` and compare them with `wsnsim.compare(out)`. A script must call
    this function under `if __name__ == "__main__":`, because worker processes import the script.

    Args:
        source: file or shipped name of a sweep, a dict with the same content ({"scenario": "pso_mhpf", "grid":
            {"tracker.particles": [100, 200]}}), or scenarios, with axes in `vary`.
        out: folder of the campaign.
        vary: axes, such as "tracker.particles=100,200".
        overrides: changed values, such as "duration=10 s".
        trackers: trackers to compare, each with its own parameters: "pf:particles=1000,ekf".
        replicates: Monte Carlo runs per point, if not those of the sweep.
        workers: number of processes, all cores by default.
        scheduler: address of a Dask scheduler, on whose workers to run instead.
        batch: whether standalone runs are made many at once where the tracker offers it.
        progress: called with the progress several times a second.
        accept_code_change: whether runs may be added to those that other code made; the folder's manifest notes it.

    Returns:
        What was done, and what failed or is missing.

    Raises:
        ScenarioError: the scenario or the sweep is invalid.
        UsageError: the campaign cannot be started. Later failures are part of the outcome.
    """
    import multiprocessing

    from wsnsim.scenario.sweep import load_sweep

    if multiprocessing.parent_process() is not None:
        raise UsageError("a worker process imports this script: call wsnsim.sweep under if __name__ == '__main__':")
    plan = load_sweep(source, vary, overrides, trackers, replicates=replicates)
    by = [key for key in ("tracker", "tracker.kind") if trackers and key in plan.keys]
    folder = prepare(plan, out, by=by, command_line="wsnsim.sweep", accept_code_change=accept_code_change)
    return run_campaign(folder, _engine(folder.path, workers, scheduler), on_progress=progress, batch=batch)


def _engine(folder: Path, workers: int | None, scheduler: str | None) -> Engine:
    if scheduler:
        from wsnsim.campaign.dask_engine import DaskEngine

        return DaskEngine(folder, scheduler)
    from wsnsim.campaign.local_engine import LocalEngine, available_cores

    return LocalEngine(workers or available_cores())
