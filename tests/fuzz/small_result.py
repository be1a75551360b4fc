"""A small result file, made once in a process."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

from wsnsim import experiment

SCENARIO = {
    "name": "small", "network": "none", "seed": 1, "duration": 3.0, "step": 1.0,
    "prior": {"sd": [2, 1, 2, 1]}, "deploy": {"kind": "anchors", "places": [[0, 0], [200, 0], [0, 200]]},
    "motion": {"kind": "constant_velocity", "noise_input": "diagonal", "variances": [0.5], "start": [70, 5, 21, 8]},
    "sensor": {"kind": "range", "sd": 1.0, "reach": ".inf"}, "tracker": {"kind": "pf", "particles": 20},
}  # fmt: skip


@cache
def small_result() -> bytes:
    """The bytes of the result of a run of three steps without a network."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.h5"
        experiment.run(SCENARIO, out=path)
        return path.read_bytes()
