"""What a replay is drawn on: frames, the nodes that are drawn, and columns in few bits, as text for a browser.

    Film.blank(run, plan);  film.add(name, frames, ...);  film.count(name, frames);  film.text(header)
    rounded(values, low, high);  evenly(count, most);  thinned(frames, most)

The text is base64 of a zlib stream: the length of a JSON header (4 bytes, little-endian), the header, and columns, each
from a multiple of 8 bytes on. What happens at some frames only has its rows in the frames' order, and a column of how
many rows each frame has. A frame is a step, or the steps since the frame before where steps are thinned.
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
"""The quantised place of what is nowhere."""


class Plan(NamedTuple):
    """How much is drawn: each `stride`-th step, at most so many nodes, particles and links a frame, charge levels."""

    stride: int = 1
    nodes: int = 100_000
    particles: int = 2000
    links: int = 10_000
    levels: int = 255


@dataclass(frozen=True)
class Film:
    """A run that is being drawn by a plan: its frames, the nodes drawn, and the columns and notes so far."""

    run: ReplicateTables
    plan: Plan
    frames: int
    box: tuple[float, float, float, float]
    picked: Ints
    columns: Columns
    notes: list[str]

    def at(self, steps: Ints) -> Ints:
        """The frames that show the steps."""
        return -(-steps.astype(np.int64) // self.plan.stride)

    def seat(self, nodes: Ints) -> Ints:
        """Where the nodes stand among those drawn; -1 if they are not."""
        spot = np.searchsorted(self.picked, nodes).clip(0, max(self.picked.size - 1, 0))
        return np.where(self.picked[spot] == nodes, spot, -1) if self.picked.size else np.full(nodes.size, -1)

    def add(self, name: str, frames: Ints, **columns: np.ndarray) -> None:
        """Take rows that belong to frames, in the frames' order, up to the last frame."""
        order = np.argsort(frames, kind="stable")
        order = order[frames[order] < self.frames]
        self.columns[f"{name}_count"] = np.bincount(frames[order], minlength=self.frames).astype("<u4")
        self.columns.update({f"{name}_{key}": values[order] for key, values in columns.items()})

    def count(self, name: str, frames: Ints) -> None:
        """Note how many rows each frame truly has, of which fewer are drawn."""
        self.columns[f"{name}_all"] = np.bincount(frames, minlength=self.frames).astype("<u4")

    @classmethod
    def blank(cls, run: ReplicateTables, plan: Plan) -> Film:
        """A film on which nothing is drawn yet."""
        return cls(run, plan, ceil(run.last / plan.stride) + 1, box_of(run), picked_of(run, plan.nodes), {}, [])

    def text(self, header: dict[str, Any]) -> str:
        """The header and the columns, compressed."""
        place, blocks = {}, []
        offset = 0
        for name, values in self.columns.items():
            data = np.ascontiguousarray(values).tobytes()
            place[name] = [values.dtype.str[1:], offset, int(values.size)]
            blocks.append(data + bytes(-len(data) % 8))
            offset += len(blocks[-1])
        head = json.dumps(header | {"columns": place}, ensure_ascii=False, allow_nan=False).encode()
        head += b" " * (-(len(head) + 4) % 8)
        packed = zlib.compress(b"".join([len(head).to_bytes(4, "little"), head, *blocks]), 9)
        return base64.b64encode(packed).decode("ascii")


def box_of(run: ReplicateTables) -> tuple[float, float, float, float]:
    """Left, bottom, right and top of the picture: nodes and true ways with a margin; without a truth, the estimates."""
    shown = [run.places(table) for table in (run.truth or run.guess,) if table]
    if run.nodes:
        shown.append((np.empty(0), run.nodes["x"]) if run.flat else (run.nodes["x"], run.nodes["y"]))
    limits = [_limits(np.concatenate(each)) for each in zip(*shown, strict=True)] or [(0.0, 1.0), (0.0, 1.0)]
    (left, right), (bottom, top) = limits
    return left, bottom, right, top


def _limits(values: Floats) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    margin = 0.04 * (high - low) or max(1.0, 0.01 * abs(low))
    return low - margin, high + margin


def picked_of(run: ReplicateTables, most: int) -> Ints:
    """The nodes that are drawn, in order: those that took part, then others evenly."""
    if not run.nodes:
        return np.empty(0, np.int64)
    every = np.unique(run.nodes["node"]).astype(np.int64)
    if every.size <= most:
        return every
    said = [table[name] for table, name in ((run.events, "node"), (run.guess, "head")) if table]
    busy = np.intersect1d(np.concatenate(said) if said else [], every).astype(np.int64)
    busy = busy[evenly(busy.size, most)]
    others = np.setdiff1d(every, busy)
    return np.union1d(busy, others[evenly(others.size, most - busy.size)])


def evenly(count: int, most: int) -> Bools:
    """(count,) which of them to keep so that `most` remain, evenly spread."""
    kept = np.arange(count + 1) * min(most, count) // max(count, 1)
    return kept[1:] > kept[:-1]


def thinned(frames: Ints, most: int) -> Bools:
    """Which rows, in the frames' order, to keep so that no frame has more than `most`, spread evenly over each."""
    _, first, counts = np.unique(frames, return_index=True, return_counts=True)
    rank = np.arange(frames.size) - np.repeat(first, counts)
    each = np.repeat(counts, counts)
    few = np.minimum(each, most)
    return (rank + 1) * few // np.maximum(each, 1) > rank * few // np.maximum(each, 1)


def rounded(values: Floats, low: float, high: float) -> np.ndarray:
    """A coordinate in 16 bits; what lies beyond the picture stands at its edge."""
    share = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.where(np.isfinite(share), np.rint(np.nan_to_num(share) * (MISSING - 1)), MISSING).astype("<u2")
