# ruff: noqa
# fmt: off
# written by `python -m tests.stubs` from wsnsim/scenario/kinds.table
from wsnsim.trackers.bootstrap_pf import CentralPf as CentralPf
from wsnsim.trackers.bootstrap_pf import Pf as Pf
from wsnsim.trackers.covariance_intersection import CovarianceIntersection as CovarianceIntersection
from wsnsim.trackers.covariance_intersection import NaiveFusion as NaiveFusion
from wsnsim.trackers.cuckoo_pf import CuckooPf as CuckooPf
from wsnsim.trackers.cuckoo_pf import ImprovedCuckooPf as ImprovedCuckooPf
from wsnsim.trackers.ekf import ExtendedKalman as ExtendedKalman
from wsnsim.trackers.gaussian_pf import GaussianPf as GaussianPf
from wsnsim.trackers.gaussian_pf import GravitationalGaussianPf as GravitationalGaussianPf
from wsnsim.trackers.gaussian_pf import SwarmGaussianPf as SwarmGaussianPf
from wsnsim.trackers.grid import GridFilter as GridFilter
from wsnsim.trackers.imm import InteractingModels as InteractingModels
from wsnsim.trackers.information_consensus import HybridConsensus as HybridConsensus
from wsnsim.trackers.information_consensus import InformationConsensus as InformationConsensus
from wsnsim.trackers.information_driven import InformationDriven as InformationDriven
from wsnsim.trackers.information_pf import InformationPf as InformationPf
from wsnsim.trackers.mixture_pf import MixturePf as MixturePf
from wsnsim.trackers.multi_target.management import KnownTargets as KnownTargets
from wsnsim.trackers.multi_target.management import MOfN as MOfN
from wsnsim.trackers.multi_target.management import SequentialTest as SequentialTest
from wsnsim.trackers.multi_target.several_gaussians import Lmb as Lmb
from wsnsim.trackers.multi_target.several_gaussians import Mht as Mht
from wsnsim.trackers.multi_target.single_gaussian import Gnn as Gnn
from wsnsim.trackers.multi_target.single_gaussian import Jpda as Jpda
from wsnsim.trackers.multi_target.single_gaussian import LocalNearestNeighbour as LocalNearestNeighbour
from wsnsim.trackers.multi_target.single_gaussian import Pda as Pda
from wsnsim.trackers.neighbour_filters import DiffusionFilter as DiffusionFilter
from wsnsim.trackers.neighbour_filters import KalmanConsensus as KalmanConsensus
from wsnsim.trackers.parallel_pf import ParallelPf as ParallelPf
from wsnsim.trackers.pso_mhpf import PsoMhpf as PsoMhpf
from wsnsim.trackers.range_fixes import AwakeOnly as AwakeOnly
from wsnsim.trackers.range_fixes import GreyTracking as GreyTracking
from wsnsim.trackers.range_fixes import TwoPhase as TwoPhase
from wsnsim.trackers.sensor_chains import InteractingKalman as InteractingKalman
from wsnsim.trackers.sensor_chains import RelayKalman as RelayKalman
from wsnsim.trackers.shared.triggers import Always as Always
from wsnsim.trackers.shared.triggers import Event as Event
from wsnsim.trackers.shared.triggers import PeriodicSending as PeriodicSending
from wsnsim.trackers.shared.triggers import RandomSending as RandomSending
from wsnsim.trackers.shared.triggers import Stochastic as Stochastic
from wsnsim.trackers.sigma_points import CubatureKalman as CubatureKalman
from wsnsim.trackers.sigma_points import UnscentedKalman as UnscentedKalman
from wsnsim.trackers.trilateration import Trilateration as Trilateration

CsPf = CuckooPf
IcsPf = ImprovedCuckooPf
Ekf = ExtendedKalman
Gpf = GaussianPf
GsaGpf = GravitationalGaussianPf
PsoGpf = SwarmGaussianPf
Grid = GridFilter
Imm = InteractingModels
Ipf = InformationPf
Cluster = MixturePf
Known = KnownTargets
KnownManagement = KnownTargets
Sprt = SequentialTest
SprtManagement = SequentialTest
NearestNeighbour = LocalNearestNeighbour
Diffusion = DiffusionFilter
Ppf = ParallelPf
Ris = AwakeOnly
Gmtt = GreyTracking
Tsstp = TwoPhase
Imsf = InteractingKalman
Rkf = RelayKalman
AlwaysTrigger = Always
EventTrigger = Event
Periodic = PeriodicSending
PeriodicTrigger = PeriodicSending
Random = RandomSending
RandomTrigger = RandomSending
StochasticTrigger = Stochastic
Ckf = CubatureKalman
Ukf = UnscentedKalman
