"""Plots of results whose readings name no target: tracks beside targets in the plane, and GOSPA over time.

tracks(axes, path, replicate)      gospa(axes, path, plugins)      as the functions of `plots`
places_of_detections(path, run) -> {step, x, y, clutter}
"""

from __future__ import annotations

from itertools import zip_longest
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes

from wsnsim.analysis import error_bounds, plot_data
from wsnsim.analysis.figure_style import BLACK, BLUE, BOUND, COLOURS, GREY, ORANGE, PALE, SKY, VERMILLION, YELLOW
from wsnsim.analysis.multi_target import followed_runs
from wsnsim.analysis.plot_data import Columns, StateLayout
from wsnsim.base import multi_target
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import counted
from wsnsim.base.multi_target import FollowedRun
from wsnsim.recording import read_table, tables

PLACED: Final = {"range": ("range",), "bearing": ("bearing",), "range_bearing": ("range", "bearing")}
"""Kinds of sensors whose detections have a place in the plane, and what their readings are of it."""
GOLDEN: Final = 0.6180339887498949
"""Multiples of it, without their whole parts, are evenly spread."""
PARTS: Final = (
    ("distance", "GOSPA", BLACK), ("localisation", "localisation", BLUE), ("missed", "missed targets", ORANGE),
    ("false", "false tracks", VERMILLION),
)  # fmt: skip
"""GOSPA and its parts: attribute, label and colour."""
SWAP: Final[dict[str, Any]] = {"marker": "*", "color": YELLOW, "markeredgecolor": BLACK, "markersize": 9, "zorder": 5}


def tracks(axes: Axes, path: str | Path, plan: StateLayout, replicate: int) -> Axes:
    """Draw the tracks of a run in colours, with targets, nodes, detections and clutter, and where identities switch.

    Confirmed tracks have a line, tentative ones dots. Of a range, a detection is drawn in the direction of its target,
    of a bearing in its distance; what a false one does not say is spread evenly.
    """
    plot_data.check_replicate(path, replicate)
    run = next(followed_runs(path, [replicate]))
    if not _is_flat(plan):
        _nodes_and_detections(axes, path, run)
        axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("time [s]" if _is_flat(plan) else plan.label(plan.position[0]))
    axes.set_ylabel(plan.label(plan.position[-1]))
    times = np.arange(run.truth.shape[1]) * run.rule.dt
    for target, places in enumerate(run.truth):
        label = "ground truth" if target == 0 else None
        axes.plot(*_across(plan, times, places), color=BLACK, linewidth=2.2, label=label)
    confirmed = run.tracks.confirmed
    for i, number in enumerate(np.unique(run.tracks.track[confirmed]).tolist()):
        rows = (run.tracks.track == number) & confirmed
        colour = COLOURS[:-1][i % (len(COLOURS) - 1)]
        place = _across(plan, run.tracks.step[rows] * run.rule.dt, run.tracks.position[rows])
        axes.plot(*place, color=colour, linewidth=1.0, marker=".", markersize=2, label=None if i else "tracks")
    if not confirmed.all():
        place = _across(plan, run.tracks.step[~confirmed] * run.rule.dt, run.tracks.position[~confirmed])
        axes.plot(*place, ".", color=GREY, markersize=2, label="tentative tracks")
    if len(switched := run.switches):
        steps, targets = switched[:, 0], switched[:, 1]
        place = _across(plan, steps * run.rule.dt, run.truth[targets, steps])
        label = f"{len(switched)} identity switch{'es' * (len(switched) > 1)}"
        axes.plot(*place, linestyle="none", label=label, **SWAP)
    return axes


def _is_flat(plan: StateLayout) -> bool:
    """Whether the position has one column, which is drawn over time."""
    return len(plan.position) == 1


def _across(plan: StateLayout, times: Any, places: Any) -> tuple[Any, Any]:
    """The values on the two axes of positions (n, P): the plane, or time and position."""
    return (times, places[:, 0]) if _is_flat(plan) else (places[:, 0], places[:, 1])


