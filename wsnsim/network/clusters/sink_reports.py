"""Estimates on their way to the sink: one datagram each, while the cluster head goes on."""

from __future__ import annotations

import numpy as np

from wsnsim.base.radio import Sink
from wsnsim.base.requests import Parcel
from wsnsim.base.tables import KIND
from wsnsim.network.event_log import event
from wsnsim.network.radio.radio_services import RadioServices
from wsnsim.network.radio.transport import Datagram, Transport

REPORT = KIND["report"]


class SinkReports:
    """The reports that cluster heads send to the sink.

    Attributes:
        node: The sink; None if the scenario has none.
        received: When the sink received each report, in s: {(target, step): time}.
    """

    def __init__(self, radio: RadioServices, transport: Transport, sink: Sink, dt: float) -> None:
        self._env = radio.env
        self._log = radio.log
        self._transport = transport
        self._bits = sink.bits
        self._interval = 1 if sink.every is None else max(1, round(sink.every / dt))
        self.node = None if sink.point is None else radio.nodes.grid.nearest(np.array(sink.point))
        self.received: dict[tuple[int, int], float] = {}

    def send(self, head: int, step: int, target: int) -> None:
        """Send the estimate of a step to the sink, if a report is due. The head does not wait for its arrival."""
        if self.node is None or step % self._interval:
            return
        report = Datagram(head, self.node, Parcel(None, 1, self._bits, "report"))
        ended = self._transport.carry([report], target)
        assert ended.callbacks is not None, "a report ends later than it is sent"
        ended.callbacks.append(lambda _: self._receive(report, step, target))

    def _receive(self, report: Datagram, step: int, target: int) -> None:
        if not report.arrived:
            return
        now, code = self._env.now, self._log.code("report")
        self.received[target, step] = now
        self._log.add(event(now, self._log.step, target, report.to, REPORT, code, peer=report.source, packets=1))
