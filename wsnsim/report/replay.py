"""The replay of a run in a browser: who is where at each step, quantised and compressed to text.

    encode(path, replicate, room)     a whole replay
    portions = ReplayPortions(start)  one in portions, for a run that is still computing
    portions.head()                   as text: the nodes, the ground truth and the number of all frames
    portions.add(last, ...)           as text: the frames up to step `last` that were not sent before

`replay_encoding` defines the format, which static/replay_data.js reads, and, with `replay_nodes` and `replay_tracks`,
its content; static/live_data.js puts portions together. A portion also takes the events of the steps beside it: a node
that goes to sleep after a handover is shown asleep one step later, and a frame sent in one step may arrive in the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from wsnsim.analysis.plot_data import Columns, ReplicateTables, StateLayout, read_replicate
from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.rows import RunStart
from wsnsim.base.setups import NetworkSetup, RadioSetup, TrackingSetup
from wsnsim.report.replay_encoding import (
    MISSING,
    DetailLevel,
    ReplayEncoder,
    add_clusters,
    add_particles,
    add_track,
    add_tracks,
    quantised,
)
from wsnsim.report.replay_nodes import StateHistory, add_nodes, add_places, add_traffic
from wsnsim.report.replay_tracks import add_unlabelled, marks_of

MAX_FRAMES: Final = 20_000
"""Frames above which steps are thinned, whatever the room (our choice)."""
TRAJECTORY, TRAIL = 1000, 60
"""Frames of the ground-truth trajectory drawn before and after the current one; frames drawn in bold (our choice)."""
MIN_ROOM: Final = 300
"""Characters that the shortest replay takes."""
DETAILS: Final = (
    DetailLevel(),
    DetailLevel(particles=400, links=500),
    DetailLevel(1, 50_000, 200, 200, 127),
    DetailLevel(1, 50_000, 100, 100, 63),
    DetailLevel(2, 20_000, 100, 100, 63),
    DetailLevel(5, 20_000, 50, 50, 31),
    DetailLevel(10, 10_000, 50, 50, 31),
    DetailLevel(50, 5_000, 0, 30, 15),
    DetailLevel(200, 2_000, 0, 0, 7),
)
"""From full detail to little: the first whose text fits is used (our choice)."""


@dataclass(frozen=True)
class Replay:
    """A replay as text, '' if there is none, and notes on what is thinned or was not recorded."""

    text: str
    notes: tuple[str, ...]


def encode(path: str | Path, replicate: int, room: int) -> Replay:
    """The replay of a run, in at most `room` characters.

    Raises:
        UsageError: the result has no such replicate.
        ResultError: the result cannot be read.
    """
    run = read_replicate(path, replicate)
    missing, marks = run.missing(), marks_of(path, replicate)
    if not (run.truth or run.guess or run.unlabelled or (run.nodes and run.events)):
        return Replay("", ("There is nothing to replay.", *_sentences(missing)))
    for detail in DETAILS if room >= MIN_ROOM else ():
        stride = max(detail.stride, -(-run.last // MAX_FRAMES))
        header, encoder = _encoded(run, detail._replace(stride=stride), marks)
        notes = _sentences([*encoder.notes, *missing])
        text = encoder.text(header)
        if len(text) <= room:
            return Replay(text, notes)
    return Replay("", (f"The replay was left out: even thinned, it takes more than {max(room, 0):,} characters.",))


def _sentences(notes: list[str]) -> tuple[str, ...]:
    return tuple(f"{note[0].upper()}{note[1:]}." for note in notes)


def _encoded(
    run: ReplicateTables, detail: DetailLevel, marks: tuple[Columns, Columns]
) -> tuple[dict[str, Any], ReplayEncoder]:
    """The header and the columns of a run at one level of detail."""
    encoder = ReplayEncoder.empty(run, detail)
    charge = add_nodes(encoder) if run.nodes else None
    add_tracks(encoder)
    add_unlabelled(encoder, *marks)
    if run.events and run.nodes:
        add_clusters(encoder)
        add_traffic(encoder)
    if run.cloud:
        add_particles(encoder)
    _add_notes(encoder)
    return _header(encoder, run.last, charge), encoder


def _header(encoder: ReplayEncoder, last: int, charge: list[float] | None) -> dict[str, Any]:
    """What a viewer knows before the columns. `last`: the last step; `charge`: as `add_nodes` returns it."""
    run = encoder.run
    return {
        "last": last, "stride": encoder.detail.stride, "frames": encoder.frames, "targets": run.targets,
        "groups": None if run.unlabelled is None else len(run.groups),
        "box": encoder.box, "dt": run.dt if np.isfinite(run.dt) else None, "flat": run.flat, "axes": run.axes,
        "headless": run.headless,
        "messages": run.words, "nodes": encoder.drawn.size, "charge": charge, "trajectory": TRAJECTORY, "trail": TRAIL,
    }  # fmt: skip


def _add_notes(encoder: ReplayEncoder) -> None:
    """Notes on thinned steps, on how much of a trajectory is drawn, and on rounding."""
    run, stride = encoder.run, encoder.detail.stride
    if stride > 1:
        note = f"one step in {stride:,} of {run.last:,} is drawn"
        if run.events:
            note += ", together with what happened since the previous one"
        encoder.notes.insert(0, note)
    if (run.truth or run.guess) and encoder.frames > TRAIL:
        frames = "drawn steps" if stride > 1 else "steps"
        note = f"trajectories are drawn in bold for the last {TRAIL} {frames}"
        if encoder.frames > TRAJECTORY:
            note += f"; the ground truth is drawn for {TRAJECTORY:,} before and after"
        encoder.notes.append(note)
    side = max(encoder.box[2] - encoder.box[0], encoder.box[3] - encoder.box[1])
    encoder.notes.append(f"positions are rounded to {side / (MISSING - 1):.1g} of the axes' unit")


LEVELS: Final = 255
"""Levels of residual energy."""
SMALLEST_SPAN: Final = 0.001
"""The range of residual energy that the levels span at first, as a fraction; it doubles as often as needed."""


class ReplayPortions:
    """Encodes the replay of one run, portion by portion.

    Attributes:
        known: number of frames encoded so far.
        position: the state columns of the position; none without a target.
    """

    def __init__(self, start: RunStart) -> None:
        setup = start.setup
        self._run = run = _tables_at_start(start)
        self.position = run.layout.position if run.layout else ()
        stride = max(1, -(-setup.steps // MAX_FRAMES))
        self._last = run.last if run.truth else setup.steps
        detail = DetailLevel(stride, particles=400, levels=LEVELS)
        self._whole = replace(ReplayEncoder.empty(run, detail), frames=-(-self._last // stride) + 1)
        self._battery = np.inf  # the levels of batteries that are not alike are shown at the end
        if isinstance(setup, RadioSetup) and setup.plain_batteries:
            self._battery = float(setup.energy.battery)
        self._span = SMALLEST_SPAN
        self._levels = np.full(self._whole.drawn.size, LEVELS, np.uint8)
        self._states = StateHistory(self._whole.drawn.size)
        self._joined: Ints = np.empty(0, np.int64)
        self.known = 0

    @property
    def stride(self) -> int:
        """Steps per frame."""
        return self._whole.detail.stride

    def head(self) -> str:
        """The head of the replay as text."""
        encoder, run = replace(self._whole, columns={}), self._run
        if run.nodes:
            x, y = run.nodes["x"][encoder.drawn], run.nodes["y"][encoder.drawn]
            add_places(encoder, encoder.drawn, *((np.full(x.size, encoder.box[2]), x) if run.flat else (x, y)))
            encoder.columns["state"] = self._states.initial
            if self._scale():
                encoder.columns["charge"] = self._levels
        if run.truth:
            add_track(encoder, "truth", run.truth)
        return encoder.text(_header(encoder, self._last, self._scale()))

    def add(self, last: int, residual: Floats | None, spent: Sequence[tuple[float, float]], **tables: Any) -> str:
        """The frames up to that of step `last`, as text. There may be none, but estimates of earlier steps.

        Args:
            last: the last step.
            residual: (N,) residual energies in J at its end, None without a network.
            spent: (time in s, energy in J that the network has spent until then) of each look at the run.
            tables: what happened since the last portion, as in `ReplicateTables`: `events` of these steps, of the step
                before and of the step after; `guess`: estimates of any step; `cloud` of these steps; `words` so far.
        """
        stride = self._whole.detail.stride
        until = min(self._whole.frames, (last // stride if last < self._last else self._whole.frames - 1) + 1)
        count = max(until - self.known, 0)
        run = replace(self._run, **tables)
        encoder = replace(self._whole, run=run, columns={}, first=self.known, frames=count)
        header: dict[str, Any] = {"first": self.known, "frames": count, "messages": run.words, "spent": spent}
        if run.guess:
            self._add_estimates(encoder)
        if count and run.events and run.nodes:
            if self._states.add_changes(encoder):
                encoder.columns["state"] = self._states.initial
            if run.unlabelled is None:  # nobody knows in advance how many groups there will be
                self._joined = add_clusters(encoder, self._joined)
            add_traffic(encoder)
        if count and run.cloud:
            add_particles(encoder)
        if count and residual is not None and np.isfinite(self._battery) and self._battery > 0:
            self._add_charge(encoder, residual)
        for name in [name for name in encoder.columns if name.endswith("_total")]:
            del encoder.columns[name]
        self.known += count
        return encoder.text(header | {"charge": self._scale()})

    def _add_estimates(self, encoder: ReplayEncoder) -> None:
        """Estimates with their place in the columns of the whole replay: targets times frames."""
        run, stride, box = encoder.run, encoder.detail.stride, encoder.box
        frame = -(-run.guess["step"] // stride)
        kept = np.minimum(frame * stride, self._last) == run.guess["step"]
        target = np.searchsorted(self._run.targets, run.guess["target"])
        x, y = (np.where(np.isfinite(values), values, np.nan)[kept] for values in run.places(run.guess))
        encoder.columns["place"] = (target * self._whole.frames + frame)[kept].astype("<u4")
        encoder.columns["estimate_x"] = quantised(np.where(np.isnan(y), np.nan, x), box[0], box[2])
        encoder.columns["estimate_y"] = quantised(y, box[1], box[3])
        encoder.columns["error"] = run.guess["error"][kept].astype("<f4")
        head = run.guess["head"][kept]
        encoder.columns["head"] = np.where(head < 0, -1, encoder.index_of(head)).astype("<i4")

    def _add_charge(self, encoder: ReplayEncoder, residual: Floats) -> None:
        """The nodes whose level of residual energy has changed, in the last frame of the portion."""
        share = residual[encoder.drawn] / self._battery
        levels = self._levels.astype(np.float64)
        while 1.0 - float(share.min(initial=1.0)) > self._span and self._span < 1.0:
            levels = LEVELS - (LEVELS - levels) * self._span / min(1.0, 2.0 * self._span)
            self._span = min(1.0, 2.0 * self._span)
        before = np.rint(levels).astype(np.uint8)
        self._levels = np.rint(np.clip(1.0 - (1.0 - share) / self._span, 0.0, 1.0) * LEVELS).astype(np.uint8)
        rows = np.flatnonzero(self._levels != before)
        frames = np.full(rows.size, encoder.frames - 1)
        encoder.add("charge_change", frames, node=rows.astype("<u4"), level=self._levels[rows])

    def _scale(self) -> list[float] | None:
        """The least and the greatest residual energy of the levels as fractions, and the number of levels."""
        return [1.0 - self._span, 1.0, LEVELS] if np.isfinite(self._battery) and self._battery > 0 else None


def _tables_at_start(start: RunStart) -> ReplicateTables:
    """The tables as far as they are known when a run begins: nodes and ground truth."""
    setup, size = start.setup, len(start.positions)
    unknown = np.full(size, np.nan)
    battery = float(setup.energy.battery) if isinstance(setup, RadioSetup) else np.nan
    nodes = {} if not size else {
        "node": np.arange(size), "x": start.positions[:, 0], "y": start.positions[:, 1],
        "energy_initial": np.full(size, battery), "energy_left": unknown, "died_at": unknown,
    }  # fmt: skip
    unlabelled: Columns | None = {} if isinstance(setup, TrackingSetup) and setup.unlabelled else None
    layout, truth = None, {}
    if isinstance(setup, TrackingSetup):
        motion = setup.motions[0]
        units = dict(zip(motion.columns, motion.units, strict=True))
        layout = StateLayout(units, tuple(motion.columns[i] for i in motion.position))
        truth = _truth(start, layout.position)
    headless = isinstance(setup, NetworkSetup) and setup.headless
    return ReplicateTables(setup.dt, layout, (), frozenset(), truth, {}, nodes, {}, {}, unlabelled, headless)


def _truth(start: RunStart, position: tuple[str, ...]) -> Columns:
    """The ground truth of all targets: target, step, time and position."""
    setup, steps = start.setup, np.arange(start.setup.steps + 1)
    assert isinstance(setup, TrackingSetup)
    columns = setup.motions[0].columns
    count = len(start.truths)
    return {
        "target": np.repeat(np.arange(count), steps.size),
        "step": np.tile(steps, count),
        "time": np.tile(steps * setup.dt, count),
        **{name: np.concatenate([truth[: steps.size, columns.index(name)] for truth in start.truths])
           for name in position},
    }  # fmt: skip
