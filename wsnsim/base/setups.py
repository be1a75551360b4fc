"""Setups: scenarios whose components are built and checked, one component per role.

Setup ─┬─ TrackingSetup (targets, sensor, tracker) ──┬─ NetworkSetup
       └─ RadioSetup (radio, energy, sleep) ─────────┴─ BeaconSetup has the radio alone, and a workload

table_layout(setup) -> TableLayout        what decides which columns the tables have
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from wsnsim.base import medium_access
from wsnsim.base.arrays import Estimate, components_of
from wsnsim.base.batteries import Battery
from wsnsim.base.detections import ReportsScans
from wsnsim.base.mechanisms import TimeSync
from wsnsim.base.metrics import LOST_ERROR, LOST_STEPS
from wsnsim.base.network_ports import ClusterPolicy, Deployment, FaultEvent, HasSeveralSinks, Routing, Sink, Workload
from wsnsim.base.optional_ports import ForecastsSuccession, LinearGaussian, MayBeAbsent, Replays
from wsnsim.base.ports import Acquire, Detection, MotionModel, PriorModel, Scene, SensorModel, Tracker
from wsnsim.base.radio import Clock, Cpu, EnergyModel, LinkModel, PacketJoules
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.rng import Streams, derive_all
from wsnsim.base.sensing import is_perfect
from wsnsim.base.sleeping import SleepSchedule, WakeUp

Intervals = tuple[tuple[float, float], ...]
"""(begin, end) in s of each of several intervals, disjoint and ascending."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What every scenario has.

    Attributes:
        name: of the scenario.
        seed: of every random stream.
        steps: the number of the last instant. Instants are 0, 1, ..., `steps`, each owns the step that begins at it.
        dt: the length of a step in s.
        deploy: where the nodes stand.
        record: {table: whether it is recorded}.
        faults: what fails; without a network, of sensors.
        unused: keys of the scenario that have no effect on this run.
        network: number of the run whose network all runs have; None: each has its own.
    """

    name: str
    seed: int
    steps: int
    dt: float
    deploy: Deployment
    record: Mapping[str, bool] = field(default_factory=dict)
    faults: tuple[FaultEvent, ...] = ()
    unused: tuple[str, ...] = ()
    network: int | None = None

    def streams(self, replicate: int) -> Streams:
        """The random streams of a run."""
        return Streams(self.seed, replicate, self.network)

    @property
    def duration(self) -> float:
        """The simulated time in s: from instant 0 to the end of the step of the last instant."""
        return (self.steps + 1) * self.dt

    @property
    def position_error(self) -> float:
        """Standard deviation (m, per axis) of the assumed positions of nodes; 0 for a deployment that has none."""
        return getattr(self.deploy, "position_error", 0.0)


@dataclass(frozen=True, kw_only=True)
class TrackingSetup(Setup):
    """A scenario without its network: what is estimated, from what, and by whom. It has all that a `Setup` has.

    Attributes:
        prior: of each track.
        motions: one model per target.
        presence: for each target the intervals (s, both ends within) in which it is present, None for all the time;
            empty: no target has any.
        sensor: the sensor model; of recorded readings, the law that they are taken to follow.
        filter_motions: one model per target, which the tracker assumes (`tracker.assumes`).
        filter_sensor: the sensor model that the tracker assumes.
        tracker: the tracking strategy.
        detection: the errors of what nodes report.
        recorded: where readings come from that were recorded; None: `sensor` samples them.
        lost_window: the number of steps in a row without an estimate of less error than `lost_limit` (m) at which a
            track is lost.
        lost_limit: this error in m.
    """

    prior: PriorModel
    motions: tuple[MotionModel, ...]
    sensor: SensorModel
    filter_motions: tuple[MotionModel, ...]
    filter_sensor: SensorModel
    tracker: Tracker[Any]
    detection: Detection
    recorded: Replays | None = None
    lost_window: int = LOST_STEPS
    lost_limit: float = LOST_ERROR
    presence: tuple[Intervals | None, ...] = ()

    @property
    def has_absences(self) -> bool:
        """Whether a target may be absent for a while, or for a whole run."""
        return any(each is not None for each in self.presence) or any(
            isinstance(motion, MayBeAbsent) and motion.may_be_absent for motion in self.motions
        )

    @property
    def uses_late_readings(self) -> bool:
        """Whether the tracker uses readings that arrive after their step; without a network none does."""
        return isinstance(self, NetworkSetup) and getattr(self.tracker, "late", "ignore") != "ignore"

    @property
    def unlabelled(self) -> bool:
        """Whether nodes report scans, whose detections name no target."""
        return isinstance(self.detection, ReportsScans)

    @property
    def uses_silence(self) -> bool:
        """Whether the head learns from members that sense and send nothing."""
        return getattr(getattr(self.tracker, "trigger", None), "silence", "ignored") == "used"

    def filter_motion(self, target: int) -> MotionModel:
        """The motion model that the tracker assumes of a target; where readings name none, that of the first one."""
        return self.filter_motions[0 if self.unlabelled else target]

    @property
    def member_cycles(self) -> float:
        """Operations that one member computes in a step, as the tracker states them; 0 if it states none."""
        return getattr(self.tracker, "member_cycles", 0.0)

    @property
    def has_covariance(self) -> bool:
        """Whether the covariance of the tracker's estimates is one; see `HeadlessTracker`."""
        return getattr(self.tracker, "has_covariance", True)

    @property
    def reports_all(self) -> bool:
        """Whether sensors surely report what they measure: detection is perfect, and nothing fails."""
        return not self.faults and is_perfect(self.detection)

    def posterior_is_gaussian(self, target: int) -> bool:
        """Whether the assumed models of a target are linear with Gaussian noise, and the tracker exact for such."""
        parts = (self.filter_motions[target], self.filter_sensor, self.tracker)
        return all(isinstance(part, LinearGaussian) and part.linear_gaussian for part in parts)


