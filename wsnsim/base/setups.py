"""A scenario, built: one part a role. What a bench needs, what a radio needs, and both together for a network.

Common ── Problem (what is estimated, from what, by whom)   ─┐
       └─ Radio (how nodes talk, what it costs, what fails) ─┴─ Parts;  Beacons: a radio without a target
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from wsnsim.base.metrics import LOST_ERROR, LOST_WINDOW
from wsnsim.base.ports import (
    Acquire,
    ClusterPolicy,
    Deployment,
    Detection,
    MotionModel,
    PriorModel,
    SensorModel,
    Tracker,
    head_protocol,
)
from wsnsim.base.radio import Clock, Cpu, EnergyModel, FaultEvent, LinkModel, Mac, Packing, Routing, Sink, Workload
from wsnsim.base.requests import PACKET_BITS
from wsnsim.base.sleeping import SleepSchedule, WakeUp


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What every scenario says. Times in s. `record` maps table names to whether they are wanted."""

    name: str
    seed: int
    steps: int
    dt: float
    deploy: Deployment
    record: Mapping[str, bool] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class TrackingSetup(Setup):
    """A scenario without its network: what is estimated, from what, and by whom.

    `motions` holds one model a target. `filter_motions` and `filter_sensor` are what trackers are told
    (`tracker.assumes`). A track is lost if the mean error of its last `lost_window` steps exceeds `lost_limit`.
    """

    prior: PriorModel
    motions: tuple[MotionModel, ...]
    sensor: SensorModel
    filter_motions: tuple[MotionModel, ...]
    filter_sensor: SensorModel
    tracker: Tracker[Any]
    lost_window: int = LOST_WINDOW
    lost_limit: float = LOST_ERROR


@dataclass(frozen=True, kw_only=True)
class RadioSetup(Setup):
    """How nodes talk, what it costs them, and what fails."""

    energy: EnergyModel
    link: LinkModel
    mac: Mac
    packing: Packing
    routing: Routing
    sleep: SleepSchedule
    cpu: Cpu
    clock: Clock
    faults: tuple[FaultEvent, ...] = ()


@dataclass(frozen=True, kw_only=True)
class NetworkSetup(TrackingSetup, RadioSetup):
    """A network that tracks targets."""

    wakeup: WakeUp
    clusters: ClusterPolicy
    acquire: Acquire
    detection: Detection
    sink: Sink
    until_clusters: int | None = None

    @cached_property
    def head_protocol(self) -> str:
        """The name of the head protocol of the cluster policy; see `ClusterPolicy`."""
        return head_protocol(self.clusters)

    @property
    def nodes_search(self) -> bool:
        """Whether awake nodes search all the time for targets that nobody tracks: those of moving heads do."""
        return self.head_protocol == "moving"

    @property
    def members_are_fixed(self) -> bool:
        """Whether a cluster keeps the members with which it formed."""
        return self.head_protocol in ("standing", "electing")

    @property
    def polls(self) -> int:
        """How often in a step awake nodes search for a target that nobody tracks."""
        every = self.acquire.poll
        return 1 if every is None or not self.nodes_search else max(1, round(self.dt / every))

    def due_reports(self, steps: int) -> int:
        """Number of reports that a track owes the sink in this many steps."""
        if self.sink.point is None:
            return 0
        every = 1 if self.sink.every is None else max(1, round(self.sink.every / self.dt))
        return steps // every

    @property
    def head_threshold(self) -> float:
        """Joules that a node must hold to be chosen: one packet sent at reach, one received, one step's processing.

        Jiang (2013), section 4, step 2; or what the cluster policy says. A tracker states its members' processing as
        `member_cycles`, in operations; without it, it is nothing.
        """
        if self.clusters.threshold is not None:
            return self.clusters.threshold
        energy, operations = self.energy, getattr(self.tracker, "member_cycles", 0.0)
        radio = sum(energy.transmit(PACKET_BITS, self.link.reach)) + energy.receive(PACKET_BITS)
        return radio + energy.compute(operations * self.cpu.cycles_per_flop)


@dataclass(frozen=True, kw_only=True)
class BeaconSetup(RadioSetup):
    """A network without targets, whose nodes do what the workload says: send beacons, or what a plug-in makes them."""

    workload: Workload
