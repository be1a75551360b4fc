"""Parts of a network that no link joins are found, and said by `check`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.models.test_k7file import row, written
from wsnsim import load
from wsnsim.analysis import notes
from wsnsim.analysis.notes import parts
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


def test_nodes_without_a_path_to_the_sink_are_counted() -> None:
    setup = build(load("ekf_real", ["link={kind: disk, reach: 30 m}", "sink={kind: node, x: 0, y: 0}"]))
    places = np.array([[0.0, 0.0], [20.0, 0.0], [200.0, 0.0], [220.0, 0.0], [240.0, 0.0]])
    assert notes.parted(setup, places).endswith("joins; 3 of 5 nodes have no path to the sink, node 0")
    assert notes.parted(setup, places[:2]) == ""


def test_a_network_of_one_node_and_a_very_large_one_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    setup = build(load("pso_mhpf"))
    assert notes.parted(setup, np.zeros((1, 2))) == ""
    monkeypatch.setattr(notes, "MOST", 1)
    assert notes.parted(setup, np.array([[0.0, 0.0], [9e9, 0.0]])) == ""


def test_parts_of_recorded_links_are_joined_by_links_that_deliver_half_in_both_directions(tmp_path: Path) -> None:
    far = ["deploy.nodes=4", "deploy.width=1e6", "deploy.height=1e6", "link.channel=11", "duration=10 s"]
    rows = [
        *(row(0, 0, other, ratio) for other, ratio in ((1, 0.5), (2, 0.5), (3, 1.0))),
        *(row(20, 1, other, ratio) for other, ratio in ((0, 0.7), (3, 0.9))),
        *(row(40, 2, other, ratio) for other, ratio in ((0, 0.49), (1, 1.0))),
        row(60, 3, 2, 1.0),
    ]
    path = written(tmp_path, *rows)
    (said,) = notes.of_setup(build(load("recorded_links", [f"link.path={path}", *far])))
    assert said == (
        "run 0: the network is in 3 parts, of 2, 1, 1 nodes, that no recorded link that delivers half of the frames "
        "joins; 2 nodes have no neighbour"
    )
    written(tmp_path, *rows, row(60, 3, 1, 0.5), row(40, 2, 3, 1.0))
    assert notes.of_setup(build(load("recorded_links", [f"link.path={path}", *far]))) == []