def _nodes_and_detections(axes: Axes, path: str | Path, run: FollowedRun) -> None:
    nodes = plot_data.nodes_of(path, run.replicate)
    if nodes:
        label = counted(len(nodes["x"]), "node")
        axes.scatter(nodes["x"], nodes["y"], s=6.0, color=GREY, linewidths=0, label=label)
    marks = places_of_detections(path, run)
    if not marks:
        return
    clutter = marks["clutter"]
    axes.plot(marks["x"][clutter], marks["y"][clutter], "x", color=PALE, markersize=3, zorder=0.5, label="clutter")
    axes.plot(marks["x"][~clutter], marks["y"][~clutter], ".", color=SKY, markersize=3, zorder=0.6, label="detections")


def places_of_detections(path: str | Path, run: FollowedRun) -> Columns:
    """Where the detections of a run are drawn: `step`, `x`, `y` and `clutter`, (n,) each.

    Empty if they were not recorded, or if the sensor's readings are neither ranges nor bearings from a common axis.
    """
    scenario, sizes = plot_data.stored_json(path, "scenario/resolved_json"), tables(path)
    sensor = scenario.get("sensor", {})
    sensor = sensor.get("law", sensor) if sensor.get("kind") == "recorded" else sensor
    names, nodes = PLACED.get(sensor.get("kind", ""), ()), plot_data.nodes_of(path, run.replicate)
    if not names or not nodes or "detections" not in sizes or sensor.get("heading") == "own":
        return {}
    held = read_table(path, "detections", ["replicate", "step", "node", "reading", "origin"])
    held = {name: values[held["replicate"] == run.replicate] for name, values in held.items()}
    if not held["step"].size:
        return {}
    told = dict(zip(names, held.pop("reading").reshape(-1, len(names)).T, strict=True))
    step, node, origin = (held[name][:: len(names)].astype(np.int64) for name in ("step", "node", "origin"))
    places = np.column_stack([nodes["x"], nodes["y"]])[np.searchsorted(nodes["node"], node)]
    clutter = origin < 0
    lines = np.zeros_like(places)
    lines[~clutter] = run.truth[origin[~clutter], step[~clutter]] - places[~clutter]
    spread = np.arange(step.size) * GOLDEN % 1.0
    farthest = np.hypot(*lines.T).max(initial=0.0) or float(np.ptp(nodes["x"]))
    distance = told.get("range", np.where(clutter, spread * farthest, np.hypot(*lines.T)))
    angle = told.get("bearing", np.where(clutter, spread * 2.0 * np.pi, np.arctan2(lines[:, 1], lines[:, 0])))
    x, y = (places + distance[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])).T
    return {"step": step, "x": x, "y": y, "clutter": clutter}


def gospa(axes: Axes, path: str | Path, plugins: bool = False) -> tuple[Axes, str]:
    """Draw GOSPA and its parts at each step, root mean square over the runs, with the bound of the localisation part.

    The bound is the trajectory-conditional CRLB with known association: it leaves out clutter, detections of several
    targets, and the targets that no track follows.

    Args:
        axes: matplotlib axes.
        path: a result file.
        plugins: whether plug-ins that the result's scenario names are imported for the bound.

    Returns:
        The axes and their title.
    """
    found = list(followed_runs(path))
    rule = found[0].rule
    each = [multi_target.gospa(run.truth, run.tracks, [run.rule.cutoff]) for run in found]
    times = np.arange(1, 1 + max(parts.distance.shape[1] for parts in each)) * rule.dt
    for part, label, colour in PARTS:
        rows = [getattr(parts, part)[0] for parts in each]
        axes.plot(times, _over_runs(rows), color=colour, linewidth=1.0 + 0.6 * (colour == BLACK), label=label)
    limit = error_bounds.found_bound(path, "in_range", plugins)
    if limit is not None:
        least = np.broadcast_to(limit.each, (len(found), *limit.each.shape[1:]))
        squares = [np.where(run.followed >= 0, one[:, : run.followed.shape[1]], 0.0) ** 2
                   for run, one in zip(found, least, strict=True)]  # fmt: skip
        rows = [np.sqrt(square.sum(axis=0)) for square in squares]
        axes.plot(times, _over_runs(rows), label="CRLB, known association", **BOUND)
    axes.set_ylim(bottom=0.0)
    return axes, f"GOSPA of {counted(len(found), 'run')} (c = {rule.cutoff:.4g}, p = 2, α = 2)"


def _over_runs(rows: list[Floats]) -> Floats:
    """Root mean square over the runs at each step, of those that are that long."""
    whole = np.array(list(zip_longest(*rows, fillvalue=np.nan)))
    return np.asarray(np.sqrt(np.nanmean(whole**2, axis=1)))
