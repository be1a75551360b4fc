"""The measures and figures of the study plugin_name.

A measure is a function (data, variant) -> one value for each run, by replicate. A figure is a function (figure, data).
"""

from __future__ import annotations

from typing import Final

import pandas as pd
from matplotlib.figure import Figure

from wsnsim.papers.toolkit import COLOURS, Data, plotting

LOOKS: Final = {"ekf": plotting.Look("EKF", COLOURS[0]), "gpf": plotting.Look("Gaussian particle filter", COLOURS[1])}
SETTLED: Final = 1.0
"""Seconds after which errors count."""


def settled_error(data: Data, variant: str) -> pd.Series:
    """The mean position error (m) of each run after the first second."""
    estimates = data.of(variant, "estimates")
    return estimates[estimates["time"] > SETTLED].groupby("replicate")["error"].mean()


def errors(figure: Figure, data: Data) -> None:
    """Draw the RMSE over the runs at each step, a curve for each variant."""
    axes = figure.subplots()
    plotting.rmse_curves(axes, data, LOOKS, plotting.mean_and_lost(data))
    axes.set_ylabel("RMSE [m]")
    axes.legend()


MEASURES: Final = {"settled_error": settled_error}
FIGURES: Final = {"errors": errors}
