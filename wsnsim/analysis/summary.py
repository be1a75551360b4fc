"""The summary of a run of a scenario as plain values: quantities, published values and bounds.

    as_json(report, published, bounds) -> dict        `summary_text.text` makes lines of it

`published` may hold 'rmse' (in the position's unit), 'energy' (J), 'clusters', and 'rmse_px', 'rmse_vx', ... for the
state columns. The summary of a run without targets is about receptions, links, and reports to sinks.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from wsnsim.analysis import notes
from wsnsim.analysis.answer import comparable, sentence
from wsnsim.analysis.phrases import REASONS
from wsnsim.analysis.quantities import NETWORK_ONLY, QUANTITIES, flagged, interval, median_time, medians
from wsnsim.analysis.result_facts import ResultFacts, errors_of, facts_of_report
from wsnsim.base import metrics
from wsnsim.base.results import Report
from wsnsim.base.tables import KIND, UNLABELLED
from wsnsim.bounds import READINGS, bounds_of_run
from wsnsim.recording import meanings, read_table

SCHEMA_VERSION = 1
STILL_COUNTED: Final = ("in_range", "alive")
"""Quantities of networks that have a value without one."""


class RunBounds(NamedTuple):
    """Trajectory-conditional CRLBs beside the time-averaged RMSE of a report.

    Attributes:
        rmse: for all readings in range.
        kind: the kind of bound.
        reason: why there is none.
        active: for the readings of active members.
        arrived: for the readings that arrived at the head.
        judged: for all readings in range, at the steps of the error in the answer (see `answer.answer`); where readings
            name no target, that of the localisation part of GOSPA.
        every: whether those of active members and of the readings that arrived were asked for.
    """

    rmse: float = math.nan
    kind: str = ""
    reason: str = ""
    active: float = math.nan
    arrived: float = math.nan
    judged: float = math.nan
    every: bool = False


NOT_COMPUTED: Final = RunBounds(reason="not computed")


def as_json(
    report: Report, published: Mapping[str, float] | None = None, limits: RunBounds = NOT_COMPUTED
) -> dict[str, Any]:
    """The summary as one object: SI units, NaN for a quantity that does not exist; of a run without targets, see below.

    `answer` is the sentence of `answer.answer`. The quantities of `quantities.QUANTITIES` have their keys there, except
    `lost`, which is `lost_fraction` here, and `cpu_seconds`, which is the sum over runs. `column_rmse` is the root mean
    square over steps, runs and targets, `column_rmse_median` the median over runs. `rmse_three` and the like are
    medians over tracks; counts of waking are means of a run. `medians` has those over runs of means that few of them
    decide (see `quantities.medians`), `nees_median_consistent` the `nees_median` of a consistent filter. Steps without
    an estimate are left out. `faults` holds the kinds of faults, which `bound` does not count. `notes` says what a
    reader must know beside the figures, and `unknown` why each figure without a value has none.

    Without targets: a link is in range if an undisturbed beacon arrives with a probability of at least 0.5. `links`
    counts these, `found_share` is the share of them on which a beacon arrived, and `over_weak_links` counts the
    receptions over other links; they are NaN if the table `links` was not recorded, and `clock_error` and the like if
    `clocks` was not. `delivered_share` is the packet delivery ratio. For reports to sinks see `_report_figures`.
    """
    if not report.states:
        return _figures_without_target(report)
    figures = _figures(report, published or {}, limits)
    unknown = notes.reasons(report, figures)
    if not limits.every and math.isfinite(limits.rmse) and not without_network(report):
        unknown |= dict.fromkeys(("bound_active", "bound_arrived"), notes.ON_REQUEST)
    return figures | {"notes": notes.of_report(report, figures), "unknown": unknown}


def _head(report: Report, answer: str) -> dict[str, Any]:
    """What every summary begins with."""
    return {
        "schema_version": SCHEMA_VERSION,
        "answer": answer,
        "name": report.scenario.name,
        "seed": report.scenario.seed,
        "file": str(report.out),
        "replicates": len(report.summaries),
    }


def _costs(report: Report) -> dict[str, Any]:
    """Time in s of all runs, and their fingerprints."""
    return {
        "cpu_seconds": float(np.sum([summary.run["cpu_seconds"] for summary in report.summaries])),
        "wall_seconds": report.wall,
        "fingerprints": [int(summary.run["fingerprint"]) for summary in report.summaries],
    }


def _figures(report: Report, published: Mapping[str, float], limits: RunBounds) -> dict[str, Any]:
    """The summary of a run with targets, without its notes."""
    facts = facts_of_report(report)
    kept = [key for key in QUANTITIES if facts.unlabelled or key not in UNLABELLED]
    found = {key: QUANTITIES[key].value(facts) for key in kept}
    if without_network(report):
        found |= dict.fromkeys((key for key in NETWORK_ONLY if key in found and key not in STILL_COUNTED), math.nan)
    for key in filter(found.__contains__, flagged("interval")):
        found[f"{key}_low"], found[f"{key}_high"] = QUANTITIES[key].interval(facts)
    lost = facts.tracks["lost"] > 0
    clusters = (
        math.nan if without_network(report) else float(np.mean([summary.clusters for summary in report.summaries]))
    )
    return {
        **_head(report, sentence(facts, limits.judged)),
        "steps": int(facts.runs["steps"].max()),
        "targets": len(report.summaries[0].tracks),
        "medians": {key: value for key, value in medians(facts).items() if math.isfinite(found[key])},
        "nees_median_consistent": facts.consistent,
        "lost_fraction": found.pop("lost"),
        **found,
        **_column_rmse(report),
        "rmse_of_kept": metrics.averaged_rmse(np.where(lost[..., None], np.nan, facts.recorded.errors)),
        "joules": dict(facts.joules),
        "clusters": clusters,
        "runs_with_deaths": int(np.isfinite(facts.runs["first_death"]).sum()),
        **_track_figures(facts, report.scenario.step),
        **_costs(report),
        "published": dict(published),
        "bound": limits.rmse,
        "bound_active": limits.active,
        "bound_arrived": limits.arrived,
        **({"bound_localisation": limits.judged} if facts.unlabelled else {}),
        "bound_kind": limits.kind,
        "faults": list(facts.faults),
        "bound_reason": limits.reason,
    }


def bounds_of_report(report: Report, every: bool = False) -> RunBounds:
    """The trajectory-conditional CRLBs of a report, averaged over the steps that have an estimate.

    Args:
        report: what `experiment.run` returned.
        every: whether those of active members and of readings that arrived are computed, too. They are known of a
            network whose events, estimates and clusters were recorded, and take several times as long.
    """
    if not report.states:
        return NOT_COMPUTED
    kind = "per_trajectory"
    facts = facts_of_report(report)
    readings = READINGS if every and not without_network(report) and not facts.unlabelled else READINGS[:1]
    replicates = [summary.run["replicate"] for summary in report.summaries]
    found, *of_members = bounds_of_run(report.out, readings, kind, replicates=replicates, scenario=report.scenario)
    if found.reason:
        return RunBounds(reason=found.reason, every=every)
    errors = errors_of(report, found.each.shape[-1])
    judged = comparable(facts, found)
    limits = RunBounds(found.time_mean_at(errors), kind, judged=judged, every=every)
    if not of_members or not math.isfinite(limits.rmse):
        return limits
    active, arrived = (bound.time_mean_at(errors) for bound in of_members)
    return limits._replace(active=active, arrived=arrived)


def without_network(report: Report) -> bool:
    """Whether the run was a standalone filter, without a network."""
    return report.scenario.network is not None


def _track_figures(facts: ResultFacts, dt: float) -> dict[str, float]:
    """What the table `tracks` adds: losses, latencies, steps with three readings, wake-ups; steps of `dt` s."""
    tracks = {name: column.ravel() for name, column in facts.tracks.items()}
    three = facts.column("tracked_three")
    low, high = interval(three, metrics.mean_error)
    summed = ("reacquired", "late", "received", "due", "woken", "ineffective", "ineffective_twenty", "called")
    steps = float(facts.runs["steps"].sum()) * facts.tracks["lost_at"].shape[1] / facts.count
    if "time_present" in tracks:
        steps = float(tracks["time_present"].sum()) / dt / facts.count
    return {
        "lost_at": median_time(tracks["lost_at"]),
        **{name: float(tracks[name].sum()) / facts.count for name in (*summed, "dismissed")},
        "present_steps": round(steps, 6),
        "without_estimate": steps - float(tracks["reports"].sum()) / facts.count,
        **{name: metrics.median_error(tracks[name]) for name in ("delay", "report_delay", *notes.OF_THREE)},
        "mean_error": metrics.mean_error(facts.recorded.errors),
        "tracked_three": metrics.mean_error(three),
        "tracked_three_low": low,
        "tracked_three_high": high,
    }


def _column_rmse(report: Report) -> dict[str, dict[str, float]]:
    """The RMSE of each state column, over all runs and targets, and as the median over runs."""
    pooled, middle = {}, {}
    for i, (name, _) in enumerate(report.states):
        runs = [summary.column_rmse[:, i] for summary in report.summaries]
        pooled[name] = metrics.rmse(np.concatenate(runs))
        middle[name] = metrics.median_error(np.array([metrics.rmse(run) for run in runs]))
    return {"column_rmse": pooled, "column_rmse_median": middle}


MEAN_COLUMNS: Final = ("frames_sent", "in_range", "delivered", "collided", "access_failures", "alive")
"""The columns of `runs` whose mean the summary of a run without targets has."""
IN_RANGE: Final = 0.5
"""Reception probability from which on a link counts as in range."""
CLOCK_COLUMNS: Final = ("error", "error_max", "spread", "spread_max", "synchronised")


def _figures_without_target(report: Report) -> dict[str, Any]:
    """The summary of a run without targets, see `as_json`."""
    facts = facts_of_report(report)
    means = {name: facts.mean(name) for name in MEAN_COLUMNS}
    in_range = means["in_range"]
    return {
        **_head(report, sentence(facts)),
        "duration": report.scenario.duration,
        **means,
        "delivered_share": means["delivered"] / in_range if in_range else math.nan,
        "collided_share": means["collided"] / in_range if in_range else math.nan,
        **_link_figures(report),
        **clock_figures(report),
        **_report_figures(report, facts),
        "energy": facts.mean("energy"),
        "joules": dict(facts.joules),
        **_costs(report),
    }


def _link_figures(report: Report) -> dict[str, float]:
    """Links in range, neighbours of a node, share of links with a reception, and receptions over other links."""
    unknown = dict.fromkeys(("links", "neighbours", "found_share", "over_weak_links"), math.nan)
    if not dict(report.scenario.record).get("links"):
        return unknown
    table = read_table(report.out, "links", ["replicate", "source", "chance", "received"])
    strong = table["chance"] >= IN_RANGE
    if not strong.any():
        return unknown
    senders = len(set(zip(table["replicate"].tolist(), table["source"].tolist(), strict=True)))
    return {
        "links": float(strong.sum()) / len(report.summaries),
        "neighbours": float(strong.sum()) / senders,
        "found_share": float(np.mean(table["received"][strong] > 0)),
        "over_weak_links": float(table["received"][~strong].sum()) / len(report.summaries),
    }


def clock_figures(report: Report) -> dict[str, float]:
    """The columns of `clocks` at the end of runs, mean over runs, with names such as `clock_error`.

    NaN where the table was not recorded.
    """
    if not dict(report.scenario.record).get("clocks"):
        return {f"clock_{name}": math.nan for name in CLOCK_COLUMNS}
    table = read_table(report.out, "clocks", ["replicate", *CLOCK_COLUMNS])
    last = np.flatnonzero(np.diff(table["replicate"].astype(np.int64), append=-1))
    return {f"clock_{name}": float(table[name][last].mean()) if last.size else math.nan for name in CLOCK_COLUMNS}


def _report_figures(report: Report, facts: ResultFacts) -> dict[str, Any]:
    """The reports of a run to sinks; zeros and NaN if they were not recorded.

    `reports` is the mean number per run, `received_share` the share that arrived, `report_delay` (s) the median time
    until it did, `hops` their mean number, `sinks` the mean number per run at each sink, and `dropped` that of copies
    that were dropped, by reason. Copies that were dropped may be of reports that arrived: an acknowledgement was lost.
    """
    table = facts.reports
    received = table.get("received", np.empty(0))
    arrived = np.isfinite(received)
    known = {"received_share": math.nan, "report_delay": math.nan, "hops": math.nan, "sinks": {}, "dropped": {}}
    if received.size:
        known |= {"received_share": float(arrived.mean()), "dropped": _dropped(report, facts.count)}
    if arrived.any():
        counts = sorted(Counter(table["sink"][arrived].tolist()).items())
        known["report_delay"] = float(np.median((received - table["time"])[arrived]))
        known["hops"] = float(table["hops"][arrived].mean())
        known["sinks"] = {str(int(sink)): count / facts.count for sink, count in counts}
    return {"reports": received.size / facts.count, **known}


def _dropped(report: Report, runs: int) -> dict[str, float]:
    """The mean number of copies of datagrams that were dropped, by reason."""
    if not dict(report.scenario.record).get("events"):
        return {}
    table = read_table(report.out, "events", ["kind", "what"])
    words = meanings(report.out, "events", "what")
    codes = Counter(table["what"][table["kind"] == KIND["drop"]].tolist())
    found = {words[code]: count / runs for code, count in codes.items()}
    return {reason: found[reason] for reason in REASONS if reason in found and reason != "no_channel"}
