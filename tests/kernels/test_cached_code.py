"""A run has the same bits with kernels that were compiled just now as with compiled code read from the cache."""

import os
import subprocess
import sys

import pytest

PROBE = """
import numpy as np

from wsnsim.kernels.gravity import attract

rng = np.random.default_rng(1)
points, velocities = rng.normal(size=(2, 4, 50))
keys = rng.integers(0, 2**63, 50).astype(np.uint64)
fallen = attract(points, velocities, rng.normal(size=50), np.array([0, 2]), keys, 5, 10.0, 10, 1e-6)
print((fallen.tobytes() + velocities.tobytes()).hex(), sum(attract.stats.cache_hits.values()))
"""


@pytest.mark.thorough
def test_gravity_falls_the_same_from_the_cache_as_compiled_anew(tmp_path):
    """What a kernel calls must be inlined, or a process that has just compiled it calls code of another compilation."""
    where = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_DISABLE_JIT": "0"}
    anew, cached = (
        subprocess.run([sys.executable, "-c", PROBE], env=where, capture_output=True, text=True, check=True)
        for _ in range(2)
    )
    assert (anew.stdout.split()[1], cached.stdout.split()[1]) == ("0", "1")
    assert anew.stdout.split()[0] == cached.stdout.split()[0]
