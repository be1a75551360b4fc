"""Measures of figures 2 to 4 and table 1 of Liu, Wang (2012): velocity, cost, sensor probabilities; figures 1 to 4.

The probabilities need the table `tracker_state`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.papers.toolkit import COLOURS, Data, Floats, ResultError, band, plotting, runs_text

TAKES_PART: Final = 0.05
"""Probability above which a sensor takes part [our choice]."""
RUNS: Final = 50
"""Runs of table 1."""


def velocity_over_rkf(data: Data, variant: str) -> pd.Series:
    """The root mean square error of the velocity, divided by that of RKF."""
    one, two = (_velocity(data, name) for name in (variant, _twin(variant)))
    return one / two


def operations_over_rkf(data: Data, variant: str) -> pd.Series:
    """The operations that the tracker states, divided by those of RKF."""
    return data.of_runs(variant, "cycles") / data.of_runs(_twin(variant), "cycles")


def seconds_over_rkf(data: Data, variant: str) -> pd.Series:
    """The processor time of a run, truth and measurements included, divided by that of RKF.

    Runs that are made at once share their time evenly, and not all filters gain as much: --no-batch times single runs.
    """
    return data.of_runs(variant, "cpu_seconds") / data.of_runs(_twin(variant), "cpu_seconds")


def seconds_of_50(data: Data, variant: str) -> pd.Series:
    """The processor time of 50 runs like this one (s), made at once or one by one."""
    return RUNS * data.of_runs(variant, "cpu_seconds")


def taking_part(data: Data, variant: str) -> pd.Series:
    """The number of steps in which a sensor takes part, averaged over all sensors."""
    found = probabilities(data, variant)
    return pd.Series({number: float((chances >= TAKES_PART).sum(axis=0).mean()) for number, chances in found.items()})


def to_neighbours(data: Data, variant: str) -> pd.Series:
    """The fraction of the changes of the most probable sensor that go to a neighbour; NaN without any change."""
    found = {}
    for number, chances in probabilities(data, variant).items():
        leaps = np.abs(np.diff(chances.argmax(axis=1)))
        found[number] = float((leaps[leaps > 0] == 1).mean()) if leaps.any() else float("nan")
    return pd.Series(found)


def in_turn(data: Data, variant: str) -> pd.Series:
    """The fraction of neighbouring sensors that take part in the order of their positions, of those that take part.

    A sensor takes part at the mean of the target's true positions, weighted with the sensor's probability.
    """
    truth, found = data.of(variant, "truth").sort_values("step"), {}
    for number, chances in probabilities(data, variant).items():
        places = truth[(truth["replicate"] == number) & (truth["step"] > 0)]["px"].to_numpy()
        taking = chances[:, (chances >= TAKES_PART).any(axis=0)]
        means = (taking * places[:, None]).sum(axis=0) / taking.sum(axis=0)
        found[number] = float((np.diff(means) > 0.0).mean()) if means.size > 1 else float("nan")
    return pd.Series(found)


def probabilities(data: Data, variant: str) -> Mapping[int, Floats]:
    """(steps, sensors) the probability of each sensor at the steps 1, 2, ..., by replicate.

    Raises:
        ResultError: the tracker recorded no probabilities.
    """
    state = data.of(variant, "tracker_state")
    state = state[state["name"] == "probability"]
    if state.empty:
        raise ResultError(f"{data.folder.path}: '{variant}' has no probabilities in the table tracker_state")
    runs = state.pivot(index=["replicate", "step"], columns="index", values="value").groupby(level="replicate")
    return {int(number): run.to_numpy(dtype=np.float64) for number, run in runs}


def _twin(variant: str) -> str:
    """The same variant with RKF."""
    return variant.replace("imsf", "rkf")


def _velocity(data: Data, variant: str) -> pd.Series:
    runs = np.sort(data.of(variant, "runs")["replicate"].to_numpy())
    return pd.Series(np.sqrt((data.column_errors(variant, "vx") ** 2).mean(axis=1)), index=runs)


_FUNCTIONS: Final = (
    velocity_over_rkf, operations_over_rkf, seconds_over_rkf, seconds_of_50, taking_part, to_neighbours, in_turn,
)  # fmt: skip
MEASURES: Final = {measure.__name__: measure for measure in _FUNCTIONS}


PRINTED: Final = {"rkf": plotting.Look("RKF", COLOURS[0], 1.5), "imsf": plotting.Look("IMSF", COLOURS[1], 1.5)}
OTHERS: Final = {
    "rkf, spread": plotting.Look("RKF with the spread of means", COLOURS[2], 0.9),
    "imsf, mixing as printed": plotting.Look("IMSF, (23) as printed", COLOURS[3], 0.9),
    "ekf, sensors in range": plotting.Look("EKF, sensors in range", COLOURS[4], 0.9),
    "ekf, nearest sensor": plotting.Look("EKF, nearest sensor", COLOURS[5], 0.9),
}
IN_RANGE: Final = "#EDEDED"


def _position(figure: Figure, data: Data) -> None:
    """Position errors at each step."""
    _errors(figure, data, data.errors, data.bound("rkf", "unconditional").rmse, "position error [m]")


def _draw_velocity(figure: Figure, data: Data) -> None:
    """Velocity errors at each step."""
    bound = data.bound("rkf", "unconditional").columns[:, 1]
    _errors(figure, data, lambda variant: np.abs(data.column_errors(variant, "vx")), bound, "velocity error [m/s]")


def _errors(figure: Figure, data: Data, errors: Callable[[str], Floats], bound: Floats, what: str) -> None:
    """RMSE over runs of all variants with the bound; and the absolute errors of single runs of the paper's two."""
    left, right = figure.subplots(1, 2, sharex=True)
    runs = plotting.rmse_curves(left, data, PRINTED | OTHERS, plotting.lost_runs(data), errors)
    for variant, look in PRINTED.items():
        band(right, plotting.times(data, variant, len(bound)), errors(variant), look.name, look.colour)
    plotting.bound_curve(left, bound, data.scenario("rkf")["step"], "bound (posterior Cramér-Rao)")
    left.set(ylabel=f"RMSE: {what}", xlim=(0, plotting.times(data, "rkf", len(bound))[-1]))
    left.set_title(f"RMSE over {runs_text(runs)}, lost ones included", loc="left")
    right.set(xlabel="time [s]", ylabel=what, ylim=(0, None))
    right.set_title("absolute error of a run", loc="left")
    for axes in (left, right):
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=1 if axes is right else 2, frameon=False)


