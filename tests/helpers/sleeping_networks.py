"""Small networks that sleep, as scenarios: what tests of schedules and wake-ups are written on."""

from __future__ import annotations

from typing import Any

import numpy as np

import wsnsim
from wsnsim.base.tables import CAUSES, EVENT_CAUSES, KIND, Memory

PAIRS = {
    "gmtt": ("directed_flood", "prediction"),
    "tsstp": ("experience_zones", "detection"),
    "cluster": ("region", "prediction"),
    "ris": ("none", "detection"),
}
"""Each tracker of Li (2012) with its wake-up and who leads."""


def scenario(tracker: str = "gmtt", **changes: Any) -> dict[str, Any]:
    """A field like that of Li (2012), with 200 nodes; `changes` replace whole roles, or single keys of the top."""
    wakeup, main = PAIRS.get(tracker, PAIRS["gmtt"])
    said = {
        "name": "asleep",
        "seed": 5,
        "duration": 62.0,
        "step": 2.0,
        "lost": {"window": 20.0},
        "deploy": {"kind": "uniform", "nodes": 200, "width": 400.0, "height": 400.0, "cover": False},
        "motion": {"kind": "random_waypoint", "width": 300.0, "height": 300.0},
        "sensor": {"kind": "range", "reach": 40.0, "sd": 2.0},
        "energy": {"kind": "states", "radio": "cc2420", "processor": "msp430f1611", "sensing": 11e-6},
        "link": {"kind": "disk", "reach": 80.0},
        "mac": {"kind": "csma"},
        "routing": {"kind": "greedy_geographic"},
        "cpu": {"rate": 8e6, "cycles_per_flop": 3.5},
        "sleep": {"kind": "ris"},
        "wakeup": {"kind": wakeup},
        "clusters": {"kind": "moving_head", "main": main},
        "acquire": {"poll": 1.0, "detection_bits": 40, "answer_bits": 88},
        "sink": {"kind": "node", "every": 10.0, "bits": 88},
        "tracker": {"kind": tracker},
    }
    return {**said, **changes}


class Run:
    """One replicate, with all its tables."""

    def __init__(self, said: dict[str, Any], replicate: int = 0) -> None:
        self.memory = Memory()
        self.summary = wsnsim.experiment.simulate_run(said, replicate=replicate, recorder=self.memory)
        self.words = self.memory.words.all()

    def table(self, name: str) -> dict[str, np.ndarray]:
        """The columns of a table."""
        return self.memory.table(name)

    def events(self, *kinds: str, what: str | None = None) -> list[dict[str, Any]]:
        """The events of these kinds, or all, in order, `what` in words."""
        table = self.table("events")
        chosen = np.isin(table["kind"], [KIND[kind] for kind in kinds or KIND])
        rows = [{name: column[i].item() for name, column in table.items()} for i in np.flatnonzero(chosen)]
        for row in rows:
            row["what"] = self.words[row["what"]]
        return [row for row in rows if what is None or row["what"] == what]

    def books(self) -> None:
        """Whatever was spent is booked once: by node and cause, by step, and in the events of what costs by the act."""
        nodes, energy, steps = self.table("nodes"), self.table("energy"), self.table("energy_steps")
        spent = np.bincount(energy["node"].astype(int), energy["joules"], nodes["node"].size)
        left = nodes["energy_initial"] - spent
        assert np.allclose(left, nodes["energy_left"], rtol=1e-9, atol=1e-9 * nodes["energy_initial"].max())
        total = self.summary.run["energy"]
        assert np.isclose(energy["joules"].sum(), total, rtol=1e-9)
        assert np.isclose(steps["joules"].sum(), total, rtol=1e-9)
        by_cause = np.bincount(energy["cause"].astype(int), energy["joules"], len(CAUSES))
        in_steps = np.bincount(steps["cause"].astype(int), steps["joules"], len(CAUSES))
        assert np.allclose(by_cause, in_steps, rtol=1e-9, atol=1e-9 * total)
        events = self.table("events")
        by_event = np.bincount(events["cause"].astype(int), events["joules"], len(EVENT_CAUSES))
        booked = dict(zip(CAUSES, by_cause, strict=True))
        booked["tx"] = booked["tx_electronics"] + booked["tx_amplifier"]
        for cause in ("tx", "rx", "overhear", "cpu"):
            assert np.isclose(by_event[EVENT_CAUSES.index(cause)], booked[cause], rtol=1e-9, atol=1e-15), cause
