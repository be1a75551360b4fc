"""Plots of a result: each function draws one plot of a file on a matplotlib Axes and returns the Axes.

    track(axes, path, replicate, target)      states(axes, path, column, replicate, target)      error(axes, path)
    consistency(axes, path)      energy(axes, path)      gospa(axes, path)
    particles(axes, path, step, column, replicate, target)      step(axes, path, step, replicate, target)

Every function raises ResultError for a table that was not recorded, and UsageError for a column, replicate, target or
step that the file does not have. A step without an estimate is a gap.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes

from wsnsim.analysis import error_bounds, plot_data, track_plots
from wsnsim.analysis.consistency import Statistic, step_consistency
from wsnsim.analysis.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    VERMILLION,
    YELLOW,
    quartiles,
    titled,
)
from wsnsim.analysis.multi_target import is_unlabelled
from wsnsim.analysis.plot_data import Columns, StateLayout, bracketed
from wsnsim.analysis.quantities import bound_name, loss_rule
from wsnsim.analysis.result_facts import fault_kinds, position_unit
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import UsageError, counted
from wsnsim.base.tables import CAUSES
from wsnsim.recording import read_table, table_names

OF_SPENT: Final = ORANGE, VERMILLION, SKY, BLUE, GREEN, YELLOW, GREY, PALE, PURPLE, BLACK
OF_LOSSES: Final = "#B0A060", "#705030", "#C08080", "#A0C0A0"
CAUSE_COLOURS: Final = dict(zip(CAUSES, OF_SPENT + OF_LOSSES, strict=True))
DOMINANT: Final = 0.8
"""Share of the energy from which on a cause is not drawn, since the others would be hardly visible (our choice)."""
LOG_FROM: Final = 100.0
"""Ratio of the largest to the smallest error from which on the axis is logarithmic (our choice)."""
CONSISTENCY: Final[tuple[tuple[str, Statistic, str], ...]] = (("NEES", "nees", BLUE), ("NIS", "nis", ORANGE))
"""What the plot of consistency shows: name, statistic, colour."""
LEAST_WEIGHT: Final = 1e-6
"""Particles below this share of the largest weight are not drawn (our choice)."""


def track(axes: Axes, path: str | Path, replicate: int = 0, target: int = 0) -> Axes:
    """Draw the plane with ground truth, estimates, nodes and cluster heads; on a line, the position over time.

    Where readings name no target, all targets and tracks of the run are drawn, see `track_plots.tracks`.
    """
    plot_data.demand(path, "track")
    plan = plot_data.layout(path)
    if is_unlabelled(path):
        return titled(track_plots.tracks(axes, path, plan, replicate), f"tracks of replicate {replicate}")
    truth, guess = plot_data.course(path, plan.position, replicate, target)
    nodes = plot_data.nodes_of(path, replicate)
    if len(plan.position) == 1:
        _over_time(axes, plan, plan.position[0], truth, guess)
        if nodes:
            _nodes_beside(axes, nodes["x"])
    else:
        _in_plane(axes, plan, truth, guess, nodes, plot_data.woken_regions(path, replicate, target))
        if nodes and not np.isnan(nodes["energy_initial"]).all():  # without a network there is no cluster head
            _heads(axes, nodes, guess["head"], "gateway" if plot_data.is_headless(path) else "cluster head")
    return titled(axes, f"track of {_which(replicate, target)}")


def states(axes: Axes, path: str | Path, column: str, replicate: int = 0, target: int = 0) -> Axes:
    """Draw one state column over time, true and estimated, a position with the estimated ±2σ."""
    plan = plot_data.layout(path)
    plan.check(path, column)
    plot_data.demand(path, "states")
    _over_time(axes, plan, column, *plot_data.course(path, (column,), replicate, target))
    return titled(axes, f"{column} of {_which(replicate, target)}")


def error(axes: Axes, path: str | Path, plugins: bool = False) -> Axes:
    """Draw the position error at each step over all runs: RMSE (Jiang 2013, eq. 26), median, quartiles and CRLB.

    `plugins` says whether plug-ins that the result's scenario names are imported for the bound.
    """
    plot_data.demand(path, "error")
    plan = plot_data.layout(path)
    errors, steps, times = plot_data.errors(path)
    runs, targets, _ = errors.shape
    rows = errors.reshape(-1, len(steps))
    of_runs = counted(runs, "run") + (f" × {targets} targets" if targets > 1 else "")
    mean = metrics.per_step_rmse(rows)
    shown = mean
    if len(rows) > 1:
        low, middle, high = quartiles(rows)
        axes.fill_between(times, low, high, color=SKY, alpha=0.4, linewidth=0, label=f"quartiles of {of_runs}")
        axes.plot(times, middle, color=BLUE, linewidth=1.0, label="median", **_marks(middle))
        shown = np.concatenate([mean, middle])
    name = f"error of {of_runs}" if len(rows) == 1 else "RMSE"
    axes.plot(times, mean, color=VERMILLION, linewidth=1.2, label=name, **_marks(mean))
    if (limit := error_bounds.found_bound(path, "in_range", plugins)) is not None:
        bound = limit.rmse[steps - 1]
        faults = fault_kinds(plot_data.stored_json(path, "scenario/resolved_json"))
        name = bound_name("in_range", faults).replace(", ", ",\n", 1)
        axes.plot(times, bound, color=BLACK, linewidth=1.0, linestyle=":", label=name)
        shown = np.concatenate([shown, bound])
    _scaled(axes, shown)
    if len(times) > 1:
        axes.set_xlim(0.0, float(times[-1]))
    label = "position error" + bracketed(plan.units[plan.position[0]])
    return titled(axes, f"position error{_loss_text(path, of_runs)}", label)


def _loss_text(path: str | Path, of_runs: str) -> str:
    """In how many runs a track was lost at any time, how many of them lost it for good, and by which rule."""
    if "runs" not in table_names(path):
        return ""
    runs = read_table(path, "runs")
    ever, at_end = ((runs[name] > 0).sum() for name in ("losses", "lost"))
    rule = loss_rule(runs, position_unit(path))
    return f", {ever} of {of_runs} lost" + f" ({at_end} at the end)" * bool(ever) + (f"\nlost: {rule}" if rule else "")


def consistency(axes: Axes, path: str | Path) -> Axes:
    """Draw NEES and NIS per degree of freedom at each step over all runs: 1 is consistent, above is overconfident.

    If the posterior is Gaussian, the bands are the χ² intervals of a consistent filter; otherwise bootstrap intervals.
    """
    plot_data.demand(path, "consistency")
    shown, averages = [], []
    for name, of, colour in CONSISTENCY:
        found = step_consistency(path, of)
        if not np.isfinite(found.values).any():
            continue
        band = "χ²" if found.gaussian else "bootstrap"
        if np.isfinite(found.low).any():
            axes.fill_between(
                found.times, found.low, found.high, color=colour, alpha=0.2, linewidth=0, label=f"{name}, 95 % {band}"
            )
        axes.plot(found.times, found.values, color=colour, linewidth=1.0, label=name, **_marks(found.values))
        between = f" [{found.average_low:.3g}, {found.average_high:.3g}]" if np.isfinite(found.average_low) else ""
        averages.append(f"{name} {found.average:.3g}{between}")
        shown.append(found.values)
    axes.axhline(1.0, color=BLACK, linewidth=1.0, linestyle=":", label="consistent")
    _scaled(axes, np.concatenate([*shown, [1.0]]))
    return titled(axes, f"consistency, time average:\n{', '.join(averages)}", "per degree of freedom")


def gospa(axes: Axes, path: str | Path, plugins: bool = False) -> Axes:
    """Draw GOSPA and its parts at each step over all runs, where readings name no target; see `track_plots.gospa`."""
    plot_data.demand(path, "gospa")
    axes, title = track_plots.gospa(axes, path, plugins)
    plan = plot_data.layout(path)
    return titled(axes, title, "GOSPA" + bracketed(plan.units[plan.position[0]]))


def energy(axes: Axes, path: str | Path) -> Axes:
    """Draw the energy that the network has spent by each step, stacked by cause with its share; the mean over all runs.

    A cause that dominates is named in the title instead, so that the others can be seen.
    """
    plot_data.demand(path, "energy")
    joules, times, runs = plot_data.spent(path)
    parts = {cause: row for cause, row in zip(CAUSES, joules, strict=True) if row.any()}
    whole = joules[:, -1].sum()
    names = {cause: f"{cause.replace('_', ' ')} {_percent(row[-1] / whole)}" for cause, row in parts.items()}
    title = f"energy spent by the network, mean of {counted(runs, 'run')}"
    largest = max(parts, key=lambda cause: float(parts[cause][-1]))
    if len(parts) > 1 and parts[largest][-1] > DOMINANT * whole:
        title += f"\nnot drawn: {names[largest]} of {whole:.4g} J"
        del parts[largest]
    axes.stackplot(
        times,
        list(parts.values()),
        labels=[names[cause] for cause in parts],
        colors=[CAUSE_COLOURS[cause] for cause in parts],
        linewidth=0,
    )
    axes.set_ylim(bottom=0)
    return titled(axes, title, "energy spent [J]")


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %" if share >= 0.0005 else "< 0.1 %"


def particles(
    axes: Axes,
    path: str | Path,
    step: int | None = None,
    column: str | None = None,
    replicate: int = 0,
    target: int = 0,
) -> Axes:
    """Draw the particles at a step with the ground truth: a cloud in the plane, or the histogram of one column.

    A cloud is drawn if the position has two columns and `column` is None; the area of a dot grows with its weight.
    `step` is by default the last one that has particles.
    """
    plan = plot_data.layout(path)
    if column is not None:
        plan.check(path, column)
    plot_data.demand(path, "particles")
    names = (column,) if column else plan.position
    step = plot_data.last_step_with_particles(path, replicate, target) if step is None else step
    held, truth = plot_data.cloud(path, names, step, replicate, target)
    seen = held["weight"] > LEAST_WEIGHT * held["weight"].max()
    weights, values = held["weight"][seen], [held[name][seen] for name in names]
    label = ("" if seen.all() else f"{weights.size:,} of ") + counted(seen.size, "particle")
    if len(names) == 1:
        _histogram(axes, plan, names[0], values[0], weights, label)
        axes.axvline(truth[names[0]], color=BLACK, linewidth=1.4, label="ground truth")
    else:
        sizes = 4.0 + 40.0 * weights / weights.max()
        across, up = values
        axes.scatter(across, up, s=sizes, color=SKY, linewidths=0, alpha=0.6, label=label)
        axes.plot(*truth.values(), "+", color=BLACK, markersize=12, markeredgewidth=2, label="ground truth")
        _plane(axes, plan)
    return titled(axes, f"particles at step {step} of {_which(replicate, target)}")


def step(axes: Axes, path: str | Path, step: int | None = None, replicate: int = 0, target: int = 0) -> Axes:
    """Draw the plane at a step: nodes, who sensed, the cluster head, ground truth and estimates up to then.

    `step` is by default that of the largest error after the first tenth of the run.
    """
    plot_data.demand(path, "step")
    plan = plot_data.layout(path)
    if len(plan.position) != 2:
        raise UsageError(f"{path}: a step is drawn in the plane, but the position has one column")
    now = plot_data.telling_step(path, replicate, target) if step is None else step
    whole, guess = plot_data.course(path, ("step", *plan.position), replicate, target)
    if now not in whole["step"]:
        raise UsageError(f"{path}: no step {now}; it has {plot_data.number_span(np.unique(whole['step']))}")
    truth, guess = ({name: rows[held["step"] <= now] for name, rows in held.items()} for held in (whole, guess))
    nodes, (across, up) = plot_data.nodes_of(path, replicate), plan.position
    if nodes:
        seeing = np.isin(nodes["node"], plot_data.sensing_nodes(path, now, replicate))
        head = np.isin(nodes["node"], guess["head"][guess["step"] == now])
        marks = (
            (~seeing, ".", GREY, "node"),
            (seeing, "o", BLUE, "sensing node"),
            (head, "s", VERMILLION, "gateway" if plot_data.is_headless(path) else "cluster head"),
        )
        for chosen, marker, colour, name in marks:
            axes.plot(nodes["x"][chosen], nodes["y"][chosen], marker, color=colour, markersize=5, label=name)
    axes.plot(whole[across], whole[up], color=PALE, linewidth=1.0)
    _in_plane(axes, plan, truth, guess, {})
    look: dict[str, Any] = {"markersize": 8, "markeredgewidth": 2, "fillstyle": "none"}
    for held, marker, colour in ((guess, "D", ORANGE), (truth, "+", BLACK)):
        axes.plot(held[across][-1:], held[up][-1:], marker, color=colour, **look)
    return titled(axes, f"step {now} of {_which(replicate, target)}, {truth['time'][-1]:g} s")


def _in_plane(
    axes: Axes, plan: StateLayout, truth: Columns, guess: Columns, nodes: Columns, woken: Columns | None = None
) -> None:
    across, up = plan.position
    if nodes:
        size = 4.0 if len(nodes["x"]) > 100 else 14.0
        label = counted(len(nodes["x"]), "node")
        axes.scatter(nodes["x"], nodes["y"], s=size, color=GREY, linewidths=0, label=label)
    axes.plot(truth[across], truth[up], color=BLACK, linewidth=2.2, label="ground truth")
    axes.plot(truth[across][:1], truth[up][:1], "o", color=BLACK, markersize=5)
    axes.plot(guess[across], guess[up], color=ORANGE, linewidth=1.0, label="estimate", **_marks(guess[across]))
    if woken and len(woken["x"]):
        label = counted(len(woken["x"]), "wake-up region")
        axes.plot(woken["x"], woken["y"], "+", color=GREEN, markersize=5, markeredgewidth=0.9, label=label)
    _plane(axes, plan)


def _plane(axes: Axes, plan: StateLayout) -> None:
    axes.set_xlabel(plan.label(plan.position[0]))
    axes.set_ylabel(plan.label(plan.position[1]))
    axes.set_aspect("equal", adjustable="datalim")
    axes.locator_params(axis="x", nbins=6)


def _heads(axes: Axes, nodes: Columns, heads: np.ndarray, name: str) -> None:
    """Draw the cluster heads, or gateways, in the order in which they led, joined by a line."""
    led = heads[heads >= 0]
    order = led[np.diff(led, prepend=-1) != 0]
    place = {node: row for row, node in enumerate(nodes["node"].tolist())}
    rows = [place[node] for node in order.tolist()]
    label = counted(len(set(rows)), name)
    axes.plot(nodes["x"][rows], nodes["y"][rows], ":s", color=VERMILLION, markersize=4, linewidth=0.8, label=label)


def _nodes_beside(axes: Axes, places: Floats) -> None:
    """Mark the positions of the nodes on a line at the right edge."""
    edge, label = np.ones(len(places)), counted(len(places), "node")
    inward = axes.get_yaxis_transform()
    axes.plot(edge, places, "<", color=BLUE, markersize=6, transform=inward, clip_on=False, label=label)


def _over_time(axes: Axes, plan: StateLayout, column: str, truth: Columns, guess: Columns) -> None:
    claimed = 2.0 * guess[("sd_x", "sd_y")[plan.position.index(column)]] if column in plan.position else np.empty(0)
    if np.isfinite(claimed).any():
        low, high = guess[column] - claimed, guess[column] + claimed
        axes.fill_between(guess["time"], low, high, color=ORANGE, alpha=0.3, linewidth=0, label="estimated ±2σ")
    axes.plot(truth["time"], truth[column], color=BLACK, linewidth=2.2, label="ground truth")
    axes.plot(guess["time"], guess[column], color=ORANGE, linewidth=1.0, label="estimate", **_marks(guess[column]))
    axes.set_xlabel("time [s]")
    axes.set_ylabel(plan.label(column))


def _scaled(axes: Axes, shown: Floats) -> None:
    """Make the axis logarithmic if errors span decades, else start it at zero."""
    positive = shown[shown > 0]
    if positive.size and positive.max() > LOG_FROM * positive.min():
        axes.set_yscale("log")
        axes.set_ylim(bottom=positive.min() / 2)
    else:
        axes.set_ylim(bottom=0)


def _histogram(axes: Axes, plan: StateLayout, column: str, values: Floats, weights: Floats, label: str) -> None:
    low, high = float(values.min()), float(values.max())
    margin = 1e-6 * max(1.0, abs(low), abs(high))  # so that equal particles have a bin
    bins = int(np.clip(2 * np.sqrt(values.size), 10, 60))
    heights, edges = np.histogram(values, np.linspace(low - margin, high + margin, bins + 1), weights=weights)
    heights = heights / (heights.sum() * np.diff(edges))
    axes.stairs(heights, edges, fill=True, color=SKY, label=label)
    axes.set_xlabel(plan.label(column))
    unit = plan.units[column]
    axes.set_ylabel("probability density" + bracketed(f"1/({unit})" if "/" in unit else f"1/{unit}" if unit else ""))


def _marks(values: Floats) -> dict[str, Any]:
    """The style of a dot for each value between two gaps, which a line alone would not show."""
    gap = np.isnan(np.concatenate(([np.nan], values, [np.nan])))
    alone = np.flatnonzero(~gap[1:-1] & gap[:-2] & gap[2:])
    return {"marker": ".", "markersize": 3, "markevery": alone.tolist()} if alone.size else {}


def _which(replicate: int, target: int) -> str:
    return f"replicate {replicate}" + (f", target {target}" if target else "")
