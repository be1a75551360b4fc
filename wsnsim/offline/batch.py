"""Many standalone runs at once: the batch engine, for trackers that offer `WholeRuns`.

    if offers_batch(setup): batches = Batches(setup, recorder, reports)
    summaries = batches.next(replicates)                  of the first few of them; empty if the next must be composed

Its tables are those of `OfflineRun`, run by run: the same draws, the same kernels, and so the same bits. What that does
once a step and run (requests, parcels, answers, scenes) is left out, and rows are computed for all runs of a block
together.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from wsnsim.base.errors import RunError, WsnsimError
from wsnsim.base.initial_conditions import (
    InitialConditions,
    StandaloneBlock,
    StandaloneRun,
    WholeRuns,
    sample_initial_conditions,
)
from wsnsim.base.plugin_code import plugin_fault
from wsnsim.base.results import Summary
from wsnsim.base.rng import HEAD_KEY, Streams, derive, derive_all, derive_each
from wsnsim.base.rows import triangle_columns, truth_rows, wants_steps
from wsnsim.base.setups import Setup, TrackingSetup
from wsnsim.base.tables import Recorder
from wsnsim.offline import block_rows
from wsnsim.offline.block_rows import FollowedTarget
from wsnsim.offline.loopback import HEAD, ReportsOf, readings_of
from wsnsim.offline.offline_run import node_rows

BLOCK_SECONDS: Final = 1.0
"""s: a block may take twice as long, unless it is a single run. Long enough to stack runs that take 100 ms each."""
MOST_RUNS: Final = 256
"""Runs in a block."""
MOST_NUMBERS: Final = 4_000_000
"""Readings, and entries of state covariances, of the runs in a block: about 32 MB of each."""


class Batches:
    """Blocks of runs of a scenario, one after the other, that grow while they take little time.

    Until a block takes `BLOCK_SECONDS`, the next one is twice as long: progress is reported in between. `clock` gives
    the processor time (s).
    """

    def __init__(
        self,
        setup: Setup,
        recorder: Recorder,
        reports: ReportsOf | None = None,
        clock: Callable[[], float] = time.process_time,
    ) -> None:
        assert isinstance(setup, TrackingSetup), "only standalone runs are batched"
        self._setup, self._recorder, self._reports, self._clock = setup, recorder, reports, clock
        self._size, self._composed = 1, wants_steps(recorder)
        self.used = False

    def next(self, replicates: Sequence[int]) -> list[Summary]:
        """Make the first of the runs, and write their rows; none if the next one must be composed."""
        if self._composed:
            return []
        started = time.monotonic()
        summaries = run_batch(self._setup, replicates[: self._size], self._recorder, self._reports, self._clock)
        if summaries is None:
            self._composed = True
            return []
        if time.monotonic() - started < BLOCK_SECONDS:
            self._size = min(2 * self._size, _most_runs(self._setup, summaries[0].run["alive"]))
        self.used = True
        return summaries


def _most_runs(setup: TrackingSetup, sensors: int) -> int:
    """The number of runs in the longest block, which bounds the memory; 0 if a single run takes too much of it."""
    size = max(len(motion.columns) for motion in setup.motions)
    numbers = len(setup.motions) * (setup.steps + 1) * max(sensors, size * size)
    return min(MOST_RUNS, MOST_NUMBERS // numbers)


def run_batch(
    setup: TrackingSetup,
    replicates: Sequence[int],
    recorder: Recorder,
    reports: ReportsOf | None = None,
    clock: Callable[[], float] = time.process_time,
) -> list[Summary] | None:
    """Make the runs of one block, and write their rows. None, with nothing written, if they must be composed.

    They must if the tracker does not offer its present options, if the measurements of a run need too much memory, and
    if an estimate is not finite: the composed run then says where it failed.

    Raises:
        RunError: The initial conditions of a run could not be sampled, or a model or the tracker failed.
    """
    started = clock()
    conditions = [sample_initial_conditions(setup, replicate) for replicate in replicates]
    if not all(_most_runs(setup, len(each.positions)) for each in conditions):
        return None
    streams = [Streams(setup.seed, replicate) for replicate in replicates]
    targets = []
    for number in range(len(setup.motions)):
        target = _followed(setup, number, conditions, streams, reports)
        if target is None or not np.isfinite(target.estimates.means).all():
            return None
        targets.append(target)
    summaries = _written(setup, replicates, conditions, targets, recorder)
    seconds = (clock() - started) / len(summaries)
    return [_finished(summary, seconds, recorder) for summary in summaries]


def _followed(
    setup: TrackingSetup,
    number: int,
    conditions: Sequence[InitialConditions],
    streams: Sequence[Streams],
    reports: ReportsOf | None,
) -> FollowedTarget | None:
    """One target of all runs, or None."""
    tracker, motion = setup.tracker, setup.motions[number]
    assert isinstance(tracker, WholeRuns), "only a tracker that offers whole runs is batched"
    try:
        runs = [
            _standalone(setup, number, each, stream, reports) for each, stream in zip(conditions, streams, strict=True)
        ]
        block = StandaloneBlock(runs, setup.filter_motions[number], setup.filter_sensor, setup.steps, setup.dt)
        estimates = tracker.whole_runs(block)
        if estimates is not None:
            block_rows.demand_shapes(estimates, block)
    except (Exception, SystemExit) as reason:  # a plug-in may exit
        name = "" if isinstance(reason, WsnsimError) else f"{type(reason).__name__}: "
        numbers, said = [each.replicate for each in streams], plugin_fault(reason) or f"{name}{reason}"
        what, which, how = "the run", f"replicate {numbers[0]}", ""
        if len(numbers) > 1:
            what, how = f"one of {len(numbers)} runs that are computed together", "in which, and "
            which = f"replicates {numbers[0]} to {numbers[-1]}"
        hint = f"--no-batch says {how}at what simulated time"
        raise RunError(f"{what} failed (seed {setup.seed}, {which}): {said}; {hint}") from reason
    if estimates is None:
        return None
    truths = np.array([each.truths[number][: setup.steps + 1] for each in conditions])
    heard = [np.isfinite(run.readings[1:]) for run in runs]
    readings = np.array([each.sum(axis=1) for each in heard])
    frames = readings.sum(axis=1) - np.array([each[:, HEAD].sum() for each in heard])
    gaussian = setup.posterior_is_gaussian(number)
    return FollowedTarget(motion, gaussian, truths, estimates, readings, frames)


def _standalone(
    setup: TrackingSetup, target: int, conditions: InitialConditions, streams: Streams, reports: ReportsOf | None
) -> StandaloneRun:
    """One target of one run: its readings are those of `OfflineCluster`."""
    readings = readings_of(setup, target, conditions, streams, reports)(0, setup.steps + 1)
    track = derive(streams.key("tracker"), target)
    keys = derive_each(derive_all(track, np.arange(setup.steps + 1)), np.array([HEAD_KEY], np.uint64))
    return StandaloneRun(conditions.priors[target], readings, conditions.assumed, conditions.traits, keys)


def _written(
    setup: TrackingSetup,
    replicates: Sequence[int],
    conditions: Sequence[InitialConditions],
    targets: Sequence[FollowedTarget],
    recorder: Recorder,
) -> list[Summary]:
    """The summaries of the runs, `cpu_seconds` apart; their rows but those of `runs` are written.

    Rows are in the order in which single runs write them: by run, then by target.
    """
    sensors = np.array([len(each.positions) for each in conditions])
    estimates = [block_rows.estimate_columns(target, setup, sensors) for target in targets]
    tracks: list[dict[str, Any]] = [
        {"replicate": np.array(replicates), "target": number, **block_rows.track_columns(columns, setup)}
        for number, columns in enumerate(estimates)
    ]
    if recorder.wants("truth"):
        truths = [truth_rows(target.motion, target.truths, setup.steps, setup.dt) for target in targets]
        _write(recorder, "truth", replicates, truths, setup.steps + 1)
    if recorder.wants("estimates"):
        _write(recorder, "estimates", replicates, estimates, setup.steps)
    if recorder.wants("covariances"):
        covariances = [triangle_columns(target.estimates.covs, target.motion.columns) for target in targets]
        numbered = [{"step": np.arange(1, setup.steps + 1), **columns} for columns in covariances]
        _write(recorder, "covariances", replicates, numbered, setup.steps)
    if recorder.wants("nodes"):
        for replicate, each in zip(replicates, conditions, strict=True):
            recorder.write("nodes", node_rows(setup, each, replicate))
    runs = {"replicate": list(replicates), **block_rows.run_columns(setup, targets, estimates, tracks, sensors)}
    return block_rows.summaries_of(targets, estimates, tracks, runs)


def _write(
    recorder: Recorder, table: str, replicates: Sequence[int], targets: Sequence[Mapping[str, Any]], rows: int
) -> None:
    """Write the columns of each target, which broadcast to (R, rows)."""
    shape = len(replicates), len(targets), rows
    columns = {"replicate": np.array(replicates)[:, None, None], "target": np.arange(len(targets))[None, :, None]}
    for name in targets[0]:
        each = [np.broadcast_to(own[name], (len(replicates), rows)) for own in targets]
        columns[name] = np.stack(each, axis=1)
    recorder.write(table, {name: np.broadcast_to(column, shape).reshape(-1) for name, column in columns.items()})


def _finished(summary: Summary, seconds: float, recorder: Recorder) -> Summary:
    """The summary with the processor time of its run; its rows of `tracks` and `runs` are written."""
    run = {**summary.run, "cpu_seconds": seconds}
    for table, rows in (("tracks", summary.tracks), ("runs", (run,))):
        for row in rows if recorder.wants(table) else ():
            recorder.write(table, row)
    return replace(summary, run=run)
