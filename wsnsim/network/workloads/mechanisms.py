"""The mechanisms of workloads without targets: a plug-in's own, or a built-in one by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from wsnsim.base.mechanisms import StartsWorkload, WorkloadMechanism, WorkloadServices
from wsnsim.base.network_ports import Workload
from wsnsim.network.mechanisms import make_mechanism
from wsnsim.network.workloads.beacons import Beacons
from wsnsim.network.workloads.collection_reports import CollectionReports

MECHANISMS: Final[Mapping[str, Callable[[Any, WorkloadServices], WorkloadMechanism]]] = {
    "beacons": Beacons,
    "collection": CollectionReports,
}
"""The built-in mechanisms by name. The workload 'tracking' has targets: see `world`."""


def make_workload(component: Workload, services: WorkloadServices) -> WorkloadMechanism:
    """The mechanism of a component: its own, or the built-in one that it names.

    Raises:
        RunError: there is neither.
    """
    return make_mechanism("workload", component, services, StartsWorkload, ("begin",), MECHANISMS, "tracking")
