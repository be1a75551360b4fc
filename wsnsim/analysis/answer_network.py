"""The clauses of an answer on the network: energy and what it was spent on, reports at sinks, receptions, deaths.

Each function returns a clause without a full stop, empty where there is nothing to say.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from wsnsim.analysis.answer_facts import AnswerFacts
from wsnsim.analysis.quantities import median_time

CAUSE_WORDS: Final = {
    "tx_electronics": "transmission", "tx_amplifier": "transmission", "rx": "reception", "overhear": "overhearing",
    "cpu": "computation", "sense": "sensing", "idle": "idle listening", "sleep": "sleep",
    "switch": "switching between states", "leak": "leakage",
}  # fmt: skip
"""What the energy of a cause was spent on; both causes of transmission count as one."""
IDLE: Final = CAUSE_WORDS["idle"]
DOMINANT: Final = 0.5
"""Share of the energy from which on one use alone is named."""
ALMOST_ALL: Final = 0.95
"""Share of idle listening from which on trackers hardly differ in energy (our choice)."""
PREFIXES: Final = ((1.0, "J"), (1e-3, "mJ"), (1e-6, "µJ"))


def energy_clause(facts: AnswerFacts) -> str:
    """How many joules were spent, what most of them were spent on, and whether a tracker could change that."""
    if not facts.has_network:
        return "no network is simulated, so no energy is spent"
    total = facts.mean("energy")
    if total <= 0.0:
        return "the network spent no energy"
    size, unit = next(((size, unit) for size, unit in PREFIXES if total >= size), PREFIXES[-1])
    spent = f"the network spent {figure(total / size)} {unit}{' a run' if facts.count > 1 else ''}"
    uses = _uses(facts)
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
    return f"{spent}, {parts}{_consequence(facts, uses.get(IDLE, 0.0) / total)}"


def _uses(facts: AnswerFacts) -> dict[str, float]:
    """The energy (J) by what it was spent on, the largest first."""
    found: dict[str, float] = {}
    for cause, joules in facts.joules.items():
        use = CAUSE_WORDS.get(cause, cause.replace("_", " "))
        found[use] = found.get(use, 0.0) + joules
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _consequence(facts: AnswerFacts, idle: float) -> str:
    """What follows where nearly all energy is idle listening of radios that no tracker switches off."""
    always_on = facts.mean("awake") == 1.0 and "radio_on" not in facts.runs
    if not always_on or idle < ALMOST_ALL or facts.workload != "tracking":
        return ""
    return ": trackers hardly differ in energy here"


def sink_clause(facts: AnswerFacts) -> str:
    """The share of the due estimates that reached a sink, and their latency; empty without a sink."""
    due, received = (facts.tracks.get(name, np.zeros(1)).sum() for name in ("due", "received"))
    if not due > 0:
        return ""
    late = facts.tracks.get("report_delay", np.empty(0))
    late = late[np.isfinite(late)]
    after = f", after {seconds(float(np.median(late)))} (median)" if late.size and received else ""
    return f"{percent(received / due)} of the estimates due at the sink arrived{after}"


def lifetime_clause(facts: AnswerFacts) -> str:
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


def collection_clause(facts: AnswerFacts) -> str:
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


def reception_clause(facts: AnswerFacts) -> str:
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
