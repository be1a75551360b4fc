"""The names that authors of plug-ins need: ports, requests, keyed noise, and what the shipped trackers share.

    from wsnsim.plugins import Flow, GaussianBelief, HeadFilter, gather_readings, predicted, normals

The modules are imported at first use. The names are stable; the modules behind them are not.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

from wsnsim.base.errors import did_you_mean

if TYPE_CHECKING:
    from wsnsim.base.arrays import Bools, Floats, Ints, Keys
    from wsnsim.base.clustering import AppointingPolicy, ClusterPolicy, MovingPolicy, SeesGeometry
    from wsnsim.base.deployment import Deployment, Field
    from wsnsim.base.errors import Issue
    from wsnsim.base.estimate import Estimate, Innovation
    from wsnsim.base.faults import FaultEvent
    from wsnsim.base.frames import Burst, MacFrame, OfferedFrame
    from wsnsim.base.gathered import Gathered
    from wsnsim.base.mac_mechanisms import (
        ExpectsMembers,
        FollowsRestarts,
        Fragmenter,
        KeepsIdleSlots,
        Listening,
        MacMechanism,
        MacServices,
        OnAir,
        SharedChannel,
        Signal,
        StartsMac,
        UsesShortInterval,
    )
    from wsnsim.base.mechanisms import (
        FaultMechanism,
        FaultServices,
        NodeServices,
        SensorDefect,
        StartsFault,
        StartsWakeUp,
        StartsWorkload,
        WakeUpMechanism,
        WakeUpServices,
        WorkloadMechanism,
        WorkloadServices,
    )
    from wsnsim.base.medium_access import FramedMac, Mac, Packing
    from wsnsim.base.optional_ports import (
        Announces,
        ConstantGaussian,
        Continuous,
        Detects,
        Drifts,
        ForecastsSuccession,
        Foresees,
        HasHeights,
        Informs,
        IsShadowed,
        LimitsReadings,
        LinearGaussian,
        MeasuresEnergy,
        MovesInSpace,
        NamesNodes,
        Portable,
        Ranks,
        RecordedFile,
        Recording,
        Replays,
        ReportsState,
        Snapshots,
        VectorReadings,
    )
    from wsnsim.base.outlook import Appointment, NearNodes, Outlook
    from wsnsim.base.part import OfRole, Quantity, part
    from wsnsim.base.ports import Acquire, Detection, KnownNodes, MotionModel, PriorModel, Scene, SensorModel, Tracker
    from wsnsim.base.radio import (
        Clock,
        ContinuousPower,
        Cpu,
        EnergyModel,
        LinkModel,
        Mode,
        ModePower,
        StartsWithOffsets,
    )
    from wsnsim.base.radio_duty import DutyCycledMac, GivesTurns, KnowsLatency, Latency, RadioDuty, SwitchesRadio
    from wsnsim.base.recorded_links import BurstyLosses, HeardLinks, RecordsLinks
    from wsnsim.base.recorders import Recorder, Words
    from wsnsim.base.requests import (
        PACKET_BITS,
        Broadcast,
        Compute,
        Delivery,
        Flow,
        Gather,
        GatheredReadings,
        GatherReadings,
        Local,
        Member,
        Parcel,
        Scatter,
        Send,
    )
    from wsnsim.base.rng import Streams, derive, derive_all, normals, uniforms
    from wsnsim.base.routing import Routing
    from wsnsim.base.setups import BeaconSetup, NetworkSetup, RadioSetup, Setup, TrackingSetup
    from wsnsim.base.sleeping import (
        Decision,
        SleepSchedule,
        WakeUp,
        WakeUpMessage,
        WakeUpPlan,
        WakeUpRadio,
        WakeUpRound,
    )
    from wsnsim.base.standalone import BlockEstimates, StandaloneBlock, StandaloneRun, WholeRuns
    from wsnsim.base.synchronisation import StartsSync, SyncMechanism, SyncServices, TimeSync
    from wsnsim.base.vector_readings import near, rows
    from wsnsim.base.workloads import HasSeveralSinks, Sink, Workload
    from wsnsim.models.access import Framed
    from wsnsim.models.appointed import Appointed
    from wsnsim.models.csvfile import demand_digest
    from wsnsim.models.faults import Aimed
    from wsnsim.models.wakeup import Region
    from wsnsim.trackers.shared.dealing import Arrival, Pool, send_moments
    from wsnsim.trackers.shared.heads import (
        CloudBelief,
        GaussianBelief,
        HeadCloud,
        HeadFilter,
        Prediction,
        only_predicted,
    )
    from wsnsim.trackers.shared.kalman import KalmanBelief, kalman_estimate
    from wsnsim.trackers.shared.moments import forecast, fused_by_variance, predicted, symmetric
    from wsnsim.trackers.shared.parcels import moment_packets, parcel, state_packets
    from wsnsim.trackers.shared.readings import Evidence, gather_readings, reading_parcel

HOMES: Final = {
    "wsnsim.base.arrays": "Bools Floats Ints Keys",
    "wsnsim.base.clustering": "AppointingPolicy ClusterPolicy MovingPolicy SeesGeometry",
    "wsnsim.base.deployment": "Deployment Field",
    "wsnsim.base.errors": "Issue",
    "wsnsim.base.estimate": "Estimate Innovation",
    "wsnsim.base.faults": "FaultEvent",
    "wsnsim.base.frames": "Burst MacFrame OfferedFrame",
    "wsnsim.base.gathered": "Gathered",
    "wsnsim.base.mac_mechanisms": "ExpectsMembers FollowsRestarts Fragmenter KeepsIdleSlots Listening MacMechanism "
    "MacServices OnAir SharedChannel Signal StartsMac UsesShortInterval",
    "wsnsim.base.mechanisms": "FaultMechanism FaultServices NodeServices SensorDefect StartsFault StartsWakeUp "
    "StartsWorkload WakeUpMechanism WakeUpServices WorkloadMechanism WorkloadServices",
    "wsnsim.base.medium_access": "FramedMac Mac Packing",
    "wsnsim.base.optional_ports": "Announces ConstantGaussian Continuous Detects Drifts ForecastsSuccession "
    "Foresees HasHeights Informs IsShadowed LimitsReadings LinearGaussian "
    "MeasuresEnergy MovesInSpace NamesNodes Portable Ranks RecordedFile "
    "Recording Replays ReportsState Snapshots VectorReadings",
    "wsnsim.base.outlook": "Appointment NearNodes Outlook",
    "wsnsim.base.part": "OfRole Quantity part",
    "wsnsim.base.ports": "Acquire Detection KnownNodes MotionModel PriorModel Scene SensorModel Tracker",
    "wsnsim.base.radio": "Clock ContinuousPower Cpu EnergyModel LinkModel Mode ModePower StartsWithOffsets",
    "wsnsim.base.radio_duty": "DutyCycledMac GivesTurns KnowsLatency Latency RadioDuty SwitchesRadio",
    "wsnsim.base.recorded_links": "BurstyLosses HeardLinks RecordsLinks",
    "wsnsim.base.recorders": "Recorder Words",
    "wsnsim.base.requests": "PACKET_BITS Broadcast Compute Delivery Flow Gather GatherReadings "
    "GatheredReadings Local Member Parcel Scatter Send",
    "wsnsim.base.rng": "Streams derive derive_all normals uniforms",
    "wsnsim.base.routing": "Routing",
    "wsnsim.base.setups": "BeaconSetup NetworkSetup RadioSetup Setup TrackingSetup",
    "wsnsim.base.sleeping": "Decision SleepSchedule WakeUp WakeUpMessage WakeUpPlan WakeUpRadio WakeUpRound",
    "wsnsim.base.standalone": "BlockEstimates StandaloneBlock StandaloneRun WholeRuns",
    "wsnsim.base.synchronisation": "StartsSync SyncMechanism SyncServices TimeSync",
    "wsnsim.base.vector_readings": "near rows",
    "wsnsim.base.workloads": "HasSeveralSinks Sink Workload",
    "wsnsim.models.access": "Framed",
    "wsnsim.models.appointed": "Appointed",
    "wsnsim.models.csvfile": "demand_digest",
    "wsnsim.models.faults": "Aimed",
    "wsnsim.models.wakeup": "Region",
    "wsnsim.trackers.shared.dealing": "Arrival Pool send_moments",
    "wsnsim.trackers.shared.heads": "CloudBelief GaussianBelief HeadCloud HeadFilter Prediction only_predicted",
    "wsnsim.trackers.shared.kalman": "KalmanBelief kalman_estimate",
    "wsnsim.trackers.shared.moments": "forecast fused_by_variance predicted symmetric",
    "wsnsim.trackers.shared.parcels": "moment_packets parcel state_packets",
    "wsnsim.trackers.shared.readings": "Evidence gather_readings reading_parcel",
}
"""The names that each module gives."""
__all__ = [
    "PACKET_BITS", "Acquire", "Aimed", "Announces", "Appointed", "AppointingPolicy", "Appointment", "Arrival",
    "BeaconSetup", "BlockEstimates", "Bools", "Broadcast", "Burst", "BurstyLosses", "Clock", "CloudBelief",
    "ClusterPolicy", "Compute", "ConstantGaussian", "Continuous", "ContinuousPower", "Cpu", "Decision",
    "Delivery", "Deployment", "Detection", "Detects", "Drifts", "DutyCycledMac", "EnergyModel", "Estimate",
    "Evidence", "ExpectsMembers", "FaultEvent", "FaultMechanism", "FaultServices", "Field", "Floats", "Flow",
    "FollowsRestarts", "ForecastsSuccession", "Foresees", "Fragmenter", "Framed", "FramedMac", "Gather",
    "GatherReadings", "Gathered", "GatheredReadings", "GaussianBelief", "GivesTurns", "HasHeights", "HasSeveralSinks",
    "HeadCloud", "HeadFilter", "HeardLinks", "Informs", "Innovation", "Ints", "IsShadowed",
    "Issue", "KalmanBelief", "KeepsIdleSlots", "Keys", "KnownNodes", "KnowsLatency", "Latency", "LimitsReadings",
    "LinearGaussian", "LinkModel", "Listening", "Local", "Mac", "MacFrame", "MacMechanism", "MacServices",
    "MeasuresEnergy", "Member", "Mode", "ModePower", "MotionModel", "MovesInSpace", "MovingPolicy",
    "NamesNodes", "NearNodes", "NetworkSetup", "NodeServices", "OfRole", "OfferedFrame", "OnAir", "Outlook", "Packing",
    "Parcel", "Pool", "Portable", "Prediction", "PriorModel", "Quantity", "RadioDuty", "RadioSetup", "Ranks",
    "RecordedFile", "Recorder", "Recording", "RecordsLinks", "Region", "Replays", "ReportsState", "Routing",
    "Scatter", "Scene", "SeesGeometry", "Send", "SensorDefect", "SensorModel", "Setup", "SharedChannel",
    "Signal", "Sink", "SleepSchedule", "Snapshots", "StandaloneBlock", "StandaloneRun", "StartsFault",
    "StartsMac", "StartsSync", "StartsWakeUp", "StartsWithOffsets", "StartsWorkload", "Streams",
    "SwitchesRadio", "SyncMechanism", "SyncServices", "TimeSync", "Tracker", "TrackingSetup", "UsesShortInterval",
    "VectorReadings", "WakeUp", "WakeUpMechanism", "WakeUpMessage", "WakeUpPlan", "WakeUpRadio", "WakeUpRound",
    "WakeUpServices", "WholeRuns", "Words", "Workload", "WorkloadMechanism", "WorkloadServices", "demand_digest",
    "derive", "derive_all", "forecast", "fused_by_variance", "gather_readings", "kalman_estimate", "moment_packets",
    "near", "normals", "only_predicted", "parcel", "part", "predicted", "reading_parcel", "rows",
    "send_moments", "state_packets", "symmetric", "uniforms",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    home = next((module for module, names in HOMES.items() if name in names.split()), None)
    if home is None:
        raise AttributeError(f"module 'wsnsim.plugins' has no attribute {name!r} ({did_you_mean(name, __all__)})")
    return getattr(importlib.import_module(home), name)


def __dir__() -> list[str]:
    return list(__all__)
