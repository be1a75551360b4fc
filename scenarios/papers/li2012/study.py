"""Measures of figures 4 and 5 of Li (2012), over the first 20 steps of a run, or its first 20 reports; figures 3 to 6.

They need the table `estimates`; the bound on a fix needs `truth` and `nodes`. In the first five steps the window of the
grey model is not full. Variants are named 'tracker, nodes'. The paper's curves are not in its text: figures show only
the levels and ranges that it names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wsnsim.papers.toolkit import COLOURS, Data, Floats, computing, measured, metrics, plotting, quartiles

LOW, MIDDLE, HIGH = 200, 300, 400
"""Numbers of nodes."""
STEPS: Final = 20
WINDOW: Final = 5
SAMPLES: Final = 500


def mean_error(data: Data, variant: str) -> pd.Series:
    """The mean position error over the first 20 steps (m)."""
    return errors(data, variant).mean(axis=1)


def median_error(data: Data, variant: str) -> pd.Series:
    """The median position error over the first 20 steps (m)."""
    return errors(data, variant).median(axis=1)


def later_mean(data: Data, variant: str) -> pd.Series:
    """The mean position error over the steps 6 to 20 (m)."""
    return errors(data, variant).iloc[:, WINDOW:].mean(axis=1)


def later_median(data: Data, variant: str) -> pd.Series:
    """The median position error over the steps 6 to 20 (m)."""
    return errors(data, variant).iloc[:, WINDOW:].median(axis=1)


def start_excess(data: Data, variant: str) -> pd.Series:
    """The median error of the steps 1 to 5, less that of the steps 6 to 20 (m)."""
    return errors(data, variant).iloc[:, :WINDOW].median(axis=1) - later_median(data, variant)


def last_error(data: Data, variant: str) -> pd.Series:
    """The position error at the last step of a run (m)."""
    return data.of(variant, "estimates").sort_values("step").groupby("replicate")["error"].last()


def ranges(data: Data, variant: str) -> pd.Series:
    """The mean number of ranges behind the estimate of a step, over the first 20 steps."""
    return _first(data.of(variant, "estimates"), "readings").mean(axis=1)


def vain_growth(data: Data, variant: str) -> pd.Series:
    """The unnecessary wake-ups of a tracker in 20 steps at the highest density, less those at the lowest."""
    tracker = variant.rpartition(", ")[0]
    low, high = (data.of(f"{tracker}, {nodes}", "tracks").set_index("replicate") for nodes in (LOW, HIGH))
    return high["ineffective_twenty"].astype(np.float64) - low["ineffective_twenty"].astype(np.float64)


def least_delay(data: Data, variant: str) -> pd.Series:
    """The least of the first 20 steps' delays at the main node (s)."""
    return delays(data, variant).min(axis=1)


def greatest_delay(data: Data, variant: str) -> pd.Series:
    """The greatest of the first 20 steps' delays at the main node (s)."""
    return delays(data, variant).max(axis=1)


def least_report_delay(data: Data, variant: str) -> pd.Series:
    """The least of the first 20 reports' delays at the sink (s)."""
    return report_delays(data, variant).min(axis=1)


def greatest_report_delay(data: Data, variant: str) -> pd.Series:
    """The greatest of the first 20 reports' delays at the sink (s)."""
    return report_delays(data, variant).max(axis=1)


def fix_bound(data: Data, variant: str) -> pd.Series:
    """The Cramér-Rao bound (m) on a fix from one step's ranges of all nodes in reach, as root mean square over steps.

    Steps with fewer than three nodes in reach do not count. A filter that uses earlier ranges may do better.
    """
    squares = {number: pd.Series(np.trace(found, axis1=1, axis2=2)) for number, found in _fixes(data, variant)}
    return pd.Series({number: np.sqrt(each.mean()) for number, each in squares.items()})


