"""Where the nodes stand in a film, what state they are in, and what charge they have left.

nodes(film) -> the shares of charge that the colours span, or None
"""

from __future__ import annotations

from typing import Final

import numpy as np

from wsnsim.analysis.plot_data import Columns
from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.tables import KIND
from wsnsim.report.replay_clusters import NONE, coded, shown_from
from wsnsim.report.replay_encoding import Film, evenly, rounded

CELLS: Final = 20_000_000
"""Nodes times frames up to which the charge of each node is followed; else of those that took part (our choice)."""
REST, AWAKE, DEAD = 0, 1, 2
STATE_OF: Final = {
    "wake": AWAKE, "stay": AWAKE, "sleep": REST, "resume": REST, "restart": REST, "death": DEAD, "crash": DEAD,
}  # fmt: skip
SAID: Final = 0.001
"""The part of the energy from which on it is said that its time is not known (our choice)."""


def nodes(film: Film) -> list[float] | None:
    """Places, states and charge of the nodes that are drawn."""
    run, box = film.run, film.box
    rows = np.argsort(run.nodes["node"], kind="stable")
    rows = rows[np.isin(run.nodes["node"][rows], film.picked)]
    held = {name: values[rows] for name, values in run.nodes.items()}
    if film.picked.size < run.nodes["node"].size:
        film.notes.append(
            f"{film.picked.size:,} of {run.nodes['node'].size:,} nodes are drawn: those that took part, others evenly"
        )
    across = np.full(rows.size, box[2]) if run.flat else held["x"]
    up = held["x"] if run.flat else held["y"]
    film.columns.update({"node": held["node"].astype("<i4"), "node_x": rounded(across, box[0], box[2])})
    film.columns["node_y"] = rounded(up, box[1], box[3])
    if run.events:
        _states(film)
    else:
        _dead(film, held)
    return _charge(film, held) if run.network else None


def _dead(film: Film, held: Columns) -> None:
    """Without a log all are awake, but those who died."""
    dead = np.flatnonzero(np.isfinite(held["died_at"])) if np.isfinite(film.run.dt) else np.empty(0, np.int64)
    steps = np.ceil(held["died_at"][dead] / film.run.dt).clip(0, film.run.last)
    film.columns["state"] = np.full(film.picked.size, AWAKE, np.uint8)
    film.add("turn", film.at(steps), node=dead.astype("<u4"), state=np.full(dead.size, DEAD, np.uint8))


def _states(film: Film) -> None:
    """Who rests, is awake, is dead, at first and from which frame on."""
    events = film.run.events
    state = np.full(film.picked.size, AWAKE, np.uint8)
    seat, to = film.seat(events["node"]), coded(events["kind"], STATE_OF)
    if np.isin(events["kind"], [KIND[kind] for kind in ("wake", "sleep", "stay", "resume")]).any():
        state[:] = REST
    else:
        to[events["kind"] == KIND["restart"]] = AWAKE
    mine = (seat >= 0) & (to != NONE)
    first, row = np.unique(seat[mine], return_index=True)
    state[first[events["kind"][mine][row] == KIND["sleep"]]] = AWAKE
    film.columns["state"] = state
    film.add("turn", film.at(shown_from(events)[mine]), node=seat[mine].astype("<u4"), state=to[mine])


def _charge(film: Film, held: Columns) -> list[float] | None:
    """Levels of charge, at first and from which frame on."""
    initial, left = held["energy_initial"], held["energy_left"]
    share = np.divide(left, initial, out=np.full(left.size, np.nan), where=np.isfinite(initial) & (initial > 0))
    if not np.isfinite(share).any() or np.nanmax(initial) == np.inf:
        return None
    low = np.floor(1000 * float(np.nanmin(share))) / 1000
    levels = film.plan.levels - 1
    film.columns["charge"] = _level(share, low, levels)
    if film.run.events:
        active = _followed(film)
        _followed_are_said(film, share, active)
        film.columns["charge"][active] = levels
        now = _level(1.0 - _spent(film, held, active) / initial[active, None], low, levels)
        frame, row = np.nonzero((np.diff(now, axis=1, prepend=np.uint8(levels)) != 0).T)
        film.add("drain", frame, node=active[row].astype("<u4"), level=now[row, frame])
    return [low, 1.0, levels]


def _level(share: Floats, low: float, levels: int) -> np.ndarray:
    """A share of charge as a level, the lowest being that of the least charged node."""
    part = np.nan_to_num((share - low) / ((1.0 - low) or 1.0), nan=1.0).clip(0, 1)
    return np.rint(part * levels).astype(np.uint8)


def _followed(film: Film) -> Ints:
    """The nodes whose charge is followed: all of them, or of very many those that took part."""
    seat = film.seat(film.run.events["node"])
    active = np.unique(seat[seat >= 0])
    if film.picked.size * film.frames <= CELLS:
        active = np.arange(film.picked.size)
    return active[evenly(active.size, CELLS // film.frames)]


def _followed_are_said(film: Film, share: Floats, active: Ints) -> None:
    others = np.setdiff1d(np.arange(film.picked.size), active)
    if (share[others] < 1.0).any():
        film.notes.append(f"the charge of {active.size:,} nodes is followed; that of the others is as at the end")


def _spent(film: Film, held: Columns, active: Ints) -> Floats:
    """(nodes, frames) joules that nodes have spent by the end of each frame; evenly over a life what is not logged."""
    events = film.run.events
    seat, spent = film.seat(events["node"]), np.zeros((active.size, film.frames))
    row = np.searchsorted(active, seat).clip(0, max(active.size - 1, 0))
    mine = (seat >= 0) & (events["joules"] != 0.0)
    np.add.at(spent, (row[mine], film.at(events["step"][mine])), events["joules"][mine])
    spent = np.cumsum(spent, axis=1)
    every = held["energy_initial"][active] - held["energy_left"][active]
    rest = np.maximum(every - spent[:, -1], 0.0)
    if rest.sum() > SAID * every.sum():
        film.notes.append(
            f"of {every.sum():.4g} J that the nodes spent, the log has no time for {rest.sum():.4g} J (idling, "
            "sleeping and the like): these are drawn as spent evenly over each node's life"
        )
    ends = np.full(active.size, max(film.frames - 1, 1), dtype=np.float64)
    died = held["died_at"][active] / film.run.dt / film.plan.stride
    ends = np.where(np.isfinite(died), np.clip(died, 1.0, ends), ends)
    return spent + rest[:, None] * np.minimum(np.arange(film.frames) / ends[:, None], 1.0)
