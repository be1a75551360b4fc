"""Models and policies of every role but trackers, under the names of their kinds and under their own names.

from wsnsim.models import RangeSensor, CoordinatedTurn        the modules are imported at first use
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

from wsnsim.base.errors import did_you_mean

if TYPE_CHECKING:
    from wsnsim.models.access import Csma, IdealMac, Tdma
    from wsnsim.models.acquire import AroundTruth, FromReadings
    from wsnsim.models.appointed import Appointed
    from wsnsim.models.bearing import Bearing, RangeBearing
    from wsnsim.models.clusters import Central, MovingHead, StrongestSignal
    from wsnsim.models.collection import CollectionTreeProtocol, PeriodicCollection, SeveralSinks
    from wsnsim.models.contikimac import ContikiMac
    from wsnsim.models.deploy import Anchors, Grid, JitteredGrid, Uniform
    from wsnsim.models.energy import FirstOrder, FirstOrder2002, States
    from wsnsim.models.faults import Bias, Blackout, ClockStep, Crash, Drain, LinkLoss, Restart, Stuck
    from wsnsim.models.hardware import (
        DriftingClock,
        Frames,
        ImperfectDetection,
        NearestNode,
        NoPacking,
        NoSink,
        PerfectClock,
        PerfectDetection,
        Processor,
    )
    from wsnsim.models.linear import ConstantAcceleration, ConstantVelocity
    from wsnsim.models.linear_sensing import Coordinate
    from wsnsim.models.links import Disk, GreedyGeographic, LogNormal, MinimumEnergy, MinimumHop
    from wsnsim.models.mobility import CoordinatedTurn, GaussMarkov
    from wsnsim.models.motion import BoundedVelocity
    from wsnsim.models.node_file import FromFile
    from wsnsim.models.ranging import Range, RangeFromOrigin
    from wsnsim.models.recorded_links import RecordedLinks
    from wsnsim.models.recorded_readings import RecordedSensor
    from wsnsim.models.recorded_track import RecordedTrack
    from wsnsim.models.rssi import Rssi
    from wsnsim.models.sensing import AcousticEnergy
    from wsnsim.models.sleep import AlwaysOn, DutyCycle, EventWake, RandomIndependent
    from wsnsim.models.synchronisation import Ftsp, NoSync
    from wsnsim.models.tsch import Tsch
    from wsnsim.models.ungm import Squared, Ungm
    from wsnsim.models.wakeup import DirectedFlood, ExperienceZones, NoWakeUp, Region
    from wsnsim.models.waypoints import RandomWaypoint, Waypoints
    from wsnsim.models.workload import Periodic, Tracking
    from wsnsim.models.xmac import XMac

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

CLASSES: Final = {
    "AcousticEnergy": "sensing", "AlwaysOn": "sleep", "Anchors": "deploy", "Appointed": "appointed",
    "AroundTruth": "acquire", "Bearing": "bearing", "Bias": "faults", "Blackout": "faults",
    "BoundedVelocity": "motion", "Central": "clusters", "ClockStep": "faults",
    "CollectionTreeProtocol": "collection", "ConstantAcceleration": "linear", "ConstantVelocity": "linear",
    "ContikiMac": "contikimac", "Coordinate": "linear_sensing", "CoordinatedTurn": "mobility",
    "Crash": "faults", "Csma": "access", "DirectedFlood": "wakeup", "Disk": "links", "Drain": "faults",
    "DriftingClock": "hardware", "DutyCycle": "sleep", "EventWake": "sleep", "ExperienceZones": "wakeup",
    "FirstOrder": "energy", "FirstOrder2002": "energy", "Frames": "hardware", "FromFile": "node_file",
    "FromReadings": "acquire", "Ftsp": "synchronisation", "GaussMarkov": "mobility", "GreedyGeographic": "links",
    "Grid": "deploy", "IdealMac": "access", "ImperfectDetection": "hardware", "JitteredGrid": "deploy",
    "LinkLoss": "faults", "LogNormal": "links", "MinimumEnergy": "links", "MinimumHop": "links",
    "MovingHead": "clusters", "NearestNode": "hardware", "NoPacking": "hardware", "NoSink": "hardware",
    "NoSync": "synchronisation", "NoWakeUp": "wakeup", "PerfectClock": "hardware", "PerfectDetection": "hardware",
    "Periodic": "workload", "PeriodicCollection": "collection", "Processor": "hardware",
    "RandomIndependent": "sleep", "RandomWaypoint": "waypoints", "Range": "ranging", "RangeBearing": "bearing",
    "RangeFromOrigin": "ranging", "RecordedLinks": "recorded_links", "RecordedSensor": "recorded_readings",
    "RecordedTrack": "recorded_track", "Region": "wakeup", "Restart": "faults", "Rssi": "rssi",
    "SeveralSinks": "collection", "Squared": "ungm", "States": "energy", "StrongestSignal": "clusters",
    "Stuck": "faults", "Tdma": "access", "Tracking": "workload", "Tsch": "tsch", "Ungm": "ungm",
    "Uniform": "deploy", "Waypoints": "waypoints", "XMac": "xmac",
}  # fmt: skip
"""The module of each class."""
ALIASES: Final = {
    "AnchorsDeployment": "Anchors", "AppointedClusters": "Appointed", "Beacons": "Periodic",
    "BeaconsWorkload": "Periodic", "BearingSensor": "Bearing", "BiasFault": "Bias", "BlackoutFault": "Blackout",
    "CentralClusters": "Central", "Collection": "PeriodicCollection", "CollectionWorkload": "PeriodicCollection",
    "Contikimac": "ContikiMac", "CoordinateSensor": "Coordinate", "CrashFault": "Crash", "CsmaMac": "Csma",
    "Ctp": "CollectionTreeProtocol", "CtpRouting": "CollectionTreeProtocol", "DiskLink": "Disk",
    "DrainFault": "Drain", "Drift": "DriftingClock", "File": "FromFile", "FileDeployment": "FromFile",
    "FramesPacking": "Frames", "FtspSync": "Ftsp", "GridDeployment": "Grid", "Ideal": "IdealMac",
    "Imperfect": "ImperfectDetection", "Node": "NearestNode", "NodeSink": "NearestNode", "Nodes": "SeveralSinks",
    "NodesSink": "SeveralSinks", "ProcessorCpu": "Processor", "RangeSensor": "Range", "Readings": "FromReadings",
    "ReadingsAcquire": "FromReadings", "RecordedLink": "RecordedLinks", "RegionWakeUp": "Region",
    "RestartFault": "Restart", "Ris": "RandomIndependent", "RisSleep": "RandomIndependent", "RssiSensor": "Rssi",
    "SquaredSensor": "Squared", "StatesEnergy": "States", "StuckFault": "Stuck", "TdmaMac": "Tdma",
    "TrackingWorkload": "Tracking", "TschMac": "Tsch", "UngmMotion": "Ungm", "UniformDeployment": "Uniform",
    "WaypointsMotion": "Waypoints", "Xmac": "XMac",
}  # fmt: skip
"""The class behind each name of a kind."""
__all__ = [
    "AcousticEnergy", "AlwaysOn", "Anchors", "AnchorsDeployment", "Appointed", "AppointedClusters", "AroundTruth",
    "Beacons", "BeaconsWorkload", "Bearing", "BearingSensor", "Bias", "BiasFault", "Blackout", "BlackoutFault",
    "BoundedVelocity", "Central", "CentralClusters", "ClockStep", "Collection", "CollectionTreeProtocol",
    "CollectionWorkload", "ConstantAcceleration", "ConstantVelocity", "ContikiMac", "Contikimac", "Coordinate",
    "CoordinateSensor", "CoordinatedTurn", "Crash", "CrashFault", "Csma", "CsmaMac", "Ctp", "CtpRouting",
    "DirectedFlood", "Disk", "DiskLink", "Drain", "DrainFault", "Drift", "DriftingClock", "DutyCycle", "EventWake",
    "ExperienceZones", "File", "FileDeployment", "FirstOrder", "FirstOrder2002", "Frames", "FramesPacking",
    "FromFile", "FromReadings", "Ftsp", "FtspSync", "GaussMarkov", "GreedyGeographic", "Grid", "GridDeployment",
    "Ideal", "IdealMac", "Imperfect", "ImperfectDetection", "JitteredGrid", "LinkLoss", "LogNormal",
    "MinimumEnergy", "MinimumHop", "MovingHead", "NearestNode", "NoPacking", "NoSink", "NoSync", "NoWakeUp", "Node",
    "NodeSink", "Nodes", "NodesSink", "PerfectClock", "PerfectDetection", "Periodic", "PeriodicCollection",
    "Processor", "ProcessorCpu", "RandomIndependent", "RandomWaypoint", "Range", "RangeBearing", "RangeFromOrigin",
    "RangeSensor", "Readings", "ReadingsAcquire", "RecordedLink", "RecordedLinks", "RecordedSensor",
    "RecordedTrack", "Region", "RegionWakeUp", "Restart", "RestartFault", "Ris", "RisSleep", "Rssi", "RssiSensor",
    "SeveralSinks", "Squared", "SquaredSensor", "States", "StatesEnergy", "StrongestSignal", "Stuck", "StuckFault",
    "Tdma", "TdmaMac", "Tracking", "TrackingWorkload", "Tsch", "TschMac", "Ungm", "UngmMotion", "Uniform",
    "UniformDeployment", "Waypoints", "WaypointsMotion", "XMac", "Xmac",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    own = ALIASES.get(name, name)
    if own not in CLASSES:
        nearest = did_you_mean(name, __all__)
        raise AttributeError(f"module 'wsnsim.models' has no attribute {name!r} ({nearest})")
    return getattr(importlib.import_module(f"wsnsim.models.{CLASSES[own]}"), own)


def __dir__() -> list[str]:
    return list(__all__)
