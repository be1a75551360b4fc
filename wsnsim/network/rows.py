"""What a run leaves behind, as rows of the result's tables.

write_rows(outcome, parts, replicate, truths, recorder) -> errors (targets, steps)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.ports import MotionModel, Parts, Recorder
from wsnsim.base.tables import CAUSES
from wsnsim.network.fleet import Fleet
from wsnsim.network.track import ClusterRecord, Track
from wsnsim.network.world import Outcome

NAN = float("nan")


def write_rows(outcome: Outcome, parts: Parts, replicate: int, truths: Sequence[Floats], recorder: Recorder) -> Floats:
    """Write the tables of a run that ended; give the position errors (targets, steps), NaN without an estimate."""
    errors = np.empty((len(truths), outcome.steps))
    _write(recorder, "nodes", replicate, _nodes(outcome.fleet, parts.sensor.trait_names))
    _write(recorder, "energy", replicate, _energy(outcome.fleet))
    for track, motion, truth in zip(outcome.tracks, parts.motions, truths, strict=True):
        steps = np.arange(outcome.steps + 1)
        states = {name: truth[: outcome.steps + 1, i] for i, name in enumerate(motion.columns)}
        _write(
            recorder, "truth", replicate, {"target": track.target, "step": steps, "time": steps * parts.dt, **states}
        )
        estimates = _estimates(track, motion, truth, outcome, parts.dt)
        errors[track.target] = estimates["error"]
        _write(recorder, "estimates", replicate, {"target": track.target, **estimates})
        _write(recorder, "clusters", replicate, {"target": track.target, **_clusters(track.clusters)})
    return errors


def late_steps(track: Track, steps: int, dt: float) -> int:
    """How many estimates missed their step, those that were never issued included."""
    return sum(
        step not in track.estimates or _is_late(track.estimates[step].issued, step, dt) for step in range(1, steps + 1)
    )


def _is_late(issued: float, step: int, dt: float) -> bool:
    return issued > (step + 1) * dt


def _write(recorder: Recorder, table: str, replicate: int, columns: dict[str, Any]) -> None:
    if recorder.wants(table):
        recorder.write(table, {"replicate": replicate, **columns})


def _nodes(fleet: Fleet, trait_names: tuple[str, ...]) -> dict[str, Any]:
    gain = fleet.traits[:, trait_names.index("gain")] if "gain" in trait_names else np.ones(fleet.size)
    died = np.full(fleet.size, NAN)
    for node, time in fleet.died_at.items():
        died[node] = time
    return {
        "node": np.arange(fleet.size),
        "x": fleet.positions[:, 0],
        "y": fleet.positions[:, 1],
        "gain": gain,
        "energy_initial": np.full(fleet.size, fleet.battery),
        "energy_left": fleet.all_left(),
        "died_at": died,
    }


def _energy(fleet: Fleet) -> dict[str, Any]:
    rows = [
        (node, cause, book[cause])
        for node, book in sorted(fleet.books.items())
        for cause in range(len(CAUSES))
        if book[cause] != 0.0
    ]
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return {"node": table[:, 0].astype(np.int64), "cause": table[:, 1].astype(np.int64), "joules": table[:, 2]}


def _estimates(track: Track, motion: MotionModel, truth: Floats, outcome: Outcome, dt: float) -> dict[str, Any]:
    """One row a step from 1 on; a step without an estimate has NaN for all that was not estimated."""
    steps, (x, y) = outcome.steps, motion.position
    means = np.full((steps, len(motion.columns)), NAN)
    claimed = np.full((steps, 3), NAN)
    issued, late = np.full(steps, NAN), np.ones(steps, dtype=np.uint8)
    counts = np.zeros((steps, 3), dtype=np.int64)
    heads = np.array(track.heads[1 : steps + 1], dtype=np.int64)
    for step, made in track.estimates.items():
        row, guess = step - 1, made.estimate
        means[row] = guess.mean
        claimed[row] = np.sqrt(guess.cov[x, x]), np.sqrt(guess.cov[y, y]), guess.effective
        issued[row], late[row], heads[row] = made.issued, _is_late(made.issued, step, dt), made.head
        counts[row] = made.active, made.members, made.readings
    points = truth[1 : steps + 1]
    return {
        "step": np.arange(1, steps + 1),
        "time": np.arange(1, steps + 1) * dt,
        "issued": issued,
        **{name: means[:, i] for i, name in enumerate(motion.columns)},
        "sd_x": claimed[:, 0],
        "sd_y": claimed[:, 1],
        "error": np.hypot(means[:, x] - points[:, x], means[:, y] - points[:, y]),
        "head": heads,
        "active": counts[:, 0],
        "members": counts[:, 1],
        "readings": counts[:, 2],
        "received": np.full(steps, NAN),
        "late": late,
        "woken": outcome.woken[track.target, 1 : steps + 1, 0],
        "ineffective": outcome.woken[track.target, 1 : steps + 1, 1],
        "effective_particles": claimed[:, 2],
    }


def _clusters(clusters: Sequence[ClusterRecord]) -> dict[str, Any]:
    names = {"number": "cluster"}
    return {
        names.get(f.name, f.name): np.array([getattr(cluster, f.name) for cluster in clusters], dtype=np.float64)
        for f in fields(ClusterRecord)
    }
