"""The result of one run and of several, and the rows of `runs`, `tracks`, `truth`, `estimates` and `covariances`.

summarise(setup, replicate, result, truths, recorder) -> Summary        writes the rows of these tables
provenance_of(setup)                     the recorded files that a scenario reads, and the rows left out
track_row(columns, rule) -> {column: value}      losses(errors, window, limit, dt) -> those on losses
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import Bools, Estimate, Floats, Ints
from wsnsim.base.errors import MOST_PRINTED
from wsnsim.base.files import file_digest
from wsnsim.base.multi_target import FollowedRun, Tracks
from wsnsim.base.optional_ports import RecordedFile
from wsnsim.base.ports import MotionModel
from wsnsim.base.rows import (
    NAN,
    Issued,
    consistency,
    covariance_rows,
    deviation_rmse,
    estimate_rows,
    fingerprint,
    peer_columns,
    truth_rows,
)
from wsnsim.base.setups import NetworkSetup, Setup, TrackingSetup
from wsnsim.base.tables import Recorder

OF_COVARIANCE: Final = ("sd_x", "sd_y", "cov_xy", "nees")
"""The columns of `estimates` that are NaN where the filter gives no covariance of its estimates."""
FIRST_STEPS: Final = 20
"""Steps over which Li (2012) counts unnecessary wake-ups."""


class TrackRule(NamedTuple):
    """What a track is judged by.

    Attributes:
        window: number of steps, and `limit` in m: when the track is lost.
        dt: duration of a step in s.
        every: number of steps from one due report to the next; 0: none is due.
        present: (steps,) whether the target is there at the steps from 1 on. Nothing is asked of a track while it is
            not, except what it costs.
    """

    window: int
    limit: float
    dt: float
    every: int
    present: Bools


def track_row(columns: Mapping[str, Any], rule: TrackRule) -> dict[str, Any]:
    """The row of one track, from its columns in the table `estimates`."""
    names = ("time", "issued", "received", "readings", "error", "late")
    seen = {name: np.asarray(columns[name])[rule.present] for name in names}
    return {
        "rmse": metrics.rmse(seen["error"]),
        "median_error": metrics.median_error(seen["error"]),
        **losses(np.asarray(columns["error"]), rule.window, rule.limit, rule.dt, rule.present),
        "late": int(seen["late"].sum()),
        "reports": int(np.isfinite(seen["issued"]).sum()),
        **_delays(seen, rule),
        **_followed(seen, rule.dt),
        **_woken(columns, len(rule.present)),
    }


def absence_columns(columns: Mapping[str, Any], rule: TrackRule) -> dict[str, float]:
    """The columns of the table `tracks` on a target that may be absent."""
    kept = np.isfinite(columns["issued"]) & ~rule.present
    return {"time_present": int(rule.present.sum()) * rule.dt, "false_time": int(kept.sum()) * rule.dt}


def losses(errors: Floats, window: int, limit: float, dt: float, present: Bools | bool = True) -> dict[str, Any]:
    """Whether the track is lost at the end, how often and for how long it was lost, and when first.

    Only steps count at which the target is `present`, and an absence ends a loss.
    """
    lost, there = (
        metrics.lost_steps(np.where(present, errors, 0.0), window, limit),
        np.broadcast_to(present, errors.size),
    )
    steps, seen = int(lost.sum()), lost[there]
    return {
        "lost": int(seen[-1:].any()),
        "losses": metrics.count_losses(lost),
        "time_lost": steps * dt,
        "lost_share": steps / seen.size if seen.size else NAN,
        "lost_at": (int(np.argmax(lost)) + window) * dt if steps else NAN,
    }


def _delays(columns: Mapping[str, Any], rule: TrackRule) -> dict[str, Any]:
    """Latencies at the cluster head and at the sink, in s; NaN without an estimate."""
    steps, issued, received = (columns[name] for name in ("time", "issued", "received"))
    in_time = int((received <= steps + rule.dt).sum())
    due = int(rule.present[rule.every - 1 :: rule.every].sum()) if rule.every else 0
    return {
        "delay": metrics.median_error(issued - steps),
        "received": int(np.isfinite(received).sum()),
        "report_delay": metrics.median_error(received - steps),
        "due": due,
        "in_time": in_time / due if due else NAN,
    }


def overtaken(received: Floats) -> int:
    """How many reports (K,) arrived after one of a later step; NaN: it did not arrive."""
    earliest = np.fmin.accumulate(received[::-1])[::-1]
    return int(np.count_nonzero(received[:-1] > earliest[1:]))


def _followed(columns: Mapping[str, Any], dt: float) -> dict[str, Any]:
    """Share of steps with an estimate, and errors of the steps with at least three measurements."""
    times, issued, readings = (np.asarray(columns[name]) for name in ("time", "issued", "readings"))
    errors = np.asarray(columns["error"])
    sure = errors[readings >= metrics.ENOUGH_READINGS]
    return {
        "tracked": metrics.tracked_share(issued, times, readings, dt, 1),
        "tracked_three": metrics.tracked_share(issued, times, readings, dt, metrics.ENOUGH_READINGS),
        "mean_error": metrics.mean_error(errors),
        "mean_error_three": metrics.mean_error(sure),
        "rmse_three": metrics.rmse(sure),
        "median_error_three": metrics.median_error(sure),
    }


def _woken(columns: Mapping[str, Any], steps: int) -> dict[str, int]:
    """Number of wake-ups, and of unnecessary ones."""
    woken, ineffective = (np.broadcast_to(columns[name], steps) for name in ("woken", "ineffective"))
    twenty = int(ineffective[:FIRST_STEPS].sum())
    return {"woken": int(woken.sum()), "ineffective": int(ineffective.sum()), "ineffective_twenty": twenty}


class RunTotals(NamedTuple):
    """Columns of the table `runs` that do not depend on estimates. The defaults hold for a run without a network.

    `radio_on` and `hurried` are None, and no columns, where the radios of nodes that are awake always listen.
    """

    event_fingerprint: int
    alive: int
    energy: float = NAN
    handovers: int = 0
    frames_sent: int = 0
    frames_lost: int = 0
    packets_sent: int = 0
    in_range: int = 0
    delivered: int = 0
    collided: int = 0
    access_failures: int = 0
    retries: int = 0
    cycles: float = 0.0
    awake: float = NAN
    radio_on: float | None = None
    hurried: float | None = None
    first_death: float = NAN
    half_dead: float = NAN
    coverage: float = NAN


class TrackResult(NamedTuple):
    """The estimates of one target, and what a network adds to them.

    Attributes:
        estimates: The estimates by step.
        heads: Cluster head of each step from 0 on; -1 if there is none.
        columns: Columns of the table `estimates` that only a network has.
        counts: Columns of the table `tracks` that only a network has.
    """

    estimates: Mapping[int, Issued]
    heads: Sequence[int]
    columns: Mapping[str, Any]
    counts: Mapping[str, float]


class RunResult(NamedTuple):
    """The result of one run: simulated steps, tracks, totals, energy (J) by cause, and number of clusters.

    `report_every`: number of steps from one report that each track owes the sink to the next; 0: it owes none.
    `unassigned`: the columns of the table `estimates` where readings name no target; empty where `tracks` has them.
    """

    steps: int
    tracks: Sequence[TrackResult]
    totals: RunTotals
    joules: Mapping[str, float]
    clusters: int = 0
    report_every: int = 0
    unassigned: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True)
class Summary:
    """Statistics of one run.

    Attributes:
        run: Its row of the table `runs`.
        tracks: Its rows of the table `tracks`.
        errors: (targets, steps) position errors.
        column_rmse: (targets, D) root mean square error of each state column over the steps.
        joules: Energy that the network spent, by cause.
        clusters: Number of clusters.
    """

    run: Mapping[str, Any]
    tracks: tuple[Mapping[str, Any], ...]
    errors: Floats
    column_rmse: Floats
    joules: Mapping[str, float]
    clusters: int


@dataclass(frozen=True)
class Report:
    """The result of several runs: the scenario, one summary per run, the file, and the wall-clock time in s.

    `out` is `Path()` for runs in memory.

    `compiled` is the processor time (s) in which kernels were compiled; it is no part of the runs.

    `states` are the motion model's columns as (name, unit), `position` says which of them are the position.
    """

    scenario: Any
    summaries: tuple[Summary, ...]
    out: Path
    wall: float
    states: tuple[tuple[str, str], ...]
    position: tuple[int, ...]
    compiled: float = 0.0


def summarise(
    setup: Setup, replicate: int, result: RunResult, truths: Sequence[Floats], recorder: Recorder, started: float
) -> Summary:
    """The statistics of a run; its rows of the tables `truth`, `estimates`, `tracks` and `runs` are written.

    Args:
        setup: The scenario.
        replicate: Number of the run.
        result: What the run produced.
        truths: The states (steps + 1, D) of each target; NaN where it is absent.
        recorder: Where the rows go.
        started: Processor time (s) at the start of the run, as `time.process_time` gives it, later by what is not to
            be counted.
    """
    followed = _assigned(setup, replicate, result, truths) if result.unassigned else None
    if followed and recorder.wants("estimates"):
        recorder.write("estimates", {"replicate": replicate, **result.unassigned})
    errors = np.empty((len(truths), result.steps))
    deviations, rows, estimates = [], [], []
    for target, truth in enumerate(truths):
        assert isinstance(setup, TrackingSetup), "only a tracking scenario has targets"
        present = np.isfinite(truth[1 : result.steps + 1, 0])
        rule = TrackRule(setup.lost_window, setup.lost_limit, setup.dt, result.report_every, present)
        motion = setup.motions[target]
        track = _of_target(result.unassigned, followed.followed[target], motion) if followed else result.tracks[target]
        key = {"replicate": replicate, "target": target}
        columns = estimate_rows(track.estimates, track.heads, motion, truth, result.steps, setup.dt)
        columns.update(track.columns, gaussian=int(setup.posterior_is_gaussian(target)))
        if isinstance(setup, NetworkSetup) and setup.headless:
            columns |= peer_columns(track.estimates, motion, truth, result.steps)
        if not setup.has_covariance:
            columns |= {name: np.full(result.steps, NAN) for name in OF_COVARIANCE if name in columns}
        if recorder.wants("truth"):
            recorder.write("truth", {**key, **truth_rows(motion, truth, result.steps, setup.dt)})
        if recorder.wants("estimates") and not followed:
            recorder.write("estimates", {**key, **columns})
        if recorder.wants("covariances") and not followed and setup.has_covariance:
            recorder.write("covariances", {**key, **covariance_rows(track.estimates, motion.columns)})
        estimates.append(columns)
        errors[target] = columns["error"]
        deviations.append(deviation_rmse(columns, motion, truth))
        rows.append({**key, **track_row(columns, rule), **track.counts})
        rows[-1].update(absence_columns(columns, rule) if setup.has_absences else {})
        rows[-1].update({"overtaken": overtaken(columns["received"])} if setup.uses_late_readings else {})
    column_rmse = np.array(deviations) if deviations else np.empty((0, 0))
    run = {"replicate": replicate, **_run_row(result, errors, rows)}
    tracking = setup if isinstance(setup, TrackingSetup) else None
    run["lost_window"] = tracking.lost_window * tracking.dt if tracking else NAN
    run["lost_limit"] = tracking.lost_limit if tracking else NAN
    run |= followed.columns() if followed else {}
    run |= consistency(estimates, len(setup.motions[0].position) if isinstance(setup, TrackingSetup) else 1)
    run["cpu_seconds"] = time.process_time() - started
    for table, written in (("tracks", rows), ("runs", [run])):
        for row in written if recorder.wants(table) else ():
            recorder.write(table, row)
    return Summary(run, tuple(rows), errors, column_rmse, result.joules, result.clusters)


def _assigned(setup: Setup, replicate: int, result: RunResult, truths: Sequence[Floats]) -> FollowedRun:
    """The tracks of a run whose readings name no target, assigned to the targets now that it is over."""
    assert isinstance(setup, TrackingSetup), "only a tracking scenario has targets"
    motion, held = setup.motions[0], result.unassigned
    truth = np.array([one[: result.steps + 1, list(motion.position)] for one in truths])
    positions = np.column_stack([held[motion.columns[i]] for i in motion.position])
    tracks = Tracks(held["step"], held["track"], positions, held["confirmed"] > 0)
    truth = truth.reshape(len(truths), result.steps + 1, -1)
    return FollowedRun.of(replicate, truth, tracks, setup.lost_limit, setup.lost_window, setup.dt)


def _of_target(held: Mapping[str, Any], rows: Ints, motion: MotionModel) -> TrackResult:
    """The result of a target, of the tracks that follow it.

    Args:
        held: Columns of the table `estimates` of all tracks.
        rows: (steps,) the row that follows the target at each step from 1 on; -1: none.
        motion: The motion model.
    """
    means = np.column_stack([held[name] for name in motion.columns])
    covs, place = np.zeros((len(means), means.shape[1], means.shape[1])), list(motion.position)
    for i, name in zip(place, ("sd_x", "sd_y"), strict=False):
        covs[:, i, i] = held[name] ** 2
    if len(place) > 1:
        covs[:, place[0], place[1]] = covs[:, place[1], place[0]] = held["cov_xy"]
    found = {}
    received, heads = np.full(rows.size, NAN), np.full(rows.size + 1, -1)
    for step in np.flatnonzero(rows >= 0).tolist():
        row = int(rows[step])
        issued, *counts = (held[name][row] for name in ("issued", "head", "active", "members", "readings"))
        found[step + 1] = Issued(step + 1, issued, Estimate(means[row], covs[row]), *counts)
        received[step], heads[step + 1] = held["received"][row], held["head"][row]
    nobody = np.zeros(rows.size, dtype=np.int64)
    columns = {"received": received, "woken": nobody, "ineffective": nobody}
    counts_of_none = {"reacquired": 0, "called": 0, "dismissed": 0, "handover_bits": NAN}
    return TrackResult(found, heads.tolist(), columns, counts_of_none)


def _run_row(result: RunResult, errors: Floats, tracks: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The row of the table `runs`, without `replicate` and `cpu_seconds`."""
    estimates = [track.estimates for track in result.tracks]
    return {
        "status": 0,
        "steps": result.steps,
        "rmse": metrics.rmse(errors),
        "median_error": metrics.median_error(errors),
        "lost": int(any(row["lost"] for row in tracks)),
        "losses": sum(row["losses"] for row in tracks),
        "time_lost": _mean(tracks, "time_lost"),
        "lost_share": _mean(tracks, "lost_share"),
        "tracked": _mean(tracks, "tracked"),
        "tracked_three": _mean(tracks, "tracked_three"),
        **columns_of_totals(result.totals),
        "fingerprint": fingerprint(result.totals.event_fingerprint, estimates, result.unassigned),
    }


