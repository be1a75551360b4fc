"""The contract check of workload components: `check_workload`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from wsnsim.base.radio import Workload
from wsnsim.base.setups import BeaconSetup
from wsnsim.base.tables import KIND, Memory
from wsnsim.experiment import replicate_of
from wsnsim.scenario import build, load
from wsnsim.testing.demand import demand, examined

SCENARIO: Final[dict[str, Any]] = {
    "name": "check_workload",
    "seed": 5,
    "duration": 10.0,
    "deploy": {"kind": "grid", "nodes": 25, "width": 250.0, "height": 250.0, "cover": False},
    "energy": {"kind": "first_order"},
    "link": {"kind": "disk", "reach": 75.0},
    "mac": {"kind": "csma"},
    "workload": {"kind": "beacons"},
    "faults": [{"kind": "crash", "at": 0.7, "fraction": 0.3}],
}
"""A small grid, part of which crashes."""


def check_workload(workload: Workload) -> None:
    """Check a workload component against its contract.

    The workload 'tracking' has no mechanism of its own and passes.

    Args:
        workload: the component.

    Raises:
        AssertionError: names the demand that fails. sends: nodes send within 10 s; down: no node that is down sends;
            repeatable: the same seed gives the same run.
    """
    if workload.mechanism == "tracking":
        return
    workload = examined(workload, Workload)
    first = _run(workload)
    kinds, nodes = first["kind"], first["node"]
    with demand("sends"):
        assert (kinds == KIND["send"]).any(), "no node sends anything in 10 s"
    with demand("down"):
        crashed: set[int] = set()
        for kind, node in zip(kinds.tolist(), nodes.tolist(), strict=True):
            if kind == KIND["crash"]:
                crashed.add(node)
            assert kind != KIND["send"] or node not in crashed, f"node {node} sends though it is down"
    with demand("repeatable"):
        again = _run(workload)
        assert all(np.array_equal(column, again[name]) for name, column in first.items()), (
            "the same seed gives two different runs"
        )


def _run(workload: Workload) -> dict[str, Any]:
    """The events of one run of the small grid."""
    setup = build(load(SCENARIO))
    assert isinstance(setup, BeaconSetup), "the scenario has a network and no target"
    memory = Memory()
    replicate_of(replace(setup, workload=workload), 0, memory)
    return memory.table("events")
