"""Measures of figures 6 and 8 of Jiang, Song, Lin (2013), and its figures 2 to 9, whose maps show replicate 0.

Measures: the number and level of clusters, the energy of steps.
They need the tables `clusters` and `energy_steps`. The level of a cluster is the median energy of the network in a
step, over the steps between the one in which it formed and the one in which it hands over [our choice].
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from wsnsim.papers.toolkit import COLOURS, Data, Floats, band, measured, metrics, plotting, runs_text

NEAR: Final = 0.01
"""Relative difference from its cluster's level up to which a step is on it [our choice]."""
ROUNDING: Final = 1e-6
"""Seconds subtracted from formation times, as a cluster acts at the step at whose time it forms."""


def clusters(data: Data, variant: str) -> pd.Series:
    """The number of clusters."""
    return data.of(variant, "clusters").groupby("replicate").size()


def least_level(data: Data, variant: str) -> pd.Series:
    """The lowest level of a cluster (J)."""
    return _levels(data, variant).groupby("replicate").min()


def largest_level(data: Data, variant: str) -> pd.Series:
    """The highest level of a cluster (J)."""
    return _levels(data, variant).groupby("replicate").max()


def on_level(data: Data, variant: str) -> pd.Series:
    """The fraction of all steps, handovers included, that are on the level of their cluster."""
    steps = leveled(data, variant)
    near = (steps["joules"] - steps["level"]).abs() <= NEAR * steps["level"]
    return near.groupby(steps["replicate"]).mean()


def above_level(data: Data, variant: str) -> pd.Series:
    """The energy (J) spent above the clusters' levels, over the steps that are above them."""
    steps = leveled(data, variant)
    above = steps["joules"] - steps["level"]
    return above.where(above > NEAR * steps["level"], 0.0).groupby(steps["replicate"]).sum()


def step_energy(data: Data, variant: str) -> pd.Series:
    """The mean energy of the network in a step (J)."""
    return leveled(data, variant).groupby("replicate")["joules"].mean()


def leveled(data: Data, variant: str) -> pd.DataFrame:
    """One row for each step from 1 on: replicate, step, time, joules, the acting cluster and its level.

    A cluster without a step between its first and its last has no level.
    """
    spent = data.of(variant, "energy_steps").groupby(["replicate", "step"], as_index=False)
    steps = spent.agg({"time": "first", "joules": "sum"})
    steps = steps[steps["step"] > 0].sort_values(["time", "replicate"])
    formed = data.of(variant, "clusters")[["replicate", "cluster", "formed"]].sort_values(["formed", "replicate"])
    formed["formed"] -= ROUNDING
    found = pd.merge_asof(steps, formed, left_on="time", right_on="formed", by="replicate")
    found = found.sort_values(["replicate", "step"]).reset_index(drop=True)
    whole = found.groupby(["replicate", "cluster"])["joules"]
    inside = (whole.cumcount() > 0) & (whole.cumcount(ascending=False) > 0)
    level = found[inside].groupby(["replicate", "cluster"])["joules"].median().rename("level")
    return found.join(level, on=["replicate", "cluster"])


def _levels(data: Data, variant: str) -> pd.Series:
    """The level of each cluster, by replicate and cluster."""
    return leveled(data, variant).dropna(subset="level").groupby(["replicate", "cluster"])["level"].first()


_FUNCTIONS: Final = (clusters, least_level, largest_level, on_level, above_level, step_energy)
MEASURES: Final = {measure.__name__: measure for measure in _FUNCTIONS}


MAIN: Final = "pso_mhpf"
PRINTED: Final = {
    "pso_mhpf": plotting.Look("PSO-MHPF", COLOURS[0], 1.1),
    "ipf": plotting.Look("IPF", COLOURS[1], 1.1),
    "ppf": plotting.Look("PPF", COLOURS[2], 1.1),
}
REPAIRED: Final = {
    "pso_mhpf, all readings": plotting.Look("PSO-MHPF, all measurements", COLOURS[0], 1.1),
    "ipf, noise x100": plotting.Look("IPF, noise ×100", COLOURS[1], 1.1, banded=False),
    "ppf, noise x100": plotting.Look("PPF, noise ×100", COLOURS[2], 1.1),
    "ekf": plotting.Look("EKF", COLOURS[3], 1.1, banded=False),
}
"""Without a band are those of which one diverged run would widen it over the whole figure."""
PARTICLES: Final = (100, 200, 400, 800, 1600)
ITERATIONS: Final = (1, 2, 4, 8)
FIELD: Final = 205.0
"""Distance from the centre of a map to its edges (m)."""
LIGHT: Final = "#B0B0B0"