def columns_of_totals(totals: RunTotals) -> dict[str, Any]:
    """The columns of the table `runs` that do not depend on estimates; those that are None are left out."""
    return {name: value for name, value in totals._asdict().items() if value is not None}


def _mean(tracks: Sequence[Mapping[str, Any]], name: str) -> float:
    """The mean over the targets that were ever present."""
    return metrics.mean_error(np.array([row[name] for row in tracks], dtype=np.float64))


FILES: Final = "recorded_files"
COUNTS: Final = "skipped_rows"
ROWS: Final = "skipped"


def provenance_of(setup: Setup) -> dict[str, Any]:
    """The entries of a provenance: digests by file, counts of rows left out by file, and the first 50 of these rows.

    Each recorded file counts once: readings and trajectory may stand in the same one.

    Raises:
        RunError: a file cannot be read.
    """
    found: dict[tuple[str, str], dict[str, None]] = {}
    for component in _components(setup):
        key = Path(component.path).name, component.digest or file_digest(component.path)
        found.setdefault(key, {}).update(dict.fromkeys(component.skipped_rows(setup)))
    entries: dict[str, Any] = {FILES: dict(found.keys())} if found else {}
    if skipped := {name: list(rows) for (name, _), rows in found.items() if rows}:
        entries[COUNTS] = {name: len(rows) for name, rows in skipped.items()}
        entries[ROWS] = [row for rows in skipped.values() for row in rows][:MOST_PRINTED]
    return entries


def _components(setup: Setup) -> Iterator[RecordedFile]:
    """Yield the components that read a recorded file."""
    for value in vars(setup).values():
        for component in value if isinstance(value, tuple) else (value,):
            if isinstance(component, RecordedFile):
                yield component
