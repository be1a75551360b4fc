"""The summary quantities of a result: name, definition, unit and value of each, wherever it is shown.

    arrays = stored_arrays.read_arrays(path)           of a result file; or `ResultArrays(...)` of a report
    QUANTITIES["rmse"].value(arrays)                   .interval(arrays), .text(value, unit)
    values(arrays) -> {key: value}                     worth_showing(arrays) -> keys

Terminal, `wsnsim info`, page and JSON take names and values from here. Intervals are 95 % bootstrap intervals over
runs, from five runs on. Values that are unknown (NaN) in a run are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from wsnsim.base import metrics
from wsnsim.base.arrays import Floats

NAN: Final = float("nan")
POSITION_UNIT: Final = "position"
"""Stands for the unit of the motion model's position, which only the result knows."""
LATENCY: Final = "latency"
"""Stands for seconds, written in ms where they are below one."""


@dataclass(frozen=True)
class ResultArrays:
    """The arrays that summary quantities are computed from.

    Attributes:
        errors: (runs, targets, steps) position errors, NaN without an estimate; empty if they were not recorded.
        runs: the columns of the table `runs`, (runs,) each.
        has_targets: whether there is a target to track.
        tracks: columns of the table `tracks`, (runs, targets) each; empty if they are not needed.
        size: the number of position columns.
    """

    errors: Floats
    runs: Mapping[str, Floats]
    has_targets: bool = True
    tracks: Mapping[str, Floats] = field(default_factory=dict)
    size: int = 2

    @property
    def consistent(self) -> float:
        """The median NEES per column of a consistent filter."""
        return metrics.CONSISTENT_MEDIANS.get(self.size, NAN)

    @property
    def has_network(self) -> bool:
        """Whether a network was simulated: without one, no energy is spent."""
        return bool(np.isfinite(self.runs.get("energy", np.empty(0))).any())


def time_averaged_rmse(errors: Floats) -> float:
    """The mean over the steps of the RMSE at a step, of errors (runs, targets, steps)."""
    return metrics.time_mean_rmse(errors.reshape(-1, errors.shape[-1]))


def median_time(times: Floats) -> float:
    """The median time of an event that may not happen (NaN); NaN if it does not happen in half of the runs."""
    middle = float(np.median(np.where(np.isfinite(times), times, np.inf))) if times.size else NAN
    return middle if np.isfinite(middle) else NAN


def share_above_zero(values: Floats) -> float:
    """The share of the known values that are above zero; NaN without one."""
    known = values[np.isfinite(values)]
    return float(np.mean(known > 0.0)) if known.size else NAN


def interval(samples: Floats, statistic: Callable[[Floats], float]) -> tuple[float, float]:
    """The 95 % bootstrap interval of a statistic over the rows; NaN with fewer than five, or if nothing is known."""
    return metrics.bootstrap_interval(samples, statistic) if np.isfinite(samples).any() else (NAN, NAN)


def _delivery_ratio(receptions: Floats) -> float:
    """Successful receptions as a share of the intended ones, of (runs, 2) counts."""
    successful, intended = receptions.sum(axis=0)
    return float(successful / intended) if intended > 0 else NAN


