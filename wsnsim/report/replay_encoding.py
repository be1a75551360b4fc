"""The encoding of a replay: animation frames, the nodes that are drawn, and compact columns, as text for a browser.

The text is base64 of a zlib stream. The stream holds the length of a JSON header (4 bytes, little-endian), the header,
and the columns, each aligned to 8 bytes. Rows that belong to some frames only are ordered by frame, and a column holds
their number per frame. A frame shows one step, or, if steps are thinned, the steps since the previous frame.
"""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import dataclass
from math import ceil
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.analysis.plot_data import Columns
from wsnsim.analysis.replicate_tables import ReplicateTables
from wsnsim.base.arrays import Bools, Floats, Ints

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
    shown = [run.places(table) for table in (run.truth or run.guess,) if table]
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
