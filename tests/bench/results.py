"""What the results of a large campaign cost: a block's file, the reading of thousands, and a finished reproduction."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import wsnsim
from tests.bench.timing import row
from wsnsim import experiment, scenario
from wsnsim.base.version import __version__
from wsnsim.recording.folder import Folder, Manifest, PointOnDisk

FILES, FEW, RUNS = 10_000, 1_000, 5
"""Result files, fewer where there is little time, and the runs in each."""
SIZE, FIRST, AGAIN, FINISHED = 60.0, 10.0, 1.0, 5.0
"""kB of a block's file; s for the first and for a later reading of 10,000 files, and for a finished reproduction."""


def result_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """Every figure of results."""
    files = FILES if repeats >= 9 else FEW
    with tempfile.TemporaryDirectory() as place:
        folder = campaign_of_copies(Path(place) / "x", files)
        _reading_seconds(campaign_of_copies(Path(place) / "small", 2))  # its imports do not count
        size = next(folder.path.glob("*/r*.h5")).stat().st_size
        yield row(f"file of a block of {RUNS} runs of pso_mhpf", size / 1000, "kB", SIZE)
        per_file = files / FILES
        seconds = [_reading_seconds(folder) for _ in range(3)]
        name = f"wsnsim.read of {files:,} files, table runs"
        yield row(f"{name}: first reading, CPU", seconds[0], "s", FIRST * per_file)
        yield row(f"{name}: again, CPU", min(seconds[1:]), "s", max(AGAIN * per_file, 0.2))
    yield from _finished_rows()


def campaign_of_copies(path: Path, points: int) -> Folder:
    """A campaign of so many points with one block each, whose files are links to one file."""
    folder, name = Folder(path), f"r00000-{RUNS - 1:05d}.h5"
    path.mkdir()
    ids = [f"{number:012x}" for number in range(points)]
    known = tuple(PointOnDisk(each, {"tracker.particles": i}, "", RUNS) for i, each in enumerate(ids))
    folder.write_manifest(Manifest("bench", ("tracker.particles",), known, RUNS, __version__))
    for each in ids:
        (path / each).mkdir()
    first = path / ids[0] / name
    short = ["duration=0.4 s", "record.events=false", "record.energy=false", "record.nodes=false"]
    short += [f"record.{table}=false" for table in ("truth", "estimates", "clusters", "wakeups", "energy_steps")]
    experiment.run(scenario.load("pso_mhpf", short), replicates=range(RUNS), out=first)
    for each in ids[1:]:
        os.link(first, path / each / name)
    time.sleep(0.1)  # younger files are not kept
    return folder


def _reading_seconds(folder: Folder) -> float:
    began = time.process_time()
    frame = wsnsim.read(folder.path, "runs")
    assert len(frame) == RUNS * len(folder.manifest().points)
    return time.process_time() - began


def _finished_rows() -> Iterator[dict[str, Any]]:
    """CPU of a reproduction whose runs are there: with its bounds and verdicts to work out, and with those kept."""
    with tempfile.TemporaryDirectory() as place:
        words = ["reproduce", "li2012", "--only", "straight_motion", "--quiet", "--json", "--out", place]
        command = [sys.executable, "-m", "wsnsim", *words]
        seconds = []
        for _ in range(3):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    yield row("wsnsim reproduce on a finished folder, CPU", min(seconds[1:]), "s", FINISHED)
