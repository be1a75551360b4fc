"""What a comparison concludes: pairs of points compared run by run, a sentence each, and hints at other causes.

    pair_columns(here, there, metric) -> {column: value} of one pair
    with_pairs(table, pairs) -> the table with these columns, and p-values corrected for the number of tests
    sentence(pair, names, metric, unit) -> 'ekf is 21.1 m better than pf in per-run RMSE, 95 % [18, 25], ...'
    traffic(folder, table) -> [PointTraffic of each row]        hint(here, there, names) -> a sentence, or ''
    degenerate(particles, nees, lost, singular) -> why a particle filter may have lost its target, or ''

Losses are compared first, on all runs, by McNemar's exact test. Errors are then compared by Wilcoxon's signed-rank test
on the runs in which neither of the two lost its target at any time: the error of a run that lost it says only how long
ago. Other metrics are compared on all runs. All p-values of the comparison, those of losses and those of the metric of
all pairs, are one family (Holm 1979): where all points are equal, a sentence claims a difference in at most 5 %.

A sentence claims a difference only if the 95 % interval of the median paired difference excludes zero and the p-value,
corrected for the number of tests, is at most 5 %; a difference in losses only if McNemar's corrected p-value is.

A network takes part in the decision if packets take time and estimates come late or not at all: the messages of a step,
above all of a handover with all its particles, take longer than the step. Different filters with different numbers of
particles differ by these, too; a hint says so.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd

from wsnsim.analysis import campaigns, statistics
from wsnsim.analysis.quantities import run_metric_name
from wsnsim.analysis.statistics import LEAST
from wsnsim.base.errors import ResultError, counted
from wsnsim.base.metrics import mean_error
from wsnsim.base.tables import TABLES
from wsnsim.recording.folder import Folder

ERRORS: Final = tuple(column.name for column in TABLES["runs"] if column.of_position)
"""Metrics that are compared on the runs that both points survive."""
DIFFERENCE: Final = ("difference", "difference_low", "difference_high", "effect", "p", "pairs")
WHOLE: Final = ("difference_all", "difference_all_low", "difference_all_high")
LOSSES: Final = ("lost_alone", "baseline_lost_alone", "p_losses")
NUMBERS: Final = (*DIFFERENCE, "p_holm", *WHOLE, *LOSSES, "p_losses_holm", "common")
WILCOXON: Final = "Wilcoxon signed-rank"


def pair_columns(here: pd.DataFrame, there: pd.DataFrame, metric: str) -> dict[str, float]:
    """The differences of a point from its baseline, from their rows of `runs` by replicate.

    `difference` and the columns after it are of the metric, for errors on the runs that both survive;
    `difference_all` is of all runs. `lost_alone` counts the runs that only the point lost at any time,
    `baseline_lost_alone` those that only the baseline lost.
    """
    common = here.index.intersection(there.index)
    one, other = here.loc[common], there.loc[common]
    lost, other_lost = campaigns.ever_lost(one), campaigns.ever_lost(other)
    values, base = (frame[metric].to_numpy(dtype=np.float64) for frame in (one, other))
    kept = ~(lost | other_lost) if metric in ERRORS else np.ones(len(common), dtype=np.bool_)
    whole = found = statistics.paired_difference(values[kept], base[kept])
    if not kept.all():
        whole = statistics.paired_difference(values, base)
    alone, other_alone = int((lost & ~other_lost).sum()), int((other_lost & ~lost).sum())
    losses = (alone, other_alone, statistics.exact_mcnemar(alone, other_alone) if (lost | other_lost).any() else np.nan)
    return {
        **dict(zip(DIFFERENCE, found, strict=True)),
        **dict(zip(WHOLE, whole[:3], strict=True)),
        **dict(zip(LOSSES, losses, strict=True)),
        "common": len(common),
    }


def with_pairs(table: pd.DataFrame, pairs: dict[int, dict[str, float]]) -> pd.DataFrame:
    """The table of a comparison with the columns of its pairs, by row; p-values corrected as one family."""
    numbers = {name: [pairs.get(row, {}).get(name, np.nan) for row in range(len(table))] for name in NUMBERS}
    adjusted = statistics.holm(numbers["p"] + numbers["p_losses"])
    numbers["p_holm"], numbers["p_losses_holm"] = adjusted[: len(table)], adjusted[len(table) :]
    counts = [pairs[row]["pairs"] if row in pairs else 0 for row in range(len(table))]
    exact = [f"{WILCOXON}, exact" if count <= statistics.EXACT else WILCOXON for count in counts]
    tests: list[Any] = [name if count else "" for name, count in zip(exact, counts, strict=True)]
    return table.assign(**{name: np.array(column, dtype=np.float64) for name, column in numbers.items()}, test=tests)


LEVEL: Final = 0.05
Pair = Mapping[str, Any]


def sentence(pair: Pair, names: tuple[str, str], metric: str, unit: str) -> str:
    """What the columns of a pair (`with_pairs`) say, losses first. `names`: of the point and of its baseline."""
    return "; ".join(filter(None, (_of_losses(pair, *names), _of_metric(pair, names, metric, unit))))


def shows_difference(pair: Pair) -> bool:
    """Whether the interval of the difference excludes zero and the corrected p-value is at most 5 %."""
    low, high = pair["difference_low"], pair["difference_high"]
    return bool((low > 0.0 or high < 0.0) and pair["p_holm"] <= LEVEL)


def _of_losses(pair: Pair, point: str, baseline: str) -> str:
    """The clause on losses; empty if no run was lost."""
    if math.isnan(pair["p_losses"]):
        return ""
    alone, other = int(pair["lost_alone"]), int(pair["baseline_lost_alone"])
    test = f"exact McNemar p = {p_value(pair['p_losses_holm'])}, Holm-corrected, {pair['common']:.0f} pairs"
    if not pair["p_losses_holm"] <= LEVEL:
        return (
            f"no difference in losses is shown between {point} and {baseline}"
            f" ({counted(alone, 'run')} lost by the former alone, {other} by the latter alone, {test})"
        )
    fewer, more = (point, baseline) if alone < other else (baseline, point)
    few, many = sorted((alone, other))
    return f"{fewer} loses its target in fewer runs than {more} ({few} lost by it alone, {many} by the other, {test})"


def _of_metric(pair: Pair, names: tuple[str, str], metric: str, unit: str) -> str:
    """The clause on the metric."""
    name, pairs, (point, baseline) = run_metric_name(metric), int(pair["pairs"]), names
    among = counted(pairs, "pair") + " of runs that both survive" * (pairs < pair["common"] and metric in ERRORS)
    if pairs < LEAST:
        return f"{among} {'is' if pairs == 1 else 'are'} too few to compare {point} and {baseline} in {name}"
    test = f"Wilcoxon p = {p_value(pair['p_holm'])}, Holm-corrected, {among}"
    value, low, high = (float(pair[key]) for key in ("difference", "difference_low", "difference_high"))
    unit = f" {unit}" if unit not in ("", "1") else ""
    if not shows_difference(pair):
        return (
            f"no difference in {name} is shown between {point} and {baseline}:"
            f" median {number(value)}{unit}, 95 % [{number(low)}, {number(high)}], {test}"
        )
    ranks = ("better", "worse") if metric in ERRORS else ("lower", "higher")
    size, *ends = (value, low, high) if value > 0.0 else (-value, -high, -low)  # without the sign
    return (
        f"{point} is {number(size)}{unit} {ranks[value >= 0.0]} than {baseline} in {name},"
        f" 95 % [{number(ends[0])}, {number(ends[1])}], {test}"
    )


def number(value: float) -> str:
    """A value of a sentence, with three digits."""
    return f"{value:.3g}"


def p_value(value: float) -> str:
    """A p-value with two digits."""
    return f"{value:.2g}"


def verdicts(pair: Pair, metric: str) -> Iterator[str]:
    """What a pair shows of losses and metric, without its own values; '{}' stands for the baseline."""
    name = run_metric_name(metric)
    if pair["p_losses_holm"] <= LEVEL:
        fewer = "fewer" if pair["lost_alone"] < pair["baseline_lost_alone"] else "more"
        yield f"lose their target in {fewer} runs than {{}}"
    if pair["pairs"] < LEAST:
        yield f"fewer than {LEAST} pairs, too few to compare with {{}} in {name}"
    elif shows_difference(pair):
        ranks = ("better", "worse") if metric in ERRORS else ("lower", "higher")
        yield f"{ranks[pair['difference'] >= 0.0]} than {{}} in {name}"
    else:
        yield f"no difference from {{}} in {name} is shown"


PACKETS_DECIDED: Final = "packets, not the filter, may have decided: "
DIFFERENT_PARTICLES: Final = "the numbers of particles differ: "
"""The beginnings of hints."""
DEGENERATED: Final = "particles may have degenerated"
"""Part of a hint."""
OVERCONFIDENT: Final = 100.0
"""Median NEES per degree of freedom above which the covariance of particles has collapsed [our choice]."""
MOST_LATE: Final = 0.05
"""Share of steps with a late or missing estimate above which the network may have decided [our choice]."""
READ: Final = ("replicate", "late", "reports", "delay", "handover_bits")


class PointTraffic(NamedTuple):
    """What the network made of a point's estimates.

    Attributes:
        late: share of the steps whose estimate came after the next step began.
        missing: share of the steps without an estimate.
        delay: median latency at the cluster head in s.
        step: duration of a step in s.
        handover: mean airtime in s of the bits of a handover; NaN without one, or if packets take no time.
        timed: whether packets take time. Where they do not, a missing estimate is not their fault.
        particles: the tracker's number of particles, None without.
        kind: the tracker's kind.
    """

    late: float = np.nan
    missing: float = np.nan
    delay: float = np.nan
    step: float = np.nan
    handover: float = np.nan
    timed: bool = False
    particles: int | None = None
    kind: str = ""

    @property
    def is_late(self) -> bool:
        """Whether estimates are late, missing where packets take time, or the latency or a handover fills the step."""
        absent = self.late + (self.missing if self.timed else 0.0)
        return absent > MOST_LATE or self.delay > self.step or self.handover > self.step


def traffic(folder: Folder, numbers: Iterable[int]) -> list[PointTraffic]:
    """The traffic of points by their numbers in the manifest; unknown where their tables or scenarios are missing."""
    points, tracks = folder.manifest().points, _tracks(folder)
    found = []
    for number in numbers:
        rows = tracks[tracks[campaigns.POINT] == number] if tracks is not None else None
        try:
            found.append(_of_point(json.loads(folder.scenario(points[number].id)), rows))
        except ResultError:
            found.append(PointTraffic())
    return found


def hint(here: PointTraffic, there: PointTraffic, names: tuple[str, str]) -> str:
    """What beside the filters may have decided between a point and its baseline; '' if nothing is known."""
    pair = list(zip(names, (here, there), strict=True))
    found = []
    if here.is_late or there.is_late:
        found.append(PACKETS_DECIDED + "; ".join(_latency(*one) for one in pair))
    if here.kind != there.kind and here.particles and there.particles and here.particles != there.particles:
        words = " and ".join(f"{name} has {one.particles} particles" for name, one in pair)
        found.append(f"{DIFFERENT_PARTICLES}{words}")
    return "; ".join(found)


def degenerate(particles: int | None, nees: float, lost: float, singular: float) -> str:
    """Why a filter with particles is bad or lost its target: their spread says nothing of its error. '' if it does.

    Args:
        particles: their number; None for another filter.
        nees: median NEES per degree of freedom.
        lost: share of the runs in which the target was lost at any time.
        singular: number of steps at which all particles were in one place or on a line.
    """
    if not particles or not (singular > 0.0 or (lost > 0.0 and nees > OVERCONFIDENT)):
        return ""
    said = f"median NEES {nees:.2g}" + f", {singular:.0f} singular covariances" * (singular > 0.0)
    return f"its {particles:,} {DEGENERATED} ({said}): try more of them, or more process noise in the filter"


def _tracks(folder: Folder) -> pd.DataFrame | None:
    """The columns of `tracks` with the steps of their runs; None if they were not recorded."""
    try:
        tracks = campaigns.read(folder.path, "tracks", READ, ("handover_bits",))
    except ResultError:
        return None
    keys = [campaigns.POINT, "replicate"]
    return tracks.merge(campaigns.read(folder.path, "runs", ("replicate", "steps"))[[*keys, "steps"]], on=keys)


def _of_point(scenario: dict[str, Any], tracks: pd.DataFrame | None) -> PointTraffic:
    tracker = scenario.get("tracker", {})
    particles, kind = tracker.get("particles"), tracker.get("kind", "")
    if tracks is None or not len(tracks) or not tracks["steps"].sum():
        return PointTraffic(particles=particles, kind=kind)
    steps, late, reports = (float(tracks[name].sum()) for name in ("steps", "late", "reports"))
    missing = steps - reports
    rate = scenario.get("mac", {}).get("rate")
    bits = mean_error(tracks["handover_bits"].to_numpy(dtype=np.float64))
    delays = tracks["delay"].dropna().to_numpy(dtype=np.float64)
    return PointTraffic(
        (late - missing) / steps,
        missing / steps,
        float(np.median(delays)) if delays.size else np.nan,
        float(scenario["step"]),
        bits / rate if rate else np.nan,
        bool(rate),
        particles,
        kind,
    )


def _latency(name: str, one: PointTraffic) -> str:
    """How late a point's estimates were, against the duration of its step."""
    if not math.isfinite(one.late):
        return f"{name}: not recorded"
    words = f"{name}: {one.late:.0%} of the steps late, {one.missing:.0%} missing"
    if math.isfinite(one.delay):
        words += f", median latency {one.delay:.2g} s"
    if math.isfinite(one.handover):
        words += f", {one.handover:.2g} s of airtime a handover"
    return f"{words} (step {one.step:g} s)"
