"""The figures of fits: of a law (residuals, quantiles, correlation, distance, gains), and of links.

plot_fit(fit, out) -> out       plot_links(figure, out) -> out

Links are shown by delivery ratio over power, in both directions, and by power over distance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.analysis.figure_style import BLUE, GREY, ORANGE, PALE, VERMILLION, write_figure
from wsnsim.base.arrays import Floats
from wsnsim.fitting.fitted_law import FittedLaw, FittedValue
from wsnsim.fitting.link_sample import LinkRows, delivery, mean_power
from wsnsim.fitting.residuals import curve

LONGEST_LAG = 8.0
LAG_WIDTH = 0.25
MOST_QUANTILES = 400
DISTANCE_BINS = 15


def plot_fit(fit: FittedLaw, out: Path) -> Path:
    """Write the figure. Raises UsageError for a suffix that cannot be written, ResultError if it cannot be written."""
    panels = [_histogram, _quantiles, _correlation, _against_distance] + ([_gains] if fit.gains else [])

    def draw(figure: Figure) -> None:
        rows = math.ceil(len(panels) / 2)
        cells = figure.subplots(rows, 2, squeeze=False).ravel()
        for panel, axes in zip(panels, cells, strict=False):
            panel(axes, fit)
        for axes in cells[len(panels) :]:
            axes.remove()

    files = f"{len(fit.sample.readings)} readings of {len(fit.sample.files)} tracks"
    return write_figure(
        draw, out, (10.5, 3.5 * math.ceil(len(panels) / 2)), f"Residuals of law {fit.model.form.kind}: {files}"
    )


def _histogram(axes: Axes, fit: FittedLaw) -> None:
    residuals, unit = fit.residuals, fit.model.form.unit
    limit = 5.0 * fit.model.noise.total
    axes.hist(residuals, bins=60, range=(-limit, limit), density=True, color=PALE, label="residuals")
    places = np.linspace(-limit, limit, 400)
    axes.plot(places, np.exp(fit.model.noise.log_density(places)), color=BLUE, label=f"fitted: {_noise_text(fit)}")
    normal = np.exp(-0.5 * (places / residuals.std()) ** 2) / (residuals.std() * math.sqrt(2.0 * math.pi))
    axes.plot(places, normal, color=VERMILLION, linestyle="--", linewidth=1.0, label="normal of equal variance")
    axes.set(title="Residuals and the fitted density", xlabel=f"residual [{unit}]", ylabel=f"density [1/{unit}]")
    axes.set_yscale("log")
    axes.set_ylim(0.2 / (len(residuals) * limit / 30.0), 4.0 / fit.model.noise.total)
    axes.legend(frameon=False, loc="upper center")


def _noise_text(fit: FittedLaw) -> str:
    noise = fit.model.noise
    white = f"t, {noise.dof:.3g} d.o.f." if math.isfinite(noise.dof) else "normal"
    return f"{white}, sd {noise.sd:.2f}" + (f" ⊕ {noise.shadowing:.2f}" if noise.shadowing > 0.0 else "")


def _quantiles(axes: Axes, fit: FittedLaw) -> None:
    residuals, unit = np.sort(fit.residuals), fit.model.form.unit
    chosen = np.unique(np.linspace(0, len(residuals) - 1, MOST_QUANTILES).astype(np.int64))
    expected = _fitted_quantiles(fit, (chosen + 0.5) / len(residuals))
    axes.plot(expected, residuals[chosen], ".", color=BLUE, markersize=3)
    ends = [float(min(expected[0], residuals[0])), float(max(expected[-1], residuals[-1]))]
    axes.plot(ends, ends, color=GREY, linewidth=1.0)
    axes.set(title="Quantiles", xlabel=f"under the fitted density [{unit}]", ylabel=f"of the residuals [{unit}]")


def _fitted_quantiles(fit: FittedLaw, shares: Floats) -> Floats:
    """Quantiles of the fitted density, from its integral over a fine grid."""
    places = np.linspace(-25.0, 25.0, 20_001) * fit.model.noise.total
    cumulated = np.cumsum(np.exp(fit.model.noise.log_density(places)))
    return np.interp(shares, cumulated / cumulated[-1], places)


def _correlation(axes: Axes, fit: FittedLaw) -> None:
    for model, colour, label in ((fit.plain, ORANGE, "one constant for all nodes"), (fit.model, BLUE, "fitted law")):
        lags, values = curve(fit.sample, model.residuals(fit.sample), LONGEST_LAG, LAG_WIDTH)
        axes.plot(lags, values, ".-", color=colour, linewidth=1.0, label=label)
        if model is fit.plain and not fit.gains:
            break
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.set(title="Correlation of one node's residuals", xlabel="time between them [s]", ylabel="correlation")
    axes.legend(frameon=False)


def _against_distance(axes: Axes, fit: FittedLaw) -> None:
    distances, residuals = fit.sample.distances(fit.model.heights), fit.residuals
    axes.plot(distances, residuals, ",", color=GREY, alpha=0.5, rasterized=True)
    edges = np.unique(np.quantile(distances, np.linspace(0.0, 1.0, DISTANCE_BINS + 1)))
    bins = np.clip(np.searchsorted(edges, distances, side="right") - 1, 0, max(len(edges) - 2, 0))
    counts = np.maximum(np.bincount(bins), 1)
    means = np.bincount(bins, residuals) / counts
    spread = np.sqrt(np.maximum(np.bincount(bins, residuals**2) / counts - means**2, 0.0))
    centres = np.bincount(bins, distances) / counts
    axes.errorbar(centres, means, spread, fmt="o-", color=BLUE, markersize=3, linewidth=1.0, label="mean and sd")
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    unit = fit.model.form.unit
    axes.set(title="Residual against distance", xlabel="distance [m]", ylabel=f"residual [{unit}]")
    axes.legend(frameon=False)


def _gains(axes: Axes, fit: FittedLaw) -> None:
    values = np.array([gain.value for gain in fit.gains])
    reaches = np.array([[gain.value - gain.low, gain.high - gain.value] for gain in fit.gains]).T
    places = np.arange(len(values))
    axes.errorbar(places, values, np.nan_to_num(reaches), fmt="o", color=BLUE, markersize=3, linewidth=1.0)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    names = [gain.node for gain in fit.gains]
    shown = places[:: max(1, len(names) // 25)]
    axes.set_xticks(shown, [names[i] for i in shown.tolist()], rotation=60, ha="right", fontsize=7)
    axes.set(title="Gains with 95 % intervals", ylabel=f"gain [{fit.model.form.unit}]")


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
