"""The names that authors of plug-ins need: ports, requests, keyed noise, and what the shipped trackers share.

    from wsnsim.plugins import Flow, GaussianBelief, HeadFilter, gather_readings, predicted, normals

The modules are imported at first use. The names are stable; the modules behind them are not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wsnsim.base.facades import facade

if TYPE_CHECKING:
    # fmt: off
    # isort: off
    from wsnsim.base.arrays import (
        Bools as Bools, Estimate as Estimate, Floats as Floats, Innovation as Innovation, Ints as Ints, Keys as Keys,
        near as near, rows as rows,
    )
    from wsnsim.base.batteries import (
        Advance as Advance, Battery as Battery, BatteryState as BatteryState, Income as Income,
    )
    from wsnsim.base.detections import Management as Management, MultiTracker as MultiTracker
    from wsnsim.base.errors import Issue as Issue
    from wsnsim.base.frames import Burst as Burst, MacFrame as MacFrame, OfferedFrame as OfferedFrame
    from wsnsim.base.initial_conditions import (
        BlockEstimates as BlockEstimates, StandaloneBlock as StandaloneBlock, StandaloneRun as StandaloneRun,
        WholeRuns as WholeRuns,
    )
    from wsnsim.base.mac_mechanisms import (
        ExpectsMembers as ExpectsMembers, FollowsRestarts as FollowsRestarts, Fragmenter as Fragmenter,
        KeepsIdleSlots as KeepsIdleSlots, Listening as Listening, MacMechanism as MacMechanism,
        MacServices as MacServices, OnAir as OnAir, SharedChannel as SharedChannel, Signal as Signal,
        StartsMac as StartsMac, UsesShortInterval as UsesShortInterval,
    )
    from wsnsim.base.mechanisms import (
        FaultMechanism as FaultMechanism, FaultServices as FaultServices, NodeServices as NodeServices,
        SensorDefect as SensorDefect, StartsFault as StartsFault, StartsSync as StartsSync,
        StartsWakeUp as StartsWakeUp, StartsWorkload as StartsWorkload, SyncMechanism as SyncMechanism,
        SyncServices as SyncServices, TimeSync as TimeSync, WakeUpMechanism as WakeUpMechanism,
        WakeUpServices as WakeUpServices, WorkloadMechanism as WorkloadMechanism, WorkloadServices as WorkloadServices,
    )
    from wsnsim.base.medium_access import (
        DutyCycledMac as DutyCycledMac, FramedMac as FramedMac, GivesTurns as GivesTurns, KnowsLatency as KnowsLatency,
        Latency as Latency, Mac as Mac, Packing as Packing, RadioDuty as RadioDuty, SwitchesRadio as SwitchesRadio,
    )
    from wsnsim.base.network_ports import (
        AppointingPolicy as AppointingPolicy, Appointment as Appointment, ClusterPolicy as ClusterPolicy,
        Deployment as Deployment, FaultEvent as FaultEvent, Field as Field, HasSeveralSinks as HasSeveralSinks,
        MovingPolicy as MovingPolicy, NearNodes as NearNodes, Outlook as Outlook, Routing as Routing,
        SeesGeometry as SeesGeometry, Sink as Sink, Workload as Workload,
    )
    from wsnsim.base.optional_ports import (
        Announces as Announces, ConstantGaussian as ConstantGaussian, Continuous as Continuous, Detects as Detects,
        FewReadings as FewReadings, ForecastsSuccession as ForecastsSuccession, Foresees as Foresees,
        HasHeights as HasHeights, Informs as Informs, IsShadowed as IsShadowed, LimitsReadings as LimitsReadings,
        LinearGaussian as LinearGaussian, MeasuresEnergy as MeasuresEnergy, MovesInSpace as MovesInSpace,
        NamesNodes as NamesNodes, Portable as Portable, Ranks as Ranks, RecordedFile as RecordedFile,
        Recording as Recording, RelativeReadings as RelativeReadings, Replays as Replays, ReportsState as ReportsState,
        Snapshots as Snapshots, VectorReadings as VectorReadings,
    )
    from wsnsim.base.part import OfRole as OfRole, part as part, Quantity as Quantity
    from wsnsim.base.ports import (
        Acquire as Acquire, Detection as Detection, HeadlessTracker as HeadlessTracker, KnownNodes as KnownNodes,
        MotionModel as MotionModel, PriorModel as PriorModel, Scene as Scene, SensorModel as SensorModel,
        Tracker as Tracker,
    )
    from wsnsim.base.quiet import (
        Hearing as Hearing, KnowsLongRun as KnowsLongRun, RadioUse as RadioUse, SendsUpkeep as SendsUpkeep,
        SentFrames as SentFrames, Upkeep as Upkeep, UsesRadios as UsesRadios,
    )
    from wsnsim.base.radio import (
        BurstyLosses as BurstyLosses, Clock as Clock, ContinuousPower as ContinuousPower, Cpu as Cpu,
        EnergyModel as EnergyModel, HeardLinks as HeardLinks, LinkModel as LinkModel, Mode as Mode,
        ModePower as ModePower, RecordsLinks as RecordsLinks, StartsWithOffsets as StartsWithOffsets,
    )
    from wsnsim.base.requests import (
        Broadcast as Broadcast, Compute as Compute, Delivery as Delivery, Exchange as Exchange, Flow as Flow,
        Gather as Gather, Gathered as Gathered, GatheredReadings as GatheredReadings, GatherLate as GatherLate,
        GatherReadings as GatherReadings,
        Local as Local, Member as Member, PACKET_BITS as PACKET_BITS, Parcel as Parcel, Scatter as Scatter,
        Send as Send,
    )
    from wsnsim.base.rng import (
        derive as derive, derive_all as derive_all, normals as normals, Streams as Streams, uniforms as uniforms,
    )
    from wsnsim.base.scans import (
        Facts as Facts, Scan as Scan, ScanOutcome as ScanOutcome, TrackEstimate as TrackEstimate,
        TrackEvent as TrackEvent,
    )
    from wsnsim.base.setups import (
        BeaconSetup as BeaconSetup, NetworkSetup as NetworkSetup, RadioSetup as RadioSetup, Setup as Setup,
        TrackingSetup as TrackingSetup,
    )
    from wsnsim.base.sleeping import (
        Decision as Decision, SleepSchedule as SleepSchedule, WakeUp as WakeUp, WakeUpMessage as WakeUpMessage,
        WakeUpPlan as WakeUpPlan, WakeUpRadio as WakeUpRadio, WakeUpRound as WakeUpRound,
    )
    from wsnsim.base.tables import Recorder as Recorder, Words as Words
    from wsnsim.models.access import Framed as Framed
    from wsnsim.models.appointed import Appointed as Appointed
    from wsnsim.models.batteries import BatteryFields as BatteryFields
    from wsnsim.models.csvfile import demand_digest as demand_digest
    from wsnsim.models.faults import Aimed as Aimed
    from wsnsim.models.wakeup import Region as Region
    from wsnsim.trackers.shared.dealing import Arrival as Arrival, Pool as Pool, send_moments as send_moments
    from wsnsim.trackers.shared.heads import (
        CloudBelief as CloudBelief, GaussianBelief as GaussianBelief, HeadCloud as HeadCloud, HeadFilter as HeadFilter,
        only_predicted as only_predicted, Prediction as Prediction,
    )
    from wsnsim.trackers.shared.moments import (
        forecast as forecast, fused_by_variance as fused_by_variance, predicted as predicted, symmetric as symmetric,
    )
    from wsnsim.trackers.shared.peers import PeerFilter as PeerFilter
    from wsnsim.trackers.shared.readings import (
        Evidence as Evidence, gather_readings as gather_readings, moment_packets as moment_packets, parcel as parcel,
        reading_parcel as reading_parcel, state_packets as state_packets,
    )

__getattr__, __dir__ = facade(__name__)
