"""THE MAIN PATH: scenario → parts → positions and truth → world (or bench) → rows → file.

    simulate(scenario, replicate=0, recorder=None) -> Summary      pure, but for what it hands the recorder
    run(scenario, replicates=30, out=path) -> Report               many replicates in one HDF5 file

`scenario` is what `scenario.load` takes: a file, a shipped name, or a plain dict.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import wsnsim.scenario as scenarios
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import RunError, UsageError
from wsnsim.base.ports import Continuous, Estimate, Recorder
from wsnsim.base.rng import Streams
from wsnsim.base.rows import Issued, deviation_rmse, estimate_rows, fingerprint, truth_rows
from wsnsim.base.setups import BeaconSetup, NetworkSetup, Setup, TrackingSetup
from wsnsim.base.tables import CAUSES, Memory
from wsnsim.base.tracking import Rule, track_row
from wsnsim.models.deploy import coverage
from wsnsim.network.nodes import Nodes
from wsnsim.network.result_rows import called_row, run_row, woken_rows, write_network, write_rows
from wsnsim.network.workload_world import WorkloadWorld
from wsnsim.network.world import Sensors, Targets, World
from wsnsim.offline.offline_run import OfflineRun
from wsnsim.recording import ResultFile, provenance, read_text

NAN = float("nan")
UNCALLED = {"called": 0, "dismissed": 0}
"""Without a network there is nobody to be called."""
Source = Any
"""What `scenario.load` takes, or the Scenario that it gives."""
Tell = Callable[[float], None] | None
"""Told the simulated time, now and then."""


@dataclass(frozen=True)
class Summary:
    """One replicate in figures: rows of the tables `runs` and `tracks`, and the position errors (targets, steps).

    `column_rmse` (targets, D): the root mean square error of each state column over the steps.
    """

    run: Mapping[str, Any]
    tracks: tuple[Mapping[str, Any], ...]
    errors: Floats
    column_rmse: Floats
    joules: Mapping[str, float]
    clusters: int


@dataclass(frozen=True)
class Progress:
    """How far a run is: simulated `time` of `duration` seconds in one of the replicates, after `wall` seconds.

    `replicate` counts those of this run, from 0.
    """

    replicate: int
    replicates: int
    time: float
    duration: float
    wall: float


@dataclass(frozen=True)
class Report:
    """What `run` did: the scenario, one summary a replicate, the file, and the seconds it took.

    `states` are the motion model's columns as (name, unit), `position` says which of them are the position.
    """

    scenario: Any
    summaries: tuple[Summary, ...]
    out: Path
    wall: float
    states: tuple[tuple[str, str], ...]
    position: tuple[int, ...]


def simulate(
    scenario: Source,
    replicate: int = 0,
    recorder: Recorder | None = None,
    progress: Callable[[float], None] | None = None,
) -> Summary:
    """Run one replicate of a scenario. The same arguments give the same rows, in any process and any order.

    Errors: ScenarioError if the scenario says what cannot be, RunError if the run cannot go on.
    """
    return replicate_of(scenarios.build(scenarios.load(scenario)), replicate, recorder or Memory({}), progress)


def replicate_of(
    problem: Setup, replicate: int, recorder: Recorder, progress: Callable[[float], None] | None = None
) -> Summary:
    """Run one replicate of a scenario that is built."""
    started = time.process_time()
    if isinstance(problem, BeaconSetup):
        return _beaconing(problem, replicate, recorder, progress, started)
    assert isinstance(problem, TrackingSetup)
    streams = Streams(problem.seed, replicate)
    positions = _deployed(problem, problem.sensor.reach, streams, replicate)
    traits = problem.sensor.draw_traits(len(positions), streams("gains"))
    truth_stream, prior_stream = streams("truth"), streams("prior")
    truths = [motion.truth(problem.steps, problem.dt, truth_stream) for motion in problem.motions]
    priors = [problem.prior.draw(truth[0], prior_stream) for truth in truths]
    setting = _Setting(positions, traits, truths, priors, streams, recorder)
    if isinstance(problem, NetworkSetup):
        played = _in_network(problem, replicate, setting, _paths(problem, truths, streams), progress)
    else:
        played = _on_bench(problem, replicate, setting, progress)
    summary = _summarise(played, problem, replicate, truths, recorder, started)
    if recorder.wants("tracks"):
        for row in summary.tracks:
            recorder.write("tracks", row)
    if recorder.wants("runs"):
        recorder.write("runs", summary.run)
    return summary


def _deployed(problem: Setup, reach: float, streams: Streams, replicate: int) -> Floats:
    """Where the nodes stand, (N, 2)."""
    try:
        return problem.deploy.draw(reach, streams("deploy"))
    except RunError as reason:
        raise RunError(f"{reason} (seed {problem.seed}, replicate {replicate})") from reason


def _beaconing(problem: BeaconSetup, replicate: int, recorder: Recorder, progress: Tell, started: float) -> Summary:
    """One replicate of a network without a target: no tracks, and no errors."""
    streams = Streams(problem.seed, replicate)
    positions = _deployed(problem, problem.link.reach, streams, replicate)
    outcome = WorkloadWorld(problem, replicate, positions, streams, recorder).run(progress)
    write_network(outcome.nodes, replicate, (), recorder)
    run = {
        "replicate": replicate,
        "status": 0,
        "steps": problem.steps,
        "rmse": NAN,
        "median_error": NAN,
        "lost": 0,
        "tracked": NAN,
        "tracked_three": NAN,
        **(row := run_row(outcome)),
        "fingerprint": fingerprint(row["event_fingerprint"], ()),
        "cpu_seconds": time.process_time() - started,
    }
    if recorder.wants("runs"):
        recorder.write("runs", run)
    joules = {cause: total for cause, total in zip(CAUSES, outcome.nodes.ledger.totals, strict=True) if total}
    return Summary(run, (), np.empty((0, problem.steps)), np.empty((0, 0)), joules, 0)


def _paths(parts: NetworkSetup, truths: list[Floats], streams: Streams) -> list[Floats]:
    """The truths at the instants at which nodes look for a target, `parts.polls` a step; the truth itself is the same.

    A way in continuous time is sampled more finely; between the states of other motions it goes straight.
    """
    polls, steps = parts.polls, parts.steps
    if polls == 1:
        return truths
    if all(isinstance(motion, Continuous) for motion in parts.motions):
        stream = streams("truth")
        return [motion.truth(steps * polls, parts.dt / polls, stream) for motion in parts.motions]
    fine, coarse = np.arange(steps * polls + 1) / polls, np.arange(steps + 1)
    return [np.column_stack([np.interp(fine, coarse, column) for column in truth.T]) for truth in truths]


class _Setting(NamedTuple):
    """What is drawn before the clock starts, and where rows go: the arguments of a world, and of a bench."""

    positions: Floats
    traits: Floats
    truths: list[Floats]
    priors: list[Estimate]
    streams: Streams
    recorder: Recorder


class _Track(NamedTuple):
    """One target's estimates, who led at each step, and what else stands beside them in the tables."""

    estimates: Mapping[int, Issued]
    heads: Sequence[int]
    columns: Mapping[str, Any]
    reacquired: int
    called: Mapping[str, int]


