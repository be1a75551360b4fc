"""Parts of a network that no link joins are found, and said by `check`."""

from __future__ import annotations

import numpy as np
import pytest

from wsnsim import load
from wsnsim.analysis import connectivity, notes
from wsnsim.analysis.connectivity import parts
from wsnsim.scenario import build


@pytest.mark.parametrize("seed", range(5))
def test_parts_are_those_of_a_search_over_all_pairs(seed: int) -> None:
    positions = np.random.default_rng(seed).uniform(0.0, 100.0, (60, 2))
    near = np.hypot(*(positions[:, None] - positions[None]).transpose(2, 0, 1)) <= 12.0
    joined = near.copy()
    for _ in range(6):  # paths of up to 64 hops
        joined = joined @ joined
    found = parts(positions, 12.0)
    assert [len(part) for part in found] == sorted((len(part) for part in found), reverse=True)
    assert sorted(np.concatenate(found).tolist()) == list(range(60))
    for part in found:
        assert np.flatnonzero(joined[part[0]]).tolist() == part.tolist()


def test_a_range_that_reaches_no_node_and_one_that_reaches_some_are_notes() -> None:
    (said,) = notes.of_setup(build(load("pso_mhpf", ["link.reach=0.01"])))
    assert said.startswith("run 0: no node is within the communication range of 0.01 m of another")
    (said,) = notes.of_setup(build(load("pso_mhpf", ["link.reach=18 m"])))
    assert "parts, of " in said and "that no link of 18 m joins" in said


def test_a_network_of_one_node_and_a_very_large_one_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    setup = build(load("pso_mhpf"))
    assert connectivity.note(setup, np.zeros((1, 2))) == ""
    monkeypatch.setattr(connectivity, "MOST", 1)
    assert connectivity.note(setup, np.array([[0.0, 0.0], [9e9, 0.0]])) == ""
