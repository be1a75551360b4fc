"""A run as a picture that moves, for a browser: who is where at each step, quantised, compressed, as text.

    pack(path, replicate, room) -> Packed

How the text is made up, `film` says; who reads it is page/replay.js.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.analysis.film import MISSING, Film, Plan, evenly, rounded
from wsnsim.analysis.plots import LEAST_WEIGHT
from wsnsim.analysis.recorded import Run, recorded
from wsnsim.analysis.sources import Columns
from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.tables import KIND

CELLS: Final = 20_000_000
"""Nodes times frames up to which the charge of each node is followed; else of those that took part (our choice)."""
MOST_FRAMES: Final = 20_000
"""Frames from which on steps are thinned, whatever the room (our choice)."""
REST, AWAKE, DEAD = 0, 1, 2
ANEW: Final = 128
"""Added to the target's number where its cluster begins anew."""
STATE_OF: Final = {
    "wake": AWAKE, "stay": AWAKE, "sleep": REST, "resume": REST, "restart": REST, "death": DEAD, "crash": DEAD,
}  # fmt: skip


PLANS: Final = (
    Plan(),
    Plan(particles=400, links=500),
    Plan(1, 50_000, 200, 200, 127),
    Plan(1, 50_000, 100, 100, 63),
    Plan(2, 20_000, 100, 100, 63),
    Plan(5, 20_000, 50, 50, 31),
    Plan(10, 10_000, 50, 50, 31),
    Plan(50, 5_000, 0, 30, 15),
    Plan(200, 2_000, 0, 0, 7),
)
"""From everything to little: the first one is taken whose text has room (our choice)."""


@dataclass(frozen=True)
class Packed:
    """A replay as text, '' if there is none, and what its viewer must know: what was thinned, what is not recorded."""

    text: str
    notes: tuple[str, ...]


