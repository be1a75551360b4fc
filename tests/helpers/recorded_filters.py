"""What a filter had and made in each step of a run: scenes, readings, means and covariances."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from wsnsim import experiment, scenario
from wsnsim.base.tables import RECORDED_BY_DEFAULT, Memory

COLUMNS = ("px", "vx", "py", "vy")


class Step(NamedTuple):
    """What a cluster head had in a step: its cluster's positions, gains and readings, and the steps that passed."""

    positions: np.ndarray
    gains: np.ndarray
    readings: np.ndarray
    steps: int
    head: int


class Recorded(NamedTuple):
    """The prior of a track, its steps, and what our filter made of them: means, covariances and NIS."""

    mean: np.ndarray
    cov: np.ndarray
    steps: list[Step]
    means: np.ndarray
    covs: np.ndarray
    nis: np.ndarray
    state: dict[str, np.ndarray]


def recorded(name: str, *changes: str) -> Recorded:
    """A run of a shipped scenario, whose scenes are noted as the tracker gets them."""
    memory = Memory({**RECORDED_BY_DEFAULT, "readings": True, "covariances": True, "tracker_state": True})
    setup = scenario.build(scenario.load(name, changes))
    kind, noted = type(setup.tracker), []
    start, step = kind.start, kind.step
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kind, "start", lambda self, prior, scene: (noted.append(prior), start(self, prior, scene))[1])
        patch.setattr(kind, "step", lambda self, belief, scene: (noted.append(scene), step(self, belief, scene))[1])
        experiment.replicate_of(setup, 0, memory)
    prior, *scenes = noted
    table, said = memory.table("readings"), memory.table("estimates")
    read = dict(zip(zip(table["step"].tolist(), table["node"].tolist(), strict=True), table["reading"], strict=True))
    steps = [
        Step(scene.positions, scene.traits[:, :1].sum(axis=1), np.array(readings), scene.steps, scene.head)
        for scene in scenes
        for readings in [[read[scene.step, node] for node in scene.ids]]
    ]
    rows = np.isin(said["step"], [scene.step for scene in scenes])
    means = np.column_stack([said[column] for column in COLUMNS])[rows]
    return Recorded(prior.mean, prior.cov, steps, means, covariances(memory)[rows], said["nis"][rows], reported(memory))


def covariances(memory: Memory) -> np.ndarray:
    """(K, 4, 4) of the table `covariances`."""
    table = memory.table("covariances")
    pairs = [(i, j) for i in range(4) for j in range(i, 4)]
    result = np.empty((len(table["step"]), 4, 4))
    for i, j in pairs:
        result[:, i, j] = result[:, j, i] = table[f"cov_{COLUMNS[i]}_{COLUMNS[j]}"]
    return result


def reported(memory: Memory) -> dict[str, np.ndarray]:
    """(K, n) by name: the values of the table `tracker_state`."""
    table, words = memory.table("tracker_state"), memory.state_names.all()
    result = {}
    for code, word in enumerate(words):
        which = table["name"] == code
        result[word] = table["value"][which].reshape(-1, int(table["index"][which].max()) + 1)
    return result
