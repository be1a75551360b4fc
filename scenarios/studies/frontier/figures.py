"""The figure of information_driven beside the bound: its error over time, its consistency by distance from a wall."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, NullLocator
from matplotlib.transforms import Bbox

from wsnsim.papers.toolkit import BLUE, BOUND, COLOURS, VERMILLION, Data, Floats, metrics, plotting

from .bound import DIMENSIONS, nees_of_steps, squares, true_positions
from .strategies import LEAST_IN_TIME, MOST_LOST, NEAR, RADIOS, Strategy, concluded, front, limit, named, strategies

BIN: Final = 5.0
"""Metres of a bin of the distance from a wall."""
LEAST: Final = 50
"""Steps that a bin must have."""


def at_the_bound(figure: Figure, data: Data) -> None:
    """The RMSE over runs at each step beside the bound, and the mean NEES by distance from the nearest wall."""
    upper, lower = figure.subplots(2, 1)
    _errors(upper, data)
    _consistency(lower, data)


def _errors(axes: Axes, data: Data) -> None:
    variant = data.variants[0]
    found = squares(data, variant)
    for values, look in ((found.errors, {"color": BLUE, "label": "information_driven"}),
                         (found.bounds, {**BOUND, "label": "bound for all readings in range"})):  # fmt: skip
        axes.plot(found.times, metrics.per_step_rmse(np.sqrt(values)), **look)
    axes.set(yscale="log", xlabel="time [s]", ylabel="RMSE over runs [m]", xlim=(0.0, None))
    axes.set_title(f"{variant}, {len(found.runs)} runs", loc="left")
    axes.legend(frameon=False)


def _consistency(axes: Axes, data: Data) -> None:
    variant = data.variants[0]
    wall = data.scenario(variant)["motion"]["bound"]
    away = (wall - np.abs(true_positions(data, variant))).min(axis=2)
    bins = np.floor(away / BIN).astype(np.int64)
    for of, colour in zip(DIMENSIONS, (BLUE, VERMILLION), strict=True):
        values = nees_of_steps(data, variant, of)
        known = np.isfinite(values)
        places = [one for one in np.unique(bins[known]) if (known & (bins == one)).sum() >= LEAST]
        means = [values[known & (bins == one)].mean() / DIMENSIONS[of] for one in places]
        axes.plot((np.array(places) + 0.5) * BIN, means, ".-", color=colour, label=f"of the {of}")
    axes.axhline(1.0, color=plotting.GREY, linewidth=0.8)
    axes.axvline(0.0, color=plotting.GREY, linewidth=0.8, linestyle=":")
    axes.set(yscale="log", xlabel="distance of the target from the nearest wall [m]; negative: beyond it",
             ylabel="mean NEES per coordinate")  # fmt: skip
    axes.legend(frameon=False)


SHORT: Final = {
    "Gaussian handover": "G",
    "all readings": "all",
    "own readings": "own",
    "greedy": "greedy",
    "nearest": "nearest",
    "iterated": "iterated",
    "appointed": "appointed",
    "fair": "fair",
    "frugal": "frugal",
}
KEY: Final = (
    "named: information_driven, and the Pareto front of the others, also if one run of ten may lose the target\n"
    "fair, frugal: settings that a sweep on other seeds has chosen, otherwise the defaults;  appointed: clusters that\n"
    "the head appoints from its prediction"
)
CHOSEN_NAMES: Final = {"fair": "fair settings", "frugal": "frugal settings"}
DEFAULTS: Final = "defaults"
RADIO_NAMES: Final = {
    "CSMA": "CSMA, one packet in a frame",
    "CSMA packed": "CSMA, nine packets in a frame",
    "slots": "slots, nine packets in a frame",
    "10 % awake": "slots, 10 % of the nodes awake",
    "3 % awake": "slots, 3 % of the nodes awake",
}
WIDTH: Final = 105
"""Characters in a line of a title."""
SIDE: Final = 6.0
"""Size of a marker (points)."""
DISTANCES: Final = (7.0, 12.0, 18.0, 26.0, 36.0, 48.0, 62.0, 78.0, 96.0, 116.0, 140.0, 170.0, 205.0, 245.0)
"""Distances (points) from a marker to its label; the first free place is used."""
LETTERS: Final = 7.5
"""Font size of a label (points)."""
PAD: Final = 1.0
"""Margin (points) above and below a label; twice as much on either side."""
LEADING: Final = 8.0
"""Distance (points) above which a line leads to the label."""


def _frontier(figure: Figure, data: Data) -> None:
    """Median RMSE of a run against the network's energy, on the ideal and on a realistic radio."""
    runs = data.manifest.points[0].replicates
    about = f"{runs} runs of {float(data.scenario(data.variants[0])['duration']):g} s each"
    draw_strategies(figure, strategies(data), limit(data), about)


