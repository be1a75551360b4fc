"""The answer of a result in one sentence: was the target followed, how well, for how many joules, spent on what.

answer(source) -> 'The target was followed in all 30 runs, with a time-averaged RMSE of 0.894 m, 6.8 times the ...'

Each function of a clause returns it without a full stop, empty where there is nothing to say.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection
from pathlib import Path
from typing import Final

import numpy as np

from wsnsim.analysis.multi_target import GOSPA, least_localisation
from wsnsim.analysis.quantities import DECIDED, loss_rule, median_time, time_averaged_rmse
from wsnsim.analysis.result_facts import ResultFacts, facts_of_file, facts_of_report
from wsnsim.base import metrics
from wsnsim.base.arrays import Floats
from wsnsim.base.errors import WsnsimError, shortened
from wsnsim.base.results import Report
from wsnsim.base.tables import LOSSES, SPENT
from wsnsim.bounds import Bound, bound, bounds_of_run

CAUSE_WORDS: Final = {
    "tx_electronics": "transmission", "tx_amplifier": "transmission", "rx": "reception", "overhear": "overhearing",
    "cpu": "computation", "sense": "sensing", "idle": "idle listening", "sleep": "sleep",
    "switch": "switching between states", "leak": "leakage", "self_discharge": "self-discharge",
    "stranded": "charge that could not be drawn", "unstored": "charging", "surplus": "surplus of full batteries",
}  # fmt: skip
"""What the energy of a cause was spent on; both causes of transmission count as one."""
PRESENT: Final = "time_present"
"""The column of `tracks` that results have whose targets may be absent."""
IDLE: Final = CAUSE_WORDS["idle"]
DOMINANT: Final = 0.5
"""Share of the energy from which on one use alone is named."""
ALMOST_ALL: Final = 0.95
"""Share of idle listening from which on trackers hardly differ in energy (our choice)."""
PREFIXES: Final = ((1.0, "J"), (1e-3, "mJ"), (1e-6, "µJ"))


def energy_clause(facts: ResultFacts) -> str:
    """How many joules were spent, what most of them were spent on, and whether a tracker could change that."""
    if not facts.has_network:
        return "no network is simulated, so no energy is spent"
    total = facts.mean("energy")
    if total <= 0.0:
        return "the network spent no energy"
    size, unit = next(((size, unit) for size, unit in PREFIXES if total >= size), PREFIXES[-1])
    spent = f"the network spent {figure(total / size)} {unit}{' a run' if facts.count > 1 else ''}"
    uses = _uses(facts, SPENT)
    if not uses or not math.isclose(sum(uses.values()), total, rel_tol=0.01):
        return spent
    named = list(uses.items())[: 1 if next(iter(uses.values())) >= DOMINANT * total else 2]
    figures = [figure(joules / size) for _, joules in named]
    if figures[0] == figure(total / size):
        parts = f"nearly all of it {named[0][0]}"
    else:
        parts = "of which " + " and ".join(
            f"{shown} {unit} is {use}" for shown, (use, _) in zip(figures, named, strict=True)
        )
    # where nearly all energy is idle listening of radios that no tracker switches off
    always_on = facts.mean("awake") == 1.0 and "radio_on" not in facts.runs and facts.workload == "tracking"
    idle = always_on and uses.get(IDLE, 0.0) / total >= ALMOST_ALL
    return f"{spent}, {parts}" + ": trackers hardly differ in energy here" * idle


def losses_clause(facts: ResultFacts) -> str:
    """How many joules batteries lost beside what was spent, and to what; empty if none."""
    lost = {use: joules for use, joules in _uses(facts, LOSSES).items() if joules > 0.0}
    named = ", ".join(f"{figure(joules)} J to {use}" for use, joules in lost.items())
    return f"batteries lost {named}" if lost else ""


def _uses(facts: ResultFacts, causes: Collection[str]) -> dict[str, float]:
    """The energy (J) by what it was spent on or lost to, of some causes, the largest first."""
    found = defaultdict[str, float](float)
    for cause in filter(causes.__contains__, facts.joules):
        found[CAUSE_WORDS.get(cause, cause.replace("_", " "))] += facts.joules[cause]
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def sink_clause(facts: ResultFacts) -> str:
    """The share of the due estimates that reached a sink, and their latency; empty without a sink."""
    due, received = (facts.tracks.get(name, np.zeros(1)).sum() for name in ("due", "received"))
    if not due > 0:
        return ""
    late = facts.tracks.get("report_delay", np.empty(0))
    late = late[np.isfinite(late)]
    after = f", after {seconds(float(np.median(late)))} (median)" if late.size and received else ""
    return f"{percent(received / due)} of the estimates due at the sink arrived{after}"


def lifetime_clause(facts: ResultFacts) -> str:
    """In how many runs nodes died, when the first one did, and how many are alive at the end; empty if none died."""
    deaths = facts.column("first_death")
    died = int(np.isfinite(deaths).sum())
    if not died:
        return ""
    alive = f"{figure(facts.mean('alive'))} are alive at the end"
    if facts.count == 1:
        return f"the first node died after {figure(float(deaths[0]))} s, and {alive}"
    first = median_time(deaths)
    when = f", the first after {figure(first)} s (median)" if math.isfinite(first) else ""
    return f"nodes died in {runs(died, facts.count)}{when}, and {alive} (mean)"


def collection_clause(facts: ResultFacts) -> str:
    """The share of reports that reached a sink, their latency and hops; empty if reports were not recorded."""
    received = facts.reports.get("received", np.empty(0))
    if not received.size or not {"time", "hops", "sink"} <= set(facts.reports):
        return ""
    there = np.isfinite(received)
    if not there.any():
        return "None of the reports reached a sink"
    sinks = np.unique(facts.reports["sink"][there]).size
    delay = float(np.median((received - facts.reports["time"])[there]))
    hops = float(facts.reports["hops"][there].mean())
    where = "the sink" if sinks == 1 else f"one of {sinks:,} sinks"
    share = percent(float(there.mean()))
    return f"{share} of the reports reached {where}, after {seconds(delay)} (median) over {figure(hops)} hops (mean)"


def reception_clause(facts: ResultFacts) -> str:
    """The share of intended receptions that succeeded, and of those lost in collisions."""
    intended, delivered, collided = (facts.mean(name) for name in ("in_range", "delivered", "collided"))
    what = "beacons" if facts.workload == "beacons" else "frames"
    if not intended > 0.0:
        return f"No node was in range of the {what} sent"
    if delivered == intended:
        return f"All intended receptions of {what} succeeded"
    lost = f" ({percent(collided / intended, 1)} were lost in collisions)" if collided > 0.0 else ""
    return f"{percent(delivered / intended, 1)} of the intended receptions of {what} succeeded{lost}"


def figure(value: float) -> str:
    """A number of a sentence: three digits, and no exponent where it would be short."""
    return f"{value:,.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.3g}"


def runs(some: int, every: int) -> str:
    """Some of the runs: 'the run', 'both runs', 'all 30 runs', '3 of 30 runs'."""
    if some < every:
        return f"{some:,} of {every:,} runs"
    return {1: "the run", 2: "both runs"}.get(every, f"all {every:,} runs")


def percent(share: float, digits: int = 0) -> str:
    """A share in per cent, which says all or nothing only if it is."""
    least = 10.0**-digits
    if 0.0 < share < 1.0 and not least / 2.0 <= 100.0 * share < 100.0 - least / 2.0:
        return f"{'less' if share < 0.5 else 'more'} than {least if share < 0.5 else 100.0 - least:g} %"
    return f"{100.0 * share:.{digits}f} %"


def seconds(time: float) -> str:
    """A latency with a fitting unit."""
    return f"{1e3 * time:.3g} ms" if time < 1.0 else f"{figure(time)} s"


SEEN: Final = 0.995
"""Share of tracked steps from which on all steps count as tracked."""


def answer(source: Report | str | Path, *, plugins: bool = False, facts: ResultFacts | None = None) -> str:
    """A sentence on the runs of a result: whether the target was followed, how well, for how many joules.

    The error is the time-averaged RMSE over the runs in which no track was lost, and over all runs. Beside it stands
    the trajectory-conditional CRLB of the same steps for all readings in range, unless most runs lost a track.

    Args:
        source: what `experiment.run` returned, or a result file. The bound takes about 20 ms a run of 700 steps.
        plugins: whether plug-ins that a result file names are imported for the bound.
        facts: the facts of the source, if they are already known.

    Raises:
        ResultError: the file cannot be read.
    """
    facts = facts or (facts_of_report(source) if isinstance(source, Report) else facts_of_file(source))
    crlb = _found_bound(source, facts, plugins) if facts.count and facts.recorded.errors.size else None
    return sentence(facts, comparable(facts, crlb))


def sentence(facts: ResultFacts, crlb: float = np.nan) -> str:
    """The sentence of known facts; empty if no run has finished.

    Args:
        facts: what is known of the runs.
        crlb: the bound beside the error, NaN if there is none.
    """
    if not facts.count:
        return ""
    if facts.workload != "tracking":
        first = collection_clause(facts) or reception_clause(facts)
    else:
        known = facts.recorded.errors if facts.recorded.errors.size else facts.column("rmse")
        followed = tracks_clause if facts.unlabelled else _followed
        first = followed(facts, crlb) if facts.unlabelled or np.isfinite(known).any() else _no_estimate(facts)
    clauses = (
        first, absent_clause(facts), sink_clause(facts), energy_clause(facts), losses_clause(facts),
        lifetime_clause(facts),
    )  # fmt: skip
    return "; ".join(filter(None, clauses)) + "."


def _found_bound(source: Report | str | Path, facts: ResultFacts, plugins: bool) -> Bound | None:
    """The trajectory-conditional CRLB for all readings in range; None if it cannot be had."""
    replicates, kind = facts.recorded.replicates.tolist(), "per_trajectory"
    try:
        if isinstance(source, Report):
            return bound(source.scenario, replicates, kind)
        return bounds_of_run(source, ("in_range",), kind, replicates=replicates, plugins=plugins)[0]
    except WsnsimError:
        return None


def comparable(facts: ResultFacts, crlb: Bound | None) -> float:
    """The time average of a bound at the steps of the errors that are judged; NaN without a bound.

    Where readings name no target, it is that of the localisation part of GOSPA.
    """
    steps = facts.recorded.steps
    if crlb is None or crlb.reason or not steps.size:
        return np.nan
    judged, each = facts.judged_errors, crlb.each
    if steps[0] < 1 or steps[-1] > each.shape[-1] or judged.shape[:2] != each.shape[:2]:
        return np.nan
    errors = np.full(each.shape, np.nan)
    errors[:, :, steps - 1] = facts.recorded.errors if facts.unlabelled else judged
    return least_localisation(each, errors) if facts.unlabelled else crlb.time_mean_at(errors)


def _targets(facts: ResultFacts) -> int:
    """The number of targets that exist in some run."""
    if "target" in facts.tracks and facts.tracks["target"].size:
        targets: Floats = facts.tracks["target"]
        return int(np.unique(targets[facts.tracks.get(PRESENT, targets + 1.0) > 0.0]).size)
    return int(max(facts.recorded.errors.shape[1], 1))


def absent_clause(facts: ResultFacts) -> str:
    """Which of several targets never existed; empty if all did, or none of them."""
    if PRESENT not in facts.tracks or not _targets(facts):
        return ""
    targets, there = facts.tracks["target"], facts.tracks[PRESENT] > 0.0
    missing = np.setdiff1d(targets, targets[there]).astype(int).tolist()
    named = f"target{'s' * (len(missing) > 1)} {shortened(', '.join(map(str, missing)))}"
    return f"{named} never existed in {runs(facts.count, facts.count)}" if missing else ""


def tracks_clause(facts: ResultFacts, crlb: float) -> str:
    """How completely targets were followed where readings name none, with which GOSPA, switches and false tracks.

    `crlb` is the bound of the localisation part, NaN if there is none.
    """
    where, share = runs(facts.count, facts.count), facts.mean("completeness")
    false = f"{_number_of(facts.mean('false_tracks'), 'false track', 's')} an hour"
    if np.isnan(share):
        return f"No target existed in {where}, and there were {false}"
    subject = "The target was" if _targets(facts) == 1 else f"The {_targets(facts):,} targets were"
    whole, near, missed, extra = (f"{figure(facts.mean(name))} {facts.unit}".rstrip() for name in GOSPA)
    if math.isfinite(crlb) and crlb > 0.0:
        limit = f"{figure(crlb)} {facts.unit}".rstrip()
        ratio = _ratio(facts.mean("gospa_localisation") / crlb)
        near += f", which is {ratio} times the trajectory-conditional CRLB with known association of {limit}"
    switched = _number_of(facts.mean("switches"), "identity switch", "es") + " a run" * (facts.count > 1)
    return (
        f"{subject} followed at {percent(share)} of their steps in {where}, with a GOSPA of {whole} (c ="
        f" {facts.cutoff:.4g} {facts.unit}; missed targets {missed}, false tracks {extra},"
        f" localisation {near}), {switched} and {false}"
    )


def _number_of(value: float, what: str, plural: str) -> str:
    return f"{figure(value) if value else 'no'} {what}{plural * (value != 1.0)}"


def _no_estimate(facts: ResultFacts) -> str:
    subject = "The target was" if _targets(facts) == 1 else "The targets were"
    where = "the run" if facts.count == 1 else f"the {facts.count:,} runs"
    if not facts.tracks.get(PRESENT, np.ones(1)).any():
        return f"No target existed: none is present at any step of {where}"
    return f"{subject} never located: no step of {where} has an estimate"


def _followed(facts: ResultFacts, crlb: float) -> str:
    """Whether the targets were followed, in how many runs one was lost, and with what error."""
    lost, (name, value) = int(facts.ever_lost.sum()), _error(facts)
    error = f"a {name} of {figure(value)} {facts.unit}".rstrip()
    if 0 < lost < facts.count:
        errors = facts.recorded.errors
        every = time_averaged_rmse(errors) if errors.size else metrics.median_error(facts.column("rmse"))
        error += f" ({figure(every)} {facts.unit}".rstrip() + " over all runs)"
    measured = facts.tracked_shares.any()
    judged = measured and math.isfinite(crlb) and crlb > 0.0 and (2 * lost <= facts.count or lost == facts.count)
    if judged:
        without = " without faults" if facts.faults else ""
        limit = f"trajectory-conditional CRLB{without} of {figure(crlb)} {facts.unit}".rstrip()
        error += f", {_ratio(value / crlb)} times the {limit}"
    middle = _middle_of_kept(facts)
    if value > DECIDED * middle > 0.0:
        error += f" (few runs decide this mean: the median per-run RMSE is {figure(middle)} {facts.unit}".rstrip()
        error += f", {_ratio(middle / crlb)} times the CRLB{without})" if judged else ")"
    if others := facts.count - lost if lost else 0:
        return f"{_lost(facts, lost)}; the other {'has' if others == 1 else f'{others:,} have'} {error}"
    if lost:
        return f"{_lost(facts, lost)}, with {error}"
    if math.isinf(facts.limit):
        return f"Over {'the run' if facts.count == 1 else f'{facts.count:,} runs'} the filter has {error}"
    if not measured:
        return f"{_never_lost(facts, poor=False)}, with {error}"
    poor = value > facts.limit / 2.0 or not facts.tracked_shares.all()
    return f"{_never_lost(facts, poor)}, {'but ' * poor}with {error}"


def _never_lost(facts: ResultFacts, poor: bool) -> str:
    """That no track was lost; `poor` if the error or what was measured forbids to say that the target was followed."""
    targets, tracked = _targets(facts), facts.mean("tracked")
    subject = {1: "The target was", 2: "Both targets were"}.get(targets, f"All {targets:,} targets were")
    if absent_clause(facts):
        subject = "The target that existed was" if targets == 1 else f"The {targets:,} targets that existed were"
    if not facts.tracked_shares.any():
        return f"{subject} never measured in {runs(facts.count, facts.count)} (all estimates are predictions)"
    rule = _rule(facts) if poor else ""
    share = f" (tracked at {percent(tracked)} of the steps)" if tracked < SEEN else ""
    how = "never lost in" if poor else "followed throughout" if facts.count == 1 else "followed in"
    if PRESENT in facts.tracks:
        how = f"{'never lost' if poor else 'followed'} while present in"
    return f"{subject} {how} {runs(facts.count, facts.count)}{rule}{share}"


def _rule(facts: ResultFacts) -> str:
    """When a track counts as lost, in brackets; empty if it is unknown."""
    rule = loss_rule(facts.runs, facts.unit)
    return f" ({rule})" if rule else ""


def _lost(facts: ResultFacts, lost: int) -> str:
    """In how many runs a track was lost, and in how many of these it was found again."""
    found, subject = lost - int(facts.lost_at_the_end.sum()), "The target" if _targets(facts) == 1 else "A target"
    if facts.count == 1:
        share = facts.mean("lost_share")
        how = "but found again" if found else "and not found again"
        return f"{subject} was lost{_rule(facts)} {how}" + (
            f" (for {percent(share)} of the steps)" if share > 0.0 else ""
        )
    some = f"{found:,}" if found < lost else "both" if lost == 2 else "all"
    again = f" (and found again in {some} of these)" if lost > 1 else " (and found again)"
    return f"{subject} was lost{_rule(facts)} in {runs(lost, facts.count)}{again * (found > 0)}"


def _error(facts: ResultFacts) -> tuple[str, float]:
    """(name, value) of the error over the runs that are judged."""
    if facts.recorded.errors.size:
        return "time-averaged RMSE", time_averaged_rmse(facts.judged_errors)
    return "median per-run RMSE", _middle_of_kept(facts)


def _middle_of_kept(facts: ResultFacts) -> float:
    """The median per-run RMSE over the runs that are judged."""
    lost = facts.ever_lost
    kept = facts.column("rmse")[~lost] if lost.any() and not lost.all() else facts.column("rmse")
    return metrics.median_error(kept)


def _ratio(value: float) -> str:
    """A ratio to the bound, with two or three digits."""
    return f"{value:.2f}" if value < 2.0 else f"{value:.1f}" if value < 10.0 else f"{value:,.0f}"