@dataclass(frozen=True)
class SummaryQuantity:
    """A quantity that sums up the runs of a result.

    Attributes:
        name: its name wherever it is shown.
        definition: what it is, in a sentence without a full stop.
        form: how its value is written, without its unit.
        unit: its SI unit; `POSITION_UNIT` for that of the position; `LATENCY` for s, written in ms below one.
        columns: the columns of `runs` that it is computed from; none: the position errors.
        statistic: the value, of a row per run.
        of_tracks: whether the columns are those of `tracks`.
    """

    name: str
    definition: str
    form: str
    unit: str
    columns: tuple[str, ...]
    statistic: Callable[[Floats], float] = metrics.mean_error
    of_tracks: bool = False

    def samples(self, arrays: ResultArrays) -> Floats:
        """What the value is computed from, a row per run; empty if it was not recorded."""
        if not self.columns:
            return arrays.errors
        table = arrays.tracks if self.of_tracks else arrays.runs
        if not set(self.columns) <= table.keys():
            return np.empty(0)
        columns = [table[name] for name in self.columns]
        return columns[0] if len(columns) == 1 else np.stack(columns, axis=1)

    def value(self, arrays: ResultArrays) -> float:
        """The value over all runs; NaN if it is unknown."""
        samples = self.samples(arrays)
        return self.statistic(samples) if samples.size else NAN

    def interval(self, arrays: ResultArrays) -> tuple[float, float]:
        """The 95 % bootstrap interval over runs; NaN with fewer than five runs, or if the value is unknown.

        The targets of one run share its sensors, so they are resampled together.
        """
        return interval(self.samples(arrays), self.statistic)

    def text(self, value: float, position_unit: str) -> str:
        """The value with its unit; "unknown" for NaN."""
        if np.isnan(value):
            return "unknown"
        if self.unit == LATENCY:
            return f"{1e3 * value:.3g} ms" if value < 1.0 else f"{value:.3g} s"
        unit = position_unit if self.unit == POSITION_UNIT else self.unit
        return f"{self.form.format(value)} {unit}".rstrip()

    def interval_text(self, low: float, high: float) -> str:
        """The interval in brackets, without the unit; empty if it is unknown."""
        if not np.isfinite(low):
            return ""
        ends = (self.text(end, "") if self.unit == LATENCY else self.form.format(end) for end in (low, high))
        return f"[{', '.join(ends)}]"


def _of_runs(
    name: str, definition: str, form: str, unit: str, column: str, statistic: Callable[[Floats], float] | None = None
) -> SummaryQuantity:
    return SummaryQuantity(name, definition, form, unit, (column,), statistic or metrics.mean_error)


