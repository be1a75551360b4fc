"""A simulated result for all tests of this folder."""

from __future__ import annotations

import pytest

from wsnsim.experiment import run
from wsnsim.scenario import load


@pytest.fixture(scope="session")
def real(tmp_path_factory):
    """A result of two short runs, in which nodes wake, join, sense, send, hand over and sleep."""
    path = tmp_path_factory.mktemp("real") / "real.h5"
    overrides = ["duration=4 s", "tracker.particles=40", "record.particles=true"]
    run(load("pso_mhpf", overrides), replicates=2, out=path)
    return path
