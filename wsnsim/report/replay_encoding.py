"""The encoding of a replay: animation frames, the nodes that are drawn, and compact columns, as text for a browser.

The text is base64 of a zlib stream. The stream holds the length of a JSON header (4 bytes, little-endian), the header,
and the columns, each aligned to 8 bytes. Rows that belong to some frames only are ordered by frame, and a column holds
their number per frame. A frame shows one step, or, if steps are thinned, the steps since the previous frame.

Targets and clusters: ground truth, estimates, particles, and changes of membership by frame. Changes stand in the order
of the event log, in the columns membership_node, membership_target and membership_change: a node JOINS a target's
cluster; a cluster STARTS with the node as its only member; a node LEAVES every cluster, because it goes to sleep or
fails; or a cluster ENDS, because its track is lost. Without a head, those who compute are the members of that frame.
"""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import dataclass
from math import ceil
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.analysis.plot_data import Columns, ReplicateTables
from wsnsim.analysis.plots import LEAST_WEIGHT
from wsnsim.base.arrays import Bools, Floats, Ints
from wsnsim.base.tables import KIND

MISSING: Final = 65535
"""The quantised coordinate of what has no position."""
MARGIN: Final = 0.04
"""Margin of the drawing as a fraction of its extent."""


class DetailLevel(NamedTuple):
    """How much of a run is encoded.

    Attributes:
        stride: steps per frame.
        nodes: largest number of nodes.
        particles: largest number of particles per frame.
        links: largest number of links per frame.
        levels: levels of residual energy.
    """

    stride: int = 1
    nodes: int = 100_000
    particles: int = 2000
    links: int = 10_000
    levels: int = 255


