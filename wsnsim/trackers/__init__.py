"""Tracking strategies, one per file, under the names of their kinds and under their own names.

from wsnsim.trackers import PsoMhpf, Ekf        the modules are imported at first use
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

from wsnsim.base.errors import did_you_mean

if TYPE_CHECKING:
    from wsnsim.trackers.awake_only import AwakeOnly
    from wsnsim.trackers.centralised import CentralPf
    from wsnsim.trackers.ckf import CubatureKalman
    from wsnsim.trackers.cuckoo_pf import CuckooPf, ImprovedCuckooPf
    from wsnsim.trackers.ekf import ExtendedKalman
    from wsnsim.trackers.gaussian_pf import GaussianPf, GravitationalGaussianPf, SwarmGaussianPf
    from wsnsim.trackers.grey import GreyTracking
    from wsnsim.trackers.grid import GridFilter
    from wsnsim.trackers.imm import InteractingModels
    from wsnsim.trackers.information_driven import InformationDriven
    from wsnsim.trackers.information_pf import InformationPf
    from wsnsim.trackers.interacting_kalman import InteractingKalman
    from wsnsim.trackers.markov import TwoPhase
    from wsnsim.trackers.mixture_pf import MixturePf
    from wsnsim.trackers.parallel_pf import ParallelPf
    from wsnsim.trackers.pso_mhpf import PsoMhpf
    from wsnsim.trackers.relay_kalman import RelayKalman
    from wsnsim.trackers.sir import Sir
    from wsnsim.trackers.trilateration import Trilateration
    from wsnsim.trackers.ukf import UnscentedKalman

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

CLASSES: Final = {
    "AwakeOnly": "awake_only", "CentralPf": "centralised", "CubatureKalman": "ckf", "CuckooPf": "cuckoo_pf",
    "ExtendedKalman": "ekf", "GaussianPf": "gaussian_pf", "GravitationalGaussianPf": "gaussian_pf",
    "GreyTracking": "grey", "GridFilter": "grid", "ImprovedCuckooPf": "cuckoo_pf",
    "InformationDriven": "information_driven", "InformationPf": "information_pf",
    "InteractingKalman": "interacting_kalman", "InteractingModels": "imm", "MixturePf": "mixture_pf",
    "ParallelPf": "parallel_pf", "PsoMhpf": "pso_mhpf", "RelayKalman": "relay_kalman", "Sir": "sir",
    "SwarmGaussianPf": "gaussian_pf", "Trilateration": "trilateration", "TwoPhase": "markov",
    "UnscentedKalman": "ukf",
}  # fmt: skip
"""The module of each class."""
ALIASES: Final = {
    "Ckf": "CubatureKalman", "Cluster": "MixturePf", "CsPf": "CuckooPf", "Ekf": "ExtendedKalman",
    "Gmtt": "GreyTracking", "Gpf": "GaussianPf", "Grid": "GridFilter", "GsaGpf": "GravitationalGaussianPf",
    "IcsPf": "ImprovedCuckooPf", "Imm": "InteractingModels", "Imsf": "InteractingKalman", "Ipf": "InformationPf",
    "Pf": "Sir", "Ppf": "ParallelPf", "PsoGpf": "SwarmGaussianPf", "Ris": "AwakeOnly", "Rkf": "RelayKalman",
    "Tsstp": "TwoPhase", "Ukf": "UnscentedKalman",
}  # fmt: skip
"""The class behind each name of a kind."""
__all__ = [
    "AwakeOnly", "CentralPf", "Ckf", "Cluster", "CsPf", "CubatureKalman", "CuckooPf", "Ekf", "ExtendedKalman",
    "GaussianPf", "Gmtt", "Gpf", "GravitationalGaussianPf", "GreyTracking", "Grid", "GridFilter", "GsaGpf", "IcsPf",
    "Imm", "ImprovedCuckooPf", "Imsf", "InformationDriven", "InformationPf", "InteractingKalman",
    "InteractingModels", "Ipf", "MixturePf", "ParallelPf", "Pf", "Ppf", "PsoGpf", "PsoMhpf", "RelayKalman", "Ris",
    "Rkf", "Sir", "SwarmGaussianPf", "Trilateration", "Tsstp", "TwoPhase", "Ukf", "UnscentedKalman",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    own = ALIASES.get(name, name)
    if own not in CLASSES:
        nearest = did_you_mean(name, __all__)
        raise AttributeError(f"module 'wsnsim.trackers' has no attribute {name!r} ({nearest})")
    return getattr(importlib.import_module(f"wsnsim.trackers.{CLASSES[own]}"), own)


def __dir__() -> list[str]:
    return list(__all__)