def _first_cluster(figure: Figure, data: Data) -> None:
    """The first cluster: the nodes that sense the target within the communication range of the head."""
    axes = figure.subplots()
    places = _places(data)
    target = plotting.first_run(data, MAIN, "truth")[["px", "py"]].to_numpy()[0]
    head = int(plotting.first_run(data, MAIN, "clusters")["head"].iloc[0])
    members = _members(data, places, target, head)
    others = np.setdiff1d(np.arange(len(places)), [*members, head])
    plotting.points(axes, places[others], "o", 3, "nodes asleep", LIGHT)
    plotting.points(axes, places[members], "P", 6, f"{len(members)} members", COLOURS[0])
    plotting.points(axes, places[head], "s", 7, "cluster head", COLOURS[1])
    plotting.points(axes, target, "*", 11, "target", COLOURS[6])
    sensing, radio = _ranges(data)
    axes.add_patch(Circle(tuple(target), sensing, fill=False, linestyle=":", label=f"sensing range, {sensing:g} m"))
    words = f"the head's communication range, {radio:g} m"
    axes.add_patch(Circle(tuple(places[head]), radio, fill=False, color=COLOURS[1], label=words))
    _map(axes)
    plotting.legend_below(figure, (axes,))


def cell(readings: str, particles: int, iterations: int) -> str:
    """The name of a variant of figure 3."""
    return f"{readings} readings, {particles} particles, {iterations} iteration{'s' if iterations > 1 else ''}"


def _convergence(figure: Figure, data: Data) -> None:
    """Error against iterations, one curve for each number of particles; own measurements, and all of the cluster's."""
    panels = figure.subplots(1, 2, sharey=True)
    words = {"own": "own measurements, as in the text", "all": "all measurements of the cluster"}
    for axes, readings in zip(panels, words, strict=True):
        for colour, particles in zip(COLOURS, PARTICLES, strict=False):
            found = [measured(data, cell(readings, particles, count), "rmse") for count in ITERATIONS]
            value, low, high, numbers, _ = (np.array(column) for column in zip(*found, strict=True))
            axes.fill_between(ITERATIONS, low, high, color=colour, alpha=0.12, linewidth=0)
            axes.plot(ITERATIONS, value, "o-", color=colour, markersize=4, linewidth=1.2, label=f"{particles}")
        bound = data.bound(cell(readings, 400, 2), "unconditional").time_mean
        plotting.published_level(axes, bound, "bound, all measurements", "#000000")
        axes.set_title(words[readings], loc="left")
        axes.set_yscale("log")
        axes.set_xscale("log", base=2)
        axes.set_xticks(ITERATIONS, [str(count) for count in ITERATIONS])
        axes.minorticks_off()
        plotting.plain_numbers(axes, (0.2, 0.5, 1, 2, 5, 10))
        axes.set_xlabel("iterations in each step")
    panels[0].set_ylabel(f"RMSE over the first cluster [m], {numbers.max()} runs and 95 %")
    plotting.legend_below(figure, panels[:1], 6, "particles")


def _heads_and_members(figure: Figure, data: Data) -> None:
    """The cluster heads in order, and their members."""
    axes = figure.subplots()
    places, clusters = _places(data), plotting.first_run(data, MAIN, "clusters")
    plotting.points(axes, places, "o", 3, "nodes", LIGHT)
    everybody = sorted({node for row in clusters.itertuples() for node in _members_of(data, places, row)})
    plotting.points(axes, places[everybody], "P", 5, "members of a cluster", COLOURS[0])
    _heads(axes, places, clusters, numbered=True)
    _map(axes)
    plotting.legend_below(figure, (axes,))


