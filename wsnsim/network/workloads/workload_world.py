"""A network without targets: its nodes do what the workload's mechanism says.

WorkloadWorld(setup, replicate, positions, streams, recorder).run() -> NetworkOutcome
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from wsnsim.base.arrays import Floats
from wsnsim.base.mechanisms import WorkloadMechanism
from wsnsim.base.ports import Recorder
from wsnsim.base.progress import OnTime
from wsnsim.base.requests import Parcel
from wsnsim.base.rng import Streams
from wsnsim.base.setups import BeaconSetup
from wsnsim.base.tables import KIND
from wsnsim.network.event_log import event
from wsnsim.network.network import Network, Sensors, Steps
from wsnsim.network.radio.datagrams import A_SINK, Datagram
from wsnsim.network.radio.radio_stack import RadioStack
from wsnsim.network.radio.transport import Transport
from wsnsim.network.report_rows import ReportRows
from wsnsim.network.result_rows import NetworkOutcome
from wsnsim.network.workloads.mechanisms import make_workload


class WorkloadNetwork:
    """What a workload may use of a network (`mechanisms.WorkloadServices`). `key` is the workload's random key."""

    def __init__(
        self, stack: RadioStack, transport: Transport, reports: ReportRows, sinks: Sequence[int], key: int
    ) -> None:  # fmt: skip
        nodes = stack.radio.nodes
        self._env = stack.radio.env
        self._nodes = nodes
        self._mac = stack.mac
        self._transport = transport
        self._reports = reports
        self.sinks = sinks
        self.key = key
        self.positions = nodes.positions
        self.is_awake: Callable[[int], bool] = nodes.is_awake
        self.lasts: Callable[[int, float], float] = stack.clocks.lasts
        self.word: Callable[[str], int] = stack.radio.log.code

    @property
    def now(self) -> float:
        """The simulated time in s."""
        return self._env.now

    def is_dead(self, node: int) -> bool:
        """Whether the battery of a node is empty."""
        return node in self._nodes.died_at

    def call_later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call an action after `seconds` of simulated time."""
        timer = self._env.timeout(seconds)
        assert timer.callbacks is not None
        timer.callbacks.append(lambda _: action())

    def broadcast(self, node: int, bits: int, word: int) -> None:
        """Broadcast a payload of `bits` to all in range."""
        self._mac.offer(node, bits, _ignore, word)

    def send(self, node: int, to: int, bits: int, what: str, on_end: Callable[[bool], None]) -> None:
        """Send a payload of `bits` to a node over the path of `routing`; `on_end(arrived)` is called at the end."""
        datagram = Datagram(node, to, Parcel(None, 1, bits, what))
        ended = self._transport.carry([datagram], -1)
        assert ended.callbacks is not None
        ended.callbacks.append(lambda _: on_end(datagram.arrived))

    def collect(self, node: int, bits: int, what: str, on_end: Callable[[int], None]) -> None:
        """Send a report of `bits` to whichever sink; `on_end(sink)` is called at the end, with -1 if it was lost."""
        report = Datagram(node, A_SINK, Parcel(None, 1, bits, what))
        ended = self._reports.send(report, -1)
        assert ended.callbacks is not None
        ended.callbacks.append(lambda _: on_end(report.to if report.arrived else -1))


class WorkloadWorld(Network):
    """One network without targets."""

    _setup: BeaconSetup

    def __init__(
        self, setup: BeaconSetup, replicate: int, positions: Floats, streams: Streams, recorder: Recorder
    ) -> None:
        sensors = Sensors(positions, np.ones((len(positions), 0)))
        super().__init__(setup, replicate, sensors, streams, recorder, count_links=recorder.wants("links"))
        self._stack.radio.topology.find_all()
        services = WorkloadNetwork(self._stack, self._transport, self._reports, self._sinks, streams.key("beacons"))
        self.workload: WorkloadMechanism = make_workload(setup.workload, services)
        self._faults = self._make_faults(streams.key("faults"), lambda target: None, {})

    def run(self, progress: OnTime | None = None) -> NetworkOutcome:
        """Run to the end and return the outcome. Errors name the seed, the run and the simulated time."""
        self._start()
        self.workload.begin()
        return self._run_until(self._env.process(self._run_steps(progress)))

    def _run_steps(self, progress: OnTime | None) -> Steps:
        for step in range(self._setup.steps + 1):
            self._begin_step(step)
            if progress:
                progress(self._env.now)
            yield self._env.timeout((step + 1) * self._setup.dt - self._env.now)

    def _log_death(self, node: int) -> None:
        log = self._event_log
        log.add(event(self._env.now, log.step, -1, node, KIND["death"]))


def _ignore(received: object) -> None:
    """Take the result of a broadcast that nothing waits for."""
