"""A run has the same bits with kernels that were compiled just now as with compiled code read from the cache."""

import os
import subprocess
import sys

PROBE = """
import wsnsim
from wsnsim.kernels.gravity import attract

run = wsnsim.simulate(wsnsim.load("indoor_gsa_gpf", ["tracker.particles=50"])).run
print(run["rmse"].hex(), sum(attract.stats.cache_hits.values()))
"""


def test_gravity_falls_the_same_from_the_cache_as_compiled_anew(tmp_path):
    """What a kernel calls must be inlined, or a process that has just compiled it calls code of another compilation."""
    where = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_DISABLE_JIT": "0"}
    anew, cached = (
        subprocess.run([sys.executable, "-c", PROBE], env=where, capture_output=True, text=True, check=True)
        for _ in range(2)
    )
    assert (anew.stdout.split()[1], cached.stdout.split()[1]) == ("0", "1")
    assert anew.stdout.split()[0] == cached.stdout.split()[0]
