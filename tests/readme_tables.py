"""The README's tables of the commercial radio and of the sleeping network, from campaigns in results/readme.

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
SLEEPERS = {
    "gmtt_literal": "gmtt, literal",
    "gmtt": "gmtt, repaired",
    "tsstp": "tsstp",
    "cluster": "cluster",
    "ris": "ris",
}
"""The scenarios of the tables of the sleeping network, and what `wsnsim reproduce li2012` calls them."""
FIRST = "gmtt_literal"
DENSITIES = (200, 300, 400)
RARELY = 300
"""Nodes of the table of one location every 10 s."""


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


def sleeping(tracks: pd.DataFrame, runs: pd.DataFrame) -> str:
    """One row per density and tracker, located every 2 s."""
    heads = ["nodes", "tracker", "steps tracked, % [95 %]", "by three ranges, %", "error",
             "latency at the head, at the sink", "reports at the sink, %", "unnecessary wake-ups in 20 steps",
             "called, and dismissed, per step"]  # fmt: skip
    rows = []
    for nodes in DENSITIES:
        for name, label in SLEEPERS.items():
            of, steps = _point(tracks, runs, name, nodes, 2.0)
            rows.append(
                [str(nodes) if name == FIRST else "", f"`{label}`" + ": nobody is woken" * (name == "ris"),
                 *_tracked(of), f"{_latency(of['delay'].median())}, {_latency(of['report_delay'].median())}",
                 f"{100 * (of['received'] / of['due']).mean():.0f}", _short(of["ineffective_twenty"].mean()),
                 _short((of["dismissed"] / steps).mean())]
            )  # fmt: skip
    return _markdown(heads, rows)


def sleeping_rarely(tracks: pd.DataFrame, runs: pd.DataFrame) -> str:
    """One row per tracker, located every 10 s."""
    heads = [f"{RARELY} nodes, every 10 s", "steps tracked, % [95 %]", "by three ranges, %", "error",
             "reacquisitions per run", "unnecessary wake-ups per step"]  # fmt: skip
    rows = []
    for name, label in SLEEPERS.items():
        of, steps = _point(tracks, runs, name, RARELY, 10.0)
        needless = (of["ineffective"] / steps).mean()
        rows.append([f"`{label}`", *_tracked(of), _short(of["reacquired"].mean()), _short(needless)])
    return _markdown(heads, rows)


TABLES: dict[str, tuple[tuple[str, ...], Callable[[pd.DataFrame, pd.DataFrame], str]]] = {
    "commercial_radio": (("compare", *RADIO_ROWS, "--no-bound", "--replicates", "6"), commercial_radio),
    "sleeping": (("sweep", "sleeping", "--replicates", "20"), sleeping),
    "sleeping_rarely": (("sweep", "sleeping", "--replicates", "20"), sleeping_rarely),
}
"""By the name of the block in the README."""


def _point(tracks: pd.DataFrame, runs: pd.DataFrame, name: str, nodes: int, step: float) -> tuple[pd.DataFrame, float]:
    """The tracks of one point of the sweep, and the steps of its runs."""
    of, run = (
        each[(each["scenario"] == name) & (each["deploy.nodes"] == nodes) & (each["step"] == step)]
        for each in (tracks, runs)
    )
    return of, float(run["steps"].max())


def _tracked(of: pd.DataFrame) -> list[str]:
    """Steps tracked with their interval, those by three ranges, and the error at these."""
    share = _with_interval(100 * of["tracked"], metrics.mean_error, "{:.1f}")
    return [share, f"{100 * of['tracked_three'].mean():.1f}", f"{of['median_error_three'].median():.2f}"]


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
