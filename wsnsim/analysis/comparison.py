"""The points of a campaign side by side: metric, losses, energy, paired differences from a baseline, and conclusions.

    found = compare(folder, metric="rmse", by=("tracker.kind",), baseline="pf")
    found.table: a DataFrame;  as_json(found);  `comparison_text.text(found)` for a terminal

Differences are paired (common random numbers): two points with the same world (seed, deployment, motion, sensor, prior)
have the same ground truth and the same readings in the same run, so a run's difference is that of the strategies.

Points that gave the same runs are named: what they differ in has no effect.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from wsnsim.analysis import campaigns, statistics
from wsnsim.analysis.campaign_info import baseline_point, keys_by_default, label, point_name
from wsnsim.analysis.conclusions import degenerate, hint, pair_columns, sentence, traffic, with_pairs
from wsnsim.analysis.quantities import loss_rule
from wsnsim.base.errors import ResultError, UsageError, did_you_mean
from wsnsim.base.tables import DUTY_CYCLED, METRICS, MORE_IS_BETTER, ONE_IS_BEST, TABLES
from wsnsim.recording import attributes
from wsnsim.recording.folder import Folder, Manifest, PointOnDisk


def same_runs(folder: Folder, manifest: Manifest) -> str:
    """Which points differ in no column of `runs`, the processor time apart; '' if there are none.

    Fingerprints are among the columns: such points differ in no event and in no estimate.
    """
    runs = campaigns.read(folder.path, "runs")
    names = [column.name for column in TABLES["runs"] if column.name in runs and column.name != "cpu_seconds"]
    alike: dict[bytes, list[Mapping[str, Any]]] = {}
    for number, rows in runs.groupby(campaigns.POINT, sort=True):
        content = pd.util.hash_pandas_object(rows[names], index=False).to_numpy().tobytes()
        alike.setdefault(content, []).append(manifest.points[int(number)].settings)
    groups = [points for points in alike.values() if len(points) > 1]
    if not groups:
        return ""
    differ = [key for key in manifest.keys if any(len({repr(one.get(key)) for one in group}) > 1 for group in groups)]
    shown = [" | ".join(label(one.get(key, "-") for key in manifest.keys) for one in group) for group in groups]
    return f"the same runs, so that {' and '.join(differ)} had no effect there: {'; '.join(shown)}"


RECORDED: Final = {"sensor": ("recorded", "readings"), "motion": ("recorded_track", "trajectory"),
                   "targets": ("recorded_track", "trajectories"), "link": ("recorded", "links")}  # fmt: skip
"""{role: (kind that replays a file, what every run replays)}."""


def shared_recordings(folder: Folder, points: Sequence[PointOnDisk]) -> str:
    """What all runs of points replay from files, and what this means for tests; '' if they replay nothing."""
    found: dict[str, None] = {}
    for point in points:
        with contextlib.suppress(ResultError):
            scenario = json.loads(folder.scenario(point.id))
            found |= {said: None for role, (kind, said) in RECORDED.items()
                      for block in np.ravel(scenario.get(role, [])) if block.get("kind") == kind}  # fmt: skip
    said = f"all runs replay the same recorded {' and '.join(found)} and differ in what is sampled beside them alone"
    return f"{said}: p-values and intervals say nothing of other recordings" if found else ""


ENERGY: Final = "energy"
MEASURED: Final = ("replicate", "lost", "losses", "lost_window", "lost_limit", "tracked", ENERGY)
OF_STEPS: Final = ("nees_median", "singular")
"""Columns that stand beside an average NEES: a single step may decide it."""
MOST_LOST: Final = 0.05
"""Share of runs lost at any time above which a point is not on the Pareto front: losing the target saves energy."""


@dataclass(frozen=True)
class Comparison:
    """The statistics of a campaign.

    Attributes:
        name: name of the campaign.
        metric: the compared column of `runs`.
        keys: the swept keys.
        by: the keys whose values are compared with each other.
        baseline: the point that differences are from.
        table: a row per point with results, in the campaign's order. Columns: `point`, the swept keys, `replicates`,
            `known` (runs in which the metric is known); `median` and `mean` of the metric, `ever_lost` (share of the
            runs that lost a track at any time), `lost_fraction` (at the end), `energy` (median, J) and
            `error_per_joule` (median of metric / energy), each with `_low` and `_high`; `lost_window` (s) and
            `lost_limit`, which decide when a track is lost; `nees_median` (median over runs) and `singular` (sum over
            runs), which stand beside a NEES; `tracked` (mean share of the
            steps); `front` (on the Pareto front of its group in both medians; none for NEES and NIS, of which 1 is
            best). Where points are compared: the paired differences, `p_holm`, `p_losses_holm`, `test`
            (its name), `conclusion` (a sentence) and `hint` (what beside the filters may have decided). Unknown values
            are NaN.
        unpaired: why rows have no difference.
        unbounded: why some rows have no bound.
        of_bounds: what bounds take of the readings that may be otherwise, such as that they are independent.
        unit: the unit of the metric.
        lost: when a track is lost, in words; empty if it is unknown.
        same: which points gave the same runs, as a sentence.
        replayed: what all runs replay from files, as a sentence.
    """

    name: str
    metric: str
    keys: tuple[str, ...]
    by: tuple[str, ...]
    baseline: str | None
    table: pd.DataFrame
    unpaired: str
    unbounded: str = ""
    of_bounds: str = ""
    unit: str = "m"
    lost: str = ""
    same: str = ""
    replayed: str = ""


def compare(
    folder: Folder | str | Path, metric: str = "rmse", by: Sequence[str] | None = None, baseline: str | None = None
) -> Comparison:
    """Compare the points of a campaign.

    Args:
        folder: folder of the campaign.
        metric: a column of `runs`.
        by: the keys whose values are compared, within each combination of the other keys. By default those that
            `wsnsim compare` compares, or the only key of a sweep.
        baseline: the point that differences are from, by its values of `by`; by default the first.

    Raises:
        UsageError: there is no such metric, key or baseline.
        ResultError: there are no results, or they cannot be read.
    """
    folder = folder if isinstance(folder, Folder) else Folder(folder)
    manifest = folder.manifest()
    if metric not in METRICS:
        raise UsageError(f"table runs has no metric '{metric}' ({did_you_mean(metric, METRICS)})")
    chosen = _chosen(manifest, by)
    runs = campaigns.read(folder.path, "runs", sorted({*MEASURED, metric, *OF_STEPS}), DUTY_CYCLED)
    frames = {int(number): frame.set_index("replicate") for number, frame in runs.groupby(campaigns.POINT, sort=True)}
    points, one = [manifest.points[number] for number in frames], list(frames.values())
    settings = {n: {key: manifest.points[n].settings.get(key) for key in manifest.keys} for n in frames}
    table = pd.DataFrame([{campaigns.POINT: n, **settings[n], **_statistics(frames[n], metric)} for n in frames])
    groups = _groups(manifest, table, chosen)
    sign = -1.0 if metric in MORE_IS_BETTER else 1.0
    table["front"] = False if metric in ONE_IS_BEST else _fronts(table, groups, sign)
    baseline = baseline_point(manifest, chosen, baseline or (manifest.baseline if by is None else None))
    names = [label(point.settings.get(key) for key in chosen) for point in points]
    first = [(row, rows) for rows in groups for row in rows if names[row] == baseline]
    unit, unpaired = _unit(folder, manifest, metric), ""
    if chosen:
        baselines, unpaired = _paired(points, first)
        pairs = {row: pair_columns(one[row], one[start], metric) for row, start in baselines.items()}
        table = _concluded(with_pairs(table, pairs), baselines, folder, (chosen, metric, unit))
        unpaired = unpaired or ("" if first else f"the baseline '{baseline}' has no results")
    words = {"lost": loss_rule(dict(runs), _unit(folder, manifest, "rmse")), "same": same_runs(folder, manifest)}
    words |= {"replayed": shared_recordings(folder, points) if chosen else ""}
    return Comparison(manifest.name, metric, manifest.keys, chosen, baseline, table, unpaired, unit=unit, **words)


def _unit(folder: Folder, manifest: Manifest, metric: str) -> str:
    """The metric's unit; that of errors is the unit of the position, which the result files hold."""
    column = next(column for column in TABLES["runs"] if column.name == metric)
    batch = next((batch for point in manifest.points for batch in folder.batches(point.id)), None)
    if column.of_position and batch and (about := attributes(batch.path))["position"]:
        return str(about["states"][about["position"][0]][1])
    return column.units


