"""Where the targets are in a film, where they are believed to be, and the particles that say so.

tracks(film);  particles(film)
"""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.analysis.plot_data import Columns
from wsnsim.analysis.plots import LEAST_WEIGHT
from wsnsim.base.arrays import Floats, Ints
from wsnsim.report.replay_encoding import Film, rounded, thinned

PROMPT: Final = 1e-6
"""Seconds up to which an estimate is known at its step."""


def tracks(film: Film) -> None:
    """The true ways, and the estimates with their errors and heads."""
    run = film.run
    for name, table in (("truth", run.truth), ("guess", run.guess)):
        if table:
            _track(film, name, table)
    late = run.guess["issued"] - run.guess["time"] if run.guess else np.empty(0)
    late = late[np.isfinite(late)]
    if late.size and late.max() > PROMPT:
        film.notes.append(
            f"estimates stand at the step that they are of; heads had them up to {late.max():.3g} s later"
        )


def _track(film: Film, name: str, table: Columns) -> None:
    """Where each target is at each frame, one target after the other; of an estimate its error, and who leads."""
    run, box = film.run, film.box
    times = np.minimum(np.arange(film.frames) * film.plan.stride, run.last)
    at = film.at(table["step"])
    kept = times[at] == table["step"]
    spot = np.searchsorted(run.targets, table["target"][kept]) * film.frames + at[kept]

    def laid(values: Floats) -> Floats:
        result = np.full(len(run.targets) * film.frames, np.nan)
        result[spot] = values[kept]
        return result

    across, up = (laid(values) for values in run.places(table))
    across[np.isnan(up)] = np.nan
    film.columns.update({f"{name}_x": rounded(across, box[0], box[2]), f"{name}_y": rounded(up, box[1], box[3])})
    if name == "guess":
        film.columns["error"] = laid(table["error"]).astype("<f4")
        film.columns["head"] = np.full(across.size, -1, "<i4")
        film.columns["head"][spot] = film.seat(table["head"][kept]) if run.network else -1


def particles(film: Film) -> None:
    """Where the particles are, in 8 bits of each frame's own box."""
    run, cloud = film.run, film.run.cloud
    rows, at = _weighty(film)
    kept = thinned(at, film.plan.particles)
    if not kept.all():
        film.notes.append(f"at most {film.plan.particles} particles are drawn at a time")
    film.count("cloud", film.at(cloud["step"])[_shown(film)])
    rows, at = rows[kept], at[kept]
    places = run.places(cloud | {"time": cloud["step"] * run.dt})
    x, y = (_boxed(film, i, values[rows], at) for i, values in enumerate(places))
    film.add("cloud", at, x=x, y=y)


def _shown(film: Film) -> np.ndarray:
    """Whether a particle is of a step that is drawn."""
    steps = film.run.cloud["step"]
    return np.minimum(film.at(steps) * film.plan.stride, film.run.last) == steps


def _weighty(film: Film) -> tuple[Ints, Ints]:
    """The particles that matter, in the frames' order, and their frames; a note on those that do not."""
    run, cloud = film.run, film.run.cloud
    at, shown = film.at(cloud["step"]), _shown(film)
    heaviest = np.zeros(film.frames)
    np.maximum.at(heaviest, at[shown], cloud["weight"][shown])
    heavy = cloud["weight"] > LEAST_WEIGHT * heaviest[at]
    if (shown & ~heavy).any():
        film.notes.append(f"particles of less than {LEAST_WEIGHT:g} of the heaviest one's weight are not drawn")
    shown &= heavy & np.isfinite(np.sum(run.places(cloud | {"time": cloud["step"]}), axis=0))
    rows = np.flatnonzero(shown)[np.argsort(at[shown], kind="stable")]
    return rows, at[rows]


def _boxed(film: Film, axis: int, values: Floats, frames: Ints) -> np.ndarray:
    """Values as 8 bits between the least and the greatest of their frame, which become columns of the film."""
    least, most = np.full(film.frames, np.inf), np.full(film.frames, -np.inf)
    np.minimum.at(least, frames, values)
    np.maximum.at(most, frames, values)
    width = np.where(most > least, most - least, 1.0)
    least = np.where(np.isfinite(least), least, 0.0)
    low, side = film.box[axis], film.box[axis + 2] - film.box[axis]
    film.columns[f"cloud_{'xy'[axis]}_low"] = ((least - low) / side).astype("<f4")
    film.columns[f"cloud_{'xy'[axis]}_width"] = (width / side).astype("<f4")
    return np.rint((values - least[frames]) / width[frames] * 255).astype(np.uint8)
