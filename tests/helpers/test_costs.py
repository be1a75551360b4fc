"""The suite notices what a test of the fast tier costs, and which cases of a thorough test are fast."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.helpers.costs import LIMITS, count_examples, excess, shared_by_all_tests, spent
from tests.helpers.recordings import short
from tests.helpers.thorough import keep_fast_cases
from wsnsim import experiment


@pytest.mark.parametrize(
    ("name", "costs"),
    [
        ("pso_mhpf", {"node-steps": 256 * 100, "particle-steps": 40 * 100}),
        ("collection", {"node-steps": 1}),
        ("ungm_pf", {"particle-steps": 1}),
    ],
)
def test_nodes_steps_and_particles_of_a_run_are_counted(name: str, costs: dict[str, int]) -> None:
    before = spent()
    experiment.simulate_run(short(name))
    found = spent() - before
    assert all(found[what] >= least for what, least in costs.items())


def test_runs_of_a_batch_are_counted_one_by_one() -> None:
    before = spent()
    experiment.run_in_memory(short("ungm_pf"), replicates=3)
    three, before = spent() - before, spent()
    experiment.run_in_memory(short("ungm_pf"), replicates=1)
    assert three["particle-steps"] == 3 * (spent() - before)["particle-steps"]


def test_processes_and_examples_are_counted_and_what_is_above_a_limit_is_named() -> None:
    before = spent()
    subprocess.run([sys.executable, "-c", ""], check=True)
    subprocess.run(["git", "--version"], check=True, capture_output=True)

    @settings(max_examples=7, derandomize=True)
    @given(st.integers())
    def holds(_: int) -> None: ...

    count_examples(holds)
    holds()
    found = spent() - before
    assert (found["processes"], found["examples"]) == (1, 7)
    assert excess(before) == []
    before.subtract({"examples": LIMITS["examples"]})
    assert excess(before) == [f"{LIMITS['examples'] + 7} examples (at most {LIMITS['examples']})"]


def test_what_is_made_for_all_tests_counts_for_none() -> None:
    before = spent()
    with shared_by_all_tests():
        subprocess.run([sys.executable, "-c", ""], check=True)
    assert spent() == before


def test_cases_that_a_mark_names_lose_it_and_those_that_do_not_exist_are_named() -> None:
    mark = pytest.mark.thorough(fast=["a", "c"]).mark
    items: list[Any] = [SimpleNamespace(nodeid=f"x.py::test[{case}]", own_markers=[mark]) for case in "ab"]
    assert keep_fast_cases(items) == {"x.py::test[c]"}
    assert [item.own_markers for item in items] == [[], [mark]]