def efficient_errors(data: Data, variant: str) -> Floats:
    """(20,) the median error (m) over runs, at the first steps, of Gaussian fixes that attain that bound."""
    normal = np.random.Generator(np.random.Philox(STEPS)).standard_normal((SAMPLES, 2))
    found = np.array([covariances[:STEPS] for _, covariances in _fixes(data, variant)])
    spreads = np.sqrt(np.linalg.eigvalsh(np.nan_to_num(found)))
    drawn = np.linalg.norm(spreads[:, :, None, :] * normal, axis=-1)
    known = np.isfinite(found[:, :, 0, 0])
    steps = range(drawn.shape[1])
    return np.array([metrics.median_error(drawn[known[:, step], step]) for step in steps])


def errors(data: Data, variant: str) -> pd.DataFrame:
    """(replicates, 20) the position errors of the first steps; NaN for a step without an estimate."""
    return _first(data.of(variant, "estimates"), "error")


def delays(data: Data, variant: str) -> pd.DataFrame:
    """(replicates, 20) the times from the first steps to their estimates at the main node (s)."""
    frame = data.of(variant, "estimates")
    return _first(frame.assign(delay=frame["issued"] - frame["time"]), "delay")


def report_delays(data: Data, variant: str) -> pd.DataFrame:
    """(replicates, up to 20) the times from a step to its estimate at the sink (s), of the first reported steps."""
    frame = data.of(variant, "estimates")
    every = data.scenario(variant)["sink"]["every"] / data.scenario(variant)["step"]
    due = frame[frame["step"] % round(every) == 0]
    return _first(due.assign(delay=due["received"] - due["time"]), "delay")


def _fixes(data: Data, variant: str) -> Iterator[tuple[int, Floats]]:
    """(replicate, (steps, 2, 2) the inverse Fisher information on the position from the ranges of all nodes in reach).

    NaN at a step with fewer than three nodes in reach.
    """
    sensor = data.scenario(variant)["sensor"]
    nodes = data.of(variant, "nodes").groupby("replicate")
    truths = data.of(variant, "truth")
    for number, truth in truths[truths["step"] > 0].groupby("replicate"):
        places = nodes.get_group(number)[["x", "y"]].to_numpy()
        offsets = places[None] - truth.sort_values("step")[["px", "py"]].to_numpy()[:, None]
        yield int(number), np.array([_covariance(each, sensor["reach"], sensor["sd"]) for each in offsets])


def _covariance(offsets: Floats, reach: float, sd: float) -> Floats:
    """(2, 2) the inverse Fisher information of ranges to the nodes in reach, NaN for fewer than three."""
    far = np.hypot(offsets[:, 0], offsets[:, 1])
    heard = (far <= reach) & (far > 0.0)
    if np.count_nonzero(heard) < metrics.ENOUGH_READINGS:
        return np.full((2, 2), np.nan)
    units = offsets[heard] / far[heard, None]
    return sd**2 * np.linalg.inv(units.T @ units).astype(np.float64)


def _first(frame: pd.DataFrame, column: str) -> pd.DataFrame:
    """(replicates, 20) a column at the first steps, in their order."""
    return frame.pivot(index="replicate", columns="step", values=column).iloc[:, :STEPS]


_FUNCTIONS: Final = (
    mean_error, median_error, later_mean, later_median, start_excess, last_error, ranges, vain_growth, least_delay,
    greatest_delay, least_report_delay, greatest_report_delay, fix_bound, computing,
)  # fmt: skip
MEASURES: Final = {measure.__name__: measure for measure in _FUNCTIONS}


