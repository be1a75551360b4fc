"""Figures of the comparison: tracks over the floor plan, histograms of residuals, and the gap of every tracker."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.analysis.figure_style import COLOURS
from wsnsim.base.arrays import Floats
from wsnsim.papers import plotting
from wsnsim.papers.measures import Data
from wsnsim.papers.reality.measures import gaps, tracks_of
from wsnsim.papers.reality.residuals import track_residuals
from wsnsim.recording import read_table

LOOKS: Final = {
    "recorded": plotting.Look("recorded readings", COLOURS[1], 1.1),
    "simulated": plotting.Look("simulated twin", COLOURS[0], 1.1),
}
COLUMNS: Final = 3
BINS: Final = np.linspace(-25.0, 25.0, 51)
"""Edges of the histogram's bins, in dB."""


def _panels(figure: Figure, count: int, shared: bool) -> list[Axes]:
    """Axes for as many panels, the unused ones removed."""
    columns = min(count, COLUMNS)
    axes = figure.subplots(math.ceil(count / columns), columns, sharex=shared, sharey=shared, squeeze=False).ravel()
    for empty in axes[count:]:
        empty.remove()
    return list(axes[:count])


def _tracks(figure: Figure, data: Data) -> None:
    """The trajectory of every track, the receivers, and the estimates of one run on either kind of readings."""
    found, kind = tracks_of(data), data.published["registered"]["tracker"]
    places = found.sample.places
    panels = _panels(figure, len(found.tracks), True)
    for axes, track in zip(panels, found.tracks, strict=True):
        for word, look in LOOKS.items():
            path = _estimates(data, f"{track.name}, {word}, {kind}")
            axes.plot(*path.T, color=look.colour, linewidth=look.width, label=look.name)
        plotting.points(axes, places[:, :2], "^", 5, "receivers")
        truth = found.of(track.name).points
        axes.plot(truth[:, 0], truth[:, 1], color=plotting.BLACK, linewidth=1.6, label="truth")
        axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
        axes.set_title(f"{track.name}, {track.seconds:.0f} s", loc="left")
        axes.label_outer()
    plotting.legend_below(figure, panels, 4)


def _estimates(data: Data, variant: str) -> Floats:
    """(K, 2) positions of the first run of a variant, which alone may have recorded them."""
    point = data.manifest.points[data.variants.index(variant)]
    table = read_table(data.folder.batches(point.id)[0].path, "estimates", ("replicate", "px", "py"))
    first = table["replicate"] == 0
    return np.column_stack([table["px"][first], table["py"][first]])


def _residuals(figure: Figure, data: Data) -> None:
    """Histograms of readings minus their expectation under the laws of the other tracks, with normal densities."""
    found = tracks_of(data)
    panels = _panels(figure, len(found.tracks), True)
    for axes, track in zip(panels, found.tracks, strict=True):
        these = track_residuals(found, track.name)
        rows = (("path loss alone", these.plain, COLOURS[1]), ("with gains", these.gains, COLOURS[0]))
        for (word, values, colour), sd, bend in zip(rows, these.sd, these.kurtosis, strict=True):
            axes.hist(values, BINS.tolist(), density=True, histtype="step", color=colour, label=word)
            axes.plot(BINS, _normal(BINS, sd), color=colour, linewidth=0.8, linestyle=":")
            at = 0.93 if word == "with gains" else 0.83
            axes.text(0.02, at, f"{sd:.1f} dB, kurtosis {bend:.1f}", color=colour, transform=axes.transAxes, fontsize=8)
        axes.set_title(track.name, loc="left")
        axes.set(xlabel="residual [dB]", ylabel="density [1/dB]")
        axes.label_outer()
    plotting.legend_below(figure, panels)


def _normal(values: Floats, sd: float) -> Floats:
    """The density of N(0, sd²)."""
    density: Floats = np.exp(-0.5 * (values / sd) ** 2) / (sd * math.sqrt(2.0 * math.pi))
    return density


def _gap(figure: Figure, data: Data) -> None:
    """The RMSE on recorded readings over that on the twin, of every tracker on every track, before and after."""
    before = gaps(data)
    after = {gap.tracker: gap for gap in gaps(data, "recorded, gains", "simulated, gains", "inflated")}
    axes = figure.subplots()
    places = {gap.tracker: len(before) - row for row, gap in enumerate(before)}
    for name, at in places.items():
        gap = next(each for each in before if each.tracker == name)
        for shift, each, colour in ((0.15, gap, COLOURS[1]), (-0.2, after.get(name), COLOURS[0])):
            if each is not None:
                values = [found.value for found in each.tracks.values()]
                axes.plot(values, [at + shift] * len(values), "o", color=colour, markersize=3.5, alpha=0.6)
                axes.plot([each.median], [at + shift], "|", color=colour, markersize=13, markeredgewidth=2.0)
    for word, colour in (("path loss alone", COLOURS[1]), ("with gains; calibrated twin", COLOURS[0])):
        axes.plot([], [], "o", color=colour, markersize=3.5, label=word)
    axes.axvline(1.0, color=plotting.GREY, linewidth=0.8)
    axes.axvline(data.published["registered"]["factor"], color=plotting.GREY, linewidth=0.8, linestyle=":")
    axes.set_yticks(list(places.values()), list(places))
    axes.set(xscale="log", xlabel="RMSE on recorded readings / on the simulated twin; a dot per track, bar: median")
    axes.set_xticks(ticks := [0.5, 1.0, 1.5, 2.0, 3.0, 4.0], [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)
    plotting.legend_below(figure, (axes,))


FIGURES: Final[plotting.Drawings] = {"tracks": _tracks, "residuals": _residuals, "gap": _gap}
