"""Networks without targets whose clocks are wrong: the world, its tables, and the errors of its clocks."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from wsnsim.base.rng import Streams
from wsnsim.base.setups import BeaconSetup
from wsnsim.base.tables import RECORDED_BY_DEFAULT, Memory
from wsnsim.network.workload_world import WorkloadWorld
from wsnsim.scenario import build, load

BASE: dict[str, Any] = {
    "name": "clocks", "seed": 1, "duration": 600.0, "step": 10.0, "energy": {"kind": "first_order"},
    "deploy": {"kind": "grid", "nodes": 9, "width": 90.0, "height": 90.0, "cover": False},
    "link": {"kind": "disk", "reach": 75.0}, "mac": {"kind": "ideal"},
    "workload": {"kind": "beacons", "period": 1e6}, "clock": {"kind": "drift", "offset": 0.005},
}  # fmt: skip


def line(nodes: int, apart: float = 60.0) -> dict[str, Any]:
    """A deployment on a line: each node hears its neighbours alone."""
    width = apart * (nodes + 1)
    places = [[apart * (i - (nodes - 1) / 2), 0.0] for i in range(nodes)]
    return {"kind": "anchors", "places": places, "width": width, "height": 100.0, "centre": [0.0, 0.0]}


def network(**changes: Any) -> SimpleNamespace:
    """A world that is ready to run, and its memory of tables."""
    setup = build(load({**BASE, **changes}))
    assert isinstance(setup, BeaconSetup)
    streams, memory = Streams(setup.seed, 0), Memory({**RECORDED_BY_DEFAULT, "clocks": True})
    positions = setup.deploy.draw(75.0, streams("deploy"))
    world = WorkloadWorld(setup, 0, positions, streams, memory)
    return SimpleNamespace(world=world, memory=memory, sync=world._sync, clocks=world._stack.clocks, env=world._env)


def ran(**changes: Any) -> SimpleNamespace:
    """A network that has run to its end: also the outcome, the log and the table `clocks`."""
    made = network(**changes)
    made.errors = []
    note = made.world._clock_errors.note

    def also(step: int, now: float) -> None:
        made.errors.append(made.clocks.error(np.arange(made.clocks._size), now))
        note(step, now)

    made.world._clock_errors.note = also
    made.outcome = made.world.run()
    made.log, made.table = made.memory.table("events"), made.memory.table("clocks")
    made.errors = np.array(made.errors)
    return made
