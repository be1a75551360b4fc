"""`python -m tests.bench.cold`: how long until every kernel was called once, in a process of its own, as JSON.

{"import": wall seconds to import NumPy and Numba, "first": from there to the return of the first kernel, in which
Numba starts up, "wall" and "cpu": from there to the last call, "kernels": how many}
"""

from __future__ import annotations

import json
import time

BEGAN = time.perf_counter()

import numba  # noqa: E402, F401
import numpy as np  # noqa: E402, F401

IMPORTED, SPENT = time.perf_counter(), time.process_time()


def main() -> None:
    """Call every kernel of the table once."""
    from tests.bench.entries import ENTRIES

    for entry in ENTRIES:
        entry.load()(*entry.arguments(16))
        if entry is ENTRIES[0]:
            first = time.perf_counter() - IMPORTED
    wall, cpu = time.perf_counter() - IMPORTED, time.process_time() - SPENT
    figures = {"import": IMPORTED - BEGAN, "first": first, "wall": wall, "cpu": cpu, "kernels": len(ENTRIES)}
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