class _Played(NamedTuple):
    """What a run leaves behind, with a network or without."""

    steps: int
    tracks: list[_Track]
    run: Mapping[str, Any]
    joules: Mapping[str, float]
    clusters: int


def _in_network(
    parts: NetworkSetup, replicate: int, setting: _Setting, paths: Sequence[Floats], progress: Tell
) -> _Played:
    """A run of the network. `paths` are the truths at the instants at which nodes look for a lost target, too."""
    sensors, targets = Sensors(setting.positions, setting.traits), Targets(setting.truths, setting.priors, paths)
    outcome = World(parts, replicate, sensors, targets, setting.streams, setting.recorder).run(progress)
    write_rows(outcome, replicate, parts, setting.recorder)
    tracks = [_Track(t.estimates, t.heads, woken_rows(outcome, t), t.reacquired, called_row(t)) for t in outcome.tracks]
    joules = {cause: total for cause, total in zip(CAUSES, outcome.nodes.ledger.totals, strict=True) if total}
    row = run_row(outcome, _coverage_left(outcome.nodes, parts))
    return _Played(outcome.steps, tracks, row, joules, sum(len(track.clusters) for track in outcome.tracks))


def _on_bench(problem: TrackingSetup, replicate: int, setting: _Setting, progress: Tell) -> _Played:
    bench = OfflineRun(problem, replicate, *setting)
    tracks = [_Track(t.estimates, t.heads, {"woken": 0, "ineffective": 0}, 0, UNCALLED) for t in bench.run(progress)]
    if setting.recorder.wants("nodes"):
        setting.recorder.write("nodes", {"replicate": replicate, **bench.node_rows()})
    return _Played(problem.steps, tracks, bench.run_row(), {}, 0)