@dataclass(frozen=True, kw_only=True)
class RadioSetup(Setup):
    """How nodes communicate, what that costs, and what fails. It has all that a `Setup` has.

    Attributes:
        energy: what acts and modes of a node cost.
        battery: what nodes are supplied from.
        link: which nodes receive each other's frames.
        mac: when a frame gets the channel.
        packing: how many packets travel in a frame.
        routing: the path of datagrams that leave their cluster.
        sleep: when nodes sense and listen.
        cpu: the time of computations.
        clock: the rates of clocks.
        sync: how nodes keep their clocks together.
    """

    energy: EnergyModel
    battery: Battery
    link: LinkModel
    mac: medium_access.Mac
    packing: medium_access.Packing
    routing: Routing
    sleep: SleepSchedule
    cpu: Cpu
    clock: Clock
    sync: TimeSync

    def streams(self, replicate: int) -> Streams:
        """The random streams of a run; nodes whose clocks do not drift wake up at the same phases for ever."""
        drifting = bool((self.clock.rates(derive_all(0, np.arange(2))) != 1.0).any())
        return Streams(self.seed, replicate, self.network, drifting)

    @property
    def sink_points(self) -> tuple[tuple[float, float], ...]:
        """(x, y) in m of each sink, which is the node nearest to it; empty: there is no sink."""
        return ()

    @property
    def plain_batteries(self) -> bool:
        """Whether all nodes have `energy.battery` at the start, and nothing but their load changes it."""
        return getattr(self.battery, "plain", False)

    @cached_property
    def hop(self) -> medium_access.Latency:
        """How long a packet takes over one hop at most, without contention and retries."""
        return medium_access.hop_latency(self.mac, PACKET_BITS)

    @cached_property
    def _turns(self) -> Callable[[int], float]:
        """What the MAC says of the turns of members."""
        return self.mac.turns if isinstance(self.mac, medium_access.GivesTurns) else _no_turns

    def gathering(self, members: int) -> float:
        """Seconds that a packet of one of this number of members takes to their head at most; see `Scene`."""
        return max(self.hop.unicast, self._turns(members))


