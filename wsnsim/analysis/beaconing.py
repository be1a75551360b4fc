"""A network without a target in figures: what share of the beacons arrived, what became of the others, who found whom.

text(report) -> str        as_json(report) -> dict
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from wsnsim.experiment import Report
from wsnsim.recording import read_table

SCHEMA_VERSION = 1
NAN = float("nan")
NEIGHBOUR = 0.5
"""Chance of a beacon from which a link counts as in range."""


def as_json(report: Report) -> dict[str, Any]:
    """The summary as one object: SI units, means over the replicates, NaN where a figure does not exist.

    Receptions in range are those over links on which a beacon, undisturbed, more often arrives than not; what comes
    over weaker ones is `over_weak_links`. `links` counts the former, `found_share` is of them those over which a beacon
    arrived. These are NaN if the table `links` was not recorded.
    """
    runs = [summary.run for summary in report.summaries]
    causes = sorted({cause for summary in report.summaries for cause in summary.joules})
    means = {name: float(np.mean([run[name] for run in runs])) for name in COUNTED}
    in_range = max(means["in_range"], 1e-300)
    return {
        "schema_version": SCHEMA_VERSION,
        "name": report.scenario.name,
        "seed": report.scenario.seed,
        "file": str(report.out),
        "replicates": len(runs),
        "duration": report.scenario.duration,
        **means,
        "delivered_share": means["delivered"] / in_range if means["in_range"] else NAN,
        "collided_share": means["collided"] / in_range if means["in_range"] else NAN,
        **_links(report),
        "energy": float(np.mean([run["energy"] for run in runs])),
        "joules": {cause: float(np.mean([s.joules.get(cause, 0.0) for s in report.summaries])) for cause in causes},
        "cpu_seconds": float(sum(run["cpu_seconds"] for run in runs)),
        "wall_seconds": report.wall,
        "fingerprints": [int(run["fingerprint"]) for run in runs],
    }


def text(report: Report) -> str:
    """The summary as lines for a terminal."""
    figures = as_json(report)
    plural = "" if figures["replicates"] == 1 else "s"
    heading = (
        f"{figures['name']}: {figures['replicates']} replicate{plural} of {figures['duration']:g} s of beacons, "
        f"seed {figures['seed']} → {figures['file']}"
    )
    rows = [*_air_rows(figures), *_link_rows(figures), *_energy_rows(figures)]
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    lines = [f"  {name:<{widths[0]}}  {value:>{widths[1]}}" for name, value in rows]
    cpu = figures["cpu_seconds"] / figures["replicates"]
    took = f"  took {figures['wall_seconds']:.1f} s, {cpu:.2f} s of CPU a replicate"
    return "\n".join([heading, *lines, took])


COUNTED = (
    "frames_sent", "in_range", "delivered", "collided", "access_failures", "alive",
)  # fmt: skip
"""Which columns of `runs` are counts that can be averaged."""


def _links(report: Report) -> dict[str, float]:
    """How many neighbours a sender has, over how many of its links a beacon arrived, and what came over weaker ones."""
    unknown = {"links": NAN, "neighbours": NAN, "found_share": NAN, "over_weak_links": NAN}
    if not dict(report.scenario.record).get("links"):
        return unknown
    table = read_table(report.out, "links", ["replicate", "source", "chance", "received"])
    strong = table["chance"] >= NEIGHBOUR
    if not strong.any():
        return unknown
    senders = len(set(zip(table["replicate"].tolist(), table["source"].tolist(), strict=True)))
    return {
        "links": float(strong.sum()) / len(report.summaries),
        "neighbours": float(strong.sum()) / senders,
        "found_share": float(np.mean(table["received"][strong] > 0)),
        "over_weak_links": float(table["received"][~strong].sum()) / len(report.summaries),
    }


def _air_rows(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    others = round(figures["in_range"] - figures["delivered"] - figures["collided"])
    delivered, collided = (
        f"{figures[name]:,.0f} ({100 * figures[f'{name}_share']:.2f} %)" for name in ("delivered", "collided")
    )
    rows = [
        ("beacons sent", f"{figures['frames_sent']:,.0f}"),
        ("beacons that never got the channel", f"{figures['access_failures']:,.0f}"),
        ("receptions in range", f"{figures['in_range']:,.0f}"),
        ("  delivered", delivered),
        ("  lost to collisions, jamming, or sending", collided),
        ("  lost to fading, or to death", f"{others:,}"),
    ]
    if figures["over_weak_links"] > 0:
        rows.append(("received over weaker links besides", f"{figures['over_weak_links']:,.0f}"))
    return rows


def _link_rows(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    if math.isnan(figures["links"]):
        return []
    return [
        ("neighbours of a node, mean", f"{figures['neighbours']:.2f}"),
        ("links found", f"{100 * figures['found_share']:.2f} % of {figures['links']:,.0f}"),
    ]


def _energy_rows(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows = [("energy of the network", f"{figures['energy']:.4f} J")]
    rows += [(f"  {cause.replace('_', ' ')}", f"{joules:.4f} J") for cause, joules in figures["joules"].items()]
    return [*rows, ("nodes alive at the end", f"{figures['alive']:.4g}")]
