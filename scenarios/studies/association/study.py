"""Measures of trackers of several targets over radios, the registered tests, and their answers.

A test compares two variants in the same runs: `over` by the geometric mean of paired ratios, `less` by the mean of
paired differences, each with Student's 95 % interval.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from wsnsim.papers.toolkit import COLOURS, Data, Floats, OwnMeasure, statistics

TRAFFIC: Final = ("tx_electronics", "tx_amplifier", "rx", "overhear")
"""Causes of what is spent on frames, strobes and acknowledgements on the air, by whoever hears them."""
KINDS: Final = ("nearest_neighbour", "gnn", "jpda", "lmb", "mht")
COLUMNS: Final = ("gospa", "gospa_localisation", "gospa_missed", "gospa_false", "ospa2", "completeness", "switches",
                  "track_life", "time_to_confirm", "false_tracks", "energy")  # fmt: skip
"""Columns of the table `runs` that are measures as they stand."""


def traffic(data: Data, variant: str) -> pd.Series:
    """The energy (J) of sending, receiving and overhearing of each run, by replicate; needs the table `energy`."""
    table = data.of(variant, "energy")
    return table[table["cause"].isin(TRAFFIC)].groupby("replicate")["joules"].sum()


def latency(data: Data, variant: str) -> pd.Series:
    """The latency (s) at the cluster head: of each run the mean over targets of their medians, by replicate."""
    return data.of(variant, "tracks").groupby("replicate")["delay"].mean()


MEASURES: Final[dict[str, OwnMeasure]] = {"traffic": traffic, "latency": latency}


def values(data: Data, variant: str, measure: str) -> pd.Series:
    """A measure of each run that has a value, by replicate."""
    return (MEASURES[measure](data, variant) if measure in MEASURES else data.of_runs(variant, measure)).dropna()


class Found(NamedTuple):
    """A mean with its 95 % interval, and the number of runs that have a value."""

    value: float
    low: float
    high: float
    runs: int


def mean(found: Floats) -> Found:
    """The mean of values (n,) with Student's interval; NaN with fewer than two."""
    if len(found) < 2:
        return Found(np.nan, np.nan, np.nan, len(found))
    half, value = stats.t.ppf(0.975, len(found) - 1) * stats.sem(found), float(found.mean())
    return Found(value, value - half, value + half, len(found))


def paired(data: Data, test: dict[str, Any]) -> tuple[Floats, Found]:
    """(n,) what is tested against zero, and what is shown: a ratio or a difference."""
    ratio, threshold = "over" in test, float(test["above" if "above" in test else "below"])
    one, other = (values(data, each, test["measure"]) for each in (test["of"], test["over" if ratio else "less"]))
    compared: Floats = (np.log(one / other) if ratio else one - other).dropna().to_numpy(dtype=np.float64)
    found = mean(compared)
    value, low, high = np.exp(found[:3]).tolist() if ratio else found[:3]
    shown = Found(value, low, high, found.runs)
    return compared - (np.log(threshold) if ratio else threshold), shown


def tested(data: Data) -> list[dict[str, Any]]:
    """The registered tests with what was found, p-values (t-test), those of Holm's family, and answers."""
    rows = []
    for test in data.registered["tests"]:
        against, found = paired(data, test)
        rows.append({**test, "found": found, "p": _p(against)})
    for row, p in zip(rows, statistics.holm([row["p"] for row in rows]), strict=True):
        row |= {"p_holm": p, "answer": _answer(row, p <= data.registered["level"])}
    return rows


def _p(against: Floats) -> float:
    """Of the two-sided t-test against zero; 0 or 1 where all values are equal, NaN with fewer than two."""
    if len(against) < 2:
        return float("nan")
    return float(stats.ttest_1samp(against, 0.0).pvalue) if np.ptp(against) > 0.0 else float(against[0] == 0.0)


def _answer(row: dict[str, Any], differs: bool) -> str:
    if not differs:
        return "undecided"
    holds = row["found"].value > row["above"] if "above" in row else row["found"].value < row["below"]
    return "yes" if holds else "no"


def words(row: dict[str, Any]) -> str:
    """A test in words: '1: ideal, 0.7, 1: gnn: switches less that of ideal, 0.7, 1: jpda > 1'."""
    limit = f"> {row['above']:g}" if "above" in row else f"< {row['below']:g}"
    how = "over" if "over" in row else "less"
    return f"{row['number']}: {row['of']}: {row['measure']} {how} that of {row[how]} {limit}"


def answers(data: Data) -> list[str]:
    """A line for each registered test."""
    lines = []
    for row in tested(data):
        found = "" if np.isnan(row["p"]) else ", {:.3f} [{:.3f}, {:.3f}]".format(*row["found"])
        lines.append(f"registered {words(row)}: {row['answer']}{found}")
    return lines


def figure(figure: Figure, data: Data) -> None:
    """Draw GOSPA against the energy of traffic and against latency, of all trackers over each radio."""
    shown = {"ideal, 0.7, 1": "o", "csma, 0.7, 1": "s", "xmac, 0.7, 1": "^", "moving ideal, 0.7, 1": "D"}
    labels = {"traffic": "energy of traffic [J]", "latency": "latency at the cluster head [s]"}
    for axes, (measure, label) in zip(figure.subplots(1, 2, sharey=True), labels.items(), strict=True):
        for colour, kind in zip(COLOURS, KINDS, strict=False):
            for cell, marker in shown.items():
                x, y = (mean(values(data, f"{cell}: {kind}", each).to_numpy(dtype=np.float64))
                        for each in (measure, "gospa"))  # fmt: skip
                axes.errorbar(x.value, y.value, yerr=y.high - y.value, color=colour, marker=marker)
            axes.plot([], [], color=colour, label=kind)
        for cell, marker in shown.items():
            axes.plot([], [], "k", marker=marker, linestyle="", label=cell.partition(",")[0])
        axes.set(xlabel=label, xscale="log", ylim=(0.0, None))
    figure.axes[0].set_ylabel("GOSPA [m]")
    figure.axes[1].legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))


FIGURES: Final = {"joules": figure}
SUMMARIES: Final = {"answers": answers}
