"""An invented result whose readings name no target: two targets, whose tracks swap, and a false track."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from wsnsim.base.multi_target import FollowedRun, Tracks
from wsnsim.base.tables import TABLES, columns_of
from wsnsim.recording import ResultFile

STATES = (("px", "m"), ("vx", "m/s"), ("py", "m"), ("vy", "m/s"))
STEPS, DT, LIMIT, WINDOW = 12, 0.5, 4.0, 2.0


def truth_of(replicate: int, targets: int) -> np.ndarray:
    """(T, STEPS + 1, 2) targets 20 m apart that move to the right; the last one comes at step 3."""
    steps = np.arange(STEPS + 1.0)
    places = np.empty((targets, STEPS + 1, 2))
    places[..., 0], places[..., 1] = steps, 20.0 * np.arange(targets)[:, None] + replicate
    places[-1:, :3] = np.nan
    return places


def rows_of(truth: np.ndarray, seed: int) -> Tracks:
    """Tracks 3 and 5 of the first two targets, which they exchange at step 8; track 7 is false; 9 stays tentative."""
    rng = np.random.default_rng(seed)
    rows = []
    for step in range(1, STEPS + 1):
        for i, track in enumerate((3, 5)[: len(truth)]):
            place = truth[i if step < 8 or len(truth) < 2 else 1 - i, step]
            if np.isfinite(place[0]):
                rows.append((step, track, *(place + rng.normal(0, 0.5, 2)), True))
        rows += [(step, 7, -30.0, 50.0, True)] if step in (4, 5) else []
        rows += [(step, 9, 40.0, 40.0, False)] if step == 6 else []
    steps, tracks, x, y, confirmed = np.array(rows, dtype=np.float64).reshape(-1, 5).T
    return Tracks(steps.astype(np.int64), tracks.astype(np.int64), np.column_stack([x, y]), confirmed > 0)


def write_result(path: Path, runs: int = 2, targets: int = 2, without: tuple[str, ...] = ()) -> Path:
    """Write the result of these runs."""
    wanted = dict.fromkeys(TABLES, True) | dict.fromkeys(without, False)
    with ResultFile(path, STATES, wanted, position=(0, 2), unlabelled=True) as file:
        for run in range(runs):
            truth, key = truth_of(run, targets), {"replicate": run}
            steps = np.arange(STEPS + 1)
            for target, places in enumerate(truth):
                state = dict(zip(("px", "vx", "py", "vy"), (places[:, 0], 2.0, places[:, 1], 0.0), strict=True))
                file.write("truth", {**key, "target": target, "step": steps, "time": steps * DT, **state})
            tracks = rows_of(truth, run)
            file.write("estimates", {**key, **estimate_columns(tracks)})
            file.write("runs", run_row(run, truth, tracks))
            file.write("nodes", dict.fromkeys((c.name for c in columns_of("nodes")), np.array([0.0, 9.0])) | {
                **key, "node": [0, 1], "energy_initial": np.nan})  # fmt: skip
        _write_detections(file, 0 if targets else -1)
        file.set_text(
            "scenario/resolved_json",
            json.dumps({"name": "invented", "seed": 11, "step": DT, "sensor": {"kind": "range"}}),
        )
    return path


def estimate_columns(tracks: Tracks) -> dict[str, object]:
    """The columns of the table `estimates`."""
    row: dict[str, object] = dict.fromkeys((c.name for c in columns_of("estimates", STATES, unlabelled=True)), 0)
    del row["replicate"]
    x, y = tracks.position.T
    row |= {"track": tracks.track, "step": tracks.step, "time": tracks.step * DT, "issued": tracks.step * DT}
    return row | {"px": x, "py": y, "sd_x": 0.5, "sd_y": 0.5, "confirmed": tracks.confirmed}


def run_row(run: int, truth: np.ndarray, tracks: Tracks) -> dict[str, object]:
    """The row of the table `runs`."""
    found = FollowedRun.of(run, truth, tracks, LIMIT, round(WINDOW / DT), DT)
    row: dict[str, object] = dict.fromkeys((c.name for c in columns_of("runs", STATES, unlabelled=True)), 0)
    row |= {"replicate": run, "steps": STEPS, "lost_limit": LIMIT, "lost_window": WINDOW, "energy": np.nan}
    row |= {"first_death": np.nan, "half_dead": np.nan}
    return row | found.columns()


def _write_detections(file: ResultFile, origin: int) -> None:
    """Ranges of node 0: one of a target, or clutter (-1), and one of clutter, at the steps 2 and 3 of the first run."""
    for step in (2, 3):
        columns = {"node": 0, "detection": [0, 1], "reading": [2.0, 7.0], "origin": [origin, -1]}
        file.write("detections", {"replicate": 0, "step": step, "time": step * DT, **columns})
