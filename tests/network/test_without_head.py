"""Networks without a head: what participants compute, exchange, pay, and survive."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from wsnsim import experiment, scenario
from wsnsim.base.errors import ScenarioError
from wsnsim.base.tables import CAUSE, KIND, Memory
from wsnsim.experiment import Summary

GRID = "deploy={kind: anchors, places: [[0, 0], [30, 0], [60, 0], [0, 30], [30, 30], [60, 30]]}"
FIXED = (
    GRID, "motion={kind: constant_velocity, start: [10, 1, 5, 1], variances: [0.1]}",
    "sensor={kind: range, reach: 500 m, sd: 2 m}", "step=1 s", "duration=6 s", "link.reach=40 m", "energy.battery=2 J", "clusters={kind: none}",
)  # fmt: skip
"""Six nodes in two rows, which hear their neighbours, and all sense."""
CENTRAL = ("clusters={kind: central}", "tracker={kind: ekf}")


def simulated(*changes: str, run: int = 0, name: str = "jiang_field") -> tuple[Memory, Summary]:
    memory = Memory()
    return memory, experiment.simulate_run(scenario.load(name, changes), run, memory)


def estimates(*changes: str) -> dict[str, Any]:
    return dict(simulated(*changes)[0].table("estimates"))


def sends(memory: Memory, what: str) -> int:
    """How many parcels of a name were broadcast."""
    events = memory.table("events")
    return int(((events["kind"] == KIND["send"]) & (events["what"] == memory.words.code(what))).sum())


@pytest.mark.parametrize("kind", ["information_consensus", "hybrid_consensus"])
@pytest.mark.parametrize("options", ["participants: 6", "weights: ratio"])
def test_after_many_rounds_consensus_is_the_central_filter(kind: str, options: str) -> None:
    found = estimates(*FIXED, f"tracker={{kind: {kind}, rounds: 150, {options}}}")
    central = estimates(*FIXED, *CENTRAL)
    for name in ("px", "vx", "py", "vy", "sd_x", "sd_y", "cov_xy"):
        np.testing.assert_allclose(found[name], central[name], rtol=1e-6, atol=1e-6)
    assert found["disagreement"].max() < 1e-6
    assert (found["readings"] == 6).all()
