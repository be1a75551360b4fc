"""Fixtures of all tests: a fresh cache for compiled kernels, one thread per numerical library, random rows."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from wsnsim.base.tables import columns_of

_WORKER = "PYTEST_XDIST_WORKER" in os.environ
if not _WORKER:  # the workers of one session share its cache: a kernel is compiled once
    os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(prefix="wsnsim-numba-")
for _library in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_library, "1")

settings.register_profile("wsnsim", deadline=None, database=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("wsnsim")

STATES = (("px", "m"), ("vx", "m/s"), ("py", "m"), ("vy", "m/s"))
Rows = dict[str, np.ndarray]


def pytest_unconfigure() -> None:
    """Remove the session's cache of compiled kernels."""
    if not _WORKER:
        shutil.rmtree(os.environ["NUMBA_CACHE_DIR"], ignore_errors=True)


@pytest.fixture
def fresh_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that is the working directory of the test."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def states() -> tuple[tuple[str, str], ...]:
    """(name, unit) of the state columns of a target that moves in the plane."""
    return STATES


@pytest.fixture
def rows_of() -> Callable[..., Rows]:
    """rows_of(table, count, seed=0): random rows that the table can hold."""
    return random_rows


def random_rows(table: str, count: int, seed: int = 0) -> Rows:
    """Random values of each column's type; categories within their meanings."""
    rng = np.random.default_rng(seed)
    return {
        column.name: rng.integers(0, len(column.meanings) or 200, count).astype(column.dtype)
        if np.dtype(column.dtype).kind in "iu"
        else rng.normal(0.0, 100.0, count)
        for column in columns_of(table, STATES)
    }