def draw_strategies(figure: Figure, found: Sequence[Strategy], bound: float, about: str) -> None:
    """Draw the same from the figures of the strategies and the bound (m). `about` names the runs.

    Those that `named` gives have names.
    """
    panels = figure.subplots(2, 1, height_ratios=(1.0, 1.0))
    for axes, radio in zip(panels, RADIOS, strict=True):
        here = [one for one in found if one.radio == radio]
        conclusion = concluded(radio, here, bound)
        _panel(axes, here, bound)
        axes.set_title(f"{radio} radio, {about}\n{textwrap.fill(conclusion.partition(', ')[2], WIDTH)}", loc="left")
    panels[-1].set_xlabel(f"energy of the network in a run [J], mean of the runs\n\n{KEY}")
    figure.draw_without_rendering()
    for axes, radio in zip(panels, RADIOS, strict=True):
        here = [one for one in found if one.radio == radio]
        colours, kept = _colours(here), named(here)
        names = [short(one.variant) if one in kept else "" for one in here]
        label(axes, [(one.energy, one.rmse) for one in here], names, [colours[_group(one)] for one in here],
              (bound, NEAR * bound))  # fmt: skip


def short(variant: str) -> str:
    """'ideal: pf, all readings, fair' -> 'pf all fair'."""
    kind, *words = variant.partition(": ")[2].split(", ")
    return " ".join([kind, *(SHORT[word] for word in words)])


def _panel(axes: Axes, found: Sequence[Strategy], bound: float) -> None:
    colours = _colours(found)
    for one in found:
        if math.isfinite(one.low):
            axes.plot([one.energy] * 2, [one.low, one.high], color=colours[_group(one)], linewidth=0.8, alpha=0.45)
        axes.plot(one.energy, one.rmse, linestyle="", markersize=SIDE, **_look(one, colours[_group(one)]))
    _scale(axes, found, bound)
    _front(axes, found)
    axes.axhline(bound, **BOUND)
    axes.axhline(NEAR * bound, **{**BOUND, "linestyle": "-."})
    axes.set_ylabel("RMSE of a run [m], median of the runs and its 95 % interval")
    axes.legend(handles=[*_legend(colours)], loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)


def _group(one: Strategy) -> str:
    """The group of a colour: the choice of settings on the ideal radio, the kind of radio on a realistic one."""
    if one.radio == RADIOS[0]:
        return CHOSEN_NAMES.get(one.variant.rpartition(", ")[2], DEFAULTS)
    return RADIO_NAMES[one.air]


def _colours(found: Sequence[Strategy]) -> dict[str, str]:
    """The colour of each group, in the order of their first strategies."""
    return dict(zip(dict.fromkeys(map(_group, found)), COLOURS, strict=False))


def _look(one: Strategy, colour: str) -> dict[str, Any]:
    return {
        "marker": "o" if one.in_time >= LEAST_IN_TIME else "D",
        "markeredgecolor": colour,
        "markerfacecolor": colour if one.lost <= MOST_LOST else "white",
    }


def _scale(axes: Axes, found: Sequence[Strategy], bound: float) -> None:
    """Logarithmic axes with space for labels on either side; intervals may be cut."""
    energies, errors = (np.array([getattr(one, name) for one in found]) for name in ("energy", "rmse"))
    errors = errors[np.isfinite(errors)]
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(energies.min() / 1.5, energies.max() * 1.9)
    axes.set_ylim(bound / 1.3, errors.max(initial=bound) * 1.6)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())


def _front(axes: Axes, found: Sequence[Strategy]) -> None:
    """The Pareto front."""
    best = sorted(itertools.compress(((one.energy, one.rmse) for one in found), front(found)))
    if best:
        axes.step(*np.array(best).T, where="post", color=plotting.GREY, linewidth=1.4, zorder=1)
        axes.plot(
            *np.array(best).T, "o", markersize=SIDE + 5, markerfacecolor="none", markeredgecolor=plotting.GREY, zorder=1
        )