LITERAL: Final = "gmtt, literal"
REPAIRED: Final = "gmtt, repaired"
PRINTED_AS: Final = {LITERAL: "gmtt"}
"""The name of a variant among the published values, where it is another."""
LOOK: Final[dict[str, dict[str, Any]]] = {
    LITERAL: {"color": COLOURS[0]},
    REPAIRED: {"color": COLOURS[5], "linestyle": "-."},
    "tsstp": {"color": COLOURS[1]},
    "tsstp low": {"color": COLOURS[4], "linestyle": (0, (4, 2))},
    "tsstp high": {"color": COLOURS[3], "linestyle": (0, (4, 2))},
    "cluster": {"color": COLOURS[2]},
    "ris": {"color": "#888888", "linestyle": "-."},
}
SAID: Final = {
    LITERAL: "GMTT, literal",
    REPAIRED: "GMTT, repaired",
    "tsstp": "TSSTP, mid",
    "tsstp low": "TSSTP, low",
    "tsstp high": "TSSTP, high",
    "cluster": "Cluster",
    "ris": "no node woken (RIS)",
}
AT: Final = (1, 5, 10, 15, 20)
BESIDE: Final = {"tsstp": 1.2, LITERAL: 2.0, "cluster": 1.2}
"""Position of a published range: steps after the last one."""
SHORT: Final = {"tsstp": "TSSTP", LITERAL: "GMTT", "cluster": "Cluster"}
FIX: Final[dict[str, Any]] = {"color": "#000000", "linewidth": 0.8}
"""The line of a reference that is no bound: a filter may use more than the ranges of one step."""
MARK: Final[dict[str, Any]] = {"marker": "o", "markersize": 3.5, "linewidth": 1.2, "capsize": 2.5}


def _figure_3(figure: Figure, data: Data) -> None:
    """The fraction of steps tracked, over the number of nodes."""
    columns = {"tracked": "one reading or more", "tracked_three": "three readings or more"}
    for axes, (column, words) in zip(figure.subplots(1, 2, sharey=True), columns.items(), strict=True):
        _over_nodes(axes, data, f"tracks_mean:{column}", tuple(LOOK))
        plotting.published_level(axes, data.published["tracked"], "published at many nodes: near 1")
        axes.set(title=f"in time, from {words}")
    figure.axes[0].set(ylabel="share of steps tracked", ylim=(None, 1.03))
    _legend(figure, f"means of {_runs(data)} runs, 95 % intervals")


def _figure_4(figure: Figure, data: Data) -> None:
    """The position error at the first 20 steps, at 300 nodes."""
    names = ("cluster", LITERAL, "tsstp")
    possible = pd.Series(efficient_errors(data, _at(MIDDLE, LITERAL)))
    for axes, name in zip(figure.subplots(1, 3, sharey=True), names, strict=True):
        found = errors(data, _at(MIDDLE, name))
        _band(axes, found, name)
        _line(axes, found.mean(), f"{SAID[name]}: mean", linestyle="--", linewidth=0.9, color=LOOK[name]["color"])
        if name == LITERAL:
            repaired = errors(data, _at(MIDDLE, REPAIRED))
            _line(axes, repaired.median(), f"{SAID[REPAIRED]}: median", linewidth=1.2, **LOOK[REPAIRED])
        _line(axes, possible, "an efficient fix of\none step's ranges: median", **FIX)
        level = data.published["error"][PRINTED_AS.get(name, name)]
        plotting.published_level(axes, level, f"published: about {level:g} m")
        axes.set(xlabel="step", xticks=AT, yscale="log", xlim=(0.5, STEPS + 0.5))
        plotting.plain_numbers(axes, (0.5, 1, 2, 5, 10, 20, 50))
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16))
    figure.axes[0].set_ylabel("position error [m]")
    words = f"{MIDDLE} nodes, {_runs(data)} runs; way-points have no density, so there is no posterior bound"
    figure.supxlabel(words, fontsize="medium")


def _figure_5(figure: Figure, data: Data) -> None:
    """The delay of the first 20 estimates, at the main node and at the sink, at 300 nodes."""
    every = round(_of(data, "sink")["every"] / data.scenario(data.variants[0])["step"])
    places = {
        "at the main node": (delays, "step"),
        "at the sink": (report_delays, "step" if every == 1 else "report"),
    }
    for axes, (place, (measure, counted)) in zip(figure.subplots(1, 2, sharey=True), places.items(), strict=True):
        for name in SHORT:
            ends = data.published["delay"][PRINTED_AS.get(name, name)]
            _band(axes, 1e3 * measure(data, _at(MIDDLE, name)), name)
            _published(axes, STEPS + BESIDE[name], ends, name)
        axes.set(title=place, xlabel=counted, xticks=AT, yscale="log", ylim=(8, 400), xlim=(0.5, None))
        plotting.plain_numbers(axes, (10, 20, 40, 60, 90, 200, 300))
    figure.axes[0].set_ylabel("delay [ms]")
    _legend(figure, f"{MIDDLE} nodes, {_runs(data)} runs")


