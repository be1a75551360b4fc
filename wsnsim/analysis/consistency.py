"""Consistency of a filter: whether its errors are as large as its covariances say, from the files of a result.

    step_consistency(path, "nees" | "nis" | "state") -> StepConsistency        state_nees(path) -> DataFrame

NEES is eᵀ P⁻¹ e of an estimation error e with the estimated covariance P, NIS is νᵀ S⁻¹ ν of an innovation. Both are
given per degree of freedom: 1 if the filter is consistent, above 1 if it is overconfident, below 1 if it is cautious.

If the posterior is Gaussian, the NEES of independent runs at one step sums to a χ² variable, and so does the NIS. The
interval of a step is then that of a consistent filter, about 1. Otherwise it is a bootstrap interval over the runs,
about the value found. The values of one run at successive steps are correlated: their average over time is not
χ²-distributed (in a linear scenario of 100 steps, the interval that assumes it holds between 42 and 94 % of the runs
in place of 95 %), so that its interval is always a bootstrap over runs, of one average a run.

Source: Bar-Shalom, Li, Kirubarajan (2001), section 5.4.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

import wsnsim.recording as recording
from wsnsim.analysis import plot_data
from wsnsim.analysis.quantities import interval
from wsnsim.analysis.statistics import LEAST
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats, Ints
from wsnsim.base.errors import ResultError
from wsnsim.base.tables import covariance_columns

Statistic = Literal["nees", "nis", "state"]
"""NEES of the position, NIS, and NEES of the whole state."""
KEYS: Final = ["replicate", "target", "step"]
DRAWS: Final = 400
TAILS: Final = np.array([0.025, 0.975])


class StepConsistency(NamedTuple):
    """NEES or NIS per degree of freedom.

    Attributes:
        steps: the recorded steps.
        times: their times in s.
        values: (steps,) mean over runs and targets; NaN where none is known.
        low: (steps,) lower end of the 95 % interval.
        high: (steps,) its upper end.
        gaussian: whether the interval is that of a consistent filter (χ²); otherwise a bootstrap over runs.
        average: mean over the runs of each run's time average.
        average_low: lower end of its 95 % bootstrap interval over runs; NaN with fewer than five.
        average_high: its upper end.
    """

    steps: Ints
    times: Floats
    values: Floats
    low: Floats
    high: Floats
    gaussian: bool
    average: float
    average_low: float
    average_high: float


def step_consistency(path: str | Path, of: Statistic = "nees") -> StepConsistency:
    """The consistency of a result at each step, over its runs and targets.

    Args:
        path: result file.
        of: NEES of the position, NIS, or NEES of the whole state (needs `record.covariances` and `record.truth`).

    Raises:
        ResultError: the file does not hold what is needed; the message says what.
    """
    table = _table(path, of)
    axes = [np.unique(table[name], return_inverse=True) for name in KEYS]
    sizes, place = [known.size for known, _ in axes], tuple(at for _, at in axes)
    squares, dofs, times = np.zeros(sizes), np.zeros(sizes), np.zeros(sizes[2])
    known = (np.isfinite(table["square"]) & (table["dof"] > 0)).to_numpy()
    squares[place] = np.where(known, table["square"], 0.0)
    dofs[place] = np.where(known, table["dof"], 0.0)
    times[place[2]] = table["time"]
    squares, dofs = squares.sum(axis=1), dofs.sum(axis=1)  # of all targets of a run
    gaussian = bool((table["gaussian"] == 1).all())
    counts = np.where(dofs.sum(axis=0) > 0, dofs.sum(axis=0), np.nan)
    low, high = stats.chi2.ppf(TAILS[:, None], counts) / counts if gaussian else _bootstrapped(squares, dofs)
    per_run = _ratio(squares.sum(axis=1), dofs.sum(axis=1))
    values = _ratio(squares.sum(axis=0), dofs.sum(axis=0))
    average = metrics.mean_error(per_run), *interval(per_run, metrics.mean_error)
    return StepConsistency(axes[2][0], times, values, low, high, gaussian, *average)


def state_nees(path: str | Path) -> pd.DataFrame:
    """The NEES of the whole state: a row per estimate with `replicate`, `target`, `step` and `nees`.

    Raises:
        ResultError: `covariances`, `estimates` or `truth` was not recorded.
    """
    states = recording.attributes(path)["states"]
    names, size = [name for name, _ in states], len(states)
    triangle = [column.name for column in covariance_columns(states)]
    truth, means = (pd.DataFrame(recording.read_table(path, t, [*KEYS, *names])) for t in ("truth", "estimates"))
    found = pd.DataFrame(recording.read_table(path, "covariances", [*KEYS, *triangle])).merge(means, on=KEYS)
    found = found.merge(truth, on=KEYS, suffixes=("", " true"))
    covs = np.empty((len(found), size, size))
    rows, columns = np.triu_indices(size)
    covs[:, rows, columns] = covs[:, columns, rows] = found[triangle].to_numpy()
    errors = found[names].to_numpy() - found[[f"{name} true" for name in names]].to_numpy()
    return found[KEYS].assign(nees=metrics.normalised_squares(errors, covs))


def _table(path: str | Path, of: Statistic) -> pd.DataFrame:
    """The columns `KEYS`, `time`, `gaussian`, `square` and `dof`, a row per step of a track."""
    reason = plot_data.lacking(path, "consistency")
    if reason:
        raise ResultError(f"{path}: has no {of}: {reason}")
    columns = ["nis", "nis_dof"] if of == "nis" else ["nees"]
    table = pd.DataFrame(recording.read_table(path, "estimates", [*KEYS, "time", "gaussian", *columns]))
    if of == "nis":
        return table.rename(columns={"nis": "square", "nis_dof": "dof"})
    if of == "state":
        table = table.drop(columns="nees").merge(state_nees(path), on=KEYS, how="left")
    about = recording.attributes(path)
    dof = len(about["states"]) if of == "state" else len(plot_data.layout(path).position)
    return table.rename(columns={"nees": "square"}).assign(dof=dof)


def _bootstrapped(squares: Floats, dofs: Floats) -> tuple[Floats, Floats]:
    """The 95 % bootstrap interval over the runs at each step, of squares and degrees of freedom (runs, steps)."""
    runs = len(squares)
    if runs < LEAST:
        nothing = np.full(squares.shape[1], np.nan)
        return nothing, nothing
    counts = np.random.Generator(np.random.Philox(runs)).multinomial(runs, np.full(runs, 1.0 / runs), DRAWS)
    ratios = _ratio(counts @ squares, counts @ dofs)
    few = np.isnan(ratios).any(axis=0)  # some resample has no run with a value
    low, high = np.where(few, np.nan, np.quantile(np.where(np.isnan(ratios), 0.0, ratios), TAILS, axis=0))
    return low, high


def _ratio(squares: Floats, dofs: Floats) -> Floats:
    result: Floats = np.divide(squares, dofs, out=np.full(np.shape(dofs), np.nan), where=dofs > 0)
    return result
