"""The contract check of time synchronisation: `check_sync`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from wsnsim.base.setups import BeaconSetup
from wsnsim.base.synchronisation import SyncMechanism, SyncServices, TimeSync
from wsnsim.base.tables import KIND, RECORDED_BY_DEFAULT, Memory
from wsnsim.experiment import replicate_of
from wsnsim.models.synchronisation import NoSync
from wsnsim.network.synchronisation import make_sync
from wsnsim.scenario import build, load
from wsnsim.testing.demand import demand, examined

SCENARIO: Final[dict[str, Any]] = {
    "name": "check_sync",
    "seed": 5,
    "duration": 1800.0,
    "step": 10.0,
    "deploy": {"kind": "grid", "nodes": 9, "width": 90.0, "height": 90.0, "cover": False},
    "energy": {"kind": "first_order"},
    "link": {"kind": "disk", "reach": 150.0},
    "mac": {"kind": "csma"},
    "clock": {"kind": "drift", "sd": 100e-6, "offset": 0.01},
    "workload": {"kind": "beacons", "period": 1e6},
}
"""A small grid whose clocks differ by some 10 ms at the start, and by 180 ms after half an hour without correction."""
CRASH: Final = {"kind": "crash", "at": 905.0, "duration": 3.0, "nodes": [4, 8]}
"""Two nodes are down for a while between two steps."""


def check_sync(sync: TimeSync) -> None:
    """Check a component of time synchronisation against its contract, in a grid of nine nodes that hear each other.

    The kind 'none' has no messages and passes.

    Args:
        sync: The component.

    Raises:
        AssertionError: Names the demand that fails. agreement: after half an hour clocks differ by less than a tenth of
            what they differ by without synchronisation, and some node takes its clock for synchronised; paid: nodes
            send something; forgets: a node that crashes no longer takes its clock for synchronised; down: no node sends
            while it is down; repeatable: the same seed gives the same run.
    """
    if sync.mechanism == "none":
        return
    sync = examined(sync, TimeSync)
    watched = _Watched(sync)
    first, crashed, alone = _run(sync), _run(watched, CRASH), _run(NoSync())
    clocks, events = first.table("clocks"), first.table("events")
    with demand("agreement"):
        apart, unsynchronised = clocks["spread_max"][-1], alone.table("clocks")["spread_max"][-1]
        assert apart < 0.1 * unsynchronised, (
            f"clocks differ by {apart:.3g} s after half an hour; without synchronisation by {unsynchronised:.3g} s"
        )
        assert clocks["synchronised"][-1] > 0.0, "no node takes its clock for synchronised"
    with demand("paid"):
        assert (events["kind"] == KIND["send"]).any(), "clocks agree, and nothing was sent"
    with demand("forgets"):
        assert watched.forgotten == [False, False], "a node that crashed still takes its clock for synchronised"
    with demand("down"):
        _check_down(crashed.table("events"))
    with demand("repeatable"):
        again = _run(sync).table("events")
        assert all(np.array_equal(column, again[name]) for name, column in events.items()), (
            "the same seed gives two different runs"
        )


def _check_down(events: dict[str, Any]) -> None:
    down: set[int] = set()
    for kind, node in zip(events["kind"].tolist(), events["node"].tolist(), strict=True):
        if kind == KIND["crash"]:
            down.add(node)
        elif kind == KIND["restart"]:
            down.discard(node)
        assert kind != KIND["send"] or node not in down, f"node {node} sends though it is down"


class _Watched:
    """A component whose nodes are asked after each crash whether they take their clocks for synchronised."""

    mechanism = "watched"

    def __init__(self, sync: TimeSync) -> None:
        self._sync = sync
        self.forgotten: list[bool] = []

    def start(self, services: SyncServices) -> SyncMechanism:
        """The mechanism of the component, watched."""
        mechanism = make_sync(self._sync, services)
        forget = mechanism.forget

        def forget_and_ask(node: int) -> None:
            forget(node)
            self.forgotten.append(mechanism.is_synchronised(node))

        mechanism.forget = forget_and_ask  # type: ignore[method-assign]
        return mechanism


def _run(sync: TimeSync, *faults: dict[str, Any]) -> Memory:
    """The tables of one run of the grid."""
    setup = build(load({**SCENARIO, "faults": list(faults)}))
    assert isinstance(setup, BeaconSetup), "the scenario has a network and no target"
    memory = Memory({**RECORDED_BY_DEFAULT, "clocks": True})
    replicate_of(replace(setup, sync=sync), 0, memory)
    return memory
