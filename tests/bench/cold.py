"""`python -m tests.bench.cold`: how long until every kernel was called once, in a process of its own, as JSON.

{"import": wall seconds to import NumPy and Numba, "first": from there to the return of the first kernel, in which
Numba starts up, "wall" and "cpu": from there to the last call, "kernels": how many}
"""

from __future__ import annotations

import json
import time

BEGAN = time.perf_counter()

import numba  # noqa: E402, F401
import numpy as np  # noqa: E402

IMPORTED, SPENT = time.perf_counter(), time.process_time()


def main() -> None:
    """Call every kernel of the table once, and the whole-run filter."""
    from tests.bench.entries import DRIFT, ENTRIES, LAW, ROOT

    for entry in ENTRIES:
        entry.load()(*entry.arguments(16))
        if entry is ENTRIES[0]:
            first = time.perf_counter() - IMPORTED
    from wsnsim.kernels.bootstrap import run, run_with_generator

    rng = np.random.default_rng(1)
    readings, positions = rng.uniform(1.0, 2.0, (2, 10)), rng.uniform(-9.0, 9.0, (10, 2))
    problem = rng.normal(size=(4, 16)), readings, positions, np.ones(10), LAW, DRIFT, ROOT, 0.5
    run(*problem, np.arange(2, dtype=np.uint64))
    run_with_generator(*problem, np.random.Generator(np.random.Philox(1)))
    wall, cpu = time.perf_counter() - IMPORTED, time.process_time() - SPENT
    figures = {"import": IMPORTED - BEGAN, "first": first, "wall": wall, "cpu": cpu, "kernels": len(ENTRIES) + 2}
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
