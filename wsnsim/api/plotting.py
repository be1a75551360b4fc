"""Plots of results and of result files, by one function: `wsnsim.plot`."""

from __future__ import annotations

import os
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wsnsim.api.result import Result
from wsnsim.api.result_plots import ResultPlots
from wsnsim.base.errors import UsageError, shown_value

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot(result: Result | str | Path, what: str = "track", *, ax: Axes | None = None, **options: Any) -> Axes:
    """Draw one plot of a result, or of a result file, and return its axes.

    Examples::

        plot("results/pso_mhpf.h5", "error")
        plot(wsnsim.simulate("pso_mhpf"), "states", column="vx")

    It is `result.plot(what, ...)` for results and files alike.

    Args:
        result: what `simulate` or `run` returned, or the path of a result file.
        what: 'track', 'states', 'error', 'consistency', 'energy' or 'particles'.
        ax: matplotlib axes to draw on; by default those of a new figure.
        options: what the plot of this name takes beside `ax`, such as `replicate` and `target` of 'track', `column` of
            'states', `step` of 'particles' (see `ResultPlots`).

    Raises:
        UsageError: there is no such plot, option, column, run or target, or `result` is neither a result nor a path.
        ResultError: the file cannot be read, or a table that the plot needs was not recorded.
    """
    if isinstance(result, Result):
        return result.plot(what, ax, **options)
    if not isinstance(result, str | os.PathLike):
        raise UsageError(
            f"result: expected what wsnsim.simulate or wsnsim.run returned, or the path of a result file, got "
            f"{shown_value(result)}"
        )
    path = Path(result)
    return ResultPlots(lambda: nullcontext(path))(what, ax, **options)
