"""Figures 2 to 9 of Jiang, Song, Lin (2013), ours.

figure_N(figure, data) puts axes on a figure and draws; maps show replicate 0
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from wsnsim.analysis.figure_style import BOUND, COLOURS, PUBLISHED, band, rmse_band, with_bands
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.papers.jiang2013 import ENERGY, RMSE, STEP_ENERGY
from wsnsim.papers.jiang2013.experiments import ITERATIONS, LITERAL, PARTICLES, READINGS, cell
from wsnsim.papers.jiang2013.measures import leveled
from wsnsim.papers.measures import Data, measured

MAIN: Final = "pso_mhpf"
COLOUR: Final = dict(zip(LITERAL, COLOURS, strict=False))
REPAIRED: Final = {
    "pso_mhpf, all readings": ("PSO-MHPF, all readings", COLOURS[0]),
    "ipf, noise x100": ("IPF, noise ×100", COLOURS[1]),
    "ppf, noise x100": ("PPF, noise ×100", COLOURS[2]),
    "ekf": ("EKF", COLOURS[3]),
}
BANDED: Final = ("pso_mhpf, all readings", "ppf, noise x100")
"""Of the repaired, those with a band: one run that is far off widens the others' over all that is drawn."""
FIELD: Final = 205.0
"""m: from the middle of a map to its edges."""
GREY: Final = "#B0B0B0"


def figure_2(figure: Figure, data: Data) -> None:
    """The first cluster: who senses within the head's reach."""
    axes = figure.subplots()
    nodes, truth = _of_first(data, "nodes"), _of_first(data, "truth")
    head = int(_of_first(data, "clusters")["head"].iloc[0])
    target = truth[["px", "py"]].to_numpy()[0]
    places = nodes[["x", "y"]].to_numpy()
    members = _members(data, places, target, head)
    others = np.setdiff1d(np.arange(len(places)), [*members, head])
    axes.plot(*places[others].T, "o", color=GREY, markersize=3, linestyle="", label="nodes asleep")
    axes.plot(*places[members].T, "P", color=COLOURS[0], markersize=6, linestyle="", label=f"{len(members)} members")
    axes.plot(*places[head], "s", color=COLOURS[1], markersize=7, linestyle="", label="head")
    axes.plot(*target, "*", color=COLOURS[6], markersize=11, linestyle="", label="target")
    sensing, radio = _reaches(data)
    axes.add_patch(Circle(tuple(target), sensing, fill=False, linestyle=":", label=f"sensing, {sensing:g} m"))
    axes.add_patch(
        Circle(tuple(places[head]), radio, fill=False, color=COLOURS[1], label=f"the head's radio, {radio:g} m")
    )
    _map(axes)
    _below(figure, axes, 3)


def figure_3(figure: Figure, data: Data) -> None:
    """Error against iterations, a curve a number of particles; own readings (the text), and all of the cluster's."""
    panels = figure.subplots(1, 2, sharey=True)
    words = {"own": "own readings, as the text", "all": "all readings of the cluster"}
    runs = 0
    for axes, readings in zip(panels, READINGS, strict=True):
        for colour, particles in zip(COLOURS, PARTICLES, strict=False):
            found = [measured(data, cell(readings, particles, count), "rmse") for count in ITERATIONS]
            value, low, high, numbers, _ = (np.array(column) for column in zip(*found, strict=True))
            axes.fill_between(ITERATIONS, low, high, color=colour, alpha=0.12, linewidth=0)
            axes.plot(ITERATIONS, value, "o-", color=colour, markersize=4, linewidth=1.2, label=f"{particles}")
            runs = int(numbers.max())
        bound = data.bound(cell(readings, 400, 2), "unconditional").time_mean
        axes.axhline(bound, **BOUND, label="bound, all readings")
        axes.set_title(words[readings], loc="left")
        axes.set_yscale("log")
        axes.set_xscale("log", base=2)
        axes.set_xticks(ITERATIONS, [str(count) for count in ITERATIONS])
        axes.minorticks_off()
        axes.set_yticks([0.2, 0.5, 1, 2, 5, 10], ["0.2", "0.5", "1", "2", "5", "10"])
        axes.set_xlabel("iterations a step")
    panels[0].set_ylabel(f"RMSE over the first cluster [m], {runs} runs and 95 %")
    _below(figure, panels[0], 6, title="particles")


def figure_4(figure: Figure, data: Data) -> None:
    """Who led, in order, and whom they led."""
    axes = figure.subplots()
    nodes, clusters = _of_first(data, "nodes"), _of_first(data, "clusters")
    places = nodes[["x", "y"]].to_numpy()
    axes.plot(*places.T, "o", color=GREY, markersize=3, linestyle="", label="nodes")
    everybody = sorted({node for row in clusters.itertuples() for node in _members_of(data, places, row)})
    axes.plot(*places[everybody].T, "P", color=COLOURS[0], markersize=5, linestyle="", label="members of a cluster")
    _heads(axes, places, clusters, numbered=True)
    _map(axes)
    _below(figure, axes, 3)