def pack(path: str | Path, replicate: int, room: int) -> Packed:
    """The replay of a run, in at most `room` characters.

    Raises:
        UsageError: the result has no such replicate.
        ResultError: the result cannot be read.
    """
    run = recorded(path, replicate)
    missing = run.missing()
    if not (run.truth or run.guess or (run.nodes and run.events)):
        return Packed("", ("There is nothing to replay.", *_sentences(missing)))
    for plan in PLANS:
        header, film = _drawn(run, plan._replace(stride=max(plan.stride, -(-run.last // MOST_FRAMES))))
        notes = _sentences([*film.notes, *missing])
        text = film.text(header | {"notes": notes})
        if len(text) <= room:
            return Packed(text, notes)
    return Packed("", (f"The replay was left out: thinned, too, it takes more than {max(room, 0):,} characters.",))


def _sentences(notes: list[str]) -> tuple[str, ...]:
    return tuple(f"{note[0].upper()}{note[1:]}." for note in notes)


def _drawn(run: Run, plan: Plan) -> tuple[dict[str, Any], Film]:
    """A run drawn by a plan."""
    film = Film.blank(run, plan)
    if plan.stride > 1:
        film.notes.append(f"each {plan.stride}th step of {run.last:,} is drawn")
    charge = _nodes(film) if run.nodes else None
    for name, table in (("truth", run.truth), ("guess", run.guess)):
        if table:
            _track(film, name, table)
    if run.events and run.nodes:
        _members(film)
        _flights(film)
    if run.cloud:
        _particles(film)
    side = max(film.box[2] - film.box[0], film.box[3] - film.box[1])
    film.notes.append(f"places are rounded to {side / (MISSING - 1):.1g} of the axes' unit")
    header = {
        "last": run.last, "stride": plan.stride, "frames": film.frames, "targets": run.targets, "box": film.box,
        "dt": run.dt if np.isfinite(run.dt) else None, "flat": run.flat, "axes": run.axes, "words": run.words,
        "nodes": film.picked.size, "charge": charge,
    }  # fmt: skip
    return header, film


def _nodes(film: Film) -> list[float] | None:
    """Where the nodes stand, their charge and their state; gives the shares of charge that the colours span."""
    run, box = film.run, film.box
    rows = np.argsort(run.nodes["node"], kind="stable")
    rows = rows[np.isin(run.nodes["node"][rows], film.picked)]
    nodes = {name: values[rows] for name, values in run.nodes.items()}
    if film.picked.size < run.nodes["node"].size:
        film.notes.append(
            f"{film.picked.size:,} of {run.nodes['node'].size:,} nodes are drawn: those that took part, others evenly"
        )
    across = np.full(rows.size, box[2]) if run.flat else nodes["x"]
    up = nodes["x"] if run.flat else nodes["y"]
    film.columns.update({"node": nodes["node"].astype("<i4"), "node_x": rounded(across, box[0], box[2])})
    film.columns["node_y"] = rounded(up, box[1], box[3])
    _states(film, nodes)
    return _charge(film, nodes) if run.network else None


def _states(film: Film, nodes: Columns) -> None:
    """Who rests, is awake, is dead, at first and from which frame on; without a log, who is dead."""
    events = film.run.events
    state = np.full(film.picked.size, AWAKE, np.uint8)
    if not events:
        dead = np.flatnonzero(np.isfinite(nodes["died_at"])) if np.isfinite(film.run.dt) else np.empty(0, np.int64)
        steps = np.ceil(nodes["died_at"][dead] / film.run.dt).clip(0, film.run.last)
        film.columns["state"] = state
        film.add("turn", film.at(steps), node=dead.astype("<u4"), state=np.full(dead.size, DEAD, np.uint8))
        return
    turned = np.full(256, 255, np.uint8)
    for kind, value in STATE_OF.items():
        turned[KIND[kind]] = value
    seat, to = film.seat(events["node"]), turned[events["kind"]]
    sleeps = np.isin(events["kind"], [KIND[kind] for kind in ("wake", "sleep", "stay", "resume")])
    if sleeps.any():
        state[:] = REST
    else:
        to[events["kind"] == KIND["restart"]] = AWAKE
    mine = (seat >= 0) & (to != 255)
    first, row = np.unique(seat[mine], return_index=True)
    state[first[events["kind"][mine][row] == KIND["sleep"]]] = AWAKE
    film.columns["state"] = state
    film.add("turn", film.at(events["step"][mine]), node=seat[mine].astype("<u4"), state=to[mine])


def _charge(film: Film, nodes: Columns) -> list[float] | None:
    """Levels of charge, and from which frame on; what the log does not say is spent evenly over a node's life."""
    run = film.run
    initial, left = nodes["energy_initial"], nodes["energy_left"]
    share = np.divide(left, initial, out=np.full(left.size, np.nan), where=np.isfinite(initial) & (initial > 0))
    if not np.isfinite(share).any() or np.nanmax(initial) == np.inf:
        return None
    low = np.floor(1000 * float(np.nanmin(share))) / 1000
    span = (1.0 - low) or 1.0
    levels = film.plan.levels - 1

    def level(of: Floats) -> Ints:
        return np.rint(np.nan_to_num((of - low) / span, nan=1.0).clip(0, 1) * levels).astype(np.uint8)

    if not run.events:
        film.columns["charge"] = level(share)
        return [low, 1.0, levels]
    seat = film.seat(run.events["node"])
    active = np.unique(seat[seat >= 0])
    if film.picked.size * film.frames <= CELLS:
        active = np.arange(film.picked.size)
    active = active[evenly(active.size, CELLS // film.frames)]
    others = np.setdiff1d(np.arange(film.picked.size), active)
    if (share[others] < 1.0).any():
        film.notes.append(f"the charge of {active.size:,} nodes is followed; that of the others is as at the end")
    start = level(share)
    start[active] = levels
    spent = _spent(film, nodes, seat, active)
    now = level(1.0 - spent / initial[active, None])
    turned = np.diff(now, axis=1, prepend=np.uint8(levels)) != 0
    frame, row = np.nonzero(turned.T)
    film.columns["charge"] = start
    film.add("drain", frame, node=active[row].astype("<u4"), level=now[row, frame])
    return [low, 1.0, levels]


def _spent(film: Film, nodes: Columns, seat: Ints, active: Ints) -> Floats:
    """(nodes, frames) joules that each of the active nodes has spent by the end of each frame."""
    events = film.run.events
    spent = np.zeros((active.size, film.frames))
    row = np.searchsorted(active, seat).clip(0, max(active.size - 1, 0))
    mine = (seat >= 0) & (events["joules"] != 0.0)
    np.add.at(spent, (row[mine], film.at(events["step"][mine])), events["joules"][mine])
    spent = np.cumsum(spent, axis=1)
    rest = np.maximum(nodes["energy_initial"][active] - nodes["energy_left"][active] - spent[:, -1], 0.0)
    ends = np.full(active.size, max(film.frames - 1, 1), dtype=np.float64)
    died = nodes["died_at"][active] / film.run.dt / film.plan.stride
    ends = np.where(np.isfinite(died), np.clip(died, 1.0, ends), ends)
    return spent + rest[:, None] * np.minimum(np.arange(film.frames) / ends[:, None], 1.0)


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


def _members(film: Film) -> None:
    """Who joins which target's cluster, and by whom one begins anew; who is sent to rest, or dies, leaves it."""
    events, kind = film.run.events, film.run.events["kind"]
    begins = (kind == KIND["announce"]) | (kind == KIND["elect"])
    seat, targets = film.seat(events["node"]), np.array(film.run.targets, dtype=np.int64)
    mine = (begins | (kind == KIND["join"])) & (seat >= 0) & np.isin(events["target"], targets)
    owner = np.searchsorted(targets, events["target"][mine]) % ANEW + ANEW * begins[mine]
    film.add("join", film.at(events["step"][mine]), node=seat[mine].astype("<u4"), target=owner.astype(np.uint8))


def _flights(film: Film) -> None:
    """Who sensed, whose frames went to whom, whose were lost, who broadcast."""
    events, kind = film.run.events, film.run.events["kind"]
    frame, seat, peer = film.at(events["step"]), film.seat(events["node"]), film.seat(events["peer"])
    sensing = (kind == KIND["sense"]) & (seat >= 0)
    senses = np.unique(frame[sensing] << 32 | seat[sensing])
    film.add("sense", senses >> 32, node=(senses & 0xFFFFFFFF).astype("<u4"))
    sent = np.isin(kind, [KIND["send"], KIND["relay"]])
    cast = sent & (events["peer"] < 0) & (seat >= 0)
    film.add("cast", frame[cast], node=seat[cast].astype("<u4"), what=events["what"][cast].astype(np.uint8))
    got, struck = (kind == KIND["receive"]), (kind == KIND["collide"])
    lost = sent & (events["peer"] >= 0) & ~np.isin(events["frame"], events["frame"][got])
    told = (got | lost | struck) & (seat >= 0) & (peer >= 0)
    origin, goal = np.where(lost, seat, peer)[told], np.where(lost, peer, seat)[told]
    words = events["what"][told].astype(np.int64) * 2 + ~got[told]
    _links(film, np.unique(((frame[told] * film.picked.size + origin) * film.picked.size + goal) * 512 + words))


def _links(film: Film, keys: Ints) -> None:
    """Links in the frames' order, each one number: of its frame, from, to, word, and whether what was sent was lost."""
    pairs, word = np.divmod(keys, 512)
    rest, goal = np.divmod(pairs, max(film.picked.size, 1))
    frame, origin = np.divmod(rest, max(film.picked.size, 1))
    kept = _thinned(frame, film.plan.links)
    if not kept.all():
        film.notes.append(f"of links that frames went over at most {film.plan.links} are drawn at a time")
    ends = {name: values[kept].astype("<u4") for name, values in (("origin", origin), ("goal", goal))}
    film.add("link", frame[kept], **ends, what=(word[kept] // 2).astype("u1"), lost=(word[kept] % 2).astype("u1"))


def _thinned(frames: Ints, most: int) -> Bools:
    """Which rows, in the frames' order, to keep so that no frame has more than `most`, spread evenly over each."""
    _, first, counts = np.unique(frames, return_index=True, return_counts=True)
    rank = np.arange(frames.size) - np.repeat(first, counts)
    each = np.repeat(counts, counts)
    few = np.minimum(each, most)
    return (rank + 1) * few // np.maximum(each, 1) > rank * few // np.maximum(each, 1)


def _particles(film: Film) -> None:
    """Where the particles are, in 8 bits of each frame's own box."""
    run, cloud = film.run, film.run.cloud
    at = film.at(cloud["step"])
    shown = np.minimum(at * film.plan.stride, run.last) == cloud["step"]
    heaviest = np.zeros(film.frames)
    np.maximum.at(heaviest, at[shown], cloud["weight"][shown])
    shown &= cloud["weight"] > LEAST_WEIGHT * heaviest[at]
    shown &= np.isfinite(np.sum(run.places(cloud | {"time": cloud["step"]}), axis=0))
    rows = np.flatnonzero(shown)[np.argsort(at[shown], kind="stable")]
    kept = _thinned(at[rows], film.plan.particles)
    if not kept.all():
        film.notes.append(f"at most {film.plan.particles} particles are drawn at a time")
    rows = rows[kept]
    places = run.places(cloud | {"time": cloud["step"] * run.dt})
    x, y = (_boxed(film, i, values[rows], at[rows]) for i, values in enumerate(places))
    film.add("cloud", at[rows], x=x, y=y)


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