def as_json(found: Comparison) -> dict[str, Any]:
    """The comparison as plain values; unknown ones are NaN."""
    rows = found.table.astype(object).where(found.table.notna(), np.nan).to_dict("records")
    values = {key: getattr(found, key) for key in ("name", "metric", "unit", "lost")}
    values |= {"keys": list(found.keys), "by": list(found.by), "points": rows, "conclusions": conclusions_of(found)}
    return values | {key: getattr(found, key) for key in ("unpaired", "unbounded", "of_bounds", "same", "replayed")}


def conclusions_of(found: Comparison) -> list[str]:
    """The sentences of all pairs, each with its hint."""
    if "conclusion" not in found.table:
        return []
    pairs = zip(found.table["conclusion"], found.table["hint"], strict=True)
    return [f"{sentence} (hint: {hint})" if hint else sentence for sentence, hint in pairs if sentence]


def _chosen(manifest: Manifest, by: Sequence[str] | None) -> tuple[str, ...]:
    if by is None:
        return manifest.by or keys_by_default(manifest.keys)
    for key in by:
        if key not in manifest.keys:
            raise UsageError(f"{manifest.name} does not vary '{key}' ({did_you_mean(key, manifest.keys)})")
    return tuple(by)


def _statistics(frame: pd.DataFrame, metric: str) -> dict[str, Any]:
    values, energy = (frame[name].to_numpy(dtype=np.float64) for name in (metric, ENERGY))
    middle, average = statistics.median(values), statistics.mean(values)
    lost, joules = statistics.share(frame["lost"].to_numpy() > 0), statistics.median(energy)
    ever = statistics.share(campaigns.ever_lost(frame))
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = statistics.median(np.where(energy > 0.0, values / energy, np.nan))
    return {
        "replicates": len(frame),
        "known": middle.known,
        **_spread("median", middle),
        **_spread("mean", average),
        **_spread("ever_lost", ever),
        **_spread("lost_fraction", lost),
        **{name: float(frame[name].min()) for name in ("lost_window", "lost_limit")},
        "nees_median": statistics.median(frame["nees_median"].to_numpy(dtype=np.float64)).value,
        "singular": float(frame["singular"].sum()),
        "tracked": statistics.mean(frame["tracked"].to_numpy(dtype=np.float64)).value,
        **_spread("energy", joules),
        **_spread("error_per_joule", rate),
    }


