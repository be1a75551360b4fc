"""The summary quantities of a result: name, definition, unit and value of each, wherever it is shown.

    facts = facts_of_file(path)                        or `facts_of_report(report)`
    QUANTITIES["rmse"].value(facts)                    .interval(facts), .text(value, unit)
    values(facts) -> {key: value}                      worth_showing(facts) -> keys

`quantities.table` is the list. Terminal, `wsnsim info`, page and JSON take names, cells and reasons from it. Intervals
are 95 % bootstrap intervals over runs, from five runs on. Values that are unknown (NaN) in a run are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from wsnsim.analysis.result_facts import ResultFacts
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.base.files import read_sections


def median_time(times: Floats) -> float:
    """The median time of an event that may not happen (NaN); NaN if it does not happen in half of the runs."""
    middle = float(np.median(np.where(np.isfinite(times), times, np.inf))) if times.size else np.nan
    return middle if np.isfinite(middle) else np.nan


def share_above_zero(values: Floats) -> float:
    """The share of the known values that are above zero; NaN without one."""
    known = values[np.isfinite(values)]
    return float(np.mean(known > 0.0)) if known.size else np.nan


def interval(samples: Floats, statistic: Callable[[Floats], float]) -> tuple[float, float]:
    """The 95 % bootstrap interval of a statistic over the rows; NaN with fewer than five, or if nothing is known."""
    return metrics.bootstrap_interval(samples, statistic) if np.isfinite(samples).any() else (np.nan, np.nan)


def delivery_ratio(receptions: Floats) -> float:
    """Successful receptions as a share of the intended ones, of (runs, 2) counts."""
    successful, intended = receptions.sum(axis=0)
    return float(successful / intended) if intended > 0 else np.nan


STATISTICS: Final[dict[str, Callable[[Floats], float]]] = {
    "mean": metrics.mean_error,
    "median": metrics.median_error,
    "median_time": median_time,
    "share_above_zero": share_above_zero,
    "averaged_rmse": metrics.averaged_rmse,
    "delivery_ratio": delivery_ratio,
}


@dataclass(frozen=True)
class SummaryQuantity:
    """A quantity that sums up the runs of a result; the fields are the cells of `quantities.table`.

    Attributes:
        name: its name wherever it is shown.
        form: how its value is written, without its unit.
        unit: its SI unit; `position` for that of the position, which only the result knows; `latency` for s, written
            in ms below one.
        flags: where it is shown, in words: `page`, `interval`, `nonzero`, `network`.
        unknown: why it has no value, where it is always for the same reason.
        columns: the columns of `runs` that it is computed from, or of `tracks`, with a dot before the name; none: the
            position errors.
        statistic: the name of what gives the value, of a row per run; a key of `STATISTICS`.
        definition: what it is, in a sentence without a full stop.
    """

    name: str
    form: str
    unit: str
    flags: str
    unknown: str
    columns: str = ""
    statistic: str = ""
    definition: str = ""

    def samples(self, facts: ResultFacts) -> Floats:
        """What the value is computed from, a row per run; empty if it was not recorded."""
        if not self.columns:
            return facts.recorded.errors
        table = facts.tracks if self.columns.startswith(".") else facts.runs
        names = self.columns.removeprefix(".").split()
        if not set(names) <= table.keys():
            return np.empty(0)
        return table[names[0]] if len(names) == 1 else np.stack([table[name] for name in names], axis=1)

    def value(self, facts: ResultFacts) -> float:
        """The value over all runs; NaN if it is unknown."""
        samples = self.samples(facts)
        return STATISTICS[self.statistic](samples) if samples.size else np.nan

    def interval(self, facts: ResultFacts) -> tuple[float, float]:
        """The 95 % bootstrap interval over runs; NaN with fewer than five runs, or if the value is unknown.

        The targets of one run share its sensors, so they are resampled together.
        """
        return interval(self.samples(facts), STATISTICS[self.statistic])

    def text(self, value: float, position_unit: str = "") -> str:
        """The value with its unit; "unknown" for NaN."""
        if np.isnan(value):
            return "unknown"
        if self.unit == "latency":
            return f"{1e3 * value:.3g} ms" if value < 1.0 else f"{value:.3g} s"
        unit = position_unit if self.unit == "position" else self.unit
        return f"{self.form.format(value)} {unit}".rstrip()

    def interval_text(self, low: float, high: float) -> str:
        """The interval in brackets, without the unit; empty if it is unknown."""
        if not np.isfinite(low):
            return ""
        ends = (self.text(end) if self.unit == "latency" else self.form.format(end) for end in (low, high))
        return f"[{', '.join(ends)}]"


def _listed() -> list[dict[str, SummaryQuantity]]:
    """The two sections of the list, by key."""
    sections = read_sections(Path(__file__).with_name("quantities.table"))
    return [
        {key: SummaryQuantity(name, form, unit, flags, unknown, *more)
         for key, name, form, unit, flags, unknown, *more in section.rows}
        for section in sections
    ]  # fmt: skip


QUANTITIES, _OTHERS = _listed()
"""By the key that JSON has for it, in the order in which they are shown."""
FIGURES: Final = QUANTITIES | _OTHERS
"""The quantities, and what a summary computes beside them."""


def flagged(flag: str) -> tuple[str, ...]:
    """The keys of the figures with a flag, in their order."""
    return tuple(key for key, quantity in FIGURES.items() if flag in quantity.flags.split())


ONLY_IF_NOT_ZERO: Final = flagged("nonzero")
NETWORK_ONLY: Final = flagged("network")
"""What means nothing without a network."""
CONSISTENCY_NOTE: Final = (
    "NEES, NIS: squared errors and innovations over covariances; 1: consistent, above 1: overconfident"
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


def name_of(key: str, runs: int) -> str:
    """The name of a quantity; the time-averaged RMSE of one run is its RMSE over steps and targets."""
    return "RMSE" if key == "rmse" and runs == 1 else FIGURES[key].name


def loss_rule(runs: Mapping[str, Floats], unit: str) -> str:
    """When tracks of runs count as lost, as "error above 20 m or no estimate for 4 s"; empty if it is unknown.

    Args:
        runs: columns of the table `runs`; `lost_window` and `lost_limit` may be missing.
        unit: the unit of the position.
    """
    windows, limits = (np.asarray(runs.get(key, np.nan), dtype=np.float64) for key in ("lost_window", "lost_limit"))
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


def values(facts: ResultFacts) -> dict[str, float]:
    """The value of every quantity that is known and means something, by its key."""
    left_out = () if facts.has_network else NETWORK_ONLY
    found = {key: quantity.value(facts) for key, quantity in QUANTITIES.items() if key not in left_out}
    return {key: value for key, value in found.items() if np.isfinite(value)}


def medians(facts: ResultFacts) -> dict[str, float]:
    """The median over runs of each mean that one run, or few, decide: that is more than `DECIDED` times the median."""
    found = {"rmse": QUANTITIES["rmse_median"].value(facts)}
    for key, quantity in QUANTITIES.items():
        samples = quantity.samples(facts)
        of_runs = samples.ndim == 1 and quantity.statistic == "mean" and "%" not in quantity.form
        if of_runs and samples.size and key != "cpu_seconds":
            found[key] = metrics.median_error(samples)
    return {key: middle for key, middle in found.items() if QUANTITIES[key].value(facts) > DECIDED * middle > 0.0}


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


def worth_showing(facts: ResultFacts) -> dict[str, float]:
    """The values without those that say nothing: of what never happened, and of what is always so."""
    found = values(facts)
    dull = {key for key in ONLY_IF_NOT_ZERO if not found.get(key)}
    dull |= set() if found.get("delay") else {"delay"}
    dull |= {"awake"} if found.get("awake") == 1.0 else set()
    dull |= {"in_range", "delivered"} if found.get("packet_delivery_ratio") == 1.0 else set()
    dull |= set() if found.get("ever_lost") else {"losses", "time_lost", "lost_share"}
    dull |= set() if facts.position else {"lost", "ever_lost"}
    dull |= {"rmse_median"} if facts.count == 1 and "rmse" in found else set()
    return {key: value for key, value in found.items() if key not in dull}