def _summarise(
    played: _Played,
    problem: TrackingSetup,
    replicate: int,
    truths: Sequence[Floats],
    recorder: Recorder,
    started: float,
) -> Summary:
    steps, dt = played.steps, problem.dt
    rule = Rule(problem.lost_window, problem.lost_limit, dt, _due(problem, steps))
    errors, deviations, rows = np.empty((len(truths), steps)), [], []
    for target, (track, motion, truth) in enumerate(zip(played.tracks, problem.motions, truths, strict=True)):
        columns = estimate_rows(track.estimates, track.heads, motion, truth, steps, dt)
        key = {"replicate": replicate, "target": target}
        if recorder.wants("truth"):
            recorder.write("truth", {**key, **truth_rows(motion, truth, steps, dt)})
        if recorder.wants("estimates"):
            recorder.write("estimates", {**key, **columns, **track.columns})
        errors[target] = columns["error"]
        deviations.append(deviation_rmse(columns, motion, truth))
        row = track_row(track.estimates, {**columns, **track.columns}, rule)
        rows.append({**key, **row, "reacquired": track.reacquired, **track.called})
    run = {
        "replicate": replicate,
        "status": 0,
        "steps": steps,
        "rmse": metrics.rmse(errors),
        "median_error": metrics.median_error(errors),
        "lost": int(any(row["lost"] for row in rows)),
        **{name: float(np.mean([row[name] for row in rows])) for name in ("tracked", "tracked_three")},
        **played.run,
        "fingerprint": fingerprint(played.run["event_fingerprint"], [track.estimates for track in played.tracks]),
        "cpu_seconds": time.process_time() - started,
    }
    return Summary(run, tuple(rows), errors, np.array(deviations), played.joules, played.clusters)


def _due(problem: TrackingSetup, steps: int) -> int:
    """How many reports a track owes the sink in so many steps."""
    if not isinstance(problem, NetworkSetup) or problem.sink.point is None:
        return 0
    every = 1 if problem.sink.every is None else max(1, round(problem.sink.every / problem.dt))
    return steps // every


def _coverage_left(fleet: Nodes, parts: NetworkSetup) -> float:
    """The fraction of the field that living nodes cover; a covered field of which all live need not be looked at."""
    all_live = bool(fleet.living.all())
    if all_live and getattr(parts.deploy, "cover", False):
        return 1.0
    field, reach = parts.deploy.field, parts.sensor.reach
    if all_live and field.centre == (0.0, 0.0):
        return coverage(fleet.positions, reach, field.width, field.height, tree=fleet.tree)
    living = fleet.positions[fleet.living]
    return coverage(living - np.array(field.centre), reach, field.width, field.height)


def run(
    scenario: Source,
    *,
    replicates: int | range | None = None,
    out: Path,
    command_line: str = "",
    progress: Callable[[Progress], None] | None = None,
) -> Report:
    """Run replicates of a scenario into one HDF5 file, which has its name only once it is complete.

    `replicates`: 0 … n − 1, or those of a range; as many as the scenario says where it is None.
    """
    began = time.monotonic()
    loaded = scenarios.load(scenario)
    parts = scenarios.build(loaded)
    wanted = loaded.replicates if replicates is None else replicates
    chosen = range(wanted) if isinstance(wanted, int) else wanted
    count = len(chosen)
    if count < 1:
        raise UsageError(f"replicates: must be at least 1, is {wanted}")
    motions = parts.motions if isinstance(parts, TrackingSetup) else ()
    states = tuple(zip(motions[0].columns, motions[0].units, strict=True)) if motions else ()
    position = motions[0].position if motions else ()
    summaries = []
    with ResultFile(Path(out), states, parts.record, position=position or None) as file:
        file.set_text("scenario/source_yaml", loaded.source_yaml)
        file.set_text("scenario/resolved_json", json.dumps({**scenarios.resolved(loaded), "replicates": count}))
        made_by = provenance(command_line, parts.seed, scenarios.plugins(loaded))
        file.set_text("provenance_json", json.dumps(made_by))
        for number, replicate in enumerate(chosen):
            tell = _teller(progress, number, count, parts.steps * parts.dt, began)
            summaries.append(replicate_of(parts, replicate, file, tell))
    wall = time.monotonic() - began
    return Report(loaded, tuple(summaries), Path(out), wall, states, position)


def _teller(
    progress: Callable[[Progress], None] | None, replicate: int, count: int, duration: float, began: float
) -> Callable[[float], None] | None:
    """Progress by wall clock, ten times a second at most."""
    if progress is None:
        return None
    told = [0.0]

    def tell(now: float) -> None:
        wall = time.monotonic()
        if wall - told[0] >= 0.1 or now >= duration:
            told[0] = wall
            progress(Progress(replicate, count, min(now, duration), duration, wall - began))

    return tell


def rerun_source(path: Path) -> dict[str, Any]:
    """The resolved scenario that a result was made from, ready for `run`."""
    resolved: dict[str, Any] = json.loads(read_text(path, "scenario/resolved_json"))
    return resolved
