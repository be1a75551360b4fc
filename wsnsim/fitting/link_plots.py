"""The figure of fitted links: delivery ratio by power, both directions, and power by distance."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.analysis.figure_style import BLUE, GREY, ORANGE, PALE, suffix_of, write_figure
from wsnsim.base.arrays import Floats
from wsnsim.fitting.fitted_law import FittedValue
from wsnsim.fitting.link_curve import delivery, mean_power
from wsnsim.fitting.link_sample import LinkRows

MOST_POINTS: Final = 20_000
TICKS: Final = [digit * 10.0**power for power in range(6) for digit in (1, 2, 5)]
"""Distances (m) that the axis may name."""


class LinkFigure(NamedTuple):
    """What the figure shows: bursts, estimates, measured curve, length of packets (bytes), transmit power (dBm)."""

    rows: LinkRows
    values: Mapping[str, FittedValue]
    curve: tuple[Floats, Floats]
    frame: int
    power: float


def plot_links(shown: LinkFigure, out: Path) -> Path:
    """Write the figure. Raises UsageError for a suffix that cannot be written, ResultError if it cannot be written."""
    suffix_of(out)
    panels: list[Callable[[Axes, LinkFigure], None]] = [_ratios, _directions]
    if "exponent" in shown.values:
        panels.append(_powers)

    def draw(figure: Figure) -> None:
        for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            panel(axes, shown)

    title = f"Links: {len(shown.rows.ratios)} bursts between {len(shown.rows.nodes)} nodes"
    return write_figure(draw, out, (5.2 * len(panels), 3.8), title)


def _ratios(axes: Axes, shown: LinkFigure) -> None:
    rows, (powers, ratios) = shown.rows, shown.curve
    every = max(1, len(rows.powers) // MOST_POINTS)
    axes.plot(rows.powers[::every], rows.ratios[::every], ",", color=GREY, rasterized=True)
    axes.plot(powers, ratios, "o-", color=ORANGE, markersize=3, linewidth=1.0, label="mean of bursts")
    levels = np.linspace(float(rows.powers.min()), float(rows.powers.max()), 600)
    expected = delivery(levels - shown.values["sensitivity"].value, shown.frame)
    axes.plot(levels, expected, color=BLUE, label=f"fitted, packets of {shown.frame} bytes")
    axes.set(title="Delivery ratio of a burst", xlabel="mean received power [dBm]", ylabel="packet delivery ratio")
    axes.legend(frameon=False, loc="lower right")


def _directions(axes: Axes, shown: LinkFigure) -> None:
    differences = shown.rows.differences
    known = differences[np.isfinite(differences)]
    both = np.concatenate([known, -known])
    spread = shown.values["asymmetry"].value
    limit = max(4.0 * spread, 1e-3)
    axes.hist(both, bins=50, range=(-limit, limit), density=True, color=PALE, label=f"{len(known)} pairs, both signs")
    places = np.linspace(-limit, limit, 300)
    normal = np.exp(-0.5 * (places / spread) ** 2) / (spread * math.sqrt(2.0 * math.pi))
    axes.plot(places, normal, color=BLUE, label=f"normal, sd {spread:.2f} dB")
    axes.set(title="Difference between both directions", xlabel="difference [dB]", ylabel="density [1/dB]")
    axes.legend(frameon=False)


def _powers(axes: Axes, shown: LinkFigure) -> None:
    distances, powers = shown.rows.distances, shown.rows.means
    heard = np.isfinite(powers)
    axes.plot(distances[heard], powers[heard], ".", color=GREY, markersize=3, label="pairs that were heard")
    bottom = float(powers[heard].min()) - 2.0
    axes.plot(distances[~heard], np.full((~heard).sum(), bottom), "|", color=ORANGE, label="pairs that were not")
    along = np.geomspace(float(distances.min()), float(distances.max()), 200)
    mean, spread = mean_power(along, shown.power, shown.values), shown.values["shadowing"].value
    axes.plot(along, mean, color=BLUE, label="fitted, ±1 sd")
    axes.fill_between(along, mean - spread, mean + spread, color=BLUE, alpha=0.15, linewidth=0)
    axes.set_xscale("log")
    shown_at = [tick for tick in TICKS if distances.min() <= tick <= distances.max()]
    axes.set_xticks(shown_at, [f"{tick:g}" for tick in shown_at])
    axes.minorticks_off()
    axes.set(title="Path loss", xlabel="distance [m]", ylabel="mean received power [dBm]")
    axes.legend(frameon=False)