def _spread(name: str, found: statistics.IntervalEstimate) -> dict[str, float]:
    return {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high}


def _groups(manifest: Manifest, table: pd.DataFrame, by: Sequence[str]) -> list[list[int]]:
    """The rows of the points that differ in `by` only; one group of all if nothing is compared."""
    others = [key for key in manifest.keys if key not in by] if by else []
    values = [repr([table[key].iloc[row] for key in others]) for row in range(len(table))]
    return [rows.index.tolist() for _, rows in table.groupby(np.array(values), sort=False)]


def _fronts(table: pd.DataFrame, groups: Sequence[list[int]], sign: float) -> list[bool]:
    """Whether each row is on the Pareto front of its group in metric and energy; `sign` is −1 if more is better.

    A row with more than 5 % of its runs lost at any time is left out.
    """
    flags = np.zeros(len(table), dtype=np.bool_)
    follows = (table["ever_lost"] <= MOST_LOST).to_numpy()
    for rows in ([row for row in group if follows[row]] for group in groups):
        flags[rows] = statistics.pareto_front(
            (sign * table["median"].iloc[rows]).tolist(), table["energy"].iloc[rows].tolist()
        )
    return flags.tolist()


def _paired(points: Sequence[PointOnDisk], first: Sequence[tuple[int, list[int]]]) -> tuple[dict[int, int], str]:
    """The row of the baseline of each paired row, and why some rows have none, or ''."""
    found: dict[int, int] = {}
    unpaired = ""
    for start, rows in first:
        for row in rows:
            here, there = points[row], points[start]
            if here.world == there.world:
                found |= {row: start} if row != start else {}
                continue
            unpaired = unpaired or (
                f"{label(here.settings.values())} and {label(there.settings.values())} differ in seed, deployment,"
                " motion, sensor, prior, detection or faults: their runs are not paired"
            )
    return found, unpaired


def _concluded(
    table: pd.DataFrame, baselines: Mapping[int, int], folder: Folder, compared: tuple[tuple[str, ...], str, str]
) -> pd.DataFrame:
    """The table with a sentence and a hint for each pair. `compared`: keys, metric and unit."""
    by, metric, unit = compared
    manifest = folder.manifest()
    points = [manifest.points[number] for number in table[campaigns.POINT]]
    others = [key for key in manifest.keys if key not in by]
    network = traffic(folder, table[campaigns.POINT].tolist())
    sentences, hints = [""] * len(table), [""] * len(table)
    for row, start in baselines.items():
        settings, base = points[row].settings, points[start].settings
        one, other = (point_name(by, [values.get(key) for key in by]) for values in (settings, base))
        group = ", ".join(f"{key} = {label([settings.get(key)])}" for key in others)
        said = sentence(table.iloc[row].to_dict(), (one, other), metric, unit)
        sentences[row] = f"{group}: {said}" if group else said
        lossy = (
            (name, degenerate(network[at].particles, *table.loc[at, ["nees_median", "ever_lost", "singular"]]))
            for name, at in ((one, row), (other, start))
        )
        known = hint(network[row], network[start], (one, other))
        hints[row] = "; ".join([*filter(None, [known]), *(f"{name}: {said}" for name, said in lossy if said)])
    return table.assign(conclusion=sentences, hint=hints)
