"""A method author's tracker: one file of theirs, none of ours; on the bench, in the network, under check_tracker."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.helpers.commands import run_process
from wsnsim import scenario
from wsnsim.base.errors import ScenarioError

FILE = '''
from typing import Annotated

import numpy as np

import wsnsim


def reading(member):
    return None if member.reading is None else wsnsim.Parcel(member.reading, 1, 96, "reading")


@wsnsim.part
class Averager:
    """Many guesses from one Gaussian, weighed by the readings that arrived, are the next Gaussian."""

    guesses: Annotated[int, wsnsim.Quantity("", ge=10), "how many"] = 300

    def start(self, prior, scene):
        yield wsnsim.Compute(0.0)
        return prior

    def step(self, belief, scene):
        answer = yield wsnsim.Gather(reading)
        yield wsnsim.Compute(40.0 * self.guesses)
        rng = np.random.default_rng(scene.key)
        cloud = rng.multivariate_normal(belief.mean, belief.cov, self.guesses).T
        for step in range(scene.steps):
            keys = rng.integers(0, 2**63, self.guesses).astype(np.uint64)
            cloud = scene.motion.propagate(cloud, scene.dt, keys, scene.since + step * scene.dt)
        rows = [row for row, node in enumerate(scene.ids) if node in answer]
        readings = np.array([answer[scene.ids[row]][0] for row in rows], dtype=float)
        points = cloud[list(scene.motion.position)]
        fit = scene.sensor.log_likelihood(points, readings, scene.positions[rows], scene.traits[rows])
        weights = np.exp(fit - fit.max())
        cov = np.cov(cloud, aweights=weights).reshape(belief.cov.shape)
        return wsnsim.Estimate(np.average(cloud, axis=1, weights=weights), cov + 1e-6 * np.eye(len(cov)))

    def hand_over(self, belief, scene, successor):
        mask = yield wsnsim.Send(successor, wsnsim.Parcel(belief, 4, 96, "belief"))
        return belief if mask.all() else None

    def estimate(self, belief):
        return belief

    def forecast(self, belief, scene, ahead):
        return belief
'''
CHECK = """
from mylab_averager import Averager
from wsnsim.testing import check_tracker
check_tracker(Averager())
print("kept")
"""
KIND = "tracker.kind=mylab_averager:Averager"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("mylab")
    (place / "mylab_averager.py").write_text(FILE)
    return place


def ran(folder: Path, *arguments: str) -> dict:
    done = run_process(folder, "run", *arguments, "--json", "--quiet", "--out", "x.h5")
    assert done.code == 0, done.err
    answer: dict = json.loads(done.out)
    return answer


@pytest.mark.thorough
def test_it_runs_on_the_bench_beside_the_papers_filter(folder: Path) -> None:
    own = ran(folder, "ungm_pf", "--set", KIND, "--replicates", "3")
    paper = ran(folder, "ungm_pf", "--replicates", "3")
    assert own["replicates"] == 3
    assert 0.5 * paper["rmse"] < own["rmse"] < 5.0 * paper["rmse"]


@pytest.mark.thorough
def test_it_runs_in_the_network_and_pays_for_it(folder: Path) -> None:
    answer = ran(folder, "jiang_field", "--set", KIND, "--set", "duration=2 s")
    assert answer["energy"] > 0 and answer["joules"]["cpu"] > 0 and answer["frames_sent"] > 0


@pytest.mark.thorough
def test_it_keeps_the_rules_of_the_seam(folder: Path) -> None:
    done = run_process(folder, program=["-c", CHECK])
    assert done.out == "kept\n", done.err


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            ["tracker.kind=trilateration"],
            "trilateration needs a sensor that gives 'ranges', and acoustic_energy does not; it can use: range, rssi",
        ),
        (["tracker.kind=grid"], "grid holds the density of a state of one column, and that of this motion has 4"),
        (["sensor.kind=squared"], "sensor.kind: error: squared"),
        (["tracker.kind=cs_pf", "tracker.variant=metropolis", "motion.noise=g_only"], "the process noise is singular"),
    ],
)
def test_a_tracker_or_sensor_that_cannot_be_used_says_which_can(changes: list[str], message: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        scenario.build(scenario.load("jiang_field", changes))
    assert message in str(refused.value)
