"""A real run, made once for all tests of this folder that draw it."""

from __future__ import annotations

import pytest

from wsnsim import experiment
from wsnsim.scenario import load


@pytest.fixture(scope="session")
def real(tmp_path_factory):
    """A network in which nodes wake, join, sense, send, hand over and sleep."""
    path = tmp_path_factory.mktemp("real") / "real.h5"
    told = ["duration=4 s", "tracker.particles=40", "record.particles=true"]
    experiment.run(load("pso_mhpf", told), replicates=2, out=path)
    return path
