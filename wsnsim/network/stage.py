"""What the processes of one run share: the clock, the nodes, the air, the log. Each has one owner that changes it."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as with_default
from typing import TYPE_CHECKING

import simpy

from wsnsim.base.ports import Field, Recorder
from wsnsim.base.problem import Parts
from wsnsim.base.tables import EVENT_CAUSE, KIND
from wsnsim.network.air import Air
from wsnsim.network.clocks import Clocks
from wsnsim.network.fleet import Fleet
from wsnsim.network.journal import Journal
from wsnsim.network.reports import Reports
from wsnsim.network.sensed import Sensed

if TYPE_CHECKING:
    from wsnsim.network.waking import Waker


@dataclass(slots=True)
class Stage:
    """The shared services. `step` is the clock; `sensing[target]` is {node: reading} of the living in range now.

    `cycles`: operations that trackers have stated so far. `waker` wakes nodes ahead of a target; None where nobody is.
    """

    env: simpy.Environment
    parts: Parts
    fleet: Fleet
    journal: Journal
    air: Air
    clocks: Clocks
    reports: Reports
    sensed: list[Sensed]
    field: Field
    threshold: float
    tracker_key: int
    replicate: int
    recorder: Recorder
    step: int = 0
    cycles: float = 0.0
    sensing: list[dict[int, float]] = with_default(default_factory=list)
    waker: Waker | None = None

    def log(
        self, kind: str, target: int, node: int, what: str = "", peer: int = -1, packets: int = 0, bits: int = 0
    ) -> None:
        """An event that costs no energy of its own."""
        self.journal.add(
            (self.env.now, self.step, target, node, KIND[kind], self.journal.code(what), 0, 0, peer, packets, bits, 0.0,
             EVENT_CAUSE["none"])
        )  # fmt: skip

    def able(self, node: int) -> bool:
        """Whether a node lives and its charge exceeds the threshold (Jiang 2013, section 4, step 2)."""
        return self.fleet.alive[node] and self.fleet.holds_more(node, self.threshold)