@dataclass(frozen=True)
class ReplayEncoder:
    """A replay that is being encoded.

    Attributes:
        run: the tables of the run.
        detail: how much is encoded.
        frames: number of animation frames.
        box: left, bottom, right and top of the drawing.
        drawn: ids of the nodes that are drawn, ascending.
        columns: the columns so far.
        notes: what a viewer must know, so far.
        first: number of the first frame; above 0 only in a portion of a replay.
    """

    run: ReplicateTables
    detail: DetailLevel
    frames: int
    box: tuple[float, float, float, float]
    drawn: Ints
    columns: Columns
    notes: list[str]
    first: int = 0

    @classmethod
    def empty(cls, run: ReplicateTables, detail: DetailLevel) -> ReplayEncoder:
        """An encoder without columns."""
        return cls(run, detail, ceil(run.last / detail.stride) + 1, box_of(run), drawn_nodes(run, detail.nodes), {}, [])

    def frame_of(self, steps: Ints) -> Ints:
        """The frames that show the steps, counted from the first one."""
        return -(-steps.astype(np.int64) // self.detail.stride) - self.first

    def shown(self, steps: Ints) -> tuple[Ints, Bools]:
        """The frames that show the steps, and whether each step is the one that is drawn of its frame."""
        frames = self.frame_of(steps)
        drawn: Bools = np.minimum((frames + self.first) * self.detail.stride, self.run.last) == steps
        return frames, drawn & (frames >= 0) & (frames < self.frames)

    def index_of(self, nodes: Ints) -> Ints:
        """The indices of nodes among the drawn ones, -1 for others."""
        if not self.drawn.size:
            return np.full(nodes.size, -1)
        index = np.searchsorted(self.drawn, nodes).clip(0, self.drawn.size - 1)
        return np.where(self.drawn[index] == nodes, index, -1)

    def add(self, name: str, frames: Ints, **columns: np.ndarray) -> None:
        """Add rows that belong to frames; rows before the first and after the last frame are dropped."""
        order = np.argsort(frames, kind="stable")
        order = order[(frames[order] >= 0) & (frames[order] < self.frames)]
        self.columns[f"{name}_count"] = np.bincount(frames[order], minlength=self.frames).astype("<u4")
        self.columns.update({f"{name}_{key}": values[order] for key, values in columns.items()})

    def add_total(self, name: str, frames: Ints) -> None:
        """Add the number of rows that each frame has in the tables, if not all of them are drawn."""
        shown = frames[(frames >= 0) & (frames < self.frames)]
        self.columns[f"{name}_total"] = np.bincount(shown, minlength=self.frames).astype("<u4")

    def text(self, header: dict[str, Any]) -> str:
        """The compressed header and columns."""
        positions, blocks = {}, []
        offset = 0
        for name, values in self.columns.items():
            data = np.ascontiguousarray(values).tobytes()
            positions[name] = [values.dtype.str[1:], offset, int(values.size)]
            blocks.append(data + bytes(-len(data) % 8))
            offset += len(blocks[-1])
        head = json.dumps(header | {"columns": positions}, ensure_ascii=False, allow_nan=False).encode()
        head += b" " * (-(len(head) + 4) % 8)
        packed = zlib.compress(b"".join([len(head).to_bytes(4, "little"), head, *blocks]), 9)
        return base64.b64encode(packed).decode("ascii")


def box_of(run: ReplicateTables) -> tuple[float, float, float, float]:
    """Left, bottom, right and top of nodes and ground truth, with a margin; without ground truth, of the estimates."""
    shown = [run.places(table) for table in (run.truth or run.guess or run.unlabelled,) if table]
    if run.nodes:
        shown.append((np.empty(0), run.nodes["x"]) if run.flat else (run.nodes["x"], run.nodes["y"]))
    limits = [_limits(np.concatenate(each)) for each in zip(*shown, strict=True)] or [(0.0, 1.0), (0.0, 1.0)]
    (left, right), (bottom, top) = limits
    return left, bottom, right, top


def _limits(values: Floats) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    margin = MARGIN * (high - low) or max(1.0, 0.01 * abs(low))
    return low - margin, high + margin


def drawn_nodes(run: ReplicateTables, most: int) -> Ints:
    """The ids of the nodes to draw, ascending: those that took part first, then others, evenly spread."""
    if not run.nodes:
        return np.empty(0, np.int64)
    every = np.unique(run.nodes["node"]).astype(np.int64)
    if every.size <= most:
        return every
    mentioned = [table[name] for table, name in ((run.events, "node"), (run.guess, "head")) if table]
    busy = np.intersect1d(np.concatenate(mentioned) if mentioned else [], every).astype(np.int64)
    busy = busy[evenly(busy.size, most)]
    others = np.setdiff1d(every, busy)
    return np.union1d(busy, others[evenly(others.size, most - busy.size)])


def evenly(count: int, most: int) -> Bools:
    """(count,) which items to keep so that at most `most` remain, evenly spread."""
    kept = np.arange(count + 1) * min(most, count) // max(count, 1)
    return kept[1:] > kept[:-1]


def thinned(frames: Ints, most: int) -> Bools:
    """Which rows, ordered by frame, to keep so that no frame has more than `most`, evenly spread within each frame."""
    _, first, counts = np.unique(frames, return_index=True, return_counts=True)
    rank = np.arange(frames.size) - np.repeat(first, counts)
    each = np.repeat(counts, counts)
    few = np.minimum(each, most)
    return (rank + 1) * few // np.maximum(each, 1) > rank * few // np.maximum(each, 1)


def quantised(values: Floats, low: float, high: float) -> np.ndarray:
    """Coordinates in 16 bits; those outside the drawing are moved to its edge."""
    share = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.where(np.isfinite(share), np.rint(np.nan_to_num(share) * (MISSING - 1)), MISSING).astype("<u2")


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
        encoder.notes.append(f"each estimate is drawn at its step; it was computed up to {delay.max():.3g} s later")


def add_track(encoder: ReplayEncoder, name: str, table: Columns) -> None:
    """The position of each target at each frame, target by target; for estimates also error and cluster head."""
    run, box = encoder.run, encoder.box
    frame, kept = encoder.shown(table["step"])
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
    frame, shown = encoder.shown(cloud["step"])
    encoder.add_total("particle", frame[shown])
    rows, frames = rows[kept], frames[kept]
    positions = run.places(cloud | {"time": cloud["step"] * run.dt})
    x, y = (_boxed(encoder, axis, values[rows], frames) for axis, values in enumerate(positions))
    encoder.add("particle", frames, x=x, y=y)


def _weighty(encoder: ReplayEncoder) -> tuple[Ints, Ints]:
    """The rows of particles with a noticeable weight, ordered by frame, and their frames; a note on the others."""
    run, cloud = encoder.run, encoder.run.cloud
    frame, shown = encoder.shown(cloud["step"])
    heaviest = np.zeros(encoder.frames)
    np.maximum.at(heaviest, frame[shown], cloud["weight"][shown])
    heavy = cloud["weight"] > LEAST_WEIGHT * heaviest[frame.clip(0, encoder.frames - 1)]
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


JOINS, STARTS, LEAVES, ENDS = range(4)
CHANGES: Final = {
    "join": JOINS, "announce": STARTS, "elect": STARTS, "lost": ENDS, "end": ENDS, "merge": ENDS,
    "sleep": LEAVES, "resume": LEAVES, "restart": LEAVES, "crash": LEAVES, "death": LEAVES,
}  # fmt: skip
STATE_CHANGES: Final = ("wake", "stay", "sleep", "resume", "restart", "death", "crash")
"""Events that change a node's state."""
GOING_TO_SLEEP: Final = ("sleep", "resume")
NONE: Final = 255


def coded(kinds: np.ndarray, codes: dict[str, int]) -> np.ndarray:
    """(events,) the code of each kind of event, NONE for kinds without a code."""
    table = np.full(256, NONE, np.uint8)
    for kind, code in codes.items():
        table[KIND[kind]] = code
    return np.asarray(table[kinds])


def shown_from(events: Columns) -> Ints:
    """(events,) the steps from which events show.

    The estimate of a handover's step still belongs to the old cluster, whose nodes go to sleep after the handover, at
    the same time. These nodes are shown asleep from the next step on, unless they are woken again within the step.
    """
    step, kind = events["step"].astype(np.int64), events["kind"]
    handovers = np.flatnonzero(kind == KIND["handover"])
    if not handovers.size:
        return step
    cluster = step << 32 | events["target"].astype(np.int64) + 1
    known, first = np.unique(cluster[handovers], return_index=True)
    at = np.searchsorted(known, cluster).clip(0, known.size - 1)
    after = (known[at] == cluster) & (np.arange(step.size) > handovers[first][at])
    late = after & np.isin(kind, [KIND[name] for name in GOING_TO_SLEEP]) & _is_last_change(events)
    return np.asarray(step + late)


def _is_last_change(events: Columns) -> Bools:
    """(events,) whether an event is the last of its step that changes its node's state."""
    changes = np.flatnonzero(np.isin(events["kind"], [KIND[name] for name in STATE_CHANGES]))[::-1]
    node = events["step"][changes].astype(np.int64) << 32 | events["node"][changes].astype(np.int64) + 1
    result = np.zeros(events["kind"].size, dtype=bool)
    result[changes[np.unique(node, return_index=True)[1]]] = True
    return result


def add_clusters(encoder: ReplayEncoder, joined_before: Ints | None = None) -> Ints:
    """Add the changes of membership, or a note if the event log has none.

    Args:
        encoder: the replay.
        joined_before: indices of the nodes that joined a cluster in earlier portions of the replay.

    Returns:
        The indices of all nodes that joined a cluster so far.
    """
    if encoder.run.headless:
        return _add_participants(encoder)
    events = encoder.run.events
    index, change = encoder.index_of(events["node"]), coded(events["kind"], CHANGES)
    targets = np.array(encoder.run.groups, dtype=np.int64)
    of_target = np.isin(events["target"], targets) & (change != LEAVES) & (change != NONE)
    joined = np.unique(index[of_target & (change != ENDS) & (index >= 0)])
    if joined_before is not None:
        joined = np.union1d(joined, joined_before)
    if not joined.size:
        if encoder.run.guess:
            encoder.notes.append("no cluster members are drawn: the event log has none")
        return joined
    of_target &= (index >= 0) | (change == ENDS)
    rows = np.flatnonzero(of_target | ((change == LEAVES) & np.isin(index, joined)))
    number = np.where(of_target, np.searchsorted(targets, events["target"]), 0)[rows]
    encoder.add(
        "membership",
        encoder.frame_of(shown_from(events)[rows]),
        node=index[rows].clip(0).astype("<u4"),
        target=number.astype("<u2"),
        change=change[rows].astype("u1"),
    )
    return joined


def _add_participants(encoder: ReplayEncoder) -> Ints:
    """Add the nodes that compute in each frame as members; returns their indices."""
    events, index = encoder.run.events, encoder.index_of(encoder.run.events["node"])
    keys = np.column_stack([encoder.frame_of(events["step"]), events["target"], index])
    found = np.unique(keys[(events["kind"] == KIND["compute"]) & (index >= 0)], axis=0)
    ends = np.unique(found[:, :2], axis=0)
    frames, targets = np.concatenate([ends, found[:, :2]]).T
    encoder.add(
        "membership",
        frames,
        node=np.concatenate([np.zeros_like(ends[:, 0]), found[:, 2]]).astype("<u4"),
        target=np.searchsorted(encoder.run.groups, targets).astype("<u2"),
        change=np.repeat([ENDS, JOINS], [len(ends), len(found)]).astype("u1"),
    )
    return np.unique(found[:, 2])
