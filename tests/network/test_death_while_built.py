"""Nodes whose battery is empty before the simulation starts: the network takes them down when it does."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from wsnsim import experiment, scenario
from wsnsim.base.part import part
from wsnsim.base.tables import KIND, Memory
from wsnsim.models.access import IdealMac
from wsnsim.network.mechanisms import make_mechanism

SWITCHING_KILLS = "energy={kind: first_order, battery: 2 J, switch: 3 J}"
ASLEEP = "sleep={kind: ris, probability: 0.01}"


@part
class HoldsOneAwake(IdealMac):
    """An ideal MAC that holds node 7 awake from its start on."""

    mechanism: ClassVar[str] = "holds_one_awake"

    def start(self, services):
        """Return the mechanism."""
        services.hold_awake(7)
        return make_mechanism("mac", IdealMac(), services)


def deaths(*changes: str) -> tuple[list[tuple[float, int]], np.ndarray]:
    """(time, node) of the deaths in the event log of a sleeping network; and the times of death of the nodes."""
    memory = Memory()
    changes = ("duration=4 s", "record.events=true", SWITCHING_KILLS, ASLEEP, *changes)
    experiment.simulate_run(scenario.load("gmtt", changes), 0, memory)
    events = memory.table("events")
    died = events["kind"] == KIND["death"]
    pairs = zip(events["time"][died].tolist(), events["node"][died].tolist(), strict=True)
    return list(pairs), memory.table("nodes")["died_at"]


def test_a_node_that_its_mac_kills_at_the_start_has_died_at_the_start():
    logged, died_at = deaths(f"mac.kind={__name__}:HoldsOneAwake")
    assert (0.0, 7) in logged and died_at[7] == 0.0


def test_a_sink_that_dies_of_being_kept_awake_has_died_at_the_start():
    logged, died_at = deaths()
    ((_, sink),) = [death for death in logged if death[0] == 0.0]
    assert died_at[sink] == 0.0