@dataclass(frozen=True, kw_only=True)
class NetworkSetup(TrackingSetup, RadioSetup):
    """A network that tracks targets. It has all that a `TrackingSetup` and a `RadioSetup` have.

    Attributes:
        wakeup: how nodes ahead of a target are woken.
        clusters: which node leads a cluster, and until when.
        acquire: how a track is initiated from readings.
        sink: the node that collects the estimates.
        until_clusters: the number of clusters after which a run ends; None: it does not.
    """

    wakeup: WakeUp
    clusters: ClusterPolicy
    acquire: Acquire
    sink: Sink
    until_clusters: int | None = None

    @cached_property
    def head_protocol(self) -> str:
        """The name of the head protocol of the cluster policy; see `ClusterPolicy`."""
        return self.clusters.protocol

    @property
    def headless(self) -> bool:
        """Whether there is no cluster head: every participant runs the filter."""
        return self.head_protocol == "none"

    @cached_property
    def waits(self) -> medium_access.HeadWaits:
        """How long heads wait for others, where neither their policy nor their tracker says."""
        return medium_access.head_waits(self.mac, self.dt)

    @cached_property
    def successor_forecast(self) -> Callable[[Any, Scene, int], Estimate]:
        """(belief, scene, steps ahead) -> the forecast from which the next head is chosen."""
        tracker = self.tracker
        return tracker.successor_forecast if isinstance(tracker, ForecastsSuccession) else tracker.forecast

    @cached_property
    def packet_joules(self) -> PacketJoules:
        """What a packet costs by the scenario's energy model; see `Scene`."""
        return PacketJoules(self.energy)

    @property
    def nodes_search(self) -> bool:
        """Whether awake nodes search all the time for targets without a track: they do where heads move."""
        return self.head_protocol == "moving"

    @property
    def members_join(self) -> bool:
        """Whether a node belongs to a cluster from the time on at which the event log says that it joined."""
        return self.head_protocol in ("standing", "electing", "appointing")

    @property
    def sink_points(self) -> tuple[tuple[float, float], ...]:
        """(x, y) in m of each sink, which is the node nearest to it; empty: there is no sink."""
        sink = self.sink
        if sink.point is None:
            return ()
        return sink.points if isinstance(sink, HasSeveralSinks) else (sink.point,)

    @property
    def polls(self) -> int:
        """How often in a step awake nodes search for a target without a track."""
        every = self.acquire.poll
        return 1 if every is None or not self.nodes_search else max(1, round(self.dt / every))

    @property
    def report_every(self) -> int:
        """The number of steps from one report that a track owes the sink to the next; 0: there is no sink."""
        if self.sink.point is None:
            return 0
        return 1 if self.sink.every is None else max(1, round(self.sink.every / self.dt))

    @property
    def head_threshold(self) -> float:
        """The charge in J that a head must exceed: to send one packet, receive one and compute one step of a member.

        Jiang (2013), section 4, step 2; or what the cluster policy says.
        """
        if self.clusters.threshold is not None:
            return self.clusters.threshold
        energy, operations = self.energy, self.member_cycles
        radio = sum(energy.transmit(PACKET_BITS, self.link.reach)) + energy.receive(PACKET_BITS)
        return radio + energy.compute(operations * self.cpu.cycles_per_flop)


@dataclass(frozen=True, kw_only=True)
class BeaconSetup(RadioSetup):
    """A network without targets, whose nodes do what the workload says. It has all that a `RadioSetup` has.

    Attributes:
        workload: what the nodes do: send beacons, or what a plug-in makes them do.
    """

    workload: Workload

    @property
    def sink_points(self) -> tuple[tuple[float, float], ...]:
        """(x, y) in m of each sink, which is the node nearest to it; empty: the workload sends nothing to sinks."""
        return self.workload.points if isinstance(self.workload, HasSeveralSinks) else ()


def _no_turns(members: int) -> float:
    """0: members send when they have something to send."""
    return 0.0


class TableLayout(NamedTuple):
    """What `tables.columns_of` needs to know of a scenario.

    Attributes:
        states: The (name, unit) of each of the motion model's columns; none without a target.
        position: Which of them are the position; none without a target.
        components: The number of components of a reading.
        duty_cycled: Whether a MAC switches radios off.
        absences: Whether a target may be absent.
        unlabelled: Whether readings name no target.
        harvests: Whether nodes harvest energy.
        headless: Whether there is no cluster head.
        late_readings: Whether the tracker uses late readings.
    """

    states: tuple[tuple[str, str], ...] = ()
    position: tuple[int, ...] = ()
    components: int = 1
    duty_cycled: bool = False
    absences: bool = False
    unlabelled: bool = False
    harvests: bool = False
    headless: bool = False
    late_readings: bool = False

    @property
    def keywords(self) -> dict[str, Any]:
        """All but `states`, as keyword arguments of the recorders of a result."""
        return {name: value for name, value in self._asdict().items() if name != "states" and value != ()}


def table_layout(setup: Setup) -> TableLayout:
    """The layout of the tables of a scenario's runs."""
    duty_cycled = isinstance(setup, RadioSetup) and isinstance(setup.mac, medium_access.DutyCycledMac)
    harvests = isinstance(setup, RadioSetup) and setup.battery.restart is not None
    if not isinstance(setup, TrackingSetup):
        return TableLayout(duty_cycled=duty_cycled, harvests=harvests)
    motion = setup.motions[0]
    states = tuple(zip(motion.columns, motion.units, strict=True))
    components, headless = len(components_of(setup.sensor)), isinstance(setup, NetworkSetup) and setup.headless
    some = (duty_cycled, setup.has_absences, setup.unlabelled, harvests, headless, setup.uses_late_readings)
    return TableLayout(states, motion.position, components, *some)
