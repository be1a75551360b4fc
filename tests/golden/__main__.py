"""Run every shipped scenario again and compare it with its stored fingerprint, or store the fingerprints anew.

    make verify                      exit code 1 if a scenario differs
    make verify ARGS=--record        write tests/golden/*.json, and print what changed
    make verify ARGS='--only ppf,ekf_real'

A change of results is a commit of files in tests/golden that says why. Each scenario runs once, with seed 1, for the
time that it says or that of `DURATIONS`: 40 CPU seconds in all.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from tests.golden.fingerprints import (
    FOLDER,
    Machine,
    differences,
    is_exact,
    measured,
    shipped,
    store,
    stored,
    this_machine,
)
from tests.helpers.kernel_cache import kernel_cache

Measured = Iterable[tuple[str, dict[str, Any]]]


def verify(found: Measured, machine: Machine, count: int, say: Callable[[str], None], folder: Path = FOLDER) -> int:
    """Compare scenarios with what is stored, and say what differs; the number of those that do."""
    wrong, by_metrics = 0, []
    for number, (name, one) in enumerate(found, 1):
        before = stored(name, folder)
        lines = differences(name, before, one, machine)
        wrong += bool(lines)
        by_metrics += [name] if not is_exact(before, machine) else []
        say("\n    ".join([f"{number:3} of {count}  {name}: {'DIFFERS' if lines else 'equal'}", *lines]))
    if by_metrics:
        versions = ", ".join(f"{library} {version}" for library, version in machine.versions.items())
        say(f"{len(by_metrics)} scenarios were compared by their metrics, to a tolerance: none is stored for")
        say(f"    {machine.kind} with {versions}")
    say(f"{count - wrong} of {count} scenarios are as stored" + (": make verify ARGS=--record" if wrong else ""))
    return wrong


def record(found: Measured, machine: Machine, count: int, say: Callable[[str], None], folder: Path = FOLDER) -> int:
    """Store fingerprints, and say what changed; the number of scenarios that changed."""
    changed = 0
    for number, (name, one) in enumerate(found, 1):
        before = stored(name, folder)
        lines = differences(name, before, one, machine)
        changed += bool(lines)
        if lines or not is_exact(before, machine):
            store(name, one, machine, folder)
        say("\n    ".join([f"{number:3} of {count}  {name}: {'CHANGED' if lines else 'as before'}", *lines]))
    say(f"{changed} of {count} scenarios changed" + (": commit them, and say why" if changed else ""))
    return changed


def _measured(names: Sequence[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """(name, fingerprint) of each scenario, measured by two processes."""
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from zip(names, pool.map(measured, names), strict=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help="store the fingerprints anew")
    parser.add_argument("--only", default="", help="names of scenarios, separated by commas")
    chosen = parser.parse_args(arguments)
    names = [name for name in chosen.only.split(",") if name] or shipped()
    if unknown := set(names) - set(shipped()):
        parser.error(f"unknown scenarios: {', '.join(sorted(unknown))}")
    if Path(sys.prefix).is_relative_to(Path.cwd()):  # kernels that `make test` has compiled
        os.environ.setdefault("NUMBA_CACHE_DIR", str(kernel_cache(Path.cwd(), Path(sys.prefix))))
    for library in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(library, "1")

    def say(text: str) -> None:
        print(text, flush=True)

    if chosen.record:
        record(_measured(names), this_machine(), len(names), say)
        return 0
    return int(verify(_measured(names), this_machine(), len(names), say) > 0)


if __name__ == "__main__":
    sys.exit(main())
