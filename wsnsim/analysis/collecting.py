"""What became of reports to sinks: their share, latency and hops, which sink received them, and why others were lost.

figures(report) -> dict        rows(figures) -> lines of a summary
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from wsnsim.analysis.phrases import REASONS
from wsnsim.base.results import Report
from wsnsim.base.tables import KIND
from wsnsim.recording import meanings, read_table

NAN = float("nan")
NOTHING = {"reports": 0.0, "received_share": NAN, "report_delay": NAN, "hops": NAN, "sinks": {}, "dropped": {}}


def figures(report: Report) -> dict[str, Any]:
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


def rows(found: Mapping[str, Any]) -> list[tuple[str, str]]:
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
