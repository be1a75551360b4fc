"""What mechanisms of plug-ins may call takes the parameters that its port names."""

import inspect

import pytest

import wsnsim
from wsnsim.base.mac_mechanisms import MacServices
from wsnsim.base.mechanisms import FaultServices, SyncServices, WakeUpServices, WorkloadServices
from wsnsim.network.clusters.wake_up_service import WakeUpService
from wsnsim.network.faults import CHANGES, SiteServices
from wsnsim.network.imperfect_readings import CHANGE_READINGS
from wsnsim.network.mechanisms import LASTING, NetworkSyncServices
from wsnsim.network.radio.mac_services import NetworkMacServices
from wsnsim.network.workload_world import WorkloadNetwork

CRASH = {"faults": [{"kind": "crash", "at": "0.1 s", "fraction": 0.1}]}


@pytest.mark.parametrize(
    ("port", "services", "scenario", "changes"),
    [
        (MacServices, NetworkMacServices, "pso_mhpf_real", {"duration": "0.08 s"}),
        (FaultServices, SiteServices, "pso_mhpf", {"duration": "0.2 s", **CRASH}),
        (SyncServices, NetworkSyncServices, "time_sync", {"duration": "10 s"}),
        (WakeUpServices, WakeUpService, "gmtt", {"duration": "4 s"}),
        (WorkloadServices, WorkloadNetwork, "beacons", {"duration": "1 s"}),
    ],
)
def test_services_take_the_parameters_of_their_port(port, services, scenario, changes, monkeypatch):
    made, begin = [], services.__init__

    def noted(self, *arguments, **named):
        made.append(self)
        begin(self, *arguments, **named)

    monkeypatch.setattr(services, "__init__", noted)
    wsnsim.simulate(scenario, overrides=changes)
    methods = {name: method for name, method in inspect.getmembers(port, inspect.isfunction) if name[0] != "_"}
    wanted = {name: list(inspect.signature(method).parameters)[1:] for name, method in methods.items()}
    assert {name: list(inspect.signature(getattr(made[0], name)).parameters) for name in wanted} == wanted


def test_every_lasting_fault_has_a_change_and_every_change_a_fault():
    assert set(CHANGES) == set(LASTING) and set(LASTING) >= CHANGE_READINGS