def figure_5(figure: Figure, data: Data) -> None:
    """Who led, and where the target went."""
    axes = figure.subplots()
    nodes, clusters, truth = (_of_first(data, table) for table in ("nodes", "clusters", "truth"))
    axes.plot(truth["px"], truth["py"], "--", color=COLOURS[6], linewidth=1.6, label="target")
    axes.plot(truth["px"].iloc[0], truth["py"].iloc[0], "*", color=COLOURS[6], markersize=10, linestyle="",
              label="its start")  # fmt: skip
    _heads(axes, nodes[["x", "y"]].to_numpy(), clusters, numbered=False)
    _map(axes)
    _below(figure, axes, 3)


def figure_6(figure: Figure, data: Data) -> None:
    """What the network spends in a step, and the level of each cluster."""
    axes = figure.subplots()
    steps = leveled(data, MAIN)
    steps = steps[steps["replicate"] == 0]
    axes.plot(steps["time"], steps["joules"], color=COLOURS[5], linewidth=0.6, label="a step, handovers included")
    for number, (_, rows) in enumerate(steps.groupby("cluster")):
        told = "level of a cluster (its median step)" if number == 0 else None
        axes.plot(rows["time"], rows["level"], color=COLOURS[1], linewidth=2.4, label=told)
    for joules, told in zip(STEP_ENERGY, ("published least and largest level", None), strict=True):
        axes.axhline(joules, **PUBLISHED, label=told)
    axes.set_yscale("log")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("energy of the network in a step of 40 ms [J]")
    axes.set_title(f"one run, {steps['cluster'].nunique()} clusters (published: 16)", loc="left")
    axes.set_xlim(0.0, float(steps["time"].max()))
    _below(figure, axes, 3)


def figure_7(figure: Figure, data: Data) -> None:
    """The target's way and the estimates, literal and repaired."""
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    _tracks(left, data, {kind: (word, COLOUR[kind]) for kind, word in LITERAL.items()}, "literal")
    _tracks(right, data, REPAIRED, "repaired, and EKF")
    right.set_ylabel("")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=2, frameon=False)
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower right", ncols=2, frameon=False)


def figure_8(figure: Figure, data: Data) -> None:
    """What the network has spent, against time."""
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    for kind, word in LITERAL.items():
        times, rows = _spent(data, kind)
        band(left, times, rows, word, COLOUR[kind])
        left.plot(times[-1], ENERGY[kind], "D", color=COLOUR[kind], markersize=6, markeredgecolor="black",
                  clip_on=False, zorder=5)  # fmt: skip
    left.plot([], [], "D", color="white", markeredgecolor="black", label="published, at the end")
    left.set_xlabel("time [s]")
    left.set_ylabel("energy spent [J]")
    left.set_xlim(0.0, float(times[-1]))
    left.set_ylim(bottom=0.0)
    left.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False, columnspacing=1.0)
    _by_cause(right, data)


def figure_9(figure: Figure, data: Data) -> None:
    """RMSE over runs at each step (eq. 26): literal with what was published, repaired with the bounds."""
    top, bottom = figure.subplots(2, 1, sharex=True)
    for kind, word in LITERAL.items():
        _rmse(top, data, kind, word, COLOUR[kind], banded=True)
        top.axhline(RMSE[kind], color=COLOUR[kind], linestyle="--", linewidth=1.0)
    top.plot([], [], **PUBLISHED, label="published mean, in the same colour")
    for name, (word, colour) in REPAIRED.items():
        _rmse(bottom, data, name, word, colour, name in BANDED)
    runs = len(data.errors(MAIN))
    top.set_title(f"literal, RMSE of {with_bands(runs)}", loc="left")
    bottom.set_title(f"repaired, and EKF, RMSE of {with_bands(runs, 'PSO-MHPF and PPF')}", loc="left")
    for axes in (top, bottom):
        bound, along = (data.bound(MAIN, kind).rmse for kind in ("unconditional", "per_trajectory"))
        axes.plot(_times(data, len(bound)), bound, **BOUND, label="bound, all readings")
        axes.plot(_times(data, len(along)), along, **{**BOUND, "linestyle": "-"}, label="bound along each truth")
        axes.set_yscale("log")
        axes.set_ylabel("RMSE [m]")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    bottom.set_xlabel("time [s]")
    bottom.set_xlim(0.0, float(_times(data, len(bound))[-1]))