def _heads_and_target(figure: Figure, data: Data) -> None:
    """The cluster heads in order, and the ground-truth trajectory."""
    axes = figure.subplots()
    truth = plotting.first_run(data, MAIN, "truth")[["px", "py"]].to_numpy()
    axes.plot(*truth.T, "--", color=COLOURS[6], linewidth=1.6, label="target")
    plotting.points(axes, truth[0], "*", 10, "its start", COLOURS[6])
    _heads(axes, _places(data), plotting.first_run(data, MAIN, "clusters"), numbered=False)
    _map(axes)
    plotting.legend_below(figure, (axes,))


def _step_energy(figure: Figure, data: Data) -> None:
    """The energy of the network in each step, and the level of each cluster."""
    axes = figure.subplots()
    steps = leveled(data, MAIN)
    steps = steps[steps["replicate"] == 0]
    axes.plot(steps["time"], steps["joules"], color=COLOURS[5], linewidth=0.6, label="a step, handovers included")
    for number, (_, rows) in enumerate(steps.groupby("cluster")):
        label = None if number else "level of a cluster (its median step)"
        axes.plot(rows["time"], rows["level"], color=COLOURS[1], linewidth=2.4, label=label)
    levels = data.published["step_energy"]
    plotting.published_level(axes, levels["least"], "published least and largest level")
    plotting.published_level(axes, levels["largest"])
    axes.set(yscale="log", ylabel="energy of the network in a step of 40 ms [J]")
    printed = data.published["clusters"][MAIN]
    axes.set_title(f"one run, {steps['cluster'].nunique()} clusters (published: {printed})", loc="left")
    plotting.whole_run(axes, steps)
    plotting.legend_below(figure, (axes,))


def _trajectories(figure: Figure, data: Data) -> None:
    """The ground-truth trajectory and the estimates, as printed and repaired."""
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    truth = plotting.first_run(data, MAIN, "truth")
    for axes, looks, title in ((left, PRINTED, "as printed"), (right, REPAIRED, "repaired, and EKF")):
        axes.plot(truth["px"], truth["py"], color=COLOURS[6], linewidth=3.0, alpha=0.35, label="target")
        plotting.tracks(axes, data, looks)
        _map(axes)
        axes.set_title(f"{title}, one run", loc="left")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=2, frameon=False)
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower right", ncols=2, frameon=False)
    right.set_ylabel("")


def _energy(figure: Figure, data: Data) -> None:
    """The cumulative energy of the network against time, and what it was spent on."""
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    for kind, look in PRINTED.items():
        time, rows = _spent(data, kind)
        band(left, time, rows, look.name, look.colour)
        left.plot(time[-1], data.published["energy"][kind], "D", color=look.colour, markersize=6,
                  markeredgecolor="black", clip_on=False, zorder=5)  # fmt: skip
    left.plot([], [], "D", color="white", markeredgecolor="black", label="published, at the end")
    left.set(xlabel="time [s]", ylabel="energy spent [J]", xlim=(0.0, float(time[-1])), ylim=(0.0, None))
    left.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False, columnspacing=1.0)
    _by_cause(right, data)


def _errors(figure: Figure, data: Data) -> None:
    """The RMSE over runs at each step (eq. 26): as printed with the published means, repaired with the bounds."""
    panels, step = figure.subplots(2, 1, sharex=True), float(data.scenario(MAIN)["step"])
    for axes, looks, title, whose in zip(
        panels, (PRINTED, REPAIRED), ("as printed", "repaired, and EKF"), ("", "PSO-MHPF and PPF"), strict=True
    ):
        runs = plotting.rmse_curves(
            axes, data, looks, lambda _, rows: f", mean {metrics.per_step_rmse(rows).mean():.2f} m"
        )
        axes.set_title(f"{title}, RMSE of {runs_text(runs, whose)}", loc="left")
    for kind, look in PRINTED.items():
        plotting.published_level(panels[0], data.published["rmse"][kind], colour=look.colour)
    panels[0].plot([], [], "--", color="#666666", linewidth=1.0, label="published mean, in the same colour")
    for axes in panels:
        plotting.bound_curve(axes, data.bound(MAIN, "unconditional").rmse, step, "bound, all measurements")
        plotting.bound_curve(axes, data.bound(MAIN, "per_trajectory").rmse, step, "trajectory-conditional bound", "-")
        axes.set_ylabel("RMSE [m]")
        plotting.legend_beside(axes)
    panels[0].set_xlabel("")
    panels[1].set_xlim(0.0, step * data.errors(MAIN).shape[1])


