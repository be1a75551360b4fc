"""The table of docs/papers/commercial_radio.md, from a campaign in results/readme.

TABLES[block] -> (words of the `wsnsim` command that runs the campaign, table(tracks, runs) -> Markdown)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from wsnsim.analysis.quantities import interval
from wsnsim.base import metrics

RADIO_ROWS = {
    "pso_mhpf": "`pso_mhpf`, ideal channel",
    "pso_mhpf_real": "`pso_mhpf_real`",
    "pso_mhpf_packed": "`pso_mhpf_packed`: nine packets a frame, Gaussian handover",
    "ipf_real": "`ipf_real`",
    "ppf_real": "`ppf_real`",
    "central_pf_real": "`central_pf_real`: every reading to one head, hop by hop",
    "ekf_real": "`ekf_real`: slots, four-packet handover, reports to a sink",
}
"""The scenarios of the table, and what its rows call them."""


def commercial_radio(tracks: pd.DataFrame, runs: pd.DataFrame) -> str:
    """One row per scenario: estimates, latency, error, losses and energy."""
    steps = int(runs["steps"].max())
    heads = ["scenario", f"steps with an estimate, of {steps}", "of these late", "median latency",
             "median per-run RMSE [95 %], m", "tracks lost at the end, at any time", "network energy, J"]  # fmt: skip
    rows = []
    for name, label in RADIO_ROWS.items():
        of, run = tracks[tracks["scenario"] == name], runs[runs["scenario"] == name]
        late = of["late"] - (run["steps"].max() - of["reports"])
        lost, ever = int(of["lost"].sum()), int((of["losses"] > 0).sum())
        rows.append(
            [label, _short(of["reports"].mean()), _short(late.mean()), _latency(of["delay"].median()),
             _with_interval(run["rmse"], metrics.median_error, "{:.3g}"), f"{lost}, {ever} of {len(of)}",
             _short(run["energy"].mean())]
        )  # fmt: skip
    return _markdown(heads, rows)


TABLES: dict[str, tuple[tuple[str, ...], Callable[[pd.DataFrame, pd.DataFrame], str]]] = {
    "commercial_radio": (("compare", *RADIO_ROWS, "--no-bound", "--replicates", "6"), commercial_radio),
}
"""By the name of the block of the page."""


def _with_interval(values: pd.Series, statistic: Callable[..., float], form: str) -> str:
    """A statistic over runs with its 95 % bootstrap interval, if there are runs enough; a dash if it is unknown."""
    samples = values.to_numpy(dtype=np.float64)
    if not np.isfinite(samples).any():
        return "-"
    low, high = interval(samples, statistic)
    bounds = f" [{form.format(low)}, {form.format(high)}]" if np.isfinite(low) else ""
    return form.format(statistic(samples)) + bounds


def _short(value: float) -> str:
    """Two digits below ten, whole numbers from hundred on."""
    return "0" if value == 0 else f"{value:.2g}" if value < 100 else f"{value:.0f}"


def _latency(seconds: float) -> str:
    """A latency with a fitting unit; a dash if nothing arrived."""
    if not np.isfinite(seconds):
        return "-"
    return "0" if seconds == 0 else f"{seconds:.3g} s" if seconds >= 1 else f"{1000 * seconds:.3g} ms"


def _markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in (heads, ["---"] * len(heads), *rows))