def _legend(colours: dict[str, str]) -> Iterator[Line2D]:
    def mark(text: str, **how: Any) -> Line2D:
        return Line2D([], [], **{"linestyle": "", "marker": "o", "color": plotting.GREY, **how}, label=text)

    for text, colour in colours.items():
        yield mark(text, color=colour)
    lost, late = f"{100 * MOST_LOST:.0f} %", f"{100 * LEAST_IN_TIME:.0f} %"
    yield mark(f"hollow: more than {lost} of the runs\nlose the target, or diverge", markerfacecolor="white")
    yield mark(f"diamond: fewer than {late} of the steps\nhave an estimate in time", marker="D")
    yield mark("ring and line: Pareto front of\nthose that are neither", markersize=SIDE + 4,
               markerfacecolor="none", linestyle="-")  # fmt: skip
    yield Line2D(
        [], [], **BOUND, label="trajectory-conditional bound, all measurements\nin range, median over trajectories"
    )
    yield Line2D([], [], **{**BOUND, "linestyle": "-."}, label=f"{NEAR:g} times the bound")


def label(
    axes: Axes, points: Sequence[tuple[float, float]], words: Sequence[str], colours: Sequence[str],
    levels: Sequence[float] = (),
) -> list[Text]:  # fmt: skip
    """Write names beside their points, as near as possible: none on another name, a marker or a line at a level.

    The figure must have been laid out. A point whose word is empty or that is not finite has no name, nor one without
    free space around it.
    """
    figure: Any = axes.get_figure()
    renderer, scale = figure.canvas.get_renderer(), figure.dpi / 72.0  # pixels in a point
    pixels = axes.transData.transform(points)
    known = np.flatnonzero(np.isfinite(pixels).all(axis=1)).tolist()
    taken = [Bbox([pixels[i], pixels[i]]).padded(SIDE * scale / 2.0) for i in known]
    for _, height in axes.transData.transform([(points[0][0], level) for level in levels]) if levels else ():
        taken.append(Bbox([(axes.bbox.x0, height - scale), (axes.bbox.x1, height + scale)]))
    written = []
    for i in sorted(filter(lambda i: words[i], known), key=lambda i: (*pixels[i], words[i])):
        text = _annotation(axes, words[i], points[i], colours[i])
        text.update_positions(renderer)
        box = Text.get_window_extent(text, renderer).padded(2.0 * PAD * scale, PAD * scale)
        places = ((offset, box.translated(*(scale * offset))) for offset in _offsets(box.size / scale))
        free = [(offset, place) for offset, place in places if _is_free(place, taken, axes.bbox)]
        own = ((offset, place) for offset, place in free if _gap(place, pixels[i]) <= _gap(place, *pixels[known]))
        if not free:
            text.remove()
            continue
        offset, place = next(own, free[0])
        taken.append(place)
        text.set_position(offset)
        text.arrow_patch.set_visible(_gap(place, pixels[i]) > LEADING * scale)
        written.append(text)
    return written


def _annotation(axes: Axes, word: str, point: tuple[float, float], colour: str) -> Any:
    """A name on its point, with a leading line that appears when the name is moved."""
    text = axes.annotate(
        word, point, xytext=(0.0, 0.0), textcoords="offset points", ha="center", va="center", fontsize=LETTERS,
        color=colour, path_effects=[withStroke(linewidth=2.0, foreground="white")],
        arrowprops={"arrowstyle": "-", "color": plotting.GREY, "linewidth": 0.5, "shrinkA": 0.0, "shrinkB": 3.0},
    )  # fmt: skip
    text.set_in_layout(False)
    return text


def _offsets(size: Floats) -> Iterator[Floats]:
    """(dx, dy) in points from a marker to the middle of a label: near ones first, right before left."""
    turns = [0, 25, -25, 50, -50, 180, 155, -155, 90, -90, 130, -130]
    for distance, turn in itertools.product(DISTANCES, turns):
        direction = np.round([math.cos(math.radians(turn)), math.sin(math.radians(turn))], 6)
        yield distance * direction + np.sign(direction) * size / (2.0, 4.0)


def _is_free(box: Bbox, taken: Sequence[Bbox], inside: Bbox) -> bool:
    within = box.x0 >= inside.x0 and box.x1 <= inside.x1 and box.y0 >= inside.y0 and box.y1 <= inside.y1
    return within and not any(box.overlaps(other) for other in taken)


def _gap(box: Bbox, *pixels: Floats) -> float:
    """Distance (pixels) between a box and the nearest of some points."""
    return float(np.linalg.norm(pixels - np.clip(pixels, box.min, box.max), axis=1).min())


FIGURES: Final[plotting.Drawings] = {"frontier": _frontier, "at_the_bound": at_the_bound}
