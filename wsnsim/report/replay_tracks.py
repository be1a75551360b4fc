"""What a replay adds where readings name no target: all tracks, detections and clutter, and switched identities."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wsnsim.analysis.multi_target import followed_runs, is_unlabelled
from wsnsim.analysis.plot_data import Columns
from wsnsim.analysis.track_plots import places_of_detections
from wsnsim.base.arrays import Bools, Ints
from wsnsim.base.tables import KIND
from wsnsim.recording import tables
from wsnsim.report.replay_encoding import ReplayEncoder, quantised, thinned

MOST_DETECTIONS = 500
"""Detections that are drawn in a frame at most (our choice)."""


def marks_of(path: str | Path, replicate: int) -> tuple[Columns, Columns]:
    """Detections of a run (`step`, `x`, `y`, `clutter`), and where identities switch (`step`, `x`, `y`).

    Both are empty where readings name their targets, or where it has no ground truth.
    """
    if not is_unlabelled(path) or not {"truth", "runs"} <= tables(path).keys():
        return {}, {}
    run = next(followed_runs(path, [replicate]), None)
    if run is None:
        return {}, {}
    step, target = run.switches[:, 0], run.switches[:, 1]
    places, flat = run.truth[target, step], run.truth.shape[2] < 2
    x, y = (step * run.rule.dt, places[:, 0]) if flat else (places[:, 0], places[:, 1])
    return {} if flat else places_of_detections(path, run), {"step": step, "x": x, "y": y}


def add_unlabelled(encoder: ReplayEncoder, detections: Columns, switches: Columns) -> None:
    """Add the tracks, the detections, the switches, and how many groups merge and split."""
    run = encoder.run
    if run.unlabelled:
        held = run.unlabelled
        frames, shown = encoder.shown(held["step"])
        x, y = run.places(held)
        columns = {"x": x, "y": y, "number": held["track"].astype("<u4"), "confirmed": held["confirmed"].astype("u1")}
        _add(encoder, "track", frames, columns, shown)
        for what in ("merge", "split") if run.events else ():
            encoder.add(what, encoder.frame_of(run.events["step"][run.events["kind"] == KIND[what]].astype(np.int64)))
    if detections:
        frames, shown = encoder.shown(detections["step"])
        order = np.flatnonzero(shown)[np.argsort(frames[shown], kind="stable")]
        kept = thinned(frames[order], MOST_DETECTIONS)
        if not kept.all():
            encoder.notes.append(f"at most {MOST_DETECTIONS} detections are drawn at a time")
        drawn = np.zeros(shown.size, dtype=bool)
        drawn[order[kept]] = True
        columns = {"x": detections["x"], "y": detections["y"], "clutter": detections["clutter"].astype("u1")}
        _add(encoder, "detection", frames, columns, drawn)
    if switches:
        _add(encoder, "switch", encoder.frame_of(switches["step"]), {"x": switches["x"], "y": switches["y"]})


def _add(encoder: ReplayEncoder, name: str, frames: Ints, columns: Columns, rows: Bools | slice = slice(None)) -> None:
    """Add rows with their places quantised."""
    left, bottom, right, top = encoder.box
    places = {"x": quantised(columns["x"], left, right), "y": quantised(columns["y"], bottom, top)}
    encoder.add(name, frames[rows], **{key: values[rows] for key, values in (columns | places).items()})
