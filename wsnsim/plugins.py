"""The names that authors of plug-ins need: ports, requests, keyed noise, and what the shipped trackers share.

    from wsnsim.plugins import Flow, GaussianBelief, HeadFilter, gather_readings, predicted, normals

The modules are imported at first use. The names are stable; the modules behind them are not.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

from wsnsim.base.errors import did_you_mean

if TYPE_CHECKING:
    from wsnsim.base.arrays import (
        Bools,
        Floats,
        Ints,
        Keys,
    )
    from wsnsim.base.errors import (
        Issue,
    )
    from wsnsim.base.frames import (
        Burst,
        MacFrame,
        OfferedFrame,
    )
    from wsnsim.base.gathered import (
        Gathered,
    )
    from wsnsim.base.mac_mechanisms import (
        MacServices,
        OnAir,
        Signal,
    )
    from wsnsim.base.medium_access import (
        Mac,
        Packing,
    )
    from wsnsim.base.part import (
        OfRole,
        Quantity,
        part,
    )
    from wsnsim.base.ports import (
        ClusterPolicy,
        Deployment,
        Estimate,
        Innovation,
        MotionModel,
        Recorder,
        Scene,
        SensorModel,
        Tracker,
    )
    from wsnsim.base.radio import (
        Clock,
        Cpu,
        EnergyModel,
        FaultEvent,
        LinkModel,
        Routing,
        Sink,
        Workload,
    )
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
    from wsnsim.base.rng import (
        Streams,
        derive,
        derive_all,
        normals,
        uniforms,
    )
    from wsnsim.base.setups import (
        BeaconSetup,
        NetworkSetup,
        TrackingSetup,
    )
    from wsnsim.base.sleeping import (
        SleepSchedule,
        WakeUp,
    )
    from wsnsim.base.synchronisation import (
        TimeSync,
    )
    from wsnsim.base.vector_readings import (
        near,
        rows,
    )
    from wsnsim.models.access import (
        Framed,
    )
    from wsnsim.models.appointed import (
        Appointed,
    )
    from wsnsim.models.faults import (
        Aimed,
    )
    from wsnsim.models.wakeup import (
        Region,
    )
    from wsnsim.trackers.shared.dealing import (
        send_moments,
    )
    from wsnsim.trackers.shared.heads import (
        CloudBelief,
        GaussianBelief,
        HeadCloud,
        HeadFilter,
        only_predicted,
    )
    from wsnsim.trackers.shared.kalman import (
        KalmanBelief,
        kalman_estimate,
    )
    from wsnsim.trackers.shared.moments import (
        forecast,
        fused_by_variance,
        predicted,
        symmetric,
    )
    from wsnsim.trackers.shared.parcels import (
        moment_packets,
        parcel,
        state_packets,
    )
    from wsnsim.trackers.shared.readings import (
        Evidence,
        gather_readings,
        reading_parcel,
    )

HOMES: Final = {
    "wsnsim.base.arrays": "Bools Floats Ints Keys",
    "wsnsim.base.errors": "Issue",
    "wsnsim.base.frames": "Burst MacFrame OfferedFrame",
    "wsnsim.base.gathered": "Gathered",
    "wsnsim.base.mac_mechanisms": "MacServices OnAir Signal",
    "wsnsim.base.medium_access": "Mac Packing",
    "wsnsim.base.part": "OfRole Quantity part",
    "wsnsim.base.ports": "Estimate Innovation MotionModel Scene SensorModel Tracker Deployment ClusterPolicy Recorder",
    "wsnsim.base.radio": "EnergyModel FaultEvent LinkModel Routing Sink Workload Clock Cpu",
    "wsnsim.base.requests": "PACKET_BITS Broadcast Compute Delivery Flow Gather GatherReadings GatheredReadings"
    " Local Member Parcel Scatter Send",
    "wsnsim.base.rng": "Streams derive derive_all normals uniforms",
    "wsnsim.base.setups": "BeaconSetup NetworkSetup TrackingSetup",
    "wsnsim.base.sleeping": "SleepSchedule WakeUp",
    "wsnsim.base.synchronisation": "TimeSync",
    "wsnsim.base.vector_readings": "near rows",
    "wsnsim.models.access": "Framed",
    "wsnsim.models.appointed": "Appointed",
    "wsnsim.models.faults": "Aimed",
    "wsnsim.models.wakeup": "Region",
    "wsnsim.trackers.shared.dealing": "send_moments",
    "wsnsim.trackers.shared.heads": "CloudBelief GaussianBelief HeadCloud HeadFilter only_predicted",
    "wsnsim.trackers.shared.kalman": "KalmanBelief kalman_estimate",
    "wsnsim.trackers.shared.moments": "forecast fused_by_variance predicted symmetric",
    "wsnsim.trackers.shared.parcels": "moment_packets parcel state_packets",
    "wsnsim.trackers.shared.readings": "Evidence gather_readings reading_parcel",
}
"""The names that each module gives."""
__all__ = [
    "PACKET_BITS",
    "Aimed",
    "Appointed",
    "BeaconSetup",
    "Bools",
    "Broadcast",
    "Burst",
    "Clock",
    "CloudBelief",
    "ClusterPolicy",
    "Compute",
    "Cpu",
    "Delivery",
    "Deployment",
    "EnergyModel",
    "Estimate",
    "Evidence",
    "FaultEvent",
    "Floats",
    "Flow",
    "Framed",
    "Gather",
    "GatherReadings",
    "Gathered",
    "GatheredReadings",
    "GaussianBelief",
    "HeadCloud",
    "HeadFilter",
    "Innovation",
    "Ints",
    "Issue",
    "KalmanBelief",
    "Keys",
    "LinkModel",
    "Local",
    "Mac",
    "MacFrame",
    "MacServices",
    "Member",
    "MotionModel",
    "NetworkSetup",
    "OfRole",
    "OfferedFrame",
    "OnAir",
    "Packing",
    "Parcel",
    "Quantity",
    "Recorder",
    "Region",
    "Routing",
    "Scatter",
    "Scene",
    "Send",
    "SensorModel",
    "Signal",
    "Sink",
    "SleepSchedule",
    "Streams",
    "TimeSync",
    "Tracker",
    "TrackingSetup",
    "WakeUp",
    "Workload",
    "derive",
    "derive_all",
    "forecast",
    "fused_by_variance",
    "gather_readings",
    "kalman_estimate",
    "moment_packets",
    "near",
    "normals",
    "only_predicted",
    "parcel",
    "part",
    "predicted",
    "reading_parcel",
    "rows",
    "send_moments",
    "state_packets",
    "symmetric",
    "uniforms",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    home = next((module for module, names in HOMES.items() if name in names.split()), None)
    if home is None:
        raise AttributeError(f"module 'wsnsim.plugins' has no attribute {name!r} ({did_you_mean(name, __all__)})")
    return getattr(importlib.import_module(home), name)


def __dir__() -> list[str]:
    return list(__all__)