QUANTITIES: Final[dict[str, SummaryQuantity]] = {
    "rmse": SummaryQuantity(
        "time-averaged RMSE", "mean over the steps of the RMSE over runs and targets at each step",
        "{:.4f}", POSITION_UNIT, (), time_averaged_rmse,
    ),
    "rmse_median": _of_runs(
        "median per-run RMSE", "median over the runs of each run's RMSE over steps and targets",
        "{:.4f}", POSITION_UNIT, "rmse", metrics.median_error,
    ),
    "median_error": SummaryQuantity(
        "median position error", "median over all runs, targets and steps", "{:.4f}", POSITION_UNIT, (),
        metrics.median_error,
    ),
    "ever_lost": _of_runs(
        "lost at any time", "share of the runs in which a track was lost at some time, found again or not",
        "{:.1%}", "", "losses", share_above_zero,
    ),
    "lost": _of_runs(
        "lost at the end", "share of the runs in which a track is lost at its last step", "{:.1%}", "", "lost"
    ),
    "lost_limit": _of_runs(
        "lost: error above", "error above which a track is lost that has it for the window (key lost.limit)",
        "{:.4g}", POSITION_UNIT, "lost_limit",
    ),
    "lost_window": _of_runs(
        "lost: that, or no estimate, for", "time for which the error of a lost track is above the limit, or for which "
        "it has no estimate (key lost.window)", "{:.4g}", "s", "lost_window",
    ),
    "losses": _of_runs(
        "track losses", "losses of tracks in a run, those that ended included, mean", "{:.3g}", "", "losses"
    ),
    "time_lost": _of_runs(
        "time lost", "time for which a track was lost in a run, mean over targets and runs", "{:.3g}", "s", "time_lost"
    ),
    "lost_share": _of_runs(
        "share of steps lost", "share of the steps at which a track was lost", "{:.1%}", "", "lost_share"
    ),
    "tracked": _of_runs("steps tracked", "share of the steps with an estimate in time", "{:.1%}", "", "tracked"),
    "nees": _of_runs(
        "average NEES of the position", "per column, mean over the runs of each run's time average; 1: consistent",
        "{:.3g}", "", "nees",
    ),
    "nees_median": _of_runs(
        "median NEES of the position", "per column, median over the runs of each run's median over its steps; a "
        "consistent filter has 0.69 in the plane, 0.45 on a line", "{:.3g}", "", "nees_median", metrics.median_error,
    ),
    "singular": _of_runs(
        "singular covariances", "estimates of a run whose position covariance is singular, which have no NEES, mean",
        "{:.4g}", "", "singular",
    ),
    "nis": _of_runs(
        "average NIS", "per measurement, mean over the runs of each run's time average; 1: consistent",
        "{:.3g}", "", "nis",
    ),
    "delay": SummaryQuantity(
        "latency at the cluster head, median", "median time from a step to its estimate, median over the tracks",
        "{:.3g}", LATENCY, ("delay",), metrics.median_error, of_tracks=True,
    ),
    "report_delay": SummaryQuantity(
        "end-to-end latency, median",
        "median time from a step until its estimate is at a sink, median over the tracks of which one arrived",
        "{:.3g}", LATENCY, ("report_delay",), metrics.median_error, of_tracks=True,
    ),
    "energy": _of_runs("energy spent", "energy that the network spent in a run, mean", "{:.4g}", "J", "energy"),
    "handovers": _of_runs("handovers", "handovers begun in a run, mean", "{:.4g}", "", "handovers"),
    "frames_sent": _of_runs("bursts sent", "bursts put on the air in a run, mean", "{:,.0f}", "", "frames_sent"),
    "frames_lost": _of_runs(
        "bursts lost", "bursts of which a packet did not arrive, in a run, mean", "{:,.0f}", "", "frames_lost"
    ),
    "packets_sent": _of_runs("packets sent", "packets put on the air in a run, mean", "{:,.0f}", "", "packets_sent"),
    "in_range": _of_runs(
        "intended receptions", "receptions by nodes that a burst was meant for, in a run, mean",
        "{:,.0f}", "", "in_range",
    ),
    "delivered": _of_runs(
        "successful receptions", "intended receptions that succeeded, in a run, mean", "{:,.0f}", "", "delivered"
    ),
    "packet_delivery_ratio": SummaryQuantity(
        "packet delivery ratio", "successful receptions as a share of the intended ones, over all runs",
        "{:.2%}", "", ("delivered", "in_range"), _delivery_ratio,
    ),
    "collided": _of_runs(
        "collided receptions", "intended receptions lost to another transmission, in a run, mean",
        "{:,.0f}", "", "collided",
    ),
    "retries": _of_runs("retransmissions", "frames sent again in a run, mean", "{:,.0f}", "", "retries"),
    "access_failures": _of_runs(
        "channel-access failures", "frames dropped because the channel was always busy, in a run, mean",
        "{:,.0f}", "", "access_failures",
    ),
    "cycles": _of_runs("operations computed", "operations stated by the tracker, mean", "{:,.0f}", "", "cycles"),
    "awake": _of_runs("awake time of nodes", "share of the nodes' time that they were awake", "{:.1%}", "", "awake"),
    "radio_on": _of_runs(
        "radios on", "share of the nodes' time that their radios sent, received or listened", "{:.2%}", "", "radio_on"
    ),
    "hurried": _of_runs(
        "at the short wake interval", "share of the nodes' time that they were told to hurry", "{:.2%}", "", "hurried"
    ),
    "alive": _of_runs("nodes alive at the end", "mean over the runs", "{:.4g}", "", "alive"),
    "first_death": _of_runs(
        "first death of a node, median", "median over the runs; unknown if no node died in half of them",
        "{:.4g}", "s", "first_death", median_time,
    ),
    "half_dead": _of_runs(
        "half of the nodes dead, median", "median over the runs; unknown if this did not happen in half of them",
        "{:.4g}", "s", "half_dead", median_time,
    ),
    "coverage": _of_runs(
        "coverage at the end", "share of the field within sensing range of a living node, mean",
        "{:.1%}", "", "coverage",
    ),
    "cpu_seconds": _of_runs("CPU time per run", "processor time of a run, mean", "{:.2f}", "s", "cpu_seconds"),
}  # fmt: skip
"""By the key that JSON has for it, in the order in which they are shown."""
NETWORK_ONLY: Final = ("handovers", "frames_lost", "in_range", "delivered", "packet_delivery_ratio", "alive")
"""Quantities that mean nothing without a network."""
ONLY_IF_NOT_ZERO: Final = ("singular", "collided", "retries", "access_failures", "frames_lost", "handovers", "cycles")
CONSISTENCY_NOTE: Final = (
    "NEES, NIS: squares of errors and of innovations over their covariances; 1: consistent, above 1: overconfident"
)
DECIDED: Final = 2.0
"""A mean over runs that is more than this times their median is decided by few of them (our choice)."""
BOUND_NAMES: Final = {
    "in_range": "trajectory-conditional CRLB, readings in range",
    "active": "trajectory-conditional CRLB, readings of active members",
    "arrived": "trajectory-conditional CRLB, readings that arrived",
}
"""The bounds that stand beside the time-averaged RMSE, by the readings that count."""
COUNTED_FAULTS: Final = {"crash", "restart", "drain", "blackout", "link_loss"}
"""Faults of which no more is to be known than which readings arrived."""
BOUND_NOTE: Final = (
    "trajectory-conditional CRLB: not a strict bound, a filter may have a smaller error on some trajectories"
)


