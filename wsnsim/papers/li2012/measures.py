"""Measures of figures 4 and 5 of Li (2012), over the first 20 steps of a run, or its first 20 reports.

They need the table `estimates`; the bound on a fix needs `truth` and `nodes`. In the first five steps the window of the
grey model is not full.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
import pandas as pd

from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.papers.measures import Data, computing

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
