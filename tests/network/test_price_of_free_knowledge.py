"""What it would cost to send the membership that heads and members of PSO-MHPF know without a frame.

Each member that begins or ceases to sense tells its head in one packet; the head then broadcasts the membership, from
which each member computes its share of the particles (eq. 25), in one packet to the living members of the cluster.
"""

from __future__ import annotations

import numpy as np
import pytest

from wsnsim import experiment, scenario
from wsnsim.base.ports import Scene
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.tables import Memory
from wsnsim.trackers.pso_mhpf import PsoMhpf


@pytest.mark.thorough
def test_membership_and_shares_would_cost_about_two_percent_of_the_energy_of_pso_mhpf(monkeypatch):
    scenes: list[Scene] = []
    step = PsoMhpf.step

    def watched(self, belief, scene):
        scenes.append(scene)
        return step(self, belief, scene)

    monkeypatch.setattr(PsoMhpf, "step", watched)
    setup = scenario.build(scenario.load("pso_mhpf", ["seed=1"]))
    memory = Memory()
    summary = experiment.replicate_of(setup, 0, memory)
    nodes = memory.table("nodes")
    places, energy = np.column_stack([nodes["x"], nodes["y"]]), setup.energy
    receive, joules = energy.receive(PACKET_BITS), 0.0
    for scene in scenes:
        changed = [node for node in (*scene.joined, *scene.left) if node != scene.head]
        for node in changed:
            away = float(np.linalg.norm(places[node] - places[scene.head]))
            joules += sum(energy.transmit(PACKET_BITS, away)) + receive
        if changed:
            joules += sum(energy.transmit(PACKET_BITS, setup.link.reach)) + receive * (len(scene.roster) - 1)
    share = joules / summary.run["energy"]
    assert 0.01 < share < 0.03, f"{joules:.4f} J, {share:.2%} of {summary.run['energy']:.4f} J"
    assert 40 < sum(bool(scene.joined or scene.left) for scene in scenes) < 400