def _of_first(data: Data, table: str, variant: str = MAIN) -> pd.DataFrame:
    """The rows of replicate 0."""
    frame = data.of(variant, table)
    return frame[frame["replicate"] == 0]


def _reaches(data: Data) -> tuple[float, float]:
    """How far a node senses, and how far it is heard (m)."""
    scenario = data.scenario(MAIN)
    return float(scenario["sensor"]["reach"]), float(scenario["link"]["reach"])


def _members(data: Data, places: Floats, target: Floats, head: int) -> list[int]:
    """Who senses the target within the head's reach when a cluster forms, without the head."""
    sensing, radio = _reaches(data)
    near = np.hypot(*(places - target).T) <= sensing
    heard = np.hypot(*(places - places[head]).T) <= radio
    return [int(node) for node in np.flatnonzero(near & heard) if node != head]


def _members_of(data: Data, places: Floats, cluster: Any) -> list[int]:
    """The members of a row of the table `clusters`, where the target was when it formed."""
    truth = _of_first(data, "truth")
    step = int((truth["time"] - cluster.formed).abs().to_numpy().argmin())
    return _members(data, places, truth[["px", "py"]].to_numpy()[step], int(cluster.head))


def _heads(axes: Axes, places: Floats, clusters: pd.DataFrame, numbered: bool) -> None:
    """The heads in the order in which they led."""
    path = places[clusters["head"].to_numpy().astype(int)]
    axes.plot(*path.T, "s-", color=COLOURS[1], markersize=6, linewidth=1.3, label=f"heads of {len(path)} clusters")
    if numbered:
        for number, place in enumerate(path, start=1):
            axes.annotate(str(number), tuple(place), xytext=(5, 5), textcoords="offset points", fontsize=8, zorder=6,
                          path_effects=[withStroke(linewidth=2.0, foreground="white")])  # fmt: skip


def _map(axes: Axes) -> None:
    """Axes in metres over the whole field."""
    axes.set_xlim(-FIELD, FIELD)
    axes.set_ylim(-FIELD, FIELD)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def _below(figure: Figure, axes: Axes, columns: int, title: str | None = None) -> None:
    """The legend beneath the axes."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, title=title)


def _tracks(axes: Axes, data: Data, variants: dict[str, tuple[str, str]], title: str) -> None:
    truth = _of_first(data, "truth")
    axes.plot(truth["px"], truth["py"], color=COLOURS[6], linewidth=3.0, alpha=0.35, label="target")
    for name, (word, colour) in variants.items():
        guess = _of_first(data, "estimates", name)
        axes.plot(guess["px"], guess["py"], color=colour, linewidth=1.0, label=word)
    _map(axes)
    axes.set_title(f"{title}, one run", loc="left")


def _spent(data: Data, variant: str) -> tuple[Floats, Floats]:
    """(times, (runs, times)) what the network has spent by then (J)."""
    table = data.of(variant, "energy_steps").pivot_table("joules", "replicate", "time", "sum", fill_value=0.0)
    return table.columns.to_numpy(dtype=np.float64), np.cumsum(table.to_numpy(dtype=np.float64), axis=1)


def _by_cause(axes: Axes, data: Data) -> None:
    """What the energy went into, a bar a variant, means over runs."""
    names = [*LITERAL, *REPAIRED]
    words = {**LITERAL, **{name: word for name, (word, _) in REPAIRED.items()}}
    frames = {name: data.of(name, "energy_steps") for name in names}
    causes = sorted({str(cause) for frame in frames.values() for cause in frame["cause"].unique()})
    left = np.zeros(len(names))
    for colour, cause in zip(COLOURS, causes, strict=False):
        joules = np.array([_mean_of_cause(frame, cause) for frame in frames.values()])
        axes.barh(range(len(names)), joules, left=left, color=colour, label=cause.replace("_", " "), height=0.7)
        left += joules
    axes.set_yticks(range(len(names)), [words[name] for name in names])
    axes.invert_yaxis()
    axes.grid(False, axis="y")
    axes.set_xlabel("energy spent [J], mean of the runs")
    axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=4, frameon=False, columnspacing=1.0)


def _mean_of_cause(frame: pd.DataFrame, cause: str) -> float:
    return float(frame.loc[frame["cause"] == cause, "joules"].sum() / frame["replicate"].nunique())


def _rmse(axes: Axes, data: Data, variant: str, word: str, colour: str, banded: bool) -> None:
    rows = data.errors(variant)
    label = f"{word}, mean {metrics.per_step_rmse(rows).mean():.2f} m"
    rmse_band(axes, _times(data, rows.shape[1]), rows, label, colour, 1.1, banded)


def _times(data: Data, steps: int) -> Floats:
    """(steps,) when the steps 1, 2, ... are."""
    return np.arange(1, steps + 1, dtype=np.float64) * float(data.scenario(MAIN)["step"])
