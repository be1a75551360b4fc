"""What the processes of one run share: the clock, the nodes, the air, the log. Each has one owner that changes it."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as with_default
from typing import TYPE_CHECKING

import simpy

from wsnsim.base.ports import Field, Recorder
from wsnsim.base.setups import NetworkSetup
from wsnsim.base.tables import KIND
from wsnsim.network.clocks import Clocks
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.transport import Transport
from wsnsim.network.readings import Readings
from wsnsim.network.sink_reports import SinkReports

if TYPE_CHECKING:
    from wsnsim.network.clusters.wake_up_service import WakeUpService


@dataclass(slots=True)
class RunContext:
    """The shared services. `step` is the clock; `sensing[target]` is {node: reading} of the living in range now.

    `cycles`: operations that trackers have stated so far. `waker` wakes nodes ahead of a target; None where nobody is.
    """

    env: simpy.Environment
    parts: NetworkSetup
    fleet: Nodes
    journal: EventLog
    air: Transport
    clocks: Clocks
    reports: SinkReports
    sensed: list[Readings]
    field: Field
    threshold: float
    tracker_key: int
    replicate: int
    recorder: Recorder
    step: int = 0
    cycles: float = 0.0
    sensing: list[dict[int, float]] = with_default(default_factory=list)
    waker: WakeUpService | None = None

    def log(
        self, kind: str, target: int, node: int, what: str = "", peer: int = -1, packets: int = 0, bits: int = 0
    ) -> None:
        """An event that costs no energy of its own."""
        code = self.journal.code(what)
        self.journal.add(
            event(self.env.now, self.step, target, node, KIND[kind], code, peer=peer, packets=packets, bits=bits)
        )

    def able(self, node: int) -> bool:
        """Whether a node lives and its charge exceeds the threshold (Jiang 2013, section 4, step 2)."""
        return self.fleet.alive[node] and self.fleet.holds_more(node, self.threshold)
