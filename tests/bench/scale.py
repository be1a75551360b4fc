"""What nodes cost that sleep: the same target over a field of 1,000 to 1,000,000 nodes, each run in its own process.

`python -m tests.bench.scale NODES` prints one run as JSON: CPU seconds of drawing and building the fleet, of the rest
of a replicate without a file, of a whole replicate with its file; and the peak memory above the imports', in MB.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.bench.timing import peak_megabytes, row

SIZES = (1_000, 10_000, 100_000, 1_000_000)
MOST_SECONDS, MOST_MEGABYTES = 15, 350


def scale_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """Growth from a thousand nodes to a million; the shipped scenario of a million as a user runs it."""
    runs = {size: _asked(str(size)) for size in SIZES}
    for size, run in runs.items():
        yield row(f"field of {size:,} nodes: drawing and building, CPU", run["construction"], "s")
        yield row(f"field of {size:,} nodes: whole replicate with its file, CPU", run["whole"], "s")
        yield row(f"field of {size:,} nodes: memory above the imports", run["memory"], "MB")
        yield row(f"field of {size:,} nodes: without drawing, building and file, CPU", run["awake"], "s")
    with tempfile.TemporaryDirectory() as folder:
        began = time.monotonic()
        peak = _asked("run", "field_1m", "-q", "--out", str(Path(folder) / "x.h5"))["peak"]
        yield row("wsnsim run field_1m, wall, imports included", time.monotonic() - began, "s", MOST_SECONDS)
        yield row("wsnsim run field_1m, memory in all", peak, "MB", MOST_MEGABYTES)


def _asked(*arguments: str) -> dict[str, float]:
    command = [sys.executable, "-m", "tests.bench.scale", *arguments]
    answer = subprocess.run(command, check=True, capture_output=True, text=True)
    figures: dict[str, float] = json.loads(answer.stdout.splitlines()[-1])
    return figures


def main() -> None:
    """One run of the field, once small to warm up, once as large as is asked for; or a command line of wsnsim."""
    if not sys.argv[1].isdigit():
        from wsnsim.cli import main as command_line

        assert command_line(sys.argv[1:]) == 0
        print(json.dumps({"peak": peak_megabytes()}))
        return
    from wsnsim import experiment, scenario
    from wsnsim.base.rng import Streams
    from wsnsim.base.tables import Memory
    from wsnsim.network.nodes import Nodes
    from wsnsim.recording import ResultFile

    def built(nodes: int) -> Any:
        side = 25.0 * nodes**0.5
        sides = [f"deploy.nodes={nodes}", f"deploy.width={side}", f"deploy.height={side}"]
        return scenario.build(scenario.load("field_10k", sides))

    def recorded(parts: Any, folder: str) -> None:
        motion = parts.motions[0]
        states = tuple(zip(motion.columns, motion.units, strict=True))
        with ResultFile(Path(folder) / "x.h5", states, parts.record, position=motion.position) as file:
            experiment.replicate_of(parts, 0, file)

    nodes = int(sys.argv[1])
    parts = built(nodes)
    with tempfile.TemporaryDirectory() as folder:
        recorded(built(300), folder)
        before = peak_megabytes()
        began = time.process_time()
        recorded(parts, folder)
        whole = time.process_time() - began
    memory = peak_megabytes() - before
    began = time.process_time()
    positions = parts.deploy.draw(parts.sensor.reach, Streams(1, 0)("deploy"))
    Nodes(positions, parts.sensor.draw_traits(nodes, Streams(1, 0)("gains")), 2.0, 75.0)
    construction = time.process_time() - began
    began = time.process_time()
    experiment.replicate_of(parts, 0, Memory({}))
    awake = time.process_time() - began - construction
    print(json.dumps({"construction": construction, "awake": awake, "whole": whole, "memory": memory}))


if __name__ == "__main__":
    main()
