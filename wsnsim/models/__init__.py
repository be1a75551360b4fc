"""Models and policies of every role but trackers, under the names of their kinds and under their own names.

from wsnsim.models import RangeSensor, CoordinatedTurn        the modules are imported at first use
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wsnsim.base.facades import facade

if TYPE_CHECKING:
    # fmt: off
    # isort: off
    from wsnsim.models.access import Csma as Csma, IdealMac as IdealMac, Tdma as Tdma
    from wsnsim.models.acquire import AroundTruth as AroundTruth, FromReadings as FromReadings
    from wsnsim.models.appointed import Appointed as Appointed
    from wsnsim.models.bearing import Bearing as Bearing, RangeBearing as RangeBearing
    from wsnsim.models.clusters import Central as Central, MovingHead as MovingHead, StrongestSignal as StrongestSignal
    from wsnsim.models.deploy import Anchors as Anchors, Grid as Grid, JitteredGrid as JitteredGrid, Uniform as Uniform
    from wsnsim.models.energy import FirstOrder as FirstOrder, FirstOrder2002 as FirstOrder2002, States as States
    from wsnsim.models.faults import (
        Bias as Bias, Blackout as Blackout, ClockStep as ClockStep, Crash as Crash, Drain as Drain,
        LinkLoss as LinkLoss, Restart as Restart, Stuck as Stuck,
    )
    from wsnsim.models.hardware import (
        DriftingClock as DriftingClock, Frames as Frames, ImperfectDetection as ImperfectDetection,
        NearestNode as NearestNode, NoPacking as NoPacking, NoSink as NoSink, PerfectClock as PerfectClock,
        PerfectDetection as PerfectDetection, Processor as Processor,
    )
    from wsnsim.models.linear import ConstantAcceleration as ConstantAcceleration, ConstantVelocity as ConstantVelocity
    from wsnsim.models.links import (
        Disk as Disk, GreedyGeographic as GreedyGeographic, LogNormal as LogNormal, MinimumEnergy as MinimumEnergy,
        MinimumHop as MinimumHop,
    )
    from wsnsim.models.low_power_listening import ContikiMac as ContikiMac, XMac as XMac
    from wsnsim.models.mobility import CoordinatedTurn as CoordinatedTurn, GaussMarkov as GaussMarkov
    from wsnsim.models.motion import BoundedVelocity as BoundedVelocity
    from wsnsim.models.node_file import FromFile as FromFile
    from wsnsim.models.ranging import Range as Range, RangeFromOrigin as RangeFromOrigin
    from wsnsim.models.recorded_links import RecordedLinks as RecordedLinks
    from wsnsim.models.recorded_readings import RecordedSensor as RecordedSensor
    from wsnsim.models.recorded_track import RecordedTrack as RecordedTrack
    from wsnsim.models.rssi import Rssi as Rssi
    from wsnsim.models.sensing import AcousticEnergy as AcousticEnergy, Coordinate as Coordinate
    from wsnsim.models.sleep import (
        AlwaysOn as AlwaysOn, DutyCycle as DutyCycle, EventWake as EventWake, RandomIndependent as RandomIndependent,
    )
    from wsnsim.models.synchronisation import Ftsp as Ftsp, NoSync as NoSync
    from wsnsim.models.tsch import Tsch as Tsch
    from wsnsim.models.ungm import Squared as Squared, Ungm as Ungm
    from wsnsim.models.wakeup import (
        DirectedFlood as DirectedFlood, ExperienceZones as ExperienceZones, NoWakeUp as NoWakeUp, Region as Region,
    )
    from wsnsim.models.waypoints import RandomWaypoint as RandomWaypoint, Waypoints as Waypoints
    from wsnsim.models.workloads import (
        CollectionTreeProtocol as CollectionTreeProtocol, Periodic as Periodic,
        PeriodicCollection as PeriodicCollection, SeveralSinks as SeveralSinks, Tracking as Tracking,
    )

    AnchorsDeployment = Anchors
    AppointedClusters = Appointed
    Beacons = Periodic
    BeaconsWorkload = Periodic
    BearingSensor = Bearing
    BiasFault = Bias
    BlackoutFault = Blackout
    CentralClusters = Central
    Collection = PeriodicCollection
    CollectionWorkload = PeriodicCollection
    Contikimac = ContikiMac
    CoordinateSensor = Coordinate
    CrashFault = Crash
    CsmaMac = Csma
    Ctp = CollectionTreeProtocol
    CtpRouting = CollectionTreeProtocol
    DiskLink = Disk
    DrainFault = Drain
    Drift = DriftingClock
    File = FromFile
    FileDeployment = FromFile
    FramesPacking = Frames
    FtspSync = Ftsp
    GridDeployment = Grid
    Ideal = IdealMac
    Imperfect = ImperfectDetection
    Node = NearestNode
    NodeSink = NearestNode
    Nodes = SeveralSinks
    NodesSink = SeveralSinks
    ProcessorCpu = Processor
    RangeSensor = Range
    Readings = FromReadings
    ReadingsAcquire = FromReadings
    RecordedLink = RecordedLinks
    RegionWakeUp = Region
    RestartFault = Restart
    Ris = RandomIndependent
    RisSleep = RandomIndependent
    RssiSensor = Rssi
    SquaredSensor = Squared
    StatesEnergy = States
    StuckFault = Stuck
    TdmaMac = Tdma
    TrackingWorkload = Tracking
    TschMac = Tsch
    UngmMotion = Ungm
    UniformDeployment = Uniform
    WaypointsMotion = Waypoints
    Xmac = XMac

__getattr__, __dir__ = facade(__name__)
