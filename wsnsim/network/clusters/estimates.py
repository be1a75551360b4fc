"""What a track reports: its initiation, the estimate of each step, also to a sink, and what the tracker believes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wsnsim.base.arrays import Estimate, Reading
from wsnsim.base.ports import Scene
from wsnsim.base.requests import Parcel
from wsnsim.base.rows import Issued, wants_belief, write_belief
from wsnsim.base.tables import Recorder
from wsnsim.network.clusters.cluster import Cluster
from wsnsim.network.clusters.driver import Driver
from wsnsim.network.clusters.network_view import NetworkView
from wsnsim.network.clusters.track import Track
from wsnsim.network.event_log import then
from wsnsim.network.radio.datagrams import A_SINK, Datagram
from wsnsim.network.result_rows import ReportRows


class Estimates:
    """Initiates tracks, records their estimates, and has heads report them, each to one of the sinks.

    Attributes:
        received: When a sink received each report, in s: {(target, step): time}.
    """

    def __init__(
        self, network: NetworkView, reports: ReportRows, sinks: Sequence[int], recorder: Recorder, replicate: int
    ) -> None:  # fmt: skip
        self.network = network
        self.recorder = recorder
        self.replicate = replicate
        self.received: dict[tuple[int, int], float] = {}
        self._reports = reports
        self._sinks = sinks
        self._bits, self._interval = network.setup.sink.bits, network.setup.report_every

    def initial(self, track: Track, readings: Mapping[int, Reading]) -> Estimate:
        """The estimate from which a track is initiated, given {node: reading}."""
        setup, at = self.network.setup, self.network.nodes
        nodes = np.array(sorted(readings), dtype=np.int64)
        return setup.acquire.estimate(
            np.array([readings[node] for node in nodes.tolist()]),
            at.assumed.positions[nodes],
            at.traits[nodes],
            setup.filter_sensor,
            setup.filter_motions[track.target],
            track.prior,
        )

    def note_start(self, track: Track, head: int) -> None:
        """Note that a track was initiated; one that was lost before has been reacquired."""
        if track.started:
            track.reacquired += 1
            self.network.log.add("reacquire", track.target, head)
        track.started = True

    def issue(self, track: Track, step: int, scene: Scene, driver: Driver, belief: Any) -> None:
        """Record the estimate of a step and report it to the sink. At step 0 the belief is the prior, no estimate."""
        if step == 0:
            return
        estimate = self.network.setup.tracker.estimate(belief)
        self.network.log.add("estimate", track.target, scene.head)
        assert math.isfinite(sum(estimate.mean.tolist())), (
            f"the tracker's estimate at step {step} is not finite: {estimate.mean}"
        )
        track.estimates[step] = Issued(
            step, self.network.clock.now, estimate, scene.head, scene.active, len(scene.roster), driver.readings
        )
        self._report(scene.head, step, track.target)

    def snapshot(self, track: Track, cluster: Cluster, belief: Any, step: int) -> None:
        """Record the particles and the tracker's state, if their tables are wanted."""
        if not wants_belief(self.recorder):
            return
        setup = self.network.setup
        members = [cluster.members[node] for node in cluster.roster()]
        key = {"replicate": self.replicate, "target": track.target, "step": step}
        write_belief(self.recorder, key, setup.tracker, belief, members, setup.motions[track.target].columns)

    def _report(self, head: int, step: int, target: int) -> None:
        """Send the estimate of a step to a sink, if a report is due. The head does not wait for its arrival."""
        if not self._sinks or step % self._interval:
            return
        report = Datagram(head, A_SINK, Parcel(None, 1, self._bits, "report"))
        then(self._reports.send(report, target), self._receive, report, step, target)

    def _receive(self, report: Datagram, step: int, target: int) -> None:
        if report.arrived:
            self.received[target, step] = self.network.clock.now
