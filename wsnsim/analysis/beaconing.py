"""The summary of a run without targets: receptions, losses, links, energy, and what became of reports to sinks.

text(report) -> str        as_json(report) -> dict

Of reports it says their share, latency and hops, which sink received them, and why others were lost.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from wsnsim.analysis import answer_facts
from wsnsim.analysis.answer import sentence
from wsnsim.analysis.answer_facts import facts_of_report
from wsnsim.analysis.phrases import REASONS, aligned, counted, wrapped
from wsnsim.analysis.quantities import QUANTITIES
from wsnsim.base.results import Report
from wsnsim.base.tables import KIND
from wsnsim.recording import meanings, read_table

NAN = float("nan")
NOTHING = {"reports": 0.0, "received_share": NAN, "report_delay": NAN, "hops": NAN, "sinks": {}, "dropped": {}}


def report_figures(report: Report) -> dict[str, Any]:
    """The reports of a run, from the tables `reports` and `events`; zeros and NaN without them.

    `reports` is the mean number per run, `received_share` the share that arrived, `report_delay` (s) the median time
    until it did, `hops` their mean number, `sinks` the mean number per run at each sink, and `dropped` that of copies
    that were dropped, by reason. Copies that were dropped may be of reports that arrived: an acknowledgement was lost.
    """
    if not dict(report.scenario.record).get("reports"):
        return NOTHING
    table = read_table(report.out, "reports", ["time", "received", "sink", "hops"])
    sent, runs = table["time"].size, len(report.summaries)
    if not sent:
        return NOTHING
    arrived = np.isfinite(table["received"])
    counts = Counter(table["sink"][arrived].tolist())
    return {
        "reports": sent / runs,
        "received_share": float(arrived.mean()),
        "report_delay": float(np.median((table["received"] - table["time"])[arrived])) if arrived.any() else NAN,
        "hops": float(table["hops"][arrived].mean()) if arrived.any() else NAN,
        "sinks": {str(int(sink)): count / runs for sink, count in sorted(counts.items())},
        "dropped": _dropped(report, runs),
    }


def _dropped(report: Report, runs: int) -> dict[str, float]:
    """The mean number of copies of datagrams that were dropped, by reason."""
    if not dict(report.scenario.record).get("events"):
        return {}
    table = read_table(report.out, "events", ["kind", "what"])
    words = meanings(report.out, "events", "what")
    codes = Counter(table["what"][table["kind"] == KIND["drop"]].tolist())
    found = {words[code]: count / runs for code, count in codes.items()}
    return {reason: found[reason] for reason in REASONS if reason in found and reason != "no_channel"}


def report_rows(found: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The lines of a summary; none if no report was sent."""
    if not found["reports"]:
        return []
    lines = [
        ("reports sent", f"{found['reports']:,.4g}"),
        ("reports received at a sink", f"{found['received_share']:.2%}"),
    ]
    if found["sinks"]:
        several = ((f"  at node {sink}", f"{count:,.4g}") for sink, count in found["sinks"].items())
        lines += several if len(found["sinks"]) > 1 else ()
        lines.append(("end-to-end latency, median", f"{1e3 * found['report_delay']:.4g} ms"))
        lines.append(("hops to the sink, mean", f"{found['hops']:.2f}"))
    return [*lines, *((f"dropped: {REASONS[reason]}", f"{count:,.4g}") for reason, count in found["dropped"].items())]


SCHEMA_VERSION = 1
IN_RANGE = 0.5
"""Reception probability from which on a link counts as in range."""