def _relay(figure: Figure, data: Data, variant: str) -> None:
    """One row for each sensor: its probability, when the target is within its range, and the target's position."""
    axes, look = figure.subplots(), PRINTED[variant]
    replicate, track, time = _farthest(data, variant)
    chances = probabilities(data, variant)[replicate]
    nodes = data.of(variant, "nodes")
    places = nodes[nodes["replicate"] == replicate].sort_values("node")[["x", "y"]].to_numpy()
    sensing_range = float(data.scenario(variant)["sensor"]["reach"])
    for row, (x, y) in enumerate(places):
        within = np.hypot(track - x, y) <= sensing_range
        axes.fill_between(time, row, row + 0.9, where=within, color=IN_RANGE, linewidth=0)
        axes.fill_between(time, row, row + 0.9 * chances[:, row], color=look.colour, linewidth=0)
    beside = np.interp(track, places[:, 0], np.arange(len(places)) + 0.45)
    axes.plot(time, beside, color=plotting.BLACK, linewidth=1.2, label="the target's position among the sensors")
    axes.set_yticks(np.arange(len(places)) + 0.45, [f"{row + 1}: {x:g} m" for row, (x, _) in enumerate(places)])
    part = (chances >= TAKES_PART).sum(axis=0).mean()
    axes.set_title(
        f"{look.name}, replicate {replicate}; a sensor has {TAKES_PART:g} or more at {part:.0f} steps on average",
        loc="left",
    )
    axes.fill_between([], [], [], color=look.colour, label="probability, from 0 to 1 in each row")
    axes.fill_between([], [], [], color=IN_RANGE, label="target within the sensing range")
    _frame(axes, len(places), time)


def _frame(axes: Axes, rows: int, time: Floats) -> None:
    axes.set(xlabel="time [s]", ylabel="sensor, at x", xlim=(0, time[-1]), ylim=(0, rows))
    axes.grid(visible=False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=3, frameon=False)


def _farthest(data: Data, variant: str) -> tuple[int, Floats, Floats]:
    """The run whose target comes farthest without passing the last sensor [our choice]: replicate, positions, times."""
    truth, last = data.of(variant, "truth"), data.of(variant, "nodes")["x"].max()
    ends = truth[truth["step"] == truth["step"].max()].set_index("replicate")["px"]
    inside = ends[ends <= last]
    replicate = int((inside if len(inside) else ends).idxmax())
    run = truth[(truth["replicate"] == replicate) & (truth["step"] > 0)].sort_values("step")
    return replicate, run["px"].to_numpy(), run["time"].to_numpy()


FIGURES: Final[plotting.Drawings] = {
    "figure_1": _position,
    "figure_2": _draw_velocity,
    "figure_3": partial(_relay, variant="rkf"),
    "figure_4": partial(_relay, variant="imsf"),
}
