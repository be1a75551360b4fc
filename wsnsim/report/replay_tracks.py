"""The targets of a replay: ground truth, estimates and particles."""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.analysis.plot_data import Columns
from wsnsim.analysis.plots import LEAST_WEIGHT
from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.report.replay_encoding import ReplayEncoder, quantised, thinned

NO_DELAY: Final = 1e-6
"""Delays (s) of estimates up to this are rounding error."""


def add_tracks(encoder: ReplayEncoder) -> None:
    """Add the ground truth, and the estimates with their errors and cluster heads."""
    run = encoder.run
    for name, table in (("truth", run.truth), ("estimate", run.guess)):
        if table:
            add_track(encoder, name, table)
    delay = run.guess["issued"] - run.guess["time"] if run.guess else np.empty(0)
    delay = delay[np.isfinite(delay)]
    if delay.size and delay.max() > NO_DELAY:
        encoder.notes.append(
            f"each estimate is drawn at its step; cluster heads computed it up to {delay.max():.3g} s later"
        )


def add_track(encoder: ReplayEncoder, name: str, table: Columns) -> None:
    """The position of each target at each frame, target by target; for estimates also error and cluster head."""
    run, box = encoder.run, encoder.box
    steps = np.minimum(np.arange(encoder.frames) * encoder.detail.stride, run.last)
    frame = encoder.frame_of(table["step"])
    kept = steps[frame] == table["step"]
    cell = np.searchsorted(run.targets, table["target"][kept]) * encoder.frames + frame[kept]

    def by_frame(values: Floats) -> Floats:
        result = np.full(len(run.targets) * encoder.frames, np.nan)
        result[cell] = values[kept]
        return result

    x, y = (by_frame(values) for values in run.places(table))
    x[np.isnan(y)] = np.nan
    encoder.columns[f"{name}_x"] = quantised(x, box[0], box[2])
    encoder.columns[f"{name}_y"] = quantised(y, box[1], box[3])
    if name == "estimate":
        encoder.columns["error"] = by_frame(table["error"]).astype("<f4")
        encoder.columns["head"] = np.full(x.size, -1, "<i4")
        encoder.columns["head"][cell] = encoder.index_of(table["head"][kept]) if run.network else -1


def add_particles(encoder: ReplayEncoder) -> None:
    """Add the particles, in 8 bits within the bounding box of each frame's particles."""
    run, cloud = encoder.run, encoder.run.cloud
    rows, frames = _weighty(encoder)
    kept = thinned(frames, encoder.detail.particles)
    if not kept.all():
        encoder.notes.append(f"at most {encoder.detail.particles} particles are drawn at a time")
    encoder.add_total("particle", encoder.frame_of(cloud["step"])[_is_shown(encoder)])
    rows, frames = rows[kept], frames[kept]
    positions = run.places(cloud | {"time": cloud["step"] * run.dt})
    x, y = (_boxed(encoder, axis, values[rows], frames) for axis, values in enumerate(positions))
    encoder.add("particle", frames, x=x, y=y)


def _is_shown(encoder: ReplayEncoder) -> Bools:
    """(particles,) whether the particle's step is drawn."""
    steps = encoder.run.cloud["step"]
    shown = np.minimum(encoder.frame_of(steps) * encoder.detail.stride, encoder.run.last) == steps
    return np.asarray(shown)


def _weighty(encoder: ReplayEncoder) -> tuple[Ints, Ints]:
    """The rows of particles with a noticeable weight, ordered by frame, and their frames; a note on the others."""
    run, cloud = encoder.run, encoder.run.cloud
    frame, shown = encoder.frame_of(cloud["step"]), _is_shown(encoder)
    heaviest = np.zeros(encoder.frames)
    np.maximum.at(heaviest, frame[shown], cloud["weight"][shown])
    heavy = cloud["weight"] > LEAST_WEIGHT * heaviest[frame]
    if (shown & ~heavy).any():
        encoder.notes.append(f"particles lighter than {LEAST_WEIGHT:g} of the heaviest one are not drawn")
    shown &= heavy & np.isfinite(np.sum(run.places(cloud | {"time": cloud["step"]}), axis=0))
    rows = np.flatnonzero(shown)[np.argsort(frame[shown], kind="stable")]
    return rows, frame[rows]


def _boxed(encoder: ReplayEncoder, axis: int, values: Floats, frames: Ints) -> np.ndarray:
    """Values in 8 bits between the least and the greatest of their frame; the limits are added as columns."""
    low, high = np.full(encoder.frames, np.inf), np.full(encoder.frames, -np.inf)
    np.minimum.at(low, frames, values)
    np.maximum.at(high, frames, values)
    width = np.where(high > low, high - low, 1.0)
    low = np.where(np.isfinite(low), low, 0.0)
    origin, side = encoder.box[axis], encoder.box[axis + 2] - encoder.box[axis]
    encoder.columns[f"particle_{'xy'[axis]}_low"] = ((low - origin) / side).astype("<f4")
    encoder.columns[f"particle_{'xy'[axis]}_width"] = (width / side).astype("<f4")
    return np.asarray(np.rint((values - low[frames]) / width[frames] * 255).astype(np.uint8))