def _figure_6(figure: Figure, data: Data) -> None:
    """Unnecessary wake-ups in 20 steps, and in 20 reports where these are more, over the number of nodes."""
    shown = {"ineffective_twenty": "in 20 steps"}
    scenario = data.scenario(data.variants[0])
    if scenario["duration"] - scenario["step"] == STEPS * scenario["sink"]["every"] != 20 * scenario["step"]:
        shown["ineffective"] = "in 20 reports"
    for axes, (column, words) in zip(figure.subplots(1, len(shown), squeeze=False)[0], shown.items(), strict=True):
        _over_nodes(axes, data, f"tracks_mean:{column}", tuple(name for name in LOOK if name != "ris"))
        axes.set(title=words, ylim=(0, None))
    figure.axes[0].set_ylabel("unnecessary wake-ups")
    _legend(figure, f"means of {_runs(data)} runs, 95 % intervals; published: TSSTP far above both, all growing")


def _over_nodes(axes: Axes, data: Data, measure: str, trackers: tuple[str, ...]) -> None:
    """One line for each tracker that was run."""
    for name in trackers:
        densities = sorted(nodes for tracker, nodes in map(_parted, data.variants) if tracker == name)
        found = [measured(data, _at(nodes, name), measure) for nodes in densities]
        if found:
            values, low, high = (np.array([getattr(one, key) for one in found]) for key in ("value", "low", "high"))
            shifted = np.array(densities) + 3.0 * (tuple(LOOK).index(name) - 3)
            axes.errorbar(shifted, values, [values - low, high - values], label=SAID[name], **MARK, **LOOK[name])
    axes.set(
        xlabel="nodes (markers set side by side)", xticks=sorted({nodes for _, nodes in map(_parted, data.variants)})
    )


def _band(axes: Axes, rows: pd.DataFrame, name: str) -> None:
    """The median over runs and the quartiles, at the steps with a value in any run."""
    known = rows.notna().any().to_numpy()
    low, middle, high = quartiles(rows.to_numpy()[:, known])
    x = 1 + np.flatnonzero(known)
    axes.plot(x, middle, linewidth=1.4, color=LOOK[name]["color"],
              label=f"{SAID[name]}: median and quartiles")  # fmt: skip
    axes.fill_between(x, low, high, color=LOOK[name]["color"], alpha=0.18, linewidth=0)


def _published(axes: Axes, x: float, ends: Mapping[str, float], name: str) -> None:
    """A published range of delays, as a bar beside the curves."""
    low, high = 1e3 * ends["least"], 1e3 * ends["greatest"]
    middle = (low + high) / 2.0
    axes.errorbar([x], [middle], [[middle - low], [high - middle]], color=LOOK[name]["color"], linestyle="none",
                  linewidth=2.5, capsize=4, label=f"{SHORT[name]}: published {low:g} to {high:g} ms")  # fmt: skip


def _line(axes: Axes, values: pd.Series, label: str, **look: Any) -> None:
    axes.plot(1 + np.arange(len(values)), values, label=label, **look)


def _legend(figure: Figure, title: str) -> None:
    """One legend for all panels."""
    plotting.legend_below(figure, figure.axes[:1], 4, title)


def _at(nodes: int, tracker: str) -> str:
    return f"{tracker}, {nodes}"


def _parted(variant: str) -> tuple[str, int]:
    """(the tracker, the number of nodes) of a variant."""
    tracker, _, nodes = variant.rpartition(", ")
    return tracker, int(nodes)


def _of(data: Data, role: str) -> Any:
    return data.scenario(data.variants[0])[role]


def _runs(data: Data) -> int:
    """Runs of each variant."""
    return len(data.lost(data.variants[0]))


FIGURES: Final[plotting.Drawings] = {
    "figure_3": _figure_3,
    "figure_4": _figure_4,
    "figure_5": _figure_5,
    "figure_6": _figure_6,
}
