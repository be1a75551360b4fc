"""A small file of a user passes mypy in strict mode against the package, and a misspelt argument does not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import wsnsim

ROOT = Path(wsnsim.__file__).parents[1]
USE = """
import wsnsim
from wsnsim.models import DiskLink, RangeSensor
from wsnsim.plugins import GaussianBelief, HeadFilter, normals
from wsnsim.trackers import Ekf, PsoMhpf

result: wsnsim.Result = wsnsim.simulate("pso_mhpf", tracker=PsoMhpf(particles=200), link=DiskLink(reach=60.0), seed=3)
name: str = result.name
result.plot.track().set_title(name)
points = wsnsim.sweep("pso_mhpf", {"tracker.particles": [100, 400]}, replicates=2, keep=["estimates"])
complete: bool = points.complete
found = wsnsim.compare("jiang_field", trackers=[Ekf(), "ukf"], sensor=RangeSensor(sd=2.0))
conclusion: str = str(found)
"""


@pytest.mark.thorough
def test_mypy_accepts_good_use_and_finds_a_misspelt_argument(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    (tmp_path / "use.py").write_text(USE)
    (tmp_path / "misspelt.py").write_text(f"{USE}wsnsim.simulate('x', traker=1)\n")
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--cache-dir",
        str(tmp_path / "cache"),
        "use.py",
        "misspelt.py",
    ]
    here = {**os.environ, "MYPYPATH": str(ROOT)}
    settings = tmp_path / "mypy.ini"
    settings.write_text("[mypy]\nfollow_imports = silent\nignore_missing_imports = True\n")
    done = subprocess.run(command, cwd=tmp_path, env=here, capture_output=True, text=True, check=False)
    (error,) = (line for line in done.stdout.splitlines() if ": error: " in line)
    assert done.returncode == 1 and error.startswith("misspelt.py:") and "traker" in error, done.stdout
