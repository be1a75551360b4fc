"""The stored comparison of the engine with full simulations is what its script makes, and its limits hold."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.lifetime import validation
from tests.lifetime.validation import LIMITS, RUNS, Deployment

HELD = json.loads(validation.HELD.read_text(encoding="utf-8"))


def test_the_stored_verdict_is_that_of_the_stored_outcomes():
    found = validation.verdict(HELD["outcomes"])
    for name, each in HELD["verdict"].items():
        assert found[name] == pytest.approx(each)


def test_all_registered_runs_have_been_made():
    assert set(HELD["outcomes"]) == {str(seed) for seed in validation.DEPLOYMENTS}
    assert {len(times) for each in HELD["outcomes"].values() for times in each["full"].values()} == {RUNS}


@pytest.mark.parametrize("name", LIMITS)
def test_the_engine_lies_within_the_registered_limit_of_full_simulations(name):
    assert HELD["verdict"][name]["holds"]


def test_a_full_run_and_the_engine_have_the_same_visits(tmp_path):
    deployment = Deployment(1, tmp_path)
    times, numbers = deployment.listed(0)
    setup = deployment.setup
    states = deployment.motion(setup, times, numbers).truth(setup.steps, setup.dt, np.random.default_rng(0))
    there = np.isfinite(states[:, 0])
    begins = np.flatnonzero(there & ~np.roll(there, 1)) * setup.dt
    assert begins.tolist() == [time for time in times if time <= setup.steps * setup.dt]


@pytest.mark.thorough
def test_a_full_run_comes_out_as_it_is_stored(tmp_path):
    found = Deployment(1, tmp_path).full(0)[0].min()
    assert found == pytest.approx(HELD["outcomes"]["1"]["full"]["first_death"][0])
