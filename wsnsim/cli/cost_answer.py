"""The answer of `--dry-run`: what a campaign will cost."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

from wsnsim.cli.progress import duration
from wsnsim.cli.shared import echo, echo_json

if TYPE_CHECKING:
    from wsnsim.campaign.cost_estimate import CostEstimate


def print_estimate(name: str, estimate: CostEstimate, as_json: bool) -> None:
    """Print the answer of --dry-run."""
    if as_json:
        echo_json({"name": name, **dataclasses.asdict(estimate)})
        return
    size = "unknown" if math.isnan(estimate.size) else f"{estimate.size / 1e6:.1f} MB"
    echo(f"{name}: {estimate.points} points, {estimate.replicates} runs, {estimate.done} of them done")
    echo(f"  missing  {estimate.left} runs in {estimate.tasks} tasks")
    echo(f"  time     {duration(estimate.wall_seconds)} ({duration(estimate.cpu_seconds)} of CPU time)")
    echo(f"  size     {size}")
    echo(f"  estimated from {estimate.source}")
