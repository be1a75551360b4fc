"""THE MAIN PATH: scenario → parts → positions and truth → world → rows → file.

    simulate(scenario, replicate=0, recorder=None) -> Summary      pure, but for what it hands the recorder
    run(scenario, replicates=30, out=path) -> Report               many replicates in one HDF5 file
    verify(path) -> Verification                                   run it again, and compare

`scenario` is what `scenario.load` takes: a file, a shipped name, or a plain dict.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wsnsim import recording
from wsnsim import scenario as scenarios
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import RunError, UsageError
from wsnsim.base.ports import Parts, Recorder
from wsnsim.base.rng import Streams
from wsnsim.base.tables import CAUSES, Memory
from wsnsim.models.deploy import coverage
from wsnsim.network.fleet import Fleet
from wsnsim.network.rows import late_steps, write_rows
from wsnsim.network.world import Outcome, World

Source = Any
"""What `scenario.load` takes, or the Scenario that it gives."""


@dataclass(frozen=True)
class Summary:
    """One replicate in figures: rows of the tables `runs` and `tracks`, and the errors (targets, steps)."""

    run: Mapping[str, Any]
    tracks: tuple[Mapping[str, Any], ...]
    errors: Floats
    joules: Mapping[str, float]
    clusters: int


@dataclass(frozen=True)
class Progress:
    """How far a run is: simulated `time` of `duration` seconds in one of the replicates, after `wall` seconds."""

    replicate: int
    replicates: int
    time: float
    duration: float
    wall: float


@dataclass(frozen=True)
class Report:
    """What `run` did: the scenario, one summary a replicate, the file, and the seconds it took."""

    scenario: Any
    summaries: tuple[Summary, ...]
    out: Path
    wall: float


@dataclass(frozen=True)
class Verification:
    """Whether a result can be repeated; one row a replicate."""

    ok: bool
    text: str
    rows: tuple[Mapping[str, Any], ...]


def simulate(
    scenario: Source,
    replicate: int = 0,
    recorder: Recorder | None = None,
    progress: Callable[[float], None] | None = None,
) -> Summary:
    """Run one replicate of a scenario. The same arguments give the same rows, in any process and any order.

    Errors: ScenarioError if the scenario says what cannot be, RunError if the run cannot go on.
    """
    return _simulate(scenarios.build(scenarios.load(scenario)), replicate, recorder or Memory({}), progress)


def _simulate(
    parts: Parts, replicate: int, recorder: Recorder, progress: Callable[[float], None] | None = None
) -> Summary:
    started = time.process_time()
    streams = Streams(parts.seed, replicate)
    try:
        positions = parts.deploy.draw(parts.sensor.reach, streams("deploy"))
    except RunError as reason:
        raise RunError(f"{reason} (seed {parts.seed}, replicate {replicate})") from reason
    traits = parts.sensor.draw_traits(len(positions), streams("gains"))
    truth_stream, prior_stream = streams("truth"), streams("prior")
    truths = [motion.truth(parts.steps, parts.dt, truth_stream) for motion in parts.motions]
    priors = [parts.prior.draw(truth[0], prior_stream) for truth in truths]
    outcome = World(parts, replicate, positions, traits, truths, priors, streams, recorder).run(progress)
    errors = write_rows(outcome, parts, replicate, truths, recorder)
    summary = _summarise(outcome, parts, replicate, errors, started)
    if recorder.wants("tracks"):
        for row in summary.tracks:
            recorder.write("tracks", row)
    if recorder.wants("runs"):
        recorder.write("runs", summary.run)
    return summary


def _summarise(outcome: Outcome, parts: Parts, replicate: int, errors: Floats, started: float) -> Summary:
    fleet = outcome.fleet
    tracks = tuple(
        {
            "replicate": replicate,
            "target": track.target,
            "rmse": metrics.rmse(errors[track.target]),
            "median_error": metrics.median_error(errors[track.target]),
            "lost": int(metrics.is_lost(errors[track.target])),
            "lost_at": metrics.first_lost(errors[track.target]) * parts.dt,
            "reacquired": track.reacquired,
            "late": late_steps(track, outcome.steps, parts.dt),
            "reports": len(track.estimates),
        }
        for track in outcome.tracks
    )
    deaths = sorted(fleet.died_at.values())
    half = (fleet.size + 1) // 2
    run = {
        "replicate": replicate,
        "status": 0,
        "steps": outcome.steps,
        "rmse": metrics.rmse(errors),
        "median_error": metrics.median_error(errors),
        "lost": int(any(track["lost"] for track in tracks)),
        "energy": float(sum(fleet.totals)),
        "handovers": sum(track.handovers for track in outcome.tracks),
        "frames_sent": outcome.frames_sent,
        "frames_lost": outcome.frames_lost,
        "packets_sent": outcome.packets_sent,
        "alive": sum(fleet.alive),
        "first_death": deaths[0] if deaths else float("nan"),
        "half_dead": deaths[half - 1] if len(deaths) >= half else float("nan"),
        "coverage": _coverage_left(fleet, parts),
        "cpu_seconds": time.process_time() - started,
        "fingerprint": outcome.fingerprint,
    }
    joules = {cause: total for cause, total in zip(CAUSES, fleet.totals, strict=True) if total}
    return Summary(run, tracks, errors, joules, sum(len(track.clusters) for track in outcome.tracks))


def _coverage_left(fleet: Fleet, parts: Parts) -> float:
    """The fraction of the field that living nodes cover; a covered field of which nobody died need not be looked at."""
    if not fleet.died_at and getattr(parts.deploy, "cover", False):
        return 1.0
    living = fleet.positions[np.array(fleet.alive)]
    return coverage(living, parts.sensor.reach, parts.deploy.width, parts.deploy.height)


def run(
    scenario: Source,
    *,
    replicates: int | None = None,
    out: Path,
    command_line: str = "",
    progress: Callable[[Progress], None] | None = None,
) -> Report:
    """Run replicates 0 … n − 1 of a scenario into one HDF5 file, which has its name only once it is complete."""
    began = time.monotonic()
    loaded = scenarios.load(scenario)
    parts = scenarios.build(loaded)
    count = loaded.replicates if replicates is None else replicates
    if count < 1:
        raise UsageError(f"replicates: must be at least 1, is {count}")
    states = tuple(zip(parts.motions[0].columns, parts.motions[0].units, strict=True))
    summaries = []
    with recording.ResultFile(Path(out), states, parts.record) as file:
        file.set_text("scenario/source_yaml", loaded.source_yaml)
        file.set_text("scenario/resolved_json", json.dumps({**scenarios.resolved(loaded), "replicates": count}))
        made_by = recording.provenance(command_line, parts.seed, scenarios.plugins(loaded))
        file.set_text("provenance_json", json.dumps(made_by))
        for replicate in range(count):
            tell = _teller(progress, replicate, count, parts.steps * parts.dt, began)
            summaries.append(_simulate(parts, replicate, file, tell))
    return Report(loaded, tuple(summaries), Path(out), time.monotonic() - began)


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
    resolved: dict[str, Any] = json.loads(recording.read_text(path, "scenario/resolved_json"))
    return resolved


def verify(path: Path) -> Verification:
    """Run a result's scenario again and compare: fingerprints, estimates and energy of every replicate.

    On the machine's kind of CPU and with the same versions the bytes must be equal; otherwise values are compared to
    1e-6 of their size, and the text says so (NumPy's logarithm and exponential differ in the last bit between kinds
    of CPU).
    """
    resolved = rerun_source(path)
    parts = scenarios.build(scenarios.load(resolved))
    stored = json.loads(recording.read_text(path, "provenance_json"))
    here = recording.provenance("", parts.seed)
    differing = _differing(stored, here)
    runs = recording.read_table(path, "runs")
    kept = recording.read_table(path, "estimates") if "estimates" in recording.tables(path) else {}
    rows = []
    for index, replicate in enumerate(runs["replicate"].tolist()):
        memory = Memory({"estimates": True})
        again = _simulate(parts, replicate, memory).run
        before = {name: column[kept["replicate"] == replicate] for name, column in kept.items()}
        rows.append(_compare(replicate, {name: column[index] for name, column in runs.items()}, again, before, memory))
    ok = all(row["equal"] or (bool(differing) and row["close"]) for row in rows)
    return Verification(ok, _verification_text(Path(path), rows, differing, _commits(stored, here), ok), tuple(rows))


def _compare(
    replicate: int, before: Mapping[str, Any], again: Mapping[str, Any], kept: Mapping[str, Any], memory: Memory
) -> dict[str, Any]:
    """One replicate's row: whether all is equal, and whether it is close."""
    pairs: list[tuple[Any, Any]] = [
        (kept[name], column) for name, column in memory.table("estimates").items() if name in kept
    ]
    pairs += [(before[name], again[name]) for name in ("energy", "rmse")]
    same_events = int(before["fingerprint"]) == int(again["fingerprint"])
    equal = all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)
    close = all(
        np.shape(a) == np.shape(b) and np.allclose(a, b, rtol=1e-6, atol=1e-9, equal_nan=True) for a, b in pairs
    )
    return {
        "replicate": replicate,
        "fingerprint": int(before["fingerprint"]),
        "again": int(again["fingerprint"]),
        "equal": same_events and equal,
        "close": close,
    }


def _differing(stored: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """What differs between the place of a result and here, of what can change the last bit."""
    names = {"python": "Python", "packages": "packages", "cpu_features": "CPU features"}
    return [word for name, word in names.items() if stored.get(name) != here.get(name)]


def _commits(stored: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """A line on the commits where a result was made by other code than this; it excuses no difference."""
    before, now = ((made.get("git") or {}).get("commit", "no checkout")[:12] for made in (stored, here))
    return f"  made by commit {before}, run again by {now}" if before != now else ""


def _verification_text(path: Path, rows: list[dict[str, Any]], differing: list[str], commits: str, ok: bool) -> str:
    lines = [f"{path}: " + ("repeats" if ok else "DOES NOT REPEAT")]
    lines += [commits] if commits else []
    if differing:
        lines.append(f"  made with other {' and '.join(differing)}: compared to 1e-6 instead of to the last bit")
    for row in rows:
        verdict = "equal" if row["equal"] else "close" if row["close"] else "different"
        lines.append(
            f"  replicate {row['replicate']}: {verdict}, fingerprint {row['fingerprint']:016x} / {row['again']:016x}"
        )
    return "\n".join(lines)
