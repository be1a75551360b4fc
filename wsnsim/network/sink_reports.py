"""Estimates on their way to the sink: one letter each, relayed like any other, while the head goes on.

Reports(stage's air ..., sink, dt).send(head, step, target)      reports.received[target, step] -> s
"""

from __future__ import annotations

import numpy as np
import simpy

from wsnsim.base.radio import Sink
from wsnsim.base.requests import Parcel
from wsnsim.base.tables import KIND
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.nodes import Nodes
from wsnsim.network.radio.transport import Datagram, Transport, datagram

REPORT = KIND["report"]


class Reports:
    """What the sink has been told. `node` is the sink; None where a scenario has none."""

    def __init__(
        self, env: simpy.Environment, fleet: Nodes, air: Transport, journal: EventLog, sink: Sink, dt: float
    ) -> None:
        self._env = env
        self._air = air
        self._journal = journal
        self._bits = sink.bits
        self._every = 1 if sink.every is None else max(1, round(sink.every / dt))
        self.node = None if sink.point is None else int(fleet.tree.query(np.array(sink.point))[1])
        self.received: dict[tuple[int, int], float] = {}

    def send(self, head: int, step: int, target: int) -> None:
        """Send the estimate of a step to the sink, if one is due; nobody waits for it."""
        if self.node is None or step % self._every:
            return
        report = datagram(head, self.node, Parcel(None, 1, self._bits, "report"))
        event = self._air.carry([report], target)
        assert event.callbacks is not None
        event.callbacks.append(lambda _: self._arrive(report, step, target))

    def _arrive(self, report: Datagram, step: int, target: int) -> None:
        if not report.arrived:
            return
        self.received[target, step] = self._env.now
        code, step_now = self._journal.code("report"), self._journal.step
        self._journal.add(
            event(self._env.now, step_now, target, report.to, REPORT, code, peer=report.source, packets=1)
        )
