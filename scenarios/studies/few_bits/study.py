"""Measures of readings of few bits, the registered tests, and their answers.

All ratios are geometric means over runs: of the logarithms of paired ratios, the mean with Student's 95 % interval.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from wsnsim.papers.toolkit import COLOURS, Data, Floats, OwnMeasure, plotting, statistics

TRAFFIC: Final = ("tx_electronics", "tx_amplifier", "rx", "overhear")
"""Causes of what is spent on frames, strobes and acknowledgements on the air, by whoever hears them."""
LABELS: Final = {"full": "full", "fixed": "fixed cells", "adaptive": "adaptive thresholds"}


def traffic(data: Data, variant: str) -> pd.Series:
    """The energy (J) of sending, receiving and overhearing of each run, by replicate; needs the table `energy`."""
    table = data.of(variant, "energy")
    return table[table["cause"].isin(TRAFFIC)].groupby("replicate")["joules"].sum()


def error(data: Data, variant: str) -> pd.Series:
    """The RMSE (m) of each run, by replicate."""
    return data.of_runs(variant, "rmse")


def energy(data: Data, variant: str) -> pd.Series:
    """The energy (J) of the network in each run, by replicate."""
    return data.of_runs(variant, "energy")


MEASURES: Final[dict[str, OwnMeasure]] = {"traffic": traffic, "error": error, "energy": energy}


class Ratio(NamedTuple):
    """A ratio of two variants with its 95 % interval, and the runs that both have."""

    value: float
    low: float
    high: float
    runs: int


def logs(data: Data, one: str, other: str, measure: str) -> Floats:
    """(n,) the logarithms of the paired ratios of a measure, over the runs in which both have a value."""
    pairs = MEASURES[measure](data, one) / MEASURES[measure](data, other)
    found: Floats = np.log(pairs.dropna().to_numpy(dtype=np.float64))
    return found


def ratio(data: Data, one: str, other: str, measure: str) -> Ratio:
    """The geometric mean of the paired ratios of a measure; NaN with fewer than two runs."""
    found = logs(data, one, other, measure)
    if len(found) < 2:
        return Ratio(np.nan, np.nan, np.nan, len(found))
    half = stats.t.ppf(0.975, len(found) - 1) * stats.sem(found)
    value, low, high = np.exp([found.mean(), found.mean() - half, found.mean() + half]).tolist()
    return Ratio(value, low, high, len(found))


def tested(data: Data) -> list[dict[str, Any]]:
    """The registered tests with their ratios, p-values (t-test on logarithms), those of Holm's family, and answers."""
    rows = []
    for test in data.registered["tests"]:
        pair = (test["of"], test["over"], test["measure"])
        threshold = test.get("above", test.get("below"))
        found = logs(data, *pair) - np.log(threshold)
        p = float(stats.ttest_1samp(found, 0.0).pvalue) if len(found) > 1 else np.nan
        rows.append({**test, "found": ratio(data, *pair), "p": p})
    for row, p in zip(rows, statistics.holm([row["p"] for row in rows]), strict=True):
        row |= {"p_holm": p, "answer": _answer(row, p <= data.registered["level"])}
    return rows


def _answer(row: dict[str, Any], differs: bool) -> str:
    if not differs:
        return "undecided"
    holds = row["found"].value > row["above"] if "above" in row else row["found"].value < row["below"]
    return "yes" if holds else "no"


def words(row: dict[str, Any]) -> str:
    """A test in words: '1: xmac 125: pf, fixed 1: energy over that of xmac 125: pf, full > 0.98'."""
    limit = f"> {row['above']:g}" if "above" in row else f"< {row['below']:g}"
    return f"{row['number']}: {row['of']}: {row['measure']} over that of {row['over']} {limit}"


def answers(data: Data) -> list[str]:
    """A line for each registered test."""
    return [
        f"registered {words(row)}: {row['answer']}"
        + (
            f", {row['found'].value:.3f} [{row['found'].low:.3f}, {row['found'].high:.3f}]"
            if row["p"] == row["p"]
            else ""
        )
        for row in tested(data)
    ]


def figure(figure: Figure, data: Data) -> None:
    """Draw, for each radio, the error against the energy of traffic, both over those of readings in full."""
    radios = list(dict.fromkeys(name.partition(":")[0] for name in data.variants))
    panels = figure.subplots(1, len(radios), sharey=True)
    for axes, radio in zip(panels, radios, strict=True):
        full = f"{radio}: pf, full"
        for colour, kind in zip(COLOURS, ("fixed", "adaptive"), strict=False):
            names = [name for name in data.variants if name.startswith(f"{radio}: pf, {kind}")]
            names.sort(key=lambda name: int(name.split()[-1]))
            x, y = (np.array([ratio(data, name, full, measure) for name in names]) for measure in ("traffic", "error"))
            bars = [np.abs(each[:, [1, 2]] - each[:, :1]).T for each in (x, y)]
            axes.errorbar(x[:, 0], y[:, 0], xerr=bars[0], yerr=bars[1], color=colour, marker="o", label=LABELS[kind])
            for name, *place in zip(names, x[:, 0], y[:, 0], strict=True):
                axes.annotate(f" {name.split()[-1]}", place, color=colour)
        axes.plot([1.0], [1.0], "k*", markersize=9, label=LABELS["full"])
        axes.set(title=radio, xlabel="energy of traffic / that of full readings", yscale="log")
        plotting.plain_numbers(axes)
    panels[0].set_ylabel("RMSE / that of full readings")
    panels[0].legend(frameon=False)


FIGURES: Final = {"bits": figure}
SUMMARIES: Final = {"answers": answers}
