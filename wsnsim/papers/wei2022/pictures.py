"""Figures 1 to 11 of Wei, Guo (2022), ours, and what figure 11 is with four anchors.

figure_N(figure, data) puts axes on a figure and draws; where one run is shown, it is replicate 0
"""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.analysis.figure_style import BOUND, COLOURS, PUBLISHED, band, rmse_band, with_bands
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.papers.measures import Data
from wsnsim.papers.wei2022 import TABLE_1, TABLE_2
from wsnsim.papers.wei2022.measures import cloud

NAMES: Final = {"pf": "PF", "cs_pf": "CS-PF", "ics_pf": "ICS-PF"}
COLOUR: Final = dict(zip(NAMES, COLOURS, strict=False))
TRUTH: Final = {"color": "#000000", "linewidth": 1.0}
EXACT: Final = {"color": "#8C8C8C", "linewidth": 1.4}
GRID: Final = "exact posterior"
BIN: Final = 0.5
"""Width of the bins in which particles are counted."""
MOST_LINES: Final = 15
"""Trajectories in a panel."""
AROUND: Final = (-50.0, 350.0)
"""m: what figure 8 shows of the plane."""


def _states(figure: Figure, data: Data, count: int) -> None:
    """The state of the growth model in one run: true, estimated by each filter, and by the exact posterior."""
    panels = figure.subplots(3, 1, sharex=True, sharey=True)
    truth, exact = _first(data, GRID, "truth"), _first(data, GRID, "estimates")
    for axes, (kind, name) in zip(panels, NAMES.items(), strict=True):
        guess = _first(data, f"{kind}, {count}", "estimates")
        axes.plot(exact["time"], exact["x"], label=GRID, **EXACT)
        axes.plot(truth["time"], truth["x"], label="truth", **TRUTH)
        axes.plot(guess["time"], guess["x"], color=COLOUR[kind], linewidth=1.1, label=f"{name}, N = {count}")
        axes.set_ylabel("state x")
        _beside(axes)
    _over_time(panels[-1], truth)


def _errors(figure: Figure, data: Data, count: int) -> None:
    """Absolute errors in one run, with its RMSE, that of all runs, and the published one."""
    panels = figure.subplots(3, 1, sharex=True, sharey=True)
    exact = _first(data, GRID, "estimates")
    for axes, (kind, name) in zip(panels, NAMES.items(), strict=True):
        variant = f"{kind}, {count}"
        guess, rows = _first(data, variant, "estimates"), data.errors(variant)
        axes.plot(exact["time"], exact["error"], label=GRID, **EXACT)
        axes.plot(guess["time"], guess["error"], color=COLOUR[kind], linewidth=1.1, label=name)
        axes.axhline(TABLE_1[kind][count], label="published RMSE", **PUBLISHED)
        ours = f"{metrics.rmse(rows[0]):.2f} here, {metrics.rmse(rows):.2f} over {len(rows)} runs"
        best = f"{metrics.rmse(data.errors(GRID)):.2f} of the exact posterior"
        axes.set_title(f"{name}: RMSE {ours} ({best}), published {TABLE_1[kind][count]:.2f}", loc="left")
        axes.set_ylabel("|error of x|")
        _beside(axes)
    panels[0].set_ylim(bottom=0)
    _over_time(panels[-1], guess)


def _clouds(figure: Figure, data: Data, step: int) -> None:
    """Particles of one run in bins, beside the exact posterior in the same bins."""
    panels = figure.subplots(3, 1, sharex=True, sharey=True)
    exact = _of_first(cloud(data, GRID, step))
    clouds = {kind: _of_first(cloud(data, f"{kind}, 100", step)) for kind in NAMES}
    truth = _first(data, GRID, "truth")
    place = float(truth["x"][truth["step"] == step].iloc[0])
    likely = exact["x"][exact["weight"] > 1e-6 * exact["weight"].max()]
    everything = np.concatenate([likely, [place], *(one["x"] for one in clouds.values())])
    edges = np.arange(np.floor(everything.min()) - 1.0, np.ceil(everything.max()) + 1.0 + BIN, BIN)
    posterior = np.histogram(exact["x"], edges, weights=exact["weight"] / exact["weight"].sum())[0]
    for axes, (kind, name) in zip(panels, NAMES.items(), strict=True):
        held = clouds[kind]["x"]
        shares = np.histogram(held, edges)[0] / len(held)
        axes.stairs(shares, edges, fill=True, color=COLOUR[kind], alpha=0.6, label="particles")
        axes.plot(held, np.full(len(held), -0.03), "|", color=COLOUR[kind], markersize=5, clip_on=False)
        axes.stairs(posterior, edges, label=GRID, color="#000000", linewidth=1.0)
        axes.axvline(place, label="truth", **{**BOUND, "color": COLOURS[3], "linewidth": 1.6})
        axes.set_title(f"{name}: {held.nunique()} of {len(held)} particles are distinct", loc="left")
        axes.set_ylabel(f"share, by bins of {BIN:g}")
        _beside(axes)
    panels[-1].set_xlabel("state x")


figure_1, figure_3 = (partial(_states, count=count) for count in (30, 100))
figure_2, figure_4 = (partial(_errors, count=count) for count in (30, 100))
figure_5, figure_6, figure_7 = (partial(_clouds, step=step) for step in (10, 30, 90))


