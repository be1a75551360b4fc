"""The size of a run is estimated within a factor of three, and said before one that takes hours or too much memory."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wsnsim import experiment, load
from wsnsim.analysis import run_size
from wsnsim.analysis.run_size import GIGABYTE, HOUR, RunSize
from wsnsim.base.tables import Memory
from wsnsim.cli import main
from wsnsim.experiment import simulate_run
from wsnsim.recording import read_table
from wsnsim.scenario import build

SCENARIOS = {
    "pso_mhpf": ["duration=4 s"],
    "gmtt": ["duration=60 s"],
    "beacons": ["duration=3 s"],
}
SMALL = RunSize(100, 10, 5, 0.0, 0.0, seconds=60.0, memory=0.5 * GIGABYTE, file=1e6)


def within_three(estimated: float, counted: float) -> bool:
    return counted / 3.0 <= estimated <= counted * 3.0


@pytest.mark.thorough
@pytest.mark.parametrize("name", SCENARIOS)
def test_rows_and_bytes_of_a_run_are_estimated_within_a_factor_of_three(name, tmp_path):
    scenario = load(name, SCENARIOS[name])
    size = run_size.run_size(build(scenario), replicates=1)
    report = experiment.run(scenario, replicates=1, out=tmp_path / "x.h5")
    assert within_three(size.file, report.out.stat().st_size)
    assert within_three(size.events, len(read_table(report.out, "events", ["time"])["time"]))
    assert size.steps == report.summaries[0].run["steps"]
    assert size.nodes == len(read_table(report.out, "nodes", ["node"])["node"])


def test_pairs_of_neighbours_are_estimated_within_a_factor_of_three():
    scenario = load("beacons", ["duration=1 s"])
    memory = Memory()
    simulate_run(scenario, recorder=memory)
    places = np.column_stack([memory.table("nodes")[axis] for axis in ("x", "y")])
    apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
    assert within_three(run_size.run_size(build(scenario), 1).pairs, int((apart <= 75.0).sum()) - len(places))


def test_the_nodes_of_a_list_are_counted_and_more_runs_take_more_time_but_no_more_memory():
    setup = build(load("range_anchors"))
    one, ten = (run_size.run_size(setup, count, batch=False) for count in (1, 10))
    assert one.nodes == 4 and one.steps == 30
    assert ten.seconds == pytest.approx(10 * one.seconds) and ten.memory == one.memory and ten.file > one.file


def test_short_runs_are_not_announced_and_long_or_large_ones_are_with_the_figures():
    assert run_size.warning(SMALL, free=GIGABYTE) == ""
    assert run_size.warning(SMALL._replace(seconds=3.0 * HOUR), free=math.inf) == (
        "100 steps x 10 nodes x 5 runs take about 3 hours and 0.5 GB of memory, and a file of 1 MB; Ctrl-C ends it"
    )
    large = run_size.warning(SMALL._replace(memory=64 * GIGABYTE), free=8 * GIGABYTE)
    assert "take about 60 s and 64 GB of memory, of which 8 GB are free" in large


def test_shipped_scenarios_take_neither_an_hour_nor_more_than_a_gigabyte():
    for name in ("pso_mhpf", "gmtt", "field_1m", "lifetime", "beacons", "ungm_pf"):
        assert run_size.warning(run_size.run_size(build(load(name)), 1), free=GIGABYTE) == ""


def test_free_memory_is_a_positive_number_of_bytes():
    assert run_size.free_memory() > 1e6


def test_a_run_that_takes_days_is_announced_before_it_starts(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)

    def started(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(experiment, "run", started)
    assert main(["run", "lifetime", "--replicates", "100000", "--progress", "plain"]) == 130
    said = capsys.readouterr().err
    assert "10,000 steps x 256 nodes x 100,000 runs take about 24 days" in said and "Ctrl-C ends it" in said
