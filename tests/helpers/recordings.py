"""Results of shipped scenarios, each made once for all workers of a test run.

recording("pso_mhpf")   the file of two short runs; to be read: a test that changes it takes a copy
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import Any, Final

from tests.helpers.costs import shared_by_all_tests
from wsnsim import experiment
from wsnsim.scenario import load

FOLDER: Final = "WSNSIM_TEST_RECORDINGS"
"""The environment variable with the folder of the recordings, which all workers share."""
CHANGES: Final = {
    "pso_mhpf": ["record.particles=true"],
    "two_targets": ["duration=2.44 s"],
}
"""{scenario: what differs from other recordings}"""


def recording(name: str) -> Path:
    """The result of two short runs of a shipped scenario, with 40 particles if its tracker has some."""
    path = Path(os.environ[FOLDER], f"{name}.h5")
    with path.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # of two workers that want it, the second waits
        if not path.exists():
            with shared_by_all_tests():
                experiment.run(short(name), replicates=2, out=path)
            path.chmod(0o444)
    return path


def short(name: str) -> Any:
    """The scenario of a recording: it has 100 estimates at steps of 40 ms, and 10 at longer ones."""
    whole = load(name)
    few = ["tracker.particles=40"] if hasattr(getattr(whole, "tracker", None), "particles") else []
    steps = 101 if whole.step < 0.1 else 11
    return load(name, [f"duration={round(steps * whole.step, 9)} s", *few, *CHANGES.get(name, ())])
