# ruff: noqa
# fmt: off
# written by `python -m tests.stubs` from wsnsim/scenario/kinds.table
from wsnsim.models.access import Csma as Csma
from wsnsim.models.access import IdealMac as IdealMac
from wsnsim.models.access import Tdma as Tdma
from wsnsim.models.acquire import AroundTruth as AroundTruth
from wsnsim.models.acquire import FromReadings as FromReadings
from wsnsim.models.appointed import Appointed as Appointed
from wsnsim.models.batteries import Diffusion as Diffusion
from wsnsim.models.batteries import Kinetic as Kinetic
from wsnsim.models.batteries import Linear as Linear
from wsnsim.models.bearing import Bearing as Bearing
from wsnsim.models.bearing import RangeBearing as RangeBearing
from wsnsim.models.clusters import Central as Central
from wsnsim.models.clusters import MovingHead as MovingHead
from wsnsim.models.clusters import NoHead as NoHead
from wsnsim.models.clusters import StrongestSignal as StrongestSignal
from wsnsim.models.deploy import Anchors as Anchors
from wsnsim.models.deploy import Grid as Grid
from wsnsim.models.deploy import JitteredGrid as JitteredGrid
from wsnsim.models.deploy import Uniform as Uniform
from wsnsim.models.energy import FirstOrder as FirstOrder
from wsnsim.models.energy import FirstOrder2002 as FirstOrder2002
from wsnsim.models.energy import States as States
from wsnsim.models.faults import Bias as Bias
from wsnsim.models.faults import Blackout as Blackout
from wsnsim.models.faults import ClockStep as ClockStep
from wsnsim.models.faults import Crash as Crash
from wsnsim.models.faults import Drain as Drain
from wsnsim.models.faults import LinkLoss as LinkLoss
from wsnsim.models.faults import Restart as Restart
from wsnsim.models.faults import Stuck as Stuck
from wsnsim.models.hardware import DriftingClock as DriftingClock
from wsnsim.models.hardware import Frames as Frames
from wsnsim.models.hardware import Ftsp as Ftsp
from wsnsim.models.hardware import ImperfectDetection as ImperfectDetection
from wsnsim.models.hardware import NoPacking as NoPacking
from wsnsim.models.hardware import NoSync as NoSync
from wsnsim.models.hardware import PerfectClock as PerfectClock
from wsnsim.models.hardware import PerfectDetection as PerfectDetection
from wsnsim.models.hardware import Processor as Processor
from wsnsim.models.hardware import UnlabelledDetection as UnlabelledDetection
from wsnsim.models.linear import ConstantAcceleration as ConstantAcceleration
from wsnsim.models.linear import ConstantVelocity as ConstantVelocity
from wsnsim.models.links import Disk as Disk
from wsnsim.models.links import GreedyGeographic as GreedyGeographic
from wsnsim.models.links import LogNormal as LogNormal
from wsnsim.models.links import MinimumEnergy as MinimumEnergy
from wsnsim.models.links import MinimumHop as MinimumHop
from wsnsim.models.low_power_listening import ContikiMac as ContikiMac
from wsnsim.models.low_power_listening import XMac as XMac
from wsnsim.models.mobility import CoordinatedTurn as CoordinatedTurn
from wsnsim.models.mobility import GaussMarkov as GaussMarkov
from wsnsim.models.motion import BoundedVelocity as BoundedVelocity
from wsnsim.models.node_file import FromFile as FromFile
from wsnsim.models.quantised import Binary as Binary
from wsnsim.models.quantised import Quantised as Quantised
from wsnsim.models.ranging import Range as Range
from wsnsim.models.ranging import RangeFromOrigin as RangeFromOrigin
from wsnsim.models.ranging import Rssi as Rssi
from wsnsim.models.ranging import TimeDifference as TimeDifference
from wsnsim.models.recorded_links import RecordedLinks as RecordedLinks
from wsnsim.models.recorded_readings import RecordedSensor as RecordedSensor
from wsnsim.models.recorded_track import RecordedTrack as RecordedTrack
from wsnsim.models.sensing import AcousticEnergy as AcousticEnergy
from wsnsim.models.sensing import Coordinate as Coordinate
from wsnsim.models.sleep import AlwaysOn as AlwaysOn
from wsnsim.models.sleep import DutyCycle as DutyCycle
from wsnsim.models.sleep import EventWake as EventWake
from wsnsim.models.sleep import RandomIndependent as RandomIndependent
from wsnsim.models.tsch import Tsch as Tsch
from wsnsim.models.ungm import Squared as Squared
from wsnsim.models.ungm import Ungm as Ungm
from wsnsim.models.visits import Crossing as Crossing
from wsnsim.models.visits import Visits as Visits
from wsnsim.models.wakeup import DirectedFlood as DirectedFlood
from wsnsim.models.wakeup import ExperienceZones as ExperienceZones
from wsnsim.models.wakeup import NoWakeUp as NoWakeUp
from wsnsim.models.wakeup import Region as Region
from wsnsim.models.waypoints import RandomWaypoint as RandomWaypoint
from wsnsim.models.waypoints import Waypoints as Waypoints
from wsnsim.models.workloads import CollectionTreeProtocol as CollectionTreeProtocol
from wsnsim.models.workloads import NearestNode as NearestNode
from wsnsim.models.workloads import NoSink as NoSink
from wsnsim.models.workloads import Periodic as Periodic
from wsnsim.models.workloads import PeriodicCollection as PeriodicCollection
from wsnsim.models.workloads import SeveralSinks as SeveralSinks
from wsnsim.models.workloads import Tracking as Tracking

CsmaMac = Csma
Ideal = IdealMac
TdmaMac = Tdma
Readings = FromReadings
ReadingsAcquire = FromReadings
AppointedClusters = Appointed
DiffusionBattery = Diffusion
KineticBattery = Kinetic
LinearBattery = Linear
BearingSensor = Bearing
CentralClusters = Central
AnchorsDeployment = Anchors
GridDeployment = Grid
UniformDeployment = Uniform
StatesEnergy = States
BiasFault = Bias
BlackoutFault = Blackout
CrashFault = Crash
DrainFault = Drain
RestartFault = Restart
StuckFault = Stuck
Drift = DriftingClock
FramesPacking = Frames
FtspSync = Ftsp
Imperfect = ImperfectDetection
ProcessorCpu = Processor
Unlabelled = UnlabelledDetection
DiskLink = Disk
Contikimac = ContikiMac
Xmac = XMac
File = FromFile
FileDeployment = FromFile
BinarySensor = Binary
QuantisedSensor = Quantised
RangeSensor = Range
RssiSensor = Rssi
Tdoa = TimeDifference
TdoaSensor = TimeDifference
RecordedLink = RecordedLinks
CoordinateSensor = Coordinate
Ris = RandomIndependent
RisSleep = RandomIndependent
TschMac = Tsch
SquaredSensor = Squared
UngmMotion = Ungm
CrossingMotion = Crossing
VisitsMotion = Visits
RegionWakeUp = Region
WaypointsMotion = Waypoints
Ctp = CollectionTreeProtocol
CtpRouting = CollectionTreeProtocol
Node = NearestNode
NodeSink = NearestNode
Beacons = Periodic
BeaconsWorkload = Periodic
Collection = PeriodicCollection
CollectionWorkload = PeriodicCollection
Nodes = SeveralSinks
NodesSink = SeveralSinks
TrackingWorkload = Tracking
