"""Losses and handovers in the tables of a simulated run, against what its other tables say."""

from __future__ import annotations

import numpy as np
import pytest

import wsnsim
from wsnsim.base.tables import Memory

WINDOW, LIMIT = 5, 0.4


@pytest.mark.thorough
def test_a_run_counts_its_losses_and_the_bits_of_its_handovers():
    """A limit of 40 cm is exceeded now and then; the steps are counted one by one."""
    overrides = [
        "duration=4 s",
        "tracker.kind=ekf",
        f"lost.window={WINDOW * 40} ms",
        f"lost.limit={LIMIT} m",
        "record.estimates=true",
    ]
    scenario, memory = wsnsim.load("two_targets", overrides), Memory()
    summary = wsnsim.experiment.simulate_run(scenario, recorder=memory)
    estimates, clusters = memory.table("estimates"), memory.table("clusters")
    for target, track in enumerate(summary.tracks):
        errors = estimates["error"][estimates["target"] == target]
        assert np.isfinite(errors).all()
        bad = errors > LIMIT
        states = [any(bad[max(k - WINDOW, 0) : k].sum() == WINDOW for k in range(step, step + WINDOW))
                  for step in range(1, len(errors) + 1)]  # fmt: skip
        assert track["losses"] == sum(b and not a for a, b in zip([False, *states], states, strict=False))
        assert track["lost_share"] == pytest.approx(np.mean(states))
        assert track["time_lost"] == pytest.approx(sum(states) * scenario.step)
        bits = clusters["handover_bits"][(clusters["target"] == target) & (clusters["handover_bits"] > 0)]
        assert track["handover_bits"] == pytest.approx(bits.mean())
    assert summary.run["losses"] == sum(track["losses"] for track in summary.tracks) > 0
    for name in ("time_lost", "lost_share"):
        assert summary.run[name] == pytest.approx(np.mean([track[name] for track in summary.tracks]))
