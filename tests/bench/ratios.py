"""What a kernel costs, as nanoseconds per particle-step and as a ratio: to the C reference, and to NumPy twins."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from tests.bench.creference import Program, compiled
from tests.bench.entries import ENTRIES, Arguments, Entry, copies
from tests.bench.filters import STEPS, Reference, composed, reference
from tests.bench.timing import median_ratio, paired_seconds, row

SIZES = (400, 4000)
LINE, SENSOR_BOUND = 8, 1.0
TWIN_BOUND = 4.0
COMPOSED_BOUNDS = {400: 3.0, 4000: 1.4}
BATCH = 2e-3
"""Seconds of calls that are timed together."""


def filter_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """The bootstrap filter: in C, and as a tracker asks for it through the loopback driver."""
    with compiled() as programs:
        if not programs:
            yield row("C reference", math.nan, "", note="gcc is missing: no C reference")
        for size in SIZES:
            yield from _filters_of(reference(size), programs, repeats)


def _filters_of(problem: Reference, programs: dict[str, Program], repeats: int) -> Iterator[dict[str, Any]]:
    size, blocks = problem.arguments[0].shape[1], "building blocks, loopback driver"
    references = {name: partial(program, *problem.arguments, problem.keys) for name, program in programs.items()}
    ours = composed(problem)
    notes = {blocks: f"position error {problem.error(ours()):.2f} m", **_notes(problem, references)}
    everything = {blocks: ours} | {f"C, {name}": act for name, act in references.items()}
    seconds = dict(zip(everything, paired_seconds(list(everything.values()), repeats), strict=True))
    for name, mine in seconds.items():
        nanoseconds = 1e9 * float(np.median(mine)) / (size * STEPS)
        yield row(f"bootstrap N={size}: {name}", nanoseconds, "ns/particle-step", note=notes.get(name, ""))
    libmvec = [f"C, {name}" for name in references if "own" not in name]
    if libmvec:
        fastest = min(libmvec, key=lambda name: float(np.median(seconds[name])))
        ratio, note = median_ratio(seconds[blocks], seconds[fastest]), f"{fastest}, the faster libmvec build"
        yield row(f"bootstrap N={size}: {blocks} / C", ratio, "", COMPOSED_BOUNDS[size], note=note)


def _notes(problem: Reference, references: dict[str, Callable[[], Any]]) -> dict[str, str]:
    """The position errors of the builds in C; raises where two builds part before the end."""
    found = {name: act() for name, act in references.items()}
    for name, (means, resampled) in found.items():
        first, as_often = next(iter(found.values()))
        if resampled != as_often or not np.allclose(means, first, rtol=0.0, atol=1e-6):
            raise RuntimeError(f"C, {name}: gives other estimates than the first build: their times say nothing")
    return {f"C, {name}": f"position error {problem.error(means):.2f} m" for name, (means, _) in found.items()}


def kernel_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """Each kernel of the table at its sizes, mostly 400 particles and 100: its time, and its twin's as a multiple."""
    taken: dict[tuple[str, int], float] = {}
    for entry in ENTRIES:
        for count in sorted(set(entry.sizes), reverse=True):
            kernel, twin, arguments = entry.load(), entry.load_twin(), entry.arguments(count)
            check_agreement(entry, kernel, twin, arguments)
            ours, theirs = _call_seconds([kernel, twin], arguments, max(repeats, 9))
            nanoseconds = 1e9 * float(np.median(ours)) / count
            taken[entry.kernel, count] = nanoseconds / 1000
            yield row(f"{entry.kernel} N={count}", nanoseconds, f"ns/{entry.each}")
            ratio = median_ratio(theirs, ours)
            yield row(f"{entry.kernel} N={count}: NumPy twin / kernel", ratio, "", at_least=TWIN_BOUND)
    if ("relay.mix", LINE) in taken:
        update, mixing = taken["relay.filter_each", LINE], taken["relay.mix", LINE]
        note = "filter_each, with a prediction each, which the relaying filter does not need"
        yield row("rkf: kernels of a step, 8 sensors", update, "us/sensor-step", SENSOR_BOUND, note=note)
        yield row("imsf: kernels of a step, 8 sensors", mixing + update, "us/sensor-step", SENSOR_BOUND)


def check_agreement(entry: Entry, kernel: Callable[..., Any], twin: Callable[..., Any], arguments: Arguments) -> None:
    """Raises where a kernel and its twin give different results or change their arguments differently."""
    mine, theirs = copies(arguments), copies(arguments)
    pairs = [(kernel(*mine), twin(*theirs)), *zip(mine, theirs, strict=True)]
    for found, expected in pairs:
        both = zip(found, expected, strict=True) if isinstance(found, tuple) else [(found, expected)]
        for a, b in both:
            if a is not None and not np.allclose(a, b, rtol=1e-8, atol=1e-8, equal_nan=True):
                raise RuntimeError(f"{entry.kernel} and its twin differ: their times say nothing")


def _call_seconds(functions: list[Callable[..., Any]], arguments: Arguments, repeats: int) -> list[list[float]]:
    """CPU seconds of one call of each function, taken in turn; every call has arguments of its own."""
    began = time.process_time()
    for _ in range(5):
        functions[0](*copies(arguments))
    calls = int(min(max(BATCH / ((time.process_time() - began) / 5 + 1e-9), 5), 100))
    fresh: list[list[Arguments]] = []

    def prepare() -> None:
        fresh[:] = [[copies(arguments) for _ in range(calls)] for _ in functions]

    def batch(which: int) -> None:
        function = functions[which]
        for own in fresh[which]:
            function(*own)

    acts = [partial(batch, which) for which in range(len(functions))]
    return [[second / calls for second in mine] for mine in paired_seconds(acts, repeats, prepare)]


def compile_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """Every kernel of the table called once in a new process: nothing cached, then all."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "tests.bench.cold"]
        for name, bound in (("cold", 30.0), ("cached", 1.0)):
            env = {**os.environ, "NUMBA_CACHE_DIR": folder}
            answer = subprocess.run(command, check=True, capture_output=True, text=True, env=env).stdout
            found = json.loads(answer.splitlines()[-1])
            title, note = f"all kernels called once, {name}", f"{found['kernels']} kernels, wall {found['wall']:.3g} s"
            yield row(f"{title}: CPU beyond importing NumPy and Numba", found["cpu"], "s", bound, note=note)
            yield row(f"{title}: until the first returns, in which Numba starts up, wall", found["first"], "s")
            yield row(f"{title}: importing NumPy and Numba, wall", found["import"], "s")
