"""Measures of Wei, Guo (2022): velocities, operations and the particles of single steps; figures 1 to 11.

Velocities need the tables `truth` and `estimates`, particles need `particles`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.papers.toolkit import BOUND, COLOURS, Data, OwnMeasure, band, metrics, plotting, runs_text


def cloud(data: Data, variant: str, step: int) -> pd.DataFrame:
    """The particles of a step, of all runs."""
    frame = data.of(variant, "particles")
    return frame[frame["step"] == step]


def _distinct(data: Data, variant: str, step: int) -> pd.Series:
    """The fraction of the particles at distinct positions."""
    places = cloud(data, variant, step).groupby("replicate")["x"]
    return places.nunique() / places.size()


def _spread(data: Data, variant: str, step: int) -> pd.Series:
    """The weighted standard deviation of the particles."""
    frame = cloud(data, variant, step)
    found = {
        number: float(np.sqrt(np.cov(one["x"], aweights=one["weight"], ddof=0)))
        for number, one in frame.groupby("replicate")
    }
    return pd.Series(found)


def _column(data: Data, variant: str, column: str) -> pd.Series:
    """The root mean square error of a state column over the steps."""
    runs = np.sort(data.of(variant, "runs")["replicate"].to_numpy())
    return pd.Series([metrics.rmse(row) for row in data.column_errors(variant, column)], index=runs)


def _operations(data: Data, variant: str, other: str) -> pd.Series:
    """The operations that the tracker states, divided by those of another variant."""
    return data.of_runs(variant, "cycles") / data.of_runs(other, "cycles")


def _gain_over_cs_pf(data: Data, variant: str) -> pd.Series:
    """The RMSE of a run of CS-PF with as many particles, less that of the variant."""
    return data.of_runs(variant.replace("ics_pf", "cs_pf"), "rmse") - data.of_runs(variant, "rmse")


MEASURES: Final[dict[str, OwnMeasure]] = {
    **{f"distinct_{step}": partial(_distinct, step=step) for step in (10, 30, 90)},
    **{f"spread_{step}": partial(_spread, step=step) for step in (10, 30, 90)},
    **{f"operations_over_{other}": partial(_operations, other=other) for other in ("pf", "cs_pf")},
    **{f"operations_over_cs_pf_{count}": partial(_operations, other=f"cs_pf, {count}") for count in (30, 100)},
    "gain_over_cs_pf": _gain_over_cs_pf,
    "vx": partial(_column, column="vx"),
    "vy": partial(_column, column="vy"),
}


LOOKS: Final = {
    "pf": plotting.Look("PF", COLOURS[0], 1.4),
    "cs_pf": plotting.Look("CS-PF", COLOURS[1], 1.4),
    "ics_pf": plotting.Look("ICS-PF", COLOURS[2], 1.4),
}
TRUTH: Final[dict[str, Any]] = {"color": plotting.BLACK, "linewidth": 1.0, "label": "truth"}
GRID: Final = "exact posterior"
EXACT: Final[dict[str, Any]] = {"color": plotting.GREY, "linewidth": 1.4, "label": GRID}
BIN: Final = 0.5
"""Width of the bins of the histograms of particles."""
MOST_LINES: Final = 15
"""Trajectories in a panel."""
AROUND: Final = (-50.0, 350.0)
"""Part of the plane (m) that figure 8 shows."""


def _panels(figure: Figure, sharey: bool = True) -> Iterator[tuple[Axes, str, plotting.Look]]:
    """One panel for each filter, below each other."""
    panels = figure.subplots(3, 1, sharex=True, sharey=sharey)
    for axes, (kind, look) in zip(panels, LOOKS.items(), strict=True):
        yield axes, kind, look


def _states(figure: Figure, data: Data, count: int) -> None:
    """The state of the growth model in one run: the truth, the estimate of each filter, and the exact posterior."""
    truth, exact = plotting.first_run(data, GRID, "truth"), plotting.first_run(data, GRID, "estimates")
    for axes, kind, look in _panels(figure):
        guess = plotting.first_run(data, f"{kind}, {count}", "estimates")
        axes.plot(exact["time"], exact["x"], **EXACT)
        axes.plot(truth["time"], truth["x"], **TRUTH)
        axes.plot(guess["time"], guess["x"], color=look.colour, linewidth=1.1, label=f"{look.name}, N = {count}")
        axes.set_ylabel("state x")
        plotting.legend_beside(axes)
    plotting.whole_run(axes, truth)


def _errors(figure: Figure, data: Data, count: int) -> None:
    """Absolute errors in one run, with its RMSE, that of all runs, and the published one."""
    exact = plotting.first_run(data, GRID, "estimates")
    for axes, kind, look in _panels(figure):
        variant, level = f"{kind}, {count}", data.published["rmse_x"][kind][str(count)]
        guess, rows = plotting.first_run(data, variant, "estimates"), data.errors(variant)
        axes.plot(exact["time"], exact["error"], **EXACT)
        axes.plot(guess["time"], guess["error"], color=look.colour, linewidth=1.1, label=look.name)
        plotting.published_level(axes, level, "published RMSE")
        ours = f"{metrics.rmse(rows[0]):.2f} here, {metrics.rmse(rows):.2f} over {len(rows)} runs"
        best = f"{metrics.rmse(data.errors(GRID)):.2f} of the exact posterior"
        axes.set_title(f"{look.name}: RMSE {ours} ({best}), published {level:.2f}", loc="left")
        axes.set_ylabel("|error of x|")
        plotting.legend_beside(axes)
    axes.set_ylim(bottom=0)
    plotting.whole_run(axes, guess)


def _particles(figure: Figure, data: Data, step: int) -> None:
    """The histogram of the particles of one run, beside the exact posterior in the same bins."""
    exact, *clouds = (_first(cloud(data, name, step)) for name in (GRID, *(f"{kind}, 100" for kind in LOOKS)))
    truth = plotting.first_run(data, GRID, "truth")
    place = float(truth["x"][truth["step"] == step].iloc[0])
    likely = exact["x"][exact["weight"] > 1e-6 * exact["weight"].max()]
    everything = np.concatenate([likely, [place], *(one["x"] for one in clouds)])
    edges = np.arange(np.floor(everything.min()) - 1.0, np.ceil(everything.max()) + 1.0 + BIN, BIN)
    posterior = np.histogram(exact["x"], edges, weights=exact["weight"] / exact["weight"].sum())[0]
    for (axes, _, look), particles in zip(_panels(figure), clouds, strict=True):
        held = particles["x"]
        axes.stairs(np.histogram(held, edges)[0] / len(held), edges, fill=True, color=look.colour, alpha=0.6,
                    label="particles")  # fmt: skip
        axes.plot(held, np.full(len(held), -0.03), "|", color=look.colour, markersize=5, clip_on=False)
        axes.stairs(posterior, edges, label=GRID, color=plotting.BLACK, linewidth=1.0)
        axes.axvline(place, label="truth", **{**BOUND, "color": COLOURS[3], "linewidth": 1.6})
        axes.set_title(f"{look.name}: {held.nunique()} of {len(held)} particles are distinct", loc="left")
        axes.set_ylabel(f"fraction, in bins of {BIN:g}")
        plotting.legend_beside(axes)
    axes.set_xlabel("state x")


def _first(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[frame["replicate"] == 0]


def _plane(figure: Figure, data: Data) -> None:
    """The plane, one panel for each filter: the truth, and the estimates of some runs."""
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    truth = plotting.first_run(data, "pf", "truth")
    for axes, (kind, look) in zip(panels, LOOKS.items(), strict=True):
        runs = list(data.of(kind, "estimates").groupby("replicate"))[:MOST_LINES]
        for number, run in reversed(runs):
            first = number == 0
            axes.plot(run["px"], run["py"], color=look.colour, linewidth=1.6 if first else 0.6,
                      alpha=1.0 if first else 0.35, label=f"{look.name}, replicate 0" if first else None)  # fmt: skip
        axes.plot(truth["px"], truth["py"], **{**TRUTH, "linewidth": 1.8})
        plotting.points(axes, np.zeros(2), "^", 6, "sensor")
        lost = data.lost(kind)
        axes.set_title(f"{look.name}: {lost.mean():.0%} of {len(lost)} runs lost", loc="left")
        axes.set(xlim=AROUND, ylim=AROUND, aspect="equal", xlabel=f"x [m]\n{len(runs)} runs drawn, {_outside(runs)}")
    panels[0].set_ylabel("y [m]")
    plotting.legend_below(figure, panels, 5)


def _outside(runs: list[tuple[Any, pd.DataFrame]]) -> str:
    """The fraction of the estimates that the panel does not show, in words."""
    places = np.concatenate([run[["px", "py"]].to_numpy() for _, run in runs])
    return f"{((places < AROUND[0]) | (places > AROUND[1])).any(axis=1).mean():.0%} of their estimates outside"


def _velocity(figure: Figure, data: Data, column: str) -> None:
    """A component of the velocity: the truth, and the estimates of all runs; each panel with its own scale."""
    truth = plotting.first_run(data, "pf", "truth")
    for axes, kind, look in _panels(figure, sharey=False):
        guess = data.of(kind, "estimates").pivot(index="replicate", columns="step", values=column).to_numpy(np.float64)
        band(axes, truth["time"].to_numpy()[1:], guess, look.name, look.colour)
        axes.plot(truth["time"], truth[column], **TRUTH)
        found, printed = metrics.rmse(data.column_errors(kind, column)), data.published[column][kind]
        axes.set_title(f"{look.name}: RMSE {found:.3g} m/s, published {printed:.4f} m/s", loc="left")
        axes.set_ylabel(f"{column} [m/s]")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, frameon=False)
    plotting.whole_run(axes, truth)


def _position(figure: Figure, data: Data, others: Mapping[str, plotting.Look], bound: str, published: bool) -> None:
    """The RMSE of the position at each step, the bound, and the position error that follows from table 2."""
    axes = figure.subplots()
    runs = plotting.rmse_curves(axes, data, {**LOOKS, **others})
    plotting.bound_curve(axes, data.bound("pf", "unconditional").rmse, data.scenario("pf")["step"], bound)
    for kind, look in LOOKS.items() if published else ():
        level = float(np.hypot(data.published["px"][kind], data.published["py"][kind]))
        plotting.published_level(
            axes, level, f"{look.name}, from table 2: sqrt(px² + py²) = {level:.3g} m", look.colour
        )
    axes.set_ylabel("RMSE of the position [m]")
    axes.set_title(f"RMSE over {runs_text(runs)}", loc="left")
    plotting.legend_below(figure, (axes,))


FIGURES: Final[plotting.Drawings] = {
    "figure_1": partial(_states, count=30),
    "figure_2": partial(_errors, count=30),
    "figure_3": partial(_states, count=100),
    "figure_4": partial(_errors, count=100),
    "figure_5": partial(_particles, step=10),
    "figure_6": partial(_particles, step=30),
    "figure_7": partial(_particles, step=90),
    "figure_8": _plane,
    "figure_9": partial(_velocity, column="vx"),
    "figure_10": partial(_velocity, column="vy"),
    "figure_11": partial(
        _position,
        others={
            "pf, 5000": plotting.Look("PF, 5000 particles", COLOURS[4], 1.4),
            "ekf": plotting.Look("EKF", COLOURS[5], 1.4),
        },
        bound="bound (posterior Cramér-Rao), not strict",
        published=True,
    ),
    "four_anchors": partial(
        _position,
        others={
            "pf, 20000": plotting.Look("PF, 20,000 particles", COLOURS[4], 1.4),
            "ekf": plotting.Look("EKF", COLOURS[5], 1.4),
        },
        bound="bound (posterior Cramér-Rao)",
        published=False,
    ),
}