def _places(data: Data) -> Floats:
    """(nodes, 2) the positions of the nodes of replicate 0."""
    return np.asarray(plotting.first_run(data, MAIN, "nodes")[["x", "y"]], dtype=np.float64)


def _ranges(data: Data) -> tuple[float, float]:
    """The sensing range and the communication range (m)."""
    scenario = data.scenario(MAIN)
    return float(scenario["sensor"]["reach"]), float(scenario["link"]["reach"])


def _members(data: Data, places: Floats, target: Floats, head: int) -> list[int]:
    """The nodes that sense the target within the head's communication range when a cluster forms, without the head."""
    sensing, radio = _ranges(data)
    near = np.hypot(*(places - target).T) <= sensing
    heard = np.hypot(*(places - places[head]).T) <= radio
    return [int(node) for node in np.flatnonzero(near & heard) if node != head]


def _members_of(data: Data, places: Floats, cluster: Any) -> list[int]:
    """The members of a row of the table `clusters`, given the target's position when it formed."""
    truth = plotting.first_run(data, MAIN, "truth")
    step = int((truth["time"] - cluster.formed).abs().to_numpy().argmin())
    return _members(data, places, truth[["px", "py"]].to_numpy()[step], int(cluster.head))


def _heads(axes: Axes, places: Floats, clusters: pd.DataFrame, numbered: bool) -> None:
    """The path of the cluster heads."""
    path = places[clusters["head"].to_numpy().astype(int)]
    axes.plot(*path.T, "s-", color=COLOURS[1], markersize=6, linewidth=1.3, label=f"heads of {len(path)} clusters")
    for number, place in enumerate(path if numbered else (), start=1):
        axes.annotate(str(number), tuple(place), xytext=(5, 5), textcoords="offset points", fontsize=8, zorder=6,
                      path_effects=[withStroke(linewidth=2.0, foreground="white")])  # fmt: skip


def _map(axes: Axes) -> None:
    """Axes in metres over the whole field."""
    axes.set(xlim=(-FIELD, FIELD), ylim=(-FIELD, FIELD), aspect="equal", xlabel="x [m]", ylabel="y [m]")


def _spent(data: Data, variant: str) -> tuple[Floats, Floats]:
    """(times, (runs, times)) the cumulative energy of the network (J)."""
    table = data.of(variant, "energy_steps").pivot_table("joules", "replicate", "time", "sum", fill_value=0.0)
    return table.columns.to_numpy(dtype=np.float64), np.cumsum(table.to_numpy(dtype=np.float64), axis=1)


def _by_cause(axes: Axes, data: Data) -> None:
    """The energy by cause, one bar for each variant, means over runs."""
    looks = PRINTED | REPAIRED
    frames = [data.of(name, "energy_steps") for name in looks]
    causes = sorted({str(cause) for frame in frames for cause in frame["cause"].unique()})
    left = np.zeros(len(looks))
    for colour, cause in zip(COLOURS, causes, strict=False):
        joules = _means_of_cause(frames, cause)
        axes.barh(range(len(looks)), joules, left=left, color=colour, label=cause.replace("_", " "), height=0.7)
        left += joules
    axes.set_yticks(range(len(looks)), [look.name for look in looks.values()])
    axes.invert_yaxis()
    axes.grid(False, axis="y")
    axes.set_xlabel("energy spent [J], mean of the runs")
    axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=4, frameon=False, columnspacing=1.0)


def _means_of_cause(frames: Sequence[pd.DataFrame], cause: str) -> Floats:
    sums = [frame.loc[frame["cause"] == cause, "joules"].sum() / frame["replicate"].nunique() for frame in frames]
    return np.array(sums, dtype=np.float64)


FIGURES: Final[plotting.Drawings] = {
    "figure_2": _first_cluster,
    "figure_3": _convergence,
    "figure_4": _heads_and_members,
    "figure_5": _heads_and_target,
    "figure_6": _step_energy,
    "figure_7": _trajectories,
    "figure_8": _energy,
    "figure_9": _errors,
}
