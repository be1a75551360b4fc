"""Many standalone runs at once, against the same runs one by one: CPU of a run, into a result file."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.bench.timing import median_ratio, row
from wsnsim import experiment, scenario

OF_10_000 = 0.15
"""Of the time of 10,000 composed runs of the bootstrap filter."""
CASES = {
    "bootstrap filter (ungm_pf)": ("ungm_pf", [], 256, 16, OF_10_000),
    "bootstrap filter (range_pf)": ("range_pf", [], 256, 16, OF_10_000),
    "bootstrap filter (central_pf)": ("central_pf", ["network=none"], 20, 2, OF_10_000),
    "GPF (indoor_gpf)": ("indoor_gpf", [], 256, 16, None),
    "EKF (Liu's sensors)": ("rkf", ["tracker.kind=ekf"], 64, 8, None),
    "RKF (rkf)": ("rkf", [], 64, 8, None),
    "IMSF (imsf)": ("imsf", [], 64, 8, None),
}
"""Scenario, changes, runs of a turn in a batch and composed, and the bound."""


def batch_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """The batch engine over composed runs. A run is one of thousands: blocks have their full size."""
    for name, (source, changes, batched, composed, bound) in CASES.items():
        loaded = scenario.load(source, changes)
        seconds = _turns(loaded, batched, composed, repeats)
        note = f"{1000 * min(seconds[0]):.2f} ms a run, composed {1000 * min(seconds[1]):.2f} ms"
        title = f"10,000 standalone runs of the {name}, batch over composed"
        yield row(title, median_ratio(*seconds), "", bound, note=note)


def _turns(loaded: Any, batched: int, composed: int, repeats: int) -> tuple[list[float], list[float]]:
    """CPU seconds a run in batches, and composed, in turns."""
    _seconds_a_run(loaded, 2, True), _seconds_a_run(loaded, 1, False)
    pairs = [(_seconds_a_run(loaded, batched, True), _seconds_a_run(loaded, composed, False)) for _ in range(repeats)]
    return [one for one, _ in pairs], [other for _, other in pairs]


def _seconds_a_run(loaded: Any, runs: int, batch: bool) -> float:
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        experiment.run(loaded, replicates=runs, out=Path(folder) / "x.h5", batch=batch)
        return (time.process_time() - began) / runs
