"""The summary of a run without targets: receptions, losses, links, energy, and the reports that reached a sink.

text(report) -> str        as_json(report) -> dict
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from wsnsim.analysis import clock_figures, collecting
from wsnsim.analysis.answer import sentence
from wsnsim.analysis.answer_facts import facts_of_report
from wsnsim.analysis.phrases import aligned, counted, wrapped
from wsnsim.analysis.quantities import QUANTITIES
from wsnsim.base.results import Report
from wsnsim.recording import read_table

SCHEMA_VERSION = 1
NAN = float("nan")
IN_RANGE = 0.5
"""Reception probability from which on a link counts as in range."""


def as_json(report: Report) -> dict[str, Any]:
    """The summary as one object: SI units, means over the runs, NaN for a quantity that does not exist.

    A link is in range if an undisturbed beacon arrives with a probability of at least 0.5. `links` counts these,
    `found_share` is the share of them on which a beacon arrived, and `over_weak_links` counts the receptions over other
    links; they are NaN if the table `links` was not recorded, and `clock_error` and the like if `clocks` was not.
    `delivered_share` is the packet delivery ratio. For reports to sinks see `collecting.figures`.
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
        **clock_figures.figures(report),
        **collecting.figures(report),
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
        *collecting.rows(figures), *_radio_rows(figures, what), *_link_rows(figures), *clock_figures.rows(figures),
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
