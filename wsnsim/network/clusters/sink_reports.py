"""Estimates on their way to a sink: one datagram each, while the cluster head goes on."""

from __future__ import annotations

from collections.abc import Sequence

import simpy

from wsnsim.base.network_ports import Sink
from wsnsim.base.requests import Parcel
from wsnsim.network.radio.datagrams import A_SINK, Datagram
from wsnsim.network.report_rows import ReportRows


class SinkReports:
    """The reports that cluster heads send, each to one of the sinks.

    Attributes:
        received: When a sink received each report, in s: {(target, step): time}.
    """

    def __init__(
        self, env: simpy.Environment, reports: ReportRows, sink: Sink, dt: float, sinks: Sequence[int]
    ) -> None:  # fmt: skip
        self._env = env
        self._reports = reports
        self._bits = sink.bits
        self._interval = 1 if sink.every is None else max(1, round(sink.every / dt))
        self._sinks = sinks
        self.received: dict[tuple[int, int], float] = {}

    def send(self, head: int, step: int, target: int) -> None:
        """Send the estimate of a step to a sink, if a report is due. The head does not wait for its arrival."""
        if not self._sinks or step % self._interval:
            return
        report = Datagram(head, A_SINK, Parcel(None, 1, self._bits, "report"))
        ended = self._reports.send(report, target)
        assert ended.callbacks is not None, "a report ends later than it is sent"
        ended.callbacks.append(lambda _: self._receive(report, step, target))

    def _receive(self, report: Datagram, step: int, target: int) -> None:
        if report.arrived:
            self.received[target, step] = self._env.now
