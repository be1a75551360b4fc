"""Measures of late readings, the registered tests, and their answers.

A run's error is the RMSE of its estimates as they were issued. Tests are made on logarithms of paired ratios: of a run,
the mean over the radios. What lateness costs is ln(error, ignore / error, radios that always listen); what comes back
is ln(error, ignore / error, of a way). Their share is the ratio of the means over runs, with a bootstrap interval; it
is tested by the mean of (what comes back - threshold * what lateness costs). Runs that lack a value are left out.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

from wsnsim.papers.toolkit import COLOURS, Data, Floats, statistics

WAYS: Final = ("refilter", "retrodict", "wait")
LABELS: Final = {"refilter": "filtered again", "retrodict": "retrodicted", "wait": "waited for"}
INTERVALS: Final = (500, 1000)
DRAWS: Final = 10_000
COLUMNS: Final = {"error": "rmse", "energy": "energy"}


class Found(NamedTuple):
    """A value with its 95 % interval, and the number of runs."""

    value: float
    low: float
    high: float
    runs: int


def ratios(data: Data, one: str, other: str, measure: str) -> pd.Series:
    """ln(one / other) of each run, by replicate."""
    column = COLUMNS[measure]
    return np.log(data.of_runs(one, column) / data.of_runs(other, column))


def pooled(data: Data, interval: int, of: str, over: str, measure: str, radios: list[str]) -> pd.Series:
    """The mean over radios of ln(of / over) of each run; `over` is a way, or 'timely' for radios that always listen."""
    others = data.registered["radios"]
    each = [
        ratios(data, f"{radio} {interval}, {of}", others[radio] if over == "timely" else f"{radio} {interval}, {over}",
               measure)
        for radio in radios
    ]  # fmt: skip
    return pd.concat(each, axis=1).mean(axis=1, skipna=False)


def cost_and_back(data: Data, interval: int, of: str, radios: list[str]) -> Floats:
    """(n, 2) what lateness costs and what comes back by a way, of each run that has both."""
    cost = pooled(data, interval, "ignore", "timely", "error", radios)
    back = -pooled(data, interval, of, "ignore", "error", radios)
    found: Floats = pd.concat([cost, back], axis=1).dropna().to_numpy(dtype=np.float64)
    return found


def ratio(data: Data, interval: int, of: str, over: str, measure: str, radios: list[str]) -> Found:
    """The geometric mean of paired ratios with Student's 95 % interval; NaN with fewer than two runs."""
    found = pooled(data, interval, of, over, measure, radios).dropna().to_numpy(dtype=np.float64)
    if len(found) < 2:
        return Found(np.nan, np.nan, np.nan, len(found))
    half = stats.t.ppf(0.975, len(found) - 1) * stats.sem(found)
    value, low, high = np.exp([found.mean(), found.mean() - half, found.mean() + half]).tolist()
    return Found(value, low, high, len(found))


def share(data: Data, interval: int, of: str, radios: list[str]) -> Found:
    """The share of what lateness costs that comes back, with a percentile interval of resampled runs."""
    pairs = cost_and_back(data, interval, of, radios)
    if len(pairs) < 2:
        return Found(np.nan, np.nan, np.nan, len(pairs))
    rows = np.random.default_rng(1).integers(0, len(pairs), (DRAWS, len(pairs)))
    cost, back = pairs[rows].mean(axis=1).T
    low, high = np.percentile(back / cost, [2.5, 97.5]).tolist()
    return Found(float(pairs[:, 1].mean() / pairs[:, 0].mean()), low, high, len(pairs))


def tested(data: Data) -> list[dict[str, Any]]:
    """The registered tests with what was found, p-values (t-test), those of Holm's family, and answers."""
    rows, radios = [], list(data.registered["radios"])
    for test in data.registered["tests"]:
        threshold = test.get("above", test.get("below"))
        if test["measure"] == "share":
            pairs = cost_and_back(data, test["interval"], test["of"], radios)
            found, beyond = share(data, test["interval"], test["of"], radios), pairs[:, 1] - threshold * pairs[:, 0]
        else:
            pair = test["interval"], test["of"], test["over"], test["measure"], radios
            found, beyond = ratio(data, *pair), pooled(data, *pair).dropna().to_numpy() - np.log(threshold)
        p = float(stats.ttest_1samp(beyond, 0.0).pvalue) if len(beyond) > 1 else np.nan
        rows.append({**test, "found": found, "p": p, "beyond": float(beyond.mean()) if len(beyond) else np.nan})
    for row, p in zip(rows, statistics.holm([row["p"] for row in rows]), strict=True):
        holds = row["beyond"] > 0.0 if "above" in row else row["beyond"] < 0.0
        row |= {"p_holm": p, "answer": "undecided" if not p <= data.registered["level"] else "yes" if holds else "no"}
    return rows


def words(row: dict[str, Any]) -> str:
    """A test in words: '3: at 500 ms: energy of refilter over that of ignore < 1.02'."""
    limit = f"> {row['above']:g}" if "above" in row else f"< {row['below']:g}"
    what = f"{row['measure']} of {row['of']} over that of {row['over']}" if "over" in row else (
        f"share of the error that comes back by {row['of']}"
    )  # fmt: skip
    return f"{row['number']}: at {row['interval']} ms: {what} {limit}"


def answers(data: Data) -> list[str]:
    """A line for each registered test."""
    return [
        f"registered {words(row)}: {row['answer']}"
        + (", {:.3f} [{:.3f}, {:.3f}]".format(*row["found"][:3]) if row["p"] == row["p"] else "")
        for row in tested(data)
    ]


def figure(figure: Figure, data: Data) -> None:
    """Draw, for each radio and interval, the error of each way over that of ignoring late readings."""
    points = [(radio, interval) for radio in data.registered["radios"] for interval in INTERVALS]
    axes = figure.subplots()
    for shift, (way, colour) in enumerate(zip(WAYS, COLOURS, strict=False)):
        found = np.array([ratio(data, interval, way, "ignore", "error", [radio]) for radio, interval in points])
        bars = np.abs(found[:, [1, 2]] - found[:, :1]).T
        at = np.arange(len(points)) + 0.2 * (shift - 1)
        axes.errorbar(at, found[:, 0], yerr=bars, color=colour, fmt="o", label=LABELS[way])
    axes.axhline(1.0, color="k", linewidth=0.8)
    axes.set(ylabel="RMSE / that of ignoring")
    axes.set_xticks(range(len(points)), [f"{radio}\n{interval} ms" for radio, interval in points])
    axes.legend(frameon=False)


FIGURES: Final = {"late": figure}
SUMMARIES: Final = {"answers": answers}
