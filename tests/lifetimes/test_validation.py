"""The comparison of the lifetime engine with full simulations is paired, and judged by whole intervals."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.lifetimes import validation
from tests.lifetimes.validation import LIMITS, PILOT, Deployment


def test_the_stored_verdict_is_that_of_the_stored_outcomes_of_all_registered_runs():
    held = json.loads(validation.HELD.read_text(encoding="utf-8"))
    assert set(held["outcomes"]) == {str(seed) for seed in validation.DEPLOYMENTS}
    assert {len(times) for each in held["outcomes"].values() for times in each["full"].values()} == {validation.RUNS}
    found = validation.verdict(held["outcomes"], first=PILOT)
    for name, each in held["verdict"].items():
        assert found[name] == pytest.approx(each)


def test_a_limit_holds_only_if_the_whole_interval_lies_within_it():
    def outcomes(*ratios):
        return {"1": {"engine": {name: list(ratios) for name in LIMITS}, "full": {name: [1.0] * 4 for name in LIMITS}}}

    near, far, vague = (
        validation.verdict(outcomes(*each)) for each in ([1.01, 0.99] * 2, [1.04] * 3 + [1.041], [1.1, 0.9] * 2)
    )
    assert [near[name]["holds"] for name in LIMITS] == [True, True, True]
    assert [far[name]["holds"] for name in LIMITS] == [True, False, False]
    assert not any(vague[name]["holds"] for name in LIMITS)


def test_a_full_run_and_the_engine_have_the_same_visits(tmp_path):
    deployment = Deployment(1, tmp_path)
    times, numbers = deployment.listed(0)
    setup = deployment.setup
    states = deployment.motion(setup, times, numbers).truth(setup.steps, setup.dt, np.random.default_rng(0))
    there = np.isfinite(states[:, 0])
    begins = np.flatnonzero(there & ~np.roll(there, 1)) * setup.dt
    assert begins.tolist() == [time for time in times if time <= setup.steps * setup.dt]
