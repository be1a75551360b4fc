"""Reports to sinks: the event of each arrival, and the rows of the table `reports`."""

from __future__ import annotations

import numpy as np
import simpy

from wsnsim.base.ports import Recorder
from wsnsim.base.tables import KIND
from wsnsim.network.event_log import EventLog, event
from wsnsim.network.radio.datagrams import Datagram
from wsnsim.network.radio.transport import Transport

REPORT = KIND["report"]
NAN = float("nan")


class ReportRows:
    """The reports that nodes have sent to sinks, each with what became of it.

    Args:
        env: The clock.
        log: The event log.
        transport: What reports are sent with.
    """

    def __init__(self, env: simpy.Environment, log: EventLog, transport: Transport) -> None:
        self._env = env
        self._log = log
        self._transport = transport
        self._sent: list[tuple[Datagram, int, float]] = []

    def send(self, report: Datagram, target: int) -> simpy.Event:
        """Send a report to a sink. Its arrival is logged before the event fires that says that it has ended."""
        self._sent.append((report, target, self._env.now))
        ended = self._transport.carry([report], target)
        assert ended.callbacks is not None, "a report ends later than it is sent"
        ended.callbacks.append(lambda _: self._log_arrival(report, target))
        return ended

    def write(self, replicate: int, recorder: Recorder) -> None:
        """Write the table, unless no report was sent."""
        if not self._sent or not recorder.wants("reports"):
            return
        reports, targets, times = zip(*self._sent, strict=True)
        columns = {
            "target": np.array(targets),
            "node": np.array([report.source for report in reports]),
            "time": np.array(times),
            "received": np.array([report.arrived_at if report.arrived else NAN for report in reports]),
            "sink": np.array([report.to if report.arrived else -1 for report in reports]),
            "hops": np.array([report.hops if report.arrived else 0 for report in reports]),
            "bits": np.array([report.bits for report in reports]),
        }
        recorder.write("reports", {"replicate": replicate, **columns})

    def _log_arrival(self, report: Datagram, target: int) -> None:
        if report.arrived:
            now, log = self._env.now, self._log
            log.add(
                event(now, log.step, target, report.to, REPORT, log.code("report"), peer=report.source, packets=1)
            )  # fmt: skip
