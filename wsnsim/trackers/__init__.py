"""Tracking strategies, one per file, under the names of their kinds and under their own names.

from wsnsim.trackers import PsoMhpf, Ekf        the modules are imported at first use
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wsnsim.base.facades import facade

if TYPE_CHECKING:
    # fmt: off
    # isort: off
    from wsnsim.trackers.bootstrap_pf import CentralPf as CentralPf, Sir as Sir
    from wsnsim.trackers.cuckoo_pf import CuckooPf as CuckooPf, ImprovedCuckooPf as ImprovedCuckooPf
    from wsnsim.trackers.ekf import ExtendedKalman as ExtendedKalman
    from wsnsim.trackers.gaussian_pf import (
        GaussianPf as GaussianPf, GravitationalGaussianPf as GravitationalGaussianPf,
        SwarmGaussianPf as SwarmGaussianPf,
    )
    from wsnsim.trackers.range_fixes import AwakeOnly as AwakeOnly, GreyTracking as GreyTracking, TwoPhase as TwoPhase
    from wsnsim.trackers.grid import GridFilter as GridFilter
    from wsnsim.trackers.imm import InteractingModels as InteractingModels
    from wsnsim.trackers.information_driven import InformationDriven as InformationDriven
    from wsnsim.trackers.information_pf import InformationPf as InformationPf
    from wsnsim.trackers.mixture_pf import MixturePf as MixturePf
    from wsnsim.trackers.parallel_pf import ParallelPf as ParallelPf
    from wsnsim.trackers.pso_mhpf import PsoMhpf as PsoMhpf
    from wsnsim.trackers.sensor_chains import InteractingKalman as InteractingKalman, RelayKalman as RelayKalman
    from wsnsim.trackers.sigma_points import CubatureKalman as CubatureKalman, UnscentedKalman as UnscentedKalman
    from wsnsim.trackers.trilateration import Trilateration as Trilateration

    Ckf = CubatureKalman
    Cluster = MixturePf
    CsPf = CuckooPf
    Ekf = ExtendedKalman
    Gmtt = GreyTracking
    Gpf = GaussianPf
    Grid = GridFilter
    GsaGpf = GravitationalGaussianPf
    IcsPf = ImprovedCuckooPf
    Imm = InteractingModels
    Imsf = InteractingKalman
    Ipf = InformationPf
    Pf = Sir
    Ppf = ParallelPf
    PsoGpf = SwarmGaussianPf
    Ris = AwakeOnly
    Rkf = RelayKalman
    Tsstp = TwoPhase
    Ukf = UnscentedKalman

__getattr__, __dir__ = facade(__name__)