def bound_name(readings: str, faults: Collection[str]) -> str:
    """The name of a bound beside runs with these kinds of faults, which may be left out of it."""
    counted = not faults or (readings != "in_range" and COUNTED_FAULTS.issuperset(faults))
    return BOUND_NAMES[readings] + ("" if counted else ", without faults")


def loss_rule(runs: Mapping[str, Floats], unit: str) -> str:
    """When tracks of runs count as lost, as "error above 20 m or no estimate for 4 s"; empty if it is unknown.

    Args:
        runs: columns of the table `runs`; `lost_window` and `lost_limit` may be missing.
        unit: the unit of the position.
    """
    windows, limits = (np.asarray(runs.get(key, NAN), dtype=np.float64) for key in ("lost_window", "lost_limit"))
    if not windows.size or not np.isfinite(windows).all():
        return ""
    above = f"error above {_span(limits)} {unit}".rstrip() + " or " if np.isfinite(limits).any() else ""
    return f"{above}no estimate for {_span(windows)} s"


def _span(values: Floats) -> str:
    low, high = f"{values.min():.4g}", f"{values.max():.4g}"
    return low if low == high else f"{low} to {high}"


def run_metric_name(metric: str) -> str:
    """The name of a column of `runs`, as a median or mean over runs is of it."""
    names = {"rmse": "per-run RMSE", "median_error": "per-run median error", "nees": "NEES", "nis": "NIS"}
    return names.get(metric, metric.replace("_", " "))


def values(arrays: ResultArrays) -> dict[str, float]:
    """The value of every quantity that is known and means something, by its key."""
    found = {key: quantity.value(arrays) for key, quantity in QUANTITIES.items()}
    left_out = () if arrays.has_network else NETWORK_ONLY
    return {key: value for key, value in found.items() if np.isfinite(value) and key not in left_out}


def medians(arrays: ResultArrays) -> dict[str, float]:
    """The median over runs of each mean that one run, or few, decide: that is more than `DECIDED` times the median."""
    found = {"rmse": QUANTITIES["rmse_median"].value(arrays)}
    for key, quantity in QUANTITIES.items():
        samples = quantity.samples(arrays)
        of_runs = samples.ndim == 1 and quantity.statistic is metrics.mean_error and "%" not in quantity.form
        if of_runs and samples.size and key != "cpu_seconds":
            found[key] = metrics.median_error(samples)
    return {key: middle for key, middle in found.items() if QUANTITIES[key].value(arrays) > DECIDED * middle > 0.0}


def beside(key: str, middles: Mapping[str, float], consistent: float, unit: str) -> str:
    """What stands beside a value: the median over runs where few decide the mean, or what is consistent; else empty.

    Args:
        key: of the quantity.
        middles: what `medians` returned.
        consistent: the `nees_median` of a consistent filter.
        unit: of the position.
    """
    if key == "nees_median":
        return f"consistent: {consistent:.2f}"
    return f"median over runs: {QUANTITIES[key].text(middles[key], unit)}" if key in middles else ""


def worth_showing(arrays: ResultArrays) -> dict[str, float]:
    """The values without those that say nothing: of what never happened, and of what is always so."""
    found = values(arrays)
    dull = {key for key in ONLY_IF_NOT_ZERO if not found.get(key)}
    dull |= set() if found.get("delay") else {"delay"}
    dull |= {"awake"} if found.get("awake") == 1.0 else set()
    dull |= {"in_range", "delivered"} if found.get("packet_delivery_ratio") == 1.0 else set()
    dull |= set() if found.get("ever_lost") else {"losses", "time_lost", "lost_share"}
    dull |= set() if arrays.has_targets else {"lost", "ever_lost"}
    return {key: value for key, value in found.items() if key not in dull}
