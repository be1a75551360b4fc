"""Every battery, wake-up, workload and time synchronisation of the catalogue keeps the contract of plug-ins."""

from __future__ import annotations

import pytest

from wsnsim.scenario.registry import ROLES, load_class
from wsnsim.testing import check_battery, check_sync, check_wakeup, check_workload

CHECKS = {"battery": check_battery, "sync": check_sync, "wakeup": check_wakeup, "workload": check_workload}


CATALOGUE = [(role, kind) for role in CHECKS for kind in ROLES[role].kinds]


@pytest.mark.thorough(
    fast=[
        "battery-linear",
        "battery-kinetic",
        "battery-diffusion",
        "sync-none",
        "wakeup-none",
        "wakeup-region",
        "workload-tracking",
    ]
)
@pytest.mark.parametrize(("role", "kind"), CATALOGUE, ids=[f"{role}-{kind.kind}" for role, kind in CATALOGUE])
def test_each_kind_of_the_catalogue_passes_the_shipped_check(role, kind):
    CHECKS[role](load_class(kind)())