def as_json(report: Report) -> dict[str, Any]:
    """The summary as one object: SI units, means over the runs, NaN for a quantity that does not exist.

    A link is in range if an undisturbed beacon arrives with a probability of at least 0.5. `links` counts these,
    `found_share` is the share of them on which a beacon arrived, and `over_weak_links` counts the receptions over other
    links; they are NaN if the table `links` was not recorded, and `clock_error` and the like if `clocks` was not.
    `delivered_share` is the packet delivery ratio. For reports to sinks see `report_figures`.
    """
    runs = [summary.run for summary in report.summaries]
    causes = sorted({cause for summary in report.summaries for cause in summary.joules})
    means = {name: float(np.mean([run[name] for run in runs])) for name in MEAN_COLUMNS}
    in_range = means["in_range"]
    return {
        "schema_version": SCHEMA_VERSION,
        "answer": sentence(facts_of_report(report)),
        "name": report.scenario.name,
        "seed": report.scenario.seed,
        "file": str(report.out),
        "replicates": len(runs),
        "duration": report.scenario.duration,
        **means,
        "delivered_share": means["delivered"] / in_range if in_range else NAN,
        "collided_share": means["collided"] / in_range if in_range else NAN,
        **_links(report),
        **answer_facts.clock_figures(report),
        **report_figures(report),
        "energy": float(np.mean([run["energy"] for run in runs])),
        "joules": {cause: float(np.mean([s.joules.get(cause, 0.0) for s in report.summaries])) for cause in causes},
        "cpu_seconds": float(sum(run["cpu_seconds"] for run in runs)),
        "wall_seconds": report.wall,
        "fingerprints": [int(run["fingerprint"]) for run in runs],
    }


def text(report: Report) -> str:
    """The summary as lines for a terminal."""
    figures = as_json(report)
    what = "beacons" if report.scenario.workload.kind == "beacons" else "frames"
    runs = counted(figures["replicates"], "Monte Carlo run")
    heading = (
        f"{figures['name']}: {runs} of {figures['duration']:g} s of {what}, seed {figures['seed']} → {figures['file']}"
    )
    rows = [
        *report_rows(figures), *_radio_rows(figures, what), *_link_rows(figures), *answer_facts.clock_rows(figures),
        *_energy_rows(figures),
    ]  # fmt: skip
    cpu = QUANTITIES["cpu_seconds"]
    per_run = cpu.text(figures["cpu_seconds"] / figures["replicates"], "")
    took = f"  took {figures['wall_seconds']:.1f} s; {cpu.name} {per_run}"
    return "\n".join([*wrapped(figures["answer"]), heading, *aligned(rows), took])


MEAN_COLUMNS = (
    "frames_sent", "in_range", "delivered", "collided", "access_failures", "alive",
)  # fmt: skip
"""The columns of `runs` whose mean is shown."""


def _links(report: Report) -> dict[str, float]:
    """Links in range, neighbours of a node, share of links with a reception, and receptions over other links."""
    unknown = {"links": NAN, "neighbours": NAN, "found_share": NAN, "over_weak_links": NAN}
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


def _radio_rows(figures: Mapping[str, Any], what: str) -> list[tuple[str, str]]:
    ratio = QUANTITIES["packet_delivery_ratio"]
    otherwise_lost = round(figures["in_range"] - figures["delivered"] - figures["collided"])
    rows = [
        (f"{what} sent", f"{figures['frames_sent']:,.0f}"),
        *(
            (QUANTITIES[name].name, QUANTITIES[name].text(figures[name], ""))
            for name in ("access_failures", "in_range", "delivered")
        ),
        (ratio.name, ratio.text(figures["delivered_share"], "")),
        (QUANTITIES["collided"].name, f"{figures['collided']:,.0f} ({ratio.text(figures['collided_share'], '')})"),
        ("receptions lost to fading or dead nodes", f"{otherwise_lost:,}"),
    ]
    if figures["over_weak_links"] > 0:
        rows.append(("receptions over links out of range", f"{figures['over_weak_links']:,.0f}"))
    return rows


def _link_rows(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    if math.isnan(figures["links"]):
        return []
    return [
        ("neighbours of a node, mean", f"{figures['neighbours']:.2f}"),
        ("links with a reception", f"{figures['found_share']:.2%} of {figures['links']:,.0f}"),
    ]


def _energy_rows(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    energy, alive = QUANTITIES["energy"], QUANTITIES["alive"]
    rows = [(energy.name, energy.text(figures["energy"], ""))]
    rows += [(f"  {cause.replace('_', ' ')}", energy.text(joules, "")) for cause, joules in figures["joules"].items()]
    return [*rows, (alive.name, alive.text(figures["alive"], ""))]