def figure_8(figure: Figure, data: Data) -> None:
    """The plane, a panel a filter: the truth, and the estimates of some runs."""
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    truth = _first(data, "pf", "truth")
    for axes, (kind, name) in zip(panels, NAMES.items(), strict=True):
        runs = list(data.of(kind, "estimates").groupby("replicate"))[:MOST_LINES]
        for number, run in reversed(runs):
            style = (
                {"linewidth": 1.6, "label": f"{name}, replicate 0"}
                if number == 0
                else {"linewidth": 0.6, "alpha": 0.35}
            )
            axes.plot(run["px"], run["py"], color=COLOUR[kind], **style)
        axes.plot(truth["px"], truth["py"], label="truth", **{**TRUTH, "linewidth": 1.8})
        axes.plot(0.0, 0.0, "^", color="#000000", markersize=6, label="sensor", linestyle="")
        lost = float(data.lost(kind).mean())
        axes.set_title(f"{name}: {100 * lost:.0f} % of {len(data.lost(kind))} runs lost", loc="left")
        axes.set(xlim=AROUND, ylim=AROUND, aspect="equal", xlabel=f"x [m]\n{len(runs)} runs drawn, {_outside(runs)}")
    panels[0].set_ylabel("y [m]")
    lines = [line for axes in panels for line in axes.get_lines() if not line.get_label().startswith("_")]
    shown = {line.get_label(): line for line in lines}
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=5, frameon=False)


def _outside(runs: list[tuple[int, pd.DataFrame]]) -> str:
    """What share of the estimates the panel does not show."""
    places = np.concatenate([run[["px", "py"]].to_numpy() for _, run in runs])
    share = float(((places < AROUND[0]) | (places > AROUND[1])).any(axis=1).mean())
    return f"{100 * share:.0f} % of their estimates outside"


def _velocity(figure: Figure, data: Data, column: str) -> None:
    """A component of the velocity: the truth, and the estimates of all runs; a panel a filter, each with its scale."""
    panels = figure.subplots(3, 1, sharex=True)
    truth = _first(data, "pf", "truth")
    for axes, (kind, name) in zip(panels, NAMES.items(), strict=True):
        rows = _rows(data, kind, column)
        steps = truth["time"].to_numpy()[1:]
        band(axes, steps, rows, name, COLOUR[kind])
        axes.plot(truth["time"], truth[column], label="truth", **TRUTH)
        found, printed = (
            metrics.rmse(data.column_errors(kind, column)),
            TABLE_2[kind][("px", "vx", "py", "vy").index(column)],
        )
        axes.set_title(f"{name}: RMSE {found:.3g} m/s, published {printed:.4f} m/s", loc="left")
        axes.set_ylabel(f"{column} [m/s]")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, frameon=False)
    _over_time(panels[-1], truth)


figure_9, figure_10 = (partial(_velocity, column=column) for column in ("vx", "vy"))


def figure_11(figure: Figure, data: Data) -> None:
    """The RMSE of the position at each step, the bound, and what follows from table 2 for the position."""
    axes = figure.subplots()
    others = {"pf, 5000": ("PF, 5000 particles", COLOURS[4]), "ekf": ("EKF", COLOURS[5])}
    _curves(axes, data, others, "bound (posterior Cramér-Rao), not strict")
    for kind, name in NAMES.items():
        px, _, py, _ = TABLE_2[kind]
        level = float(np.hypot(px, py))
        axes.axhline(
            level,
            **{**PUBLISHED, "color": COLOUR[kind]},
            label=f"{name}, from table 2: sqrt(px² + py²) = {level:.3g} m",
        )
    _finish(figure, axes, data)


def four_anchors(figure: Figure, data: Data) -> None:
    """The same with four anchors, where the target's place can be known."""
    axes = figure.subplots()
    _curves(
        axes,
        data,
        {"pf, 20000": ("PF, 20,000 particles", COLOURS[4]), "ekf": ("EKF", COLOURS[5])},
        "bound (posterior Cramér-Rao)",
    )
    _finish(figure, axes, data)


def _curves(axes: Axes, data: Data, others: dict[str, tuple[str, str]], words: str) -> None:
    """RMSE over runs at each step, and the bound."""
    for variant, (name, colour) in {**{kind: (name, COLOUR[kind]) for kind, name in NAMES.items()}, **others}.items():
        rows = data.errors(variant)
        rmse_band(axes, np.arange(1.0, rows.shape[1] + 1.0), rows, name, colour)
    bound = data.bound("pf", "unconditional").rmse
    axes.plot(np.arange(1, len(bound) + 1), bound, label=words, **BOUND)


def _finish(figure: Figure, axes: Axes, data: Data) -> None:
    axes.set(yscale="log", xlabel="time [s]", ylabel="RMSE of the position [m]", xlim=(0, None))
    axes.set_title(f"RMSE over {with_bands(len(data.errors('pf')))}", loc="left")
    figure.legend(loc="outside lower center", ncols=3, frameon=False)


def _first(data: Data, variant: str, table: str) -> pd.DataFrame:
    """Replicate 0 of a table."""
    return _of_first(data.of(variant, table))


def _of_first(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[frame["replicate"] == 0]


def _rows(data: Data, variant: str, column: str) -> Floats:
    """(runs, steps) an estimated column."""
    return data.of(variant, "estimates").pivot(index="replicate", columns="step", values=column).to_numpy(np.float64)


def _over_time(axes: Axes, frame: pd.DataFrame) -> None:
    axes.set_xlabel("time [s]")
    axes.set_xlim(0.0, float(frame["time"].max()))


def _beside(axes: Axes) -> None:
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
