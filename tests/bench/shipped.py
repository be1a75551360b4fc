"""What one run of every shipped scenario costs, in memory: CPU seconds, and bare timeouts of the same process.

`python -m tests.bench.shipped NAME` prints one scenario's figures as JSON (see `measured`).
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.bench.timing import row, seconds_of_a_timeout

SCENARIOS = Path(__file__).parents[2] / "scenarios"
LONG = 5.0
"""Seconds from which a run is not repeated."""


def shipped_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """A row for each scenario: CPU seconds of one run after a first one, start-up and result file not counted."""
    of_papers = (path for path in SCENARIOS.glob("papers/*/*.yaml") if path.name != "study.yaml")
    for path in sorted([*SCENARIOS.glob("*.yaml"), *of_papers], key=lambda path: path.stem):
        command = [sys.executable, "-m", "tests.bench.shipped", str(path), str(min(repeats, 5))]
        answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        found = json.loads(answer.splitlines()[-1])
        note = (
            f"{found['nodes']:,} nodes, {found['simulated']:g} s simulated, {found['steps']:,} steps of targets, "
            f"{found['frames']:,} frames, {found['timeouts']:,.0f} timeouts"
        )
        yield row(f"{path.stem}: CPU of one run", found["seconds"], "s", note=note)


def measured(name: str, repeats: int) -> dict[str, float]:
    """{"seconds": CPU, "timeouts": that many bare ones, "nodes", "simulated": s, "steps", "frames": of the run}."""
    from wsnsim import experiment, scenario
    from wsnsim.base.tables import Memory

    parts = scenario.build(scenario.load(name))
    memory = Memory({"nodes": True})
    run = experiment.replicate_of(parts, 0, memory).run
    seconds: list[float] = []
    while len(seconds) < repeats and (not seconds or seconds[-1] < LONG):
        began = time.process_time()
        experiment.replicate_of(parts, 0, Memory({}))
        seconds.append(time.process_time() - began)
    cost = statistics.median(seconds)
    return {
        "seconds": cost,
        "timeouts": cost / statistics.median(seconds_of_a_timeout() for _ in range(5)),
        "nodes": len(memory.table("nodes").get("node", ())),
        "simulated": parts.duration,
        "steps": int(run["steps"]),
        "frames": int(run["frames_sent"]),
    }


if __name__ == "__main__":
    print(json.dumps(measured(sys.argv[1], int(sys.argv[2]))))
